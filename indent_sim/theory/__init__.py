"""Closed forms and semi-analytic solutions that the simulation is judged against (numpy and scipy
only).
"""
