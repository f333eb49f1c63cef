"""Roughness of given pressures: none for smooth ones, the amplitude for a saw-tooth."""

from __future__ import annotations

import numpy as np
import pytest

from indent_sim.fe.postprocessing.roughness import build_patches, roughness
from indent_sim.model.tips import FlatPunch, Paraboloid

BALL = Paraboloid(R=1.0)


def section(count: int, end: float = 1.2) -> np.ndarray:
    """Nodes (facets, 3, 2) of a flat surface from the axis to `end`, vertices first."""
    r = np.linspace(0.0, end, count + 1)
    nodes = np.stack([r[:-1], r[1:], (r[:-1] + r[1:]) / 2], axis=1)
    return np.stack([nodes, np.zeros_like(nodes)], axis=-1)


def triangles(count: int) -> np.ndarray:
    """Nodes (facets, 6, 3) of a square from -1.2 to 1.2 in triangles of irregular shapes."""
    places = np.linspace(-1.2, 1.2, count + 1)
    x, y = np.meshgrid(places, places, indexing="ij")
    shift = 0.2 * 2.4 / count * np.random.default_rng(0).uniform(-1, 1, (2, *x.shape))
    points = np.stack([x + shift[0], y + shift[1], 0 * x], axis=-1)
    low, right, up, far = points[:-1, :-1], points[1:, :-1], points[:-1, 1:], points[1:, 1:]
    corners = np.concatenate(
        [
            np.stack(three, axis=2).reshape(-1, 3, 3)
            for three in ((low, right, up), (far, up, right))
        ]
    )
    middles = [(corners[:, i] + corners[:, j]) / 2 for i, j in ((1, 2), (0, 2), (0, 1))]
    return np.concatenate([corners, np.stack(middles, axis=1)], axis=1)


def found(X: np.ndarray, pressure: np.ndarray, tip: object = BALL) -> float:
    """Roughness of a nodal pressure that is in contact where it is positive."""
    distance = np.hypot(X[..., 0], X[..., 1] if X.shape[2] == 3 else 0.0)
    return roughness(build_patches(X), pressure, pressure > 0, distance, tip)  # type: ignore[arg-type]


def hertz(X: np.ndarray) -> np.ndarray:
    """Pressure (1 - r^2)^(1/2), and zero beyond r = 1."""
    return np.sqrt(np.maximum(1 - (X[..., :-1] ** 2).sum(axis=-1), 0.0))


@pytest.mark.parametrize("X", [section(12), triangles(12)], ids=["section", "triangles"])
def test_a_quadratic_pressure_has_none(X: np.ndarray) -> None:
    assert found(X, 3 - X[..., 0] ** 2 - (X[..., 1] + 0.3 * X[..., 0]) ** 2) < 1e-12


@pytest.mark.parametrize(
    "X", [section(6), section(12), triangles(12)], ids=["coarse", "section", "triangles"]
)
def test_a_hertzian_pressure_is_smooth_but_for_its_rim(X: np.ndarray) -> None:
    """The roughness of Hertz's pressure is below 1 %, the error of the fitted polynomial.

    That error is (h/a)^3/48 times the third derivative, which is 7 at r = 0.6, with five elements
    in a.
    """
    assert found(X, hertz(X)) < 0.01


@pytest.mark.parametrize("count", [12, 40])
def test_a_saw_tooth_between_vertices_and_midpoints_has_its_height(count: int) -> None:
    X, height = section(count), np.array([0.05, 0.05, -0.05])
    assert found(X, hertz(X) + height * (hertz(X) > 0)) == pytest.approx(0.05, rel=0.5)


def test_a_saw_tooth_from_facet_to_facet_has_its_height() -> None:
    X = section(40)
    tooth = 0.05 * np.cos(np.pi * X[..., 0] / 0.03)  # one facet is 0.03 long
    assert found(X, hertz(X) + tooth * (hertz(X) > 0)) == pytest.approx(0.05, rel=0.5)


def test_a_saw_tooth_on_triangles_is_seen() -> None:
    """A random saw-tooth of 10 % at the midpoints of triangles has a roughness above 5 %.

    The quadratic polynomial takes up six of the nine numbers of a patch.
    """
    X = triangles(16)
    keys = {
        key: sign
        for sign, key in enumerate(sorted({tuple(x) for x in X[:, 3:].round(9).reshape(-1, 3)}))
    }
    signs = np.random.default_rng(1).choice([-1.0, 1.0], len(keys))
    tooth = np.zeros(X.shape[:2])
    tooth[:, 3:] = 0.1 * np.array(
        [signs[keys[tuple(x)]] for x in X[:, 3:].round(9).reshape(-1, 3)]
    ).reshape(-1, 3)
    assert found(X, hertz(X) + tooth * (hertz(X) > 0)) > 0.05


def test_a_contact_that_opens_over_an_element_inside_is_rough() -> None:
    """A hole of two facets inside the contact is rough; a wider one separates two contacts."""
    X = section(40)
    r = X[..., 0]
    pressure = hertz(X)
    assert found(X, np.where((r > 0.5) & (r < 0.5 + 2.1 * 0.03), 0.0, pressure)) > 0.1
    assert found(X, np.where((r > 0.3) & (r < 0.6), 0.0, pressure)) < 0.03


def test_a_hole_in_triangles_is_rough() -> None:
    X = triangles(24)
    r = np.hypot(X[..., 0], X[..., 1])
    assert found(X, np.where(r < 0.08, 0.0, hertz(X))) > 0.1


def test_creases_of_a_tip_are_left_out() -> None:
    """A kink of the pressure at a slope discontinuity of the tip does not count as roughness."""
    X, punch = section(40), FlatPunch(radius=1.0, edge_radius=0.5)
    kinked = 1.0 + np.maximum(X[..., 0] - 0.505, 0.0) - 2 * (X[..., 0] > 1.0)
    assert found(X, kinked, punch) < 1e-12 < 1e-3 < found(X, kinked)


def test_a_contact_of_few_elements_tells_nothing() -> None:
    X = section(4)
    assert found(X, hertz(X)) == 0.0
    assert found(X, np.zeros(X.shape[:2])) == 0.0
