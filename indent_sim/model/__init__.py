"""What is simulated: bodies, materials, tips, contact laws and loading, as frozen dataclasses and
formulas.
"""
