"""A linear body condensed to the compliance of its contact surface."""
