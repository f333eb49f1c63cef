"""The section `loading.slide`: rows, and scenes with which it cannot be combined."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scenes import BOX, ELASTIC, PARABOLOID, STRIP, WALLED

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.mesh.size_formulas import size_formula
from indent_sim.model.loading import Slide
from indent_sim.model.tip_track import TipTrack
from indent_sim.process.errors import ConfigError
from indent_sim.scene.scene import resolve

SLIDE = {"delta": 0.01, "steps": 2, "slide": {"to": [0.02, -0.02], "steps": 2}}
SECTIONS: dict[str, Any] = {
    "body": STRIP,
    "material": ELASTIC,
    "indenter": PARABOLOID,
    "loading": SLIDE,
    "contact": {"friction": 0.4},
}


def test_rows_of_a_slide() -> None:
    """The last depth is held on all stretches, whose ends are exact."""
    path = config_from_mapping(SECTIONS).loading.path()
    assert path.values == (0.005, 0.01, 0.01, 0.01, 0.01, 0.01)
    assert path.slides == (0.0, 0.0, 0.01, 0.02, 0.0, -0.02)
    assert Slide(0.3, steps=2).displacements == (0.15, 0.3)


def test_columns_choices_and_units() -> None:
    """Lengths in units are converted; the choices name the track."""
    units = {"units": {"length": "mm", "force": "mN"}}
    loading = SLIDE | {"slide": {"to": "20 um", "steps": 2}}
    scene = resolve(config_from_mapping(SECTIONS | units | {"loading": loading}))
    assert scene.physics.path.slides[-1] == pytest.approx(0.02)
    assert {"x", "side_force_x", "stick_radius", "dissipation"} <= {*scene.columns}
    assert any(choice.key == "loading.slide" for choice in scene.plan.choices)
    assert not scene.exact_theory


@pytest.mark.parametrize("along, axis", [(0.0, "y"), (90.0, "x")])
def test_a_plane_along_the_slide_is_a_mirror_plane(along: float, axis: str) -> None:
    """Of a box and of a cylinder the half on one side of the slide is solved."""
    loading = SLIDE | {"slide": {"to": [0.02], "along": along}}
    for body in (BOX, WALLED):
        scene = resolve(config_from_mapping(SECTIONS | {"body": body, "loading": loading}))
        assert scene.physics.domain.mirror_axes == (axis,)
        assert list(scene.physics.side_force_axes) == [{"y": "x", "x": "y"}[axis]]


@pytest.mark.parametrize(
    "changes, text",
    [
        ({"loading": SLIDE | {"slide": {"to": [0.1], "along": 45.0}}}, "along x or y only"),
        ({"loading": SLIDE | {"slide": {"to": [0.1], "along": 90.0}}}, "infinitely long"),
        (
            {"loading": {"history": [[0, 0], [1, 0.01]], "slide": {"to": [0.1]}}},
            "has a history",
        ),
        ({"body": {"shape": "ball", "radius": 1.0}}, "has the tip on its axis"),
        ({"body": {"shape": "half_space"}}, "has the tip on its axis"),
        ({"indenter": {"shape": "plate"}}, "covers the whole top"),
        (
            {"contact": {"adhesion": {"work": 1e-4, "range": 1e-3}}},
            "may snap in or off",
        ),
        (
            {"material": ELASTIC | {"plasticity": {"yield_stress": 0.01}}},
            "together with plasticity",
        ),
        ({"loading": SLIDE | {"slide": {"to": 0.0}}}, "part without motion"),
        ({"loading": SLIDE | {"slide": {"to": [0.1, 0.1]}}}, "part without motion"),
        ({"loading": {"deltas": [0.01, 0.0], "slide": {"to": [0.1]}}}, "which is not above 0"),
        ({"loading": SLIDE | {"slide": {"to": [1.95]}}}, "over the edge of the body"),
        ({"indenter": {"shape": "flat_punch", "radius": 0.1}}, "sharp edge of the tip"),
        ({"mesh": {"symmetry": "half"}}, "the tip slides"),
    ],
)
def test_refused_with_a_reason(changes: dict[str, Any], text: str) -> None:
    """What a slide cannot be combined with is refused with the reason."""
    with pytest.raises(ConfigError, match=text):
        resolve(config_from_mapping(SECTIONS | changes))


RELAXING = ELASTIC | {"relaxation": {"prony": [[0.5, 1.0]], "of": "shear"}}
IN_TIME = {"history": [[0, 0], [1, 0.01], [3, 0.01]], "slide_history": [[1, 0], [2, 0.02]]}


def test_a_slide_in_time() -> None:
    """The tip slides between its points and rests elsewhere; its points are rows."""
    sections = SECTIONS | {"material": RELAXING, "loading": IN_TIME}
    scene = resolve(config_from_mapping(sections))
    path = scene.physics.path
    L = scene.physics.scales.length
    x = dict(zip(path.times, path.slides, strict=True))
    assert x[1.0] == 0.0 and x[2.0] == x[3.0] == pytest.approx(0.02 / L)
    assert max(np.diff(path.slides)) <= scene.plan.prediction["a"] / L / 8 * (1 + 1e-9)
    assert {"x", "side_force_x", "moment"} <= {*scene.columns}
    assert scene.physics.track.high == pytest.approx(0.02 / L)


@pytest.mark.parametrize(
    "loading, material, text",
    [
        ({"slide_history": [[1, 0.01], [2, 0.02]]}, RELAXING, "the tip is pressed in at x = 0"),
        ({"slide_history": [[1, 0], [1, 0.02]]}, RELAXING, "not later than the point before"),
        ({"slide_history": [[1, 0], [4, 0.02]]}, RELAXING, "use times from 0 to 3"),
        ({"slide_history": [[1, 0], [2, 0]]}, RELAXING, "has no motion"),
        ({"slide": {"to": [0.1]}}, RELAXING, "give one of them"),
        ({"history": None, "delta": 0.01}, RELAXING, "has no history"),
        ({}, ELASTIC, "does not depend on time"),
        ({}, RELAXING | {"relaxation": {"prony": [[0.5, 1.0]]}}, "with of: shear"),
    ],
)
def test_a_slide_in_time_is_refused_with_a_reason(
    loading: dict[str, Any], material: dict[str, Any], text: str
) -> None:
    """What a slide in time needs, and what it cannot be combined with."""
    given = {key: value for key, value in (IN_TIME | loading).items() if value is not None}
    with pytest.raises(ConfigError, match=text):
        resolve(config_from_mapping(SECTIONS | {"material": material, "loading": given}))


def test_a_wall_through_the_tip_is_no_place_to_leave() -> None:
    """A tip on a roller wall, which is a mirror plane, can slide along it only."""
    walls = {"x_min": "roller", "x_max": "free", "y_min": "free", "y_max": "free"}
    tip = PARABOLOID | {"center": [0.0, 1.0]}
    sections = SECTIONS | {"body": BOX | {"sides": walls}, "indenter": tip}
    with pytest.raises(ConfigError, match="leads away from the roller wall x_min"):
        resolve(config_from_mapping(sections))
    along = SLIDE | {"slide": {"to": [0.02], "along": 90.0}}
    assert resolve(config_from_mapping(sections | {"loading": along})).physics.slides


def test_the_track() -> None:
    """Distances are those from the nearest place of the tip's axis; the patch follows it."""
    track = TipTrack((1.0, 2.0), 0, -0.5, 1.0)
    points = [[0.0, 2.0], [1.7, 2.3], [3.0, 2.0], [0.7, 1.5]]

    assert track.distance(np.array(points)) == pytest.approx([0.5, 0.3, 1.0, 0.5])
    assert track.position(0.25) == (1.25, 2.0)
    scene = resolve(config_from_mapping(SECTIONS))
    still = SECTIONS | {"loading": {"delta": 0.01, "steps": 2}}
    without = resolve(config_from_mapping(still))
    assert scene.sizes.track and not without.sizes.track
    assert scene.plan.prediction["cells"] > without.plan.prediction["cells"]

    def size(sizes: Any, x: float) -> float:
        formula = size_formula(sizes, 2).replace("^", "**")
        functions = {"Abs": abs, "Sqrt": np.sqrt}
        return float(eval(formula, functions | {"x": x, "y": 0.0}))

    patch = scene.sizes.fine_radius
    assert size(scene.sizes, 2.02 + patch) == pytest.approx(scene.sizes.h_contact)
    assert size(scene.sizes, 1.98 - patch - 0.1) == pytest.approx(
        scene.sizes.h_contact + 0.1 * scene.sizes.grading
    )
