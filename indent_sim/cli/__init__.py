"""Command-line interface, and its commands as Python functions."""
