"""Static condensation: a linear body condensed to the compliance of its contact surface."""
