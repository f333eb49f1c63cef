"""Measured curves: text tables of any kind and AFM files <-> depth, force and time."""
