"""What the frictionless curve of a linear body determines, adhesion and rate, without another solution."""
