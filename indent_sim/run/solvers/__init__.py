"""Solvers of the rows of a run, and of load paths that are not solved on a mesh."""
