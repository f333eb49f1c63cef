"""Measured constants of fits: numbers from fits and solved scenes, with their source.

Each entry gives the unit, the measured quantity and the scenes, and the test that repeats the
measurement ("Repeated by") or checks a consequence of it ("Checked"). Tolerances and limits that
were chosen are defined where they are used.
"""

from __future__ import annotations

# Number of depths at which a scene is solved, and degree of the polynomial through them. The
# relative interpolation error of the force by theory is 5e-11. Checked:
# tests/unit/fitting/test_scene_forces.py.
SOLVED_DEPTHS = 20
DEGREE = 12

# Number of nodes, and logarithmic and linear step [-], of the parameter grid of forces along a
# measured path. Half-way between nodes the interpolation error of the force of a poroelastic layer
# is 3e-4 with 16 elements in the contact radius. With 4 elements, that of a varied diffusivity is
# 3e-3, since time steps and the edge of contact change with it. Repeated, for the linear step, by:
# tests/physics/test_measured_constants.py. Checked, to 6e-3:
# tests/unit/fitting/test_history_table.py.
HISTORY_GRID_NODES = 4
HISTORY_LOG_STEP = 0.4
HISTORY_LINEAR_STEP = 0.05

# Number of nodes, and logarithmic step [-], of the table of loops of a cone over E/yield_stress,
# and relative errors of its loading curve and of S h_max/F_max besides the scatter of the rows:
# mesh, increments and interpolation. Half-way between nodes the interpolation differs from a run by
# at most 0.4 % in either, which is the scatter of the runs. Repeated by:
# tests/physics/test_loop_fit.py.
LOOP_NODES = 4
LOOP_LOG_STEP = 0.5
LOOP_CURVATURE_ERROR = 0.005
LOOP_STIFFNESS_ERROR = 0.005
# Relative error of the recovery at which the contact is lost, by the scatter of the runs.
LOOP_RECOVERY_ERROR = 0.03
# CPU time [s] of a run of such a loop, 13 to 27 s for E/yield_stress of 12 to 1100.
LOOP_SECONDS = 15.0
