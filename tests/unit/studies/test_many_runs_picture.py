"""Pictures of many runs: which axes are logarithmic."""

from __future__ import annotations

import numpy as np
import pytest

from indent_sim.studies.many_runs_picture import has_logarithmic_axis

FRACTIONS = (np.arange(100) + 0.5) / 100


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        (0.5 * FRACTIONS, False),  # covers decades, since it begins near 0
        (1e-3 * 500**FRACTIONS, True),
        (2 * 5**FRACTIONS, False),  # a narrow range
        (-1 + 100 * FRACTIONS, False),
        (np.geomspace(1e-3, 1, 8), True),  # edges of the rectangles of a map
        (np.linspace(1e-3, 1, 8), False),
    ],
)
def test_an_axishas_logarithmic_axis_as_its_values_are_spaced(values, expected):
    assert has_logarithmic_axis(values) is expected
