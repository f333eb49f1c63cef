"""Forward model: the force of a scene over depth and time for any values of its parameters."""
