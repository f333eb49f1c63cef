"""Measured constants of the model, from simulations and trials, with their source.

Each entry gives the unit, the measured quantity, and the test or page that repeats the measurement.
"""

from __future__ import annotations

# Smallest Poisson's ratio [-] at which displacement elements lock: p_max of a compressed thin layer
# is off by up to 2 % at 0.45 and by 10 % at 0.49, with mixed elements by 0.5 % at most. Repeated
# by: tests/physics/test_beside_the_force.py.
LOCKING_POISSON_RATIO = 0.45

# A point with an initial gap comes into contact after the fraction CLOSING_FRACTION [-]
# (gap/largest_gap)^CLOSING_EXPONENT [-] of an increment. In self-similar contact of a paraboloid
# without slip this fraction increases from 0 at the old edge of the contact to about 2/3 at the new
# one; these two constants gave the smallest error of the force for half-spaces and layers, with
# stick and with Coulomb's law. The error that they leave: tests/physics/test_friction.py.
CLOSING_FRACTION = 0.63
CLOSING_EXPONENT = 1 / 3

# Largest difference [kT] of two chemical potentials that count as equal. The potential of a free
# stretch that was found for a bath differs from the bath's by up to 3e-16 (300 random gels of chi 0
# to 0.7, n_omega 1e-4 to 0.03, baths 0 and -1e-6 to -0.1). Repeated by
# tests/unit/model/test_gel.py, for some gels.
SWELLING_ROUNDING = 1e-14
