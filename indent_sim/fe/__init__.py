"""Finite-element solution of a scene: the only package that imports dolfinx and petsc4py."""
