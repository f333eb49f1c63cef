"""Simulation of one scene, from its config to its result folder."""
