"""Scene files and the Config that they describe, with all checks."""
