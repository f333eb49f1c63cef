"""Parameter estimation from a curve: fits, noise, intervals, and the adequacy of the model."""
