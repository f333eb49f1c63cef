"""Load path: load stepping, step size control, load control, pull-off and failed increments."""
