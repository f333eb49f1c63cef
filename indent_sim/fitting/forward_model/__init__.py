"""A scene as a function of depth, time and the values of its parameters."""
