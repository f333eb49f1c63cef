"""Measured constants of the finite-element solver, with their source.

Each entry gives the unit, the measured quantity and the scenes, and the test that repeats the
measurement ("Repeated by") or checks a consequence of it ("Checked"). Tolerances and limits that
were chosen rather than measured are defined where they are used.
"""

from __future__ import annotations

# Quadrature degree [-] in the volume, by dimension. In three dimensions four points per cell are
# exact for the strain energy of linear bodies. In hyperelastic bodies they change the force by a
# thirtieth of its discretisation error, and 14 points would cost three times as much. In two
# dimensions the factors r and u_r/r need a higher degree. Repeated by:
# tests/physics/test_hyperelastic.py.
VOLUME_DEGREE = {2: 4, 3: 2}

# Relative scatter [-] of the force between equilibria of body and soft tip at one depth that are
# reached on different ways: points of the body keep their segment of the tip for a part of its
# length beyond its end. It is about 2e-5 in loading and unloading, and up to 1e-4 in the search for
# a prescribed force. Checked: tests/physics/test_soft_tips_at_finite_strain.py.
SOFT_TIP_FORCE_SCATTER = 1e-4

# Stiffness that finds the contact edge, as a multiple [-] of E*/h with the size h of the facet, by
# formulation. Measured on 60 random layers between frictionless walls, with two to thirty elements
# in the contact radius: the error of the contact radius is 0.01 h in the median, and in 95 % of the
# rows below 0.03 h (displacement) and 0.05 h (mixed). With half of these values the radius is 0.04
# h too large, with twice as much 0.03 h too small. Checked:
# tests/physics/test_beside_the_force.py.
EDGE_STIFFNESS_FACTOR = {"displacement": 4.0, "mixed": 6.0}

# Multiple [-] of gamma/h^2 that a surface tension gamma adds to this stiffness, and fraction [-] of
# the pressure step where the contact ends. Measured on 240 rows of 60 random half-spaces, layers,
# films and stacks, with 0.3 to 10 elements in the contact radius: the error of the contact radius
# is 0.005 h in the median and below 0.05 h in 95 % of the rows. Repeated by:
# tests/physics/test_surface_tension.py.
EDGE_TENSION_FACTOR = 8.0
EDGE_STEP_FRACTION = 0.42
# Pressure step s [-] at the contact edge, relative to the mean pressure: s/(1 - s) =
# EDGE_STEP_GROWTH (gamma/(E* a))^EDGE_STEP_EXPONENT. In these scenes s differs by up to 0.1 from
# theory. Repeated by: tests/physics/test_surface_tension.py.
EDGE_STEP_GROWTH = 10.0
EDGE_STEP_EXPONENT = 0.75
# Fraction [-] of the depth below which the gap at the edge of a tip counts as closed under surface
# tension. It is twice the largest gap next to the edge of a punch, for gamma/(E* a) from 1e-4 to 20
# and nu from 0 to 0.5. Checked: tests/physics/test_surface_tension.py.
EDGE_GAP_FRACTION = 0.01

# Number of facets between an assessed facet and the edge of the contact or a slope discontinuity,
# by the number of nodes of a facet. The nearest of them belong to the patch of the assessed facet.
# With two facets in three dimensions, a ball on a cube (three elements in the contact radius, no
# friction) would have the roughness 0.08, because elements that the edge of the contact crosses
# spread the pressure. Checked: tests/unit/fe/test_roughness.py.
RIM_RINGS = {3: 2, 6: 3}
# Number of facets of the largest hole in the contact that counts as an oscillation, and not as a
# true gap, by the number of nodes of a facet. Under a rounded punch with friction (depth 0.24
# thicknesses, nu 0.49, two steps) two neighbouring elements opened by such an oscillation, and the
# force was 1.6 % too small. Checked: tests/unit/fe/test_roughness.py.
LARGEST_HOLE = {3: 4, 6: 12}

# The radius of the punch that a mesh represents exceeds the radius of its last vertex by this
# fraction [-] of the element inside the edge: (value at nu = 0, decrease per nu), by formulation.
# Measured against theory on half-spaces and layers: 0.111 at nu = 0 and 0.092 at 0.3
# (displacement), 0.059 at 0.45 and 0.050 at 0.5 (mixed), to 0.004 each. Repeated by
# tests/physics/test_measured_constants.py.
RADIUS_SHIFT = {"displacement": (0.111, 0.063), "mixed": (0.140, 0.180)}

# Longest increment of an adhesive tip, and the longest one in which it may snap in or off, in units
# of the range of the attraction [-]. In a longer one Newton's method may converge to the other of
# two stable states: at Maugis' lambda = 2 the tip snapped off too early in an increment of five
# times the range of the attraction. Checked: tests/physics/test_pull_off.py.
LONGEST_STEP_RANGES = 4.0
SNAP_STEP_RANGES = 0.25

# The force as a function of the depth oscillates slightly, as the edge of contact passes from
# element to element. The amplitude relative to the largest tensile force [-] is
# FORCE_OSCILLATION_FACTOR over the square of the number of elements in the cohesive zone or in the
# contact radius, whichever is smaller, and at most MAX_FORCE_OSCILLATION. Measured as the largest
# deviation from a polynomial of degree 6 over 60 rows around pull-off: factors of 0.002 to 0.02
# with 0.7 to 11 elements at Maugis' lambda 0.5 to 2.5. Repeated by tests/physics/test_pull_off.py.
FORCE_OSCILLATION_FACTOR = 0.02
MAX_FORCE_OSCILLATION = 0.008
# Smallest tolerance of the search for the pull-off, relative [-] to the largest tensile force: with
# 11 elements in the cohesive zone the force is known to 2e-4 (docs/verification.md).
FINEST_TOLERANCE = 1e-4
# Next to a fold the interval before the best point is divided only if it is more than this many
# times [-] as long as the interval after it. With 1 a search takes a third more equilibria, with 8
# a twentieth fewer, on the curves with a fold of tests/unit/fe/test_pull_off.py.
FOLD_LENGTH_RATIO = 4.0

# Conductance of a drained vertex, relative [-] to that of its own cells. The pressure there is 1e-8
# of that of a sealed vertex. Forces agree to 1e-7 for factors from 1e6 on, and no digits are lost
# up to 1e10. Repeated by tests/physics/test_measured_constants.py.
OPEN_CONDUCTANCE_FACTOR = 1e8

# Shear modulus of a drop's surface membrane, as a fraction [-] of gamma. It increases the force by
# 0.45 times this fraction. Measured on a ball between plates with 10 to 20 elements in the contact
# radius: without a membrane no row converges below mu = 1.7e-3 gamma/R; with 3e-4 three of four
# rows converge at mu = 1e-3 gamma/R; with 1e-3 all of them do, and three of four at 1e-4 gamma/R.
# Repeated by tests/physics/test_drops.py.
MEMBRANE_STIFFNESS = 1e-3

# Stiffness of the body to the shortest waves of its surface, in units of E*/h_contact [-], in the
# preconditioner of the multiplier; 6 and 30 take more iterations. Checked:
# tests/physics/test_iterative.py.
SURFACE_STIFFNESS = 10.0
# Number of right-hand sides that are solved at once. The default of MUMPS, 32, takes a seventh
# longer. No test repeats this, because times scatter by more.
BLOCK_SIZE = 128
