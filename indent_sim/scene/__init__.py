"""Config -> Scene: every decision with its reason."""
