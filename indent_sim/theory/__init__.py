"""Closed forms and semi-analytic solutions for comparison with simulations (numpy, scipy only)."""
