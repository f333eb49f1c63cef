"""Version of the program, written to results and printed by `--version`."""

VERSION = "1.0.0"
