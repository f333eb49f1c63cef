"""The version of this program, as results and `--version` name it."""

VERSION = "0.1.0"
