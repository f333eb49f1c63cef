"""Solvers of load paths that are not solved row by row on a mesh."""
