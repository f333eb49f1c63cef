"""Measured constants of planning: numbers from runs and meshes, with their source.

Each entry gives the unit, the measured quantity and the scenes, and the test or script that repeats
the measurement ("Repeated by") or checks a consequence of it ("Checked"). Tolerances and limits
that were chosen are defined where they are used.
"""

from __future__ import annotations

# The error estimate of the force is about ERROR_CONSTANT n^-ORDER_OF_CONVERGENCE [-] at the worst
# step with n elements in the contact radius, by dimension. Repeated by:
# `python -m pytest -m verify tests/physics/test_accuracy.py -s` prints it for every scene.
ERROR_CONSTANT = {2: 0.65, 3: 0.33}
ORDER_OF_CONVERGENCE = 2.5
# Bound of the error of the contact radius, relative to the element where the contact ends [-].
# Repeated by: scripts/make_error_bar_table.
RADIUS_ERROR = 0.09
# Elements [-] in the radius of the contact without a requested accuracy, by dimension: the force of
# the last step is within 0.3 %, measured on a paraboloid in two dimensions and on a cube. Checked:
# tests/physics/test_layer_wall.py.
ELEMENTS_PER_RADIUS = {2: 10.0, 3: 5.0}

# The fluid pressure in a draining column extends over all of the height and does not decay below a
# contact. It is linear in an element, so that the relative error of the force is
# COLUMN_GRADING_ERROR grading^2 [-]. Measured on "Biot, confined ramp" of
# configs/studies/verification/published.yaml (height 1, radius 0.1, at t = 0.1 height^2/D): 7.9e-4
# when the grading is 0.2, 5.4e-4 when it is 0.167, 2.2e-4 when it is 0.1, and 1.2e-5 when all
# elements are 0.01. Repeated by: tests/physics/test_measured_constants.py.
COLUMN_GRADING_ERROR = 0.02

# h_edge n^ORDER_OF_CONVERGENCE divided by the punch's radius [-], by dimension. In three dimensions
# it is so small that the error by the edge (EDGE_ERROR times h_edge over the radius) alone is
# within ERROR_CONSTANT n^-ORDER_OF_CONVERGENCE: with 3.0 the first mesh missed the
# requested accuracy, and the second mesh took longer than a first mesh with 1.2. Checked:
# tests/physics/test_cost.py.
EDGE_SIZE_FACTOR = {2: 0.3, 3: 1.2}
# Largest relative error of the force, divided by the ratio of the element size at a punch's sharp
# edge to the radius of the punch [-]. It was 0.09 to 0.22 on 25 quarter cylinders. On sections of
# layers between frictionless walls, against theory, it was 0.11 to 0.27 at nu = 0.3; at nu = 0.4999
# it was 0.19 to 0.66 under punches of radii of 0.3 to 3 heights, INCOMPRESSIBLE_EDGE_FACTOR times
# EDGE_ERROR, and 0.75 under one of ten heights. Repeated, on the quarter cylinders, by:
# scripts/make_error_bar_table; on a section, by: tests/physics/test_measured_constants.py.
EDGE_ERROR = 0.25
# Relative error of the moment under a tilted tip, divided by that of the force [-]. The moment of a
# sharp punch of radius a grows as a^3 and its force as a: 5.2 to 5.5 % and 1.6 % were measured with
# 5 elements in the radius. Checked: tests/physics/test_tilt.py.
MOMENT_ERROR_RATIO = {"edge": 3.0, "other": 2.0}
INCOMPRESSIBLE_EDGE_FACTOR = 2.6
# The sensitivity of the force to a punch's radius next to a wall is this times (1 + radius/gap)
# [-], to 20 % of layer theory. Checked: tests/physics/test_corners.py.
EDGE_REFINEMENT = 0.74

