"""Measured constants of runs: numbers from runs and comparisons, with their source.

Each entry gives the unit, the measured quantity and the scenes, and the test or script that repeats
the measurement ("Repeated by") or checks a consequence of it ("Checked"). Tolerances and limits
that were chosen are defined where they are used.
"""

from __future__ import annotations

# The expected relative error of a draining body is DRAINAGE_ERROR n^-DRAINAGE_ORDER [-] with n
# elements in the contact radius, since the fluid pressure is singular where the tip's seal ends. It
# is SMEARED_EDGE_ERROR n^-DRAINAGE_ORDER [-] where that edge lies within partly sealed elements.
# Measured on a punch and a ball with n = 5 to 56. Checked: tests/physics/test_cost.py.
DRAINAGE_ERROR = 0.04
SMEARED_EDGE_ERROR = 0.16
DRAINAGE_ORDER = 1.3

# Steps [-] to the depth by dimension of the mesh, in runs with stick. New contact sticks during a
# step; with these numbers the force is accurate to 0.05 % and 0.15 %. Repeated, the second in
# sections, by: tests/physics/test_measured_constants.py. Checked, the first:
# tests/physics/test_friction.py.
STICK_STEPS = {2: 10, 3: 4}

# Distance from the zero of the edge pressure of nodal punches to the end of the contact, relative
# to the distance of nodes [-], by formulation. Measured against theory on layers of nu = 0 to 0.5:
# 0.14 to 0.19 and 0.03 to 0.08. Repeated by: tests/physics/test_measured_constants.py.
EDGE_SHIFT = {"displacement": 0.16, "mixed": 0.06}
# Smallest error of the depth at pull-off under force control on a mesh, relative to the depth at
# pull-off under depth control [-]. Measured on bonded layers: up to 0.0017, the largest on thin
# ones. Repeated by: tests/physics/test_measured_constants.py.
MIN_PULL_OFF_ERROR = 0.002

# Radius of the edge of a flat punch at finite strain, relative to that of the punch [-]: a sharper
# edge cannot be solved. The effect of finite strain depends little on it: for nu = 0.3 and
# delta/a = 0.1 it is 1.18 to 1.23 % with edges of 0.005 to 0.1, and 1.6 % with a sharp edge.
# Checked: tests/physics/test_require.py.
EDGE_ROUNDING = 0.05
# Smallest edge radius that is suggested as a remedy, relative to the radius R of the tip [-]. In
# neo-Hookean rubber rods with edge radii of 1 and 0.99 R reached 4.75 R, punches with 0.2 R at
# least 1.3 R, with 0.1 R 1.0 to 1.3 R, and sharper ones a few per cent of R to 0.5 R, depending on
# mesh and steps. Repeated, with 0.2 R, by: tests/physics/test_measured_constants.py.
LEAST_ROUNDING = 0.2

# Rows are reported whose contact pressure oscillates from node to node by more than this fraction
# [-] of the peak pressure. It is 0.002 to 0.02 where the pressure is smooth and 0.09 to 0.5 in a
# saw-tooth (docs/decisions/0053). Repeated by `python tests/rubber_with_friction.py`.
MAX_ROUGHNESS = 0.03
# Rows are reported whose stick radius or dissipation may be wrong by more than this fraction [-]
# because of a long step. Measured with 1, 2, 5, 10 and 40 equal steps under a paraboloid (thick
# layer, nu 0). Friction 0.3: the stick radius is 0.24, 0.45, 0.50, 0.52 and 0.54 of the contact
# radius, and the total dissipation 2.4, 1.5, 1.07, 1.01 times that of 40 steps. Friction 0.6: 0.82,
# 0.82, 0.85, 0.87 and 0.90, and 0.97, 0.60, 0.64, 0.89 times. The last step adds 1, 0.29, 0.11 and
# 0.05 of the contact radius. Checked: tests/unit/run/test_plausibility.py.
MAX_STEP_CHANGE = 0.25

# Largest overlap of a facet with the tip, relative to the depth and to an element [-]: a choice far
# above the overlaps of converged rows. With contacts of one to six elements these were 1e-3 of the
# depth and 4e-4 of an element at most. Checked: tests/unit/run/test_plausibility.py.
MAX_OVERLAP = (0.1, 0.5)
# Largest penetration outside the contact surface, relative to the depth [-]. A contact group of a
# mesh file that ends within the contact reduces the force: by 0.02 % where the tip is 2e-4 inside
# the next facets, 0.4 % at 8e-3, 4 % at 6e-2, 20 % at 0.2 (axisymmetric and plane; both gaps). The
# penetration is 0 where the contact surface is large enough. Checked:
# tests/physics/test_beside_the_contact.py.
MAX_OUTSIDE_PENETRATION = 1e-3
