"""Evaluation of a solution: contact radius, pressure, penetration, surface table and fields."""