# Bound of the relative error of the force [-] with elements of size h at a corner at the distance
# d: CORNER_ERROR (2 nu)^2 (h/d)^SINGULARITY_RATE. Measured on cylinders 0.2 to 8 heights wide under
# punches of 0.05 to 1 times their radius, with nu = 0 to 0.4999. Checked:
# tests/physics/test_corners.py.
CORNER_ERROR = 0.035
# Smallest elements at a corner of a gel that swells, in h_contact [-]. In smaller ones the free
# face beside a bonded base folds (local stretches above 3), and Newton's method finds no
# equilibrium. Checked: tests/physics/test_gel_scenes.py.
SWELLING_CORNER_SIZE = 0.125
# NOTCH_ERROR [-] replaces CORNER_ERROR (2 nu)^2 where a body overhangs its base, with any support.
# Measured on caps with contact angles from 60 to 170 degrees and elements of 0.01 to 0.3 of the
# base radius: the errors were 0.1 to 1.3 times this bound, and no more than noise up to 90 degrees.
# Repeated by: tests/physics/test_measured_constants.py. It also bounds the errors by the edges of
# cylindrical inclusions (tests/physics/test_inclusions.py).
NOTCH_ERROR = 0.1
# The error by a corner decays as exp(-DECAY_RATE (s - DECAY_ONSET)) [-] with the distance s of
# contact and side in heights of the body. Measured on the same cylinders. Checked:
# tests/physics/test_corners.py.
DECAY_ONSET = 0.5
DECAY_RATE = 1.25
# In plane strain the error by a corner falls more slowly with the radius a of the contact, as
# 1/(1 + CORNER_LOGARITHM log(d/a)) [-], and with the distance s. Measured on strips 2 to 7 heights
# wide under punches of 0.05 to 1 heights, with nu = 0.3 to 0.4999: with the formula of cylinders
# the errors were up to 6 times the bound. Checked: tests/physics/test_corners.py.
CORNER_LOGARITHM = 0.5
PLANE_STRAIN_DECAY_RATE = 1.05

# Elements [-] across a coating. tests/physics/test_skins.py measures the error of the
# force.
ELEMENTS_PER_COATING = 1.5
# Largest relative change of the force by the part of an inclusion that flat facets omit [-], and
# factor of the number of elements in an inclusion with flat faces, of which nothing is omitted. The
# force was within 0.02 to 0.1 % without a requested accuracy, for moduli of 1e-3 to 1e3 times that
# of the body. Checked: tests/physics/test_inclusions.py.
MAX_INCLUSION_WEIGHT = 0.25
FLAT_INCLUSION_FACTOR = 0.5
# Elements [-] between an inclusion and the top of a cap or ball, which bends as a shell above a
# soft inclusion. The force was within 0.1 to 0.2 % of the series solution, with 0.05 to 0.4 radii
# between them. Checked: tests/physics/test_layered_ball.py.
ELEMENTS_ABOVE_INCLUSION = 4.0

# Elements [-] in the smallest and the largest contact radius of an adhesive contact in the JKR
# limit: the pull-off force is within 0.2 %, measured on bonded layers. Repeated by:
# tests/physics/test_measured_constants.py. Checked, to 0.3 %, on layers of any thickness:
# tests/physics/test_experiment.py.
ADHESIVE_ELEMENTS_PER_RADIUS = 30.0
# Elements [-] in the contact radius for time steps by nodal pressures: the error of the force of a
# returning tip on a bonded layer is 0.03 %. Repeated, to 0.05 %, by:
# tests/physics/test_measured_constants.py.
STEPPED_ELEMENTS_PER_RADIUS = 25.0
# Elements [-] in the cohesive zone of an adhesive contact: the force is within 0.3 %. Checked, to
# 0.35 %: tests/physics/test_adhesion.py.
ELEMENTS_PER_ZONE = 2.0
# Largest ratio of element size and cohesive zone [-]. At Maugis' lambda 2.5 the oscillation of the
# force, as the edge of contact passes from node to node, was 0.8 % of the largest pull at this
# ratio, 1.3 % at 2, 2.1 % at 3 and 10 % at 8. Checked, at a ratio of 1.45:
# tests/physics/test_pull_off.py.
MAX_ELEMENT_RATIO = 1.5
# The surface below a frictionless tip stretches by exp(STRETCH_GROWTH (s - 1)) [-] at a depth of s
# radii of the tip, if this is more than one. Stretches of 2.2, 4.7 and 15 were measured at the apex
# of a rod with a round end, 2, 3 and 4.75 radii deep in a neo-Hookean material of nu = 0.49: the
# formula is 9 to 15 % lower. Repeated, to three radii, by:
# tests/physics/test_measured_constants.py.
STRETCH_GROWTH = 0.7

