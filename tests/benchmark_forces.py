"""Forces of HERTZ, the benchmark of the tests and of `scripts/bench`."""

from __future__ import annotations

# By converged computations with independent programs: of all ten steps, to 1e-8, and of the last
# one, to 3e-6
CYLINDER_STEPS = [
    4.752808e-5,
    1.3588647e-4,
    2.5173546e-4,
    3.9033719e-4,
    5.4896469e-4,
    7.2578549e-4,
    9.1945975e-4,
    1.12895354e-3,
    1.35343836e-3,
    1.59223159e-3,
]
CUBE = 1.59748e-3
CYLINDER_RADII = [
    0.03189,
    0.04526,
    0.05559,
    0.06434,
    0.07209,
    0.07912,
    0.08560,
    0.09166,
    0.09737,
    0.10279,
]
