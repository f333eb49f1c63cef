"""What a curve says of a model: estimates, their noise, and whether the model is right."""