# Linear solves [-] per radius of depth of a frictionless flat punch at finite strain, to a depth of
# STEADY_SLIDING_DEPTH[0] + STEADY_SLIDING_DEPTH[1] edge_radius/radius radii [-]; beyond, they grow
# as exp(SLIDING_SOLVES_GROWTH depth/radius). Measured in neo-Hookean blocks of nu = 0.499: an edge
# of 0.2 radii took 41 solves to one radius, 180 to two and 500 to 2.5, a rod with a round end 120
# to four and 380 to five; the formula is within a factor of 1.5. Repeated, to one radius, by:
# tests/physics/test_measured_constants.py.
SLIDING_SOLVES = 35.0
STEADY_SLIDING_DEPTH = (0.46, 2.94)
SLIDING_SOLVES_GROWTH = 1.7

# Bound of the relative difference of the forces of several equilibria on one mesh [-], with
# active_set and a path of 1, 3 and 6 steps. No scene is known on which they differ by that much:
# the forces of 29 sections and two boxes under spheres, cones and rounded punches agree to 1e-9.
# Repeated, on a section, by: tests/physics/test_measured_constants.py.
EQUILIBRIA_DIFFERENCE = 0.002
# Coefficient of friction [-] up to which the edge of the contact slips: ten steps along the path
# then change the force by 0.01 %, and no second solution is needed. Checked, to 0.05 %:
# tests/physics/test_friction.py.
MAX_SLIPPING_FRICTION = 0.3
# Largest element size at the edge, in widths of the tensile rim [-], at which the elements resolve
# the rim. Newton's method was found to cycle with sizes up to 4 or 5 of them, at nu = 0 and 0.1.
# Repeated by: tests/physics/test_measured_constants.py.
MAX_RIM_ELEMENTS = 6.0
# Coefficient of friction [-] that replaces stick then. The force is 0.05 % lower, measured at
# nu = 0. Checked, to 0.1 %: tests/physics/test_friction.py.
STICK_FRICTION = 5.0

# Elastocapillary length over contact radius [-] beyond which p_max is off by more than its error
# estimate; it is off by 5 % at 200. Checked: tests/physics/test_surface_tension.py.
TENSION_PRESSURE_LIMIT = 15.0
# Displacement elements are too stiff for a drained gel with a larger Poisson's ratio [-]: the force
# is wrong by LOCKING_ERROR [-] at 0.4999, and by a tenth of that at DRAINED_LOCKING_NU. Repeated
# by: tests/physics/test_measured_constants.py.
DRAINED_LOCKING_NU = 0.495
LOCKING_ERROR = 0.01
# Elements [-] in the radius of a contact that a tip seals, with which the unknown end of the sealed
# area costs at most 2 % of the force that relaxes. On seven meshes it was 0.1 to 1.4 %, by the
# position of the edge in its element, and 2.6 % with half as many elements. Repeated by:
# tests/physics/test_measured_constants.py.
MIN_SEALED_ELEMENTS = 10.0
# Rows earlier than this many ramp times of the bath [-] get a warning: at this time a gel has risen
# by 2.6 % less than after a sudden change. Checked: tests/unit/run/test_plausibility.py.
SUDDEN_BATH_RATIO = 10.0
# A time step is at least the diffusion time of an element over this number [-]. In a shorter one,
# elements with linear pressure do not drain as a half-space does, and the force is up to 1.4 % too
# low, measured on a drained contact with ten elements in its radius; it is 0.4 % too low at this
# limit. Repeated by: tests/physics/test_measured_constants.py.
ELEMENT_DRAINAGE_FACTOR = 6.0
# Least number [-] of time steps between a change of the tip's speed and the next output row. The
# boundary layer of pore pressure beside a drained face grows with the square root of that time. In
# one step the force of a row was 6 % wrong with an error bar of 20 %, in eight steps 0.3 %, of
# confined columns. Repeated by `python tests/early_times.py --kinds column --accuracy 0.01`.
STEPS_TO_ROW = 8.0

# Ratio of Young's moduli [-] up to which layer theory keeps the error THEORY_ERROR; beyond it the
# error grows with the power CONTRAST_ERROR_EXPONENT of the ratio. It was 2e-6 at a ratio of 1e5.
# The error up to a ratio of 1e3 is checked by tests/unit/theory/test_stack.py.
INEXACT_CONTRAST = 1e4
CONTRAST_ERROR_EXPONENT = 2.5

