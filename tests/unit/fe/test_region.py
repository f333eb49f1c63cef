"""Area of the parts of triangles where a linear function is positive, against cut polygons."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from indent_sim.fe.postprocessing.contact_area import _positive_area


def cut_area(corners: np.ndarray, values: np.ndarray) -> float:
    """Area of the positive polygon of one triangle (3, 2), by the shoelace formula."""
    points = []
    around = [*zip(corners, values, strict=True), (corners[0], values[0])]
    for (here, p), (there, q) in pairwise(around):
        if p > 0:
            points.append(here)
        if p * q < 0:
            points.append(here + (there - here) * p / (p - q))
    x, y = np.array(points).T if points else np.zeros((2, 1))
    return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def test_parts_of_triangles() -> None:
    """The area is that of the cut polygons, with none to three corners in contact.

    1e-12 is the round-off of 200 areas.
    """
    draw = np.random.default_rng(1)
    corners, values = draw.normal(size=(200, 1, 3, 2)), draw.normal(size=(200, 1, 3))
    assert {int((p > 0).sum()) for p in values[:, 0]} == {0, 1, 2, 3}
    each = [cut_area(*one) for one in zip(corners[:, 0], values[:, 0], strict=True)]
    assert _positive_area(corners, values) == pytest.approx(sum(each), rel=1e-12)
