"""Model selection: effects on the force that a model may neglect, and the simplest model."""