# Iterative solvers need so many iterations with larger Poisson's ratios [-] and contact stiffnesses
# [E*/h_contact] that some systems are not solved. On a box the Krylov iterations for each iteration
# of Newton's method were 12 at nu = 0.45 with displacement elements, 38 at 0.495, 99 at 0.499, too
# many at 0.4999. With a contact stiffness of 3e5 E*/h_contact they were 9; with 9e5 Newton's method
# found no equilibrium on some meshes, and with 3e6 on none. Repeated by:
# tests/physics/test_measured_constants.py.
MAX_ITERATIVE_NU = 0.495
MAX_ITERATIVE_STIFFNESS = 3e5

# Smallest element size relative to the longest side of the model domain [-]. With smaller elements
# gmsh aborts or does not end: up to 3e-9 were seen, and 1e-10 in an axisymmetric section, where the
# tip is at r = 0 and coordinates have all their digits. Checked: tests/physics/test_extremes.py.
MIN_ELEMENT_SIZE = 5e-9
MIN_AXIS_SIZE = 1e-10

# Cells, nodes and vertices of a mesh: in two dimensions per size^2 of the section; in three per
# size^3 of the volume, and per size^2 of its surface, where gmsh's elements are as small but lie on
# one side only. They are within 5 % on 23 boxes, quarters and cylinders with 1 000 to 63 000 cells,
# graded and uniform. Checked: tests/physics/test_cost.py.
COUNTS_2D = {"cells": 2.63, "nodes": 5.58, "vertices": 1.45}
COUNTS_3D = {"cells": (4.16, 1.94), "nodes": (5.15, 5.90), "vertices": (0.56, 1.22)}
# Facets per size^(dim - 1) of the surface, by dimension, as of equilateral triangles, and nodes per
# facet [-], of which large surfaces have 2. The predicted number of nodes that may come into
# contact was 1 % too small to 16 % too large on sections and boxes with 25 to 600 of them. Repeated
# by: tests/physics/test_measured_constants.py.
FACETS_PER_AREA = {2: 1.0, 3: 2.3}
NODES_PER_FACET = 2.1

# Costs were fitted to runs of this program on one core of about 2020 (see `cost`). Checked, within
# a factor of two: tests/physics/test_cost.py.
# Processor time [s] of a run by theory, of each of its rows, and of a row under a tip with slope
# discontinuities, whose contact radius is found by a search.
THEORY_SECONDS = 0.6
SECONDS_PER_ROW = 4e-4
SECONDS_PER_SEARCHED_ROW = 0.03
# Processor time [s] to import the libraries, to mesh and to write; and of every further scene of a
# process that has imported the libraries, with and without a mesh.
START_SECONDS = 1.4
SECONDS_PER_RUN = 0.07
SECONDS_PER_THEORY_RUN = 0.003
# Memory of the process without its scene [bytes].
PROCESS_MEMORY = 1.7e8
# Iterations of a Krylov solver [-], time of an iteration per unknown [s], and memory per unknown
# [bytes].
KRYLOV_ITERATIONS = 10.0
KRYLOV_SECONDS = 3e-7
KRYLOV_BYTES = 3.3e3
# Time of a step of Newton's method with friction relative to one without [-], by dimension; and of
# one of a time-dependent body at finite strain, which was 1.3 to 1.9 on three scenes of configs/.
FRICTION_STEP_FACTOR = {2: 2.2, 3: 1.0}
TIME_DEPENDENT_STEP_FACTOR = 1.6

# Relative error [-] of the force of a body that yields, too low, divided by the longest increment
# relative to the depth. Measured on cones of 70.3 degrees in 10, 20, 40 and 80 increments: 0.64 to
# 0.68 at E/sigma_y = 100, 0.4 at 33, 0.3 with n = 0.5. Repeated by:
# tests/physics/test_plasticity.py.
YIELD_INCREMENT_ERROR = 0.7
# Bound of this error [-] for a single increment, relative to its own force. Measured on the cone at
# E/sigma_y = 100, 300 and 700, against increments extrapolated to zero: 0.15, 0.19 and 0.10.
# Repeated by: tests/physics/test_plasticity.py.
MAX_YIELD_INCREMENT_ERROR = 0.25
# Linear solves per load increment of a body that yields [-], and the time of one of them divided by
# that of an elastic body [-]: 5 to 9 and 1.5 to 2 on cones at E/sigma_y = 33 to 333. Checked:
# tests/physics/test_yielding_contact.py.
YIELD_SOLVES = 8.0
YIELD_STEP_FACTOR = 1.7
