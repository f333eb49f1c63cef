"""What a scene requires: the effects that a model may leave out, and the cheapest model."""
