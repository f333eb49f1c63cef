"""Walks along a load path that is not solved row by row on a mesh."""
