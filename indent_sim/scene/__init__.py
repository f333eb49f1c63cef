"""Decisions of the program: from a Config to a Scene, with the reason for each decision."""
