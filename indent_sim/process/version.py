"""Version of the program, written to results and printed by `--version`."""

VERSION = "0.1.0"
