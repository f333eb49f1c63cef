"""Model of the problem: bodies, materials, tips, contact laws and loading as frozen dataclasses."""
