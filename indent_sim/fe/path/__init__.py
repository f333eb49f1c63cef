"""The load path: steps, cutbacks, load control and its failures."""
