"""Measured constants of `theory`: results of solutions that were computed once, with sources.

Each entry gives the unit, the computed quantity, and the script or test that repeats the
computation. Constants of closed forms, quadrature rules and searches are defined where they are
used.
"""

from __future__ import annotations

import math

# Force without slip over the frictionless one [-] on a layer bonded to its base, by Poisson's ratio
# (rows) and contact radius over thickness (columns), for the exponents of a paraboloid, a cone and
# a flat punch. Paraboloid and cone are as deep as the frictionless tip with that contact radius.
# Finite element solutions of the scenes in configs/studies/friction in twenty load steps, rounded
# to three decimals. Repeated by scripts/make_friction_page, which fails where one differs by more
# than MAP_ERROR; tests/physics/test_friction.py solves some of them.
MAPPED_SLENDERNESS = (0.1, 0.3, 1.0, 2.0, 3.0, 5.0, 10.0)
MAPPED_POISSON_RATIOS = (0.0, 0.3, 0.4, 0.45, 0.49, 0.5)
LAYER_FORCE_RATIOS = {
    2.0: (
        (1.057, 1.060, 1.043, 1.023, 1.013, 1.006, 1.002),
        (1.017, 1.016, 1.003, 1.000, 1.001, 1.001, 1.000),
        (1.006, 1.004, 1.001, 1.017, 1.021, 1.015, 1.006),
        (1.002, 1.000, 1.014, 1.066, 1.083, 1.066, 1.026),
        (1.000, 1.000, 1.045, 1.211, 1.339, 1.398, 1.241),
        (1.000, 1.001, 1.059, 1.304, 1.585, 2.057, 2.731),
    ),
    1.0: (
        (1.049, 1.051, 1.038, 1.020, 1.012, 1.005, 1.001),
        (1.015, 1.014, 1.003, 1.000, 1.000, 1.000, 1.000),
        (1.005, 1.003, 1.001, 1.015, 1.020, 1.014, 1.005),
        (1.001, 1.000, 1.011, 1.060, 1.078, 1.062, 1.023),
        (1.000, 1.000, 1.039, 1.196, 1.320, 1.381, 1.230),
        (1.000, 1.001, 1.051, 1.282, 1.553, 2.011, 2.683),
    ),
    math.inf: (
        (1.106, 1.110, 1.081, 1.050, 1.035, 1.022, 1.011),
        (1.030, 1.029, 1.010, 1.005, 1.004, 1.003, 1.001),
        (1.010, 1.007, 1.005, 1.022, 1.024, 1.019, 1.010),
        (1.003, 1.001, 1.022, 1.079, 1.093, 1.077, 1.041),
        (1.000, 1.001, 1.065, 1.254, 1.382, 1.434, 1.284),
        (1.000, 1.001, 1.084, 1.366, 1.659, 2.126, 2.781),
    ),
}
MAP_ERROR = 0.005  # Relative error of a force ratio of the map [-].
# Inside a cell of the map the force ratio may leave the range of its four corners: upwards by
# CELL_PEAK [-] of the largest change of the force, downwards by CELL_DIP [-] of the force, where
# the slip reverses. Measured with solutions between the lines of the map. Repeated by:
# scripts/make_friction_page.
CELL_PEAK = 0.02
CELL_DIP = 0.004

# Fraction (F - F(inf))/(F(0+) - F(inf)) [-] of the force of a paraboloid at the times tau = D t/a^2
# [-] after a step of the depth, and at the end of a ramp of that duration, for a sealed and a
# drained tip. Finite element solutions for a/h = 0.16 and nu = 0.2 with a drained surface outside
# the contact. Repeated, to 0.02, by tests/physics/test_measured_constants.py.
DRAINAGE_TIMES = (0.01, 0.1, 1.0, 10.0, 100.0)
DRAINAGE_STEP_FRACTIONS = {
    "sealed": (0.964, 0.745, 0.228, 0.0369, 1e-3),
    "drained": (0.792, 0.498, 0.182, 0.0355, 1e-3),
}
DRAINAGE_RAMP_FRACTIONS = {
    "sealed": (0.980, 0.865, 0.462, 0.1417, 0.0225),
    "drained": (0.873, 0.671, 0.3455, 0.1196, 0.0199),
}

# Constant C [-] of the force C E* tan(beta) delta^2 of a square pyramid on a half-space: a boundary
# element solution with an uncertainty of 2e-5; the often quoted 0.7453 is 1 % too high. Repeated,
# by finite elements to 1 %: tests/physics/test_tips.py.
PYRAMID_CONSTANT = 0.73762
PYRAMID_CONSTANT_ERROR = 3e-5  # Relative error of this constant [-].

# Stated relative error [-] of the force of layers and stacks: ten times the largest change with
# finer quadrature. Repeated by tests/unit/theory/test_stack.py.
THEORY_ERROR = 1e-8

# Stated relative errors [-] of the force on a layer with surface tension. Against three times as
# many basis functions the largest differences were 1.4e-4 under a tip with slope discontinuities (a
# polygon), 3e-6 under a sharp punch and 3e-9 under smooth tips. Repeated by:
# tests/physics/test_surface_tension.py.
TENSION_ERROR_OF_KINKED_TIPS = 5e-4
TENSION_ERROR_OF_PUNCHES = 1e-5
TENSION_ERROR_OF_SMOOTH_TIPS = 1e-8

# Height of the tip at the contact edge above its apex, divided by the depth [-], of a half-space
# that yields without hardening, at strain ratios E tan(beta)/sigma_r [-]: from that of an elastic
# half-space on. Sharp: cones of 70.3 degrees at E/sigma_y = 33, 100, 333 and 700. Round: spheres at
# E/sigma_y = 1000 with a/R = 0.0095, 0.029 and 0.365. Checked:
# tests/physics/test_yielding_contact.py.
SHARP_STRAIN_RATIOS = (3.3, 12.0, 36.0, 119.0, 250.0)
SHARP_CONTACT_HEIGHTS = (2 / math.pi, 0.85, 1.03, 1.17, 1.23)
ROUND_STRAIN_RATIOS = (3.3, 9.5, 29.0, 365.0)
ROUND_CONTACT_HEIGHTS = (0.5, 0.70, 0.855, 1.38)
# Mean pressure of a contact that yields minus the pressure in Johnson's cavity, over the flow
# stress [-]: 0.75 to 0.9 under spheres and 1.0 under cones. Checked:
# tests/physics/test_yielding_contact.py.
PRESSURE_OFFSET = 0.85
