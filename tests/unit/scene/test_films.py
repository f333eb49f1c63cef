"""Drainage films at drained faces: their error, their elements, and their warnings."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.linalg import solve_banded

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.process.errors import ConfigError
from indent_sim.run.explicit_config import explicit_config
from indent_sim.scene.path_rows import path_rows
from indent_sim.scene.resolution import coarsened_sizes
from indent_sim.scene.scene import Scene, resolve
from indent_sim.theory.drained_layer import drained_length, excess_length

POROUS = {"model": "linear_elastic", "E": 1.0, "nu": 0.2, "flow": {"diffusivity": 1.0}}
BASE: dict[str, Any] = {
    "body": {"shape": "cylinder", "radius": 4.0, "height": 1.0, "base": "fixed", "sides": "roller"},
    "material": POROUS,
    "indenter": {"shape": "paraboloid", "R": 1.0},
    "drainage": {"surface": "drained", "tip": "drained", "base": "sealed", "sides": "sealed"},
    "loading": {"history": [[0, 0], [1e-5, 0.02]], "times": [1e-5]},
}


def scene(**changes: Any) -> Scene:
    return resolve(config_from_mapping(BASE | changes))


def drained_faces(found: Scene) -> list[str]:
    return [film.side.surface for film in found.sizes.drained_faces]


@pytest.mark.parametrize("over", [0.0, 1.0])
@pytest.mark.parametrize("h", [0.1, 1.0, 10.0])
def test_the_excess_is_that_of_a_row_of_elements(over: float, h: float) -> None:
    """The estimated excess outflow bounds that of a half-space of linear elements closely.

    Linear elements of the height h (D t)^(1/2) are solved in 400 backward Euler steps, which cost
    2e-3.
    """
    cells, steps, D = 400, 400, 1.0
    dt = 1.0 / steps
    mass, stiff = np.full((2, cells), 0.0), D * dt / h
    mass[0], mass[1] = 2 / 3 * h, h / 6
    p, lost = np.zeros(cells), 0.0
    before = np.zeros(cells)
    bands = np.zeros((3, cells))
    bands[0, 1:] = bands[2, :-1] = h / 6 - stiff
    bands[1] = 2 / 3 * h + 2 * stiff
    bands[1, -1] = h / 3 + stiff
    content = np.zeros(cells)
    for k in range(1, steps + 1):
        load = min(k / steps / over, 1.0) if over else 1.0
        rise = load - (min((k - 1) / steps / over, 1.0) if over else float(k > 1))
        source = np.full(cells, h * rise)
        source[-1] = h / 2 * rise
        content = mass[0] * before
        content[-1] = h / 3 * before[-1]
        content[1:] += mass[1][1:] * before[:-1]
        content[:-1] += mass[1][1:] * before[1:]
        p = solve_banded((1, 1), bands, content + source)
        before = p
    whole = np.full(cells, h)
    whole[-1] = h / 2
    lost = float(
        whole.sum() + h / 2 - whole @ p
    )  # the first vertex, at the face, has lost all that is its own
    right = float(drained_length(D, np.array([1.0]), np.array([over]))[0])
    said = float(excess_length(np.array([h]), np.array([right]))[0])
    excess = lost - right
    assert excess <= said * 1.02 + 2e-3
    assert excess >= said / 1.7 - 2e-3


def test_what_has_drained_of_a_ramp_is_the_mean_of_jumps() -> None:
    t, over = 1.0, 0.4
    begins = (np.arange(1000) + 0.5) / 1000 * over
    of_jumps = drained_length(2.0, t - begins, np.zeros(1000)).mean()
    assert drained_length(2.0, np.array([t]), np.array([over]))[0] == pytest.approx(
        of_jumps, rel=1e-6
    )


def test_elements_shrink_towards_drained_faces_as_the_first_row_asks() -> None:
    early, late = scene(), scene(loading={"history": [[0, 0], [0.1, 0.02]], "times": [0.1]})
    assert drained_faces(early) == ["top"] and early.sizes.h_film is not None
    assert early.sizes.h_film < early.sizes.h_contact / 2
    assert late.sizes.h_film is None or late.sizes.h_film > 2 * early.sizes.h_film


def test_every_drained_face_has_its_elements() -> None:
    drainage = {"surface": "drained", "tip": "drained", "base": "drained", "sides": "drained"}
    disc = scene(
        body={"shape": "cylinder", "radius": 1.0, "height": 0.5, "base": "roller", "sides": "free"},
        indenter={"shape": "flat_punch", "radius": 1.0},
        drainage=drainage,
    )
    assert sorted(drained_faces(disc)) == ["base", "r_max", "top"]
    assert (
        drained_faces(
            scene(drainage=drainage | {"tip": "sealed", "base": "sealed", "sides": "sealed"})
        )
        == []
    )


def test_a_mesh_has_the_elements_of_its_film() -> None:
    """The elements at a drained face have the requested height within 50 %."""
    found = scene()
    grid = found.grid()
    top = grid.points[(grid.points[:, 1] == 0) & (grid.points[:, 0] < found.sizes.fine_radius), 0]
    assert np.diff(np.sort(top)).mean() == pytest.approx(found.sizes.h_film, rel=0.5)


def test_films_get_finer_with_the_accuracy_and_coarser_in_companions() -> None:
    fine, coarse = scene(accuracy=0.001), scene(accuracy=0.05)
    assert fine.sizes.h_film and (
        coarse.sizes.h_film is None or fine.sizes.h_film < coarse.sizes.h_film / 3
    )
    companion = coarsened_sizes(fine.sizes, 1.6, 1.0)
    assert companion.h_film is not None and companion.h_film > 1.5 * fine.sizes.h_film
    assert companion.drained_faces[0].h == pytest.approx(companion.h_film)


def test_a_resolved_scene_has_the_same_films() -> None:
    config = config_from_mapping(BASE)
    first = resolve(config)
    again = resolve(explicit_config(config, first))
    assert again.sizes == first.sizes


def test_a_given_mesh_is_warned_of_ramps_as_of_jumps() -> None:
    given = {"h_contact": 0.015}
    ramp, jump = (
        scene(mesh=given),
        scene(mesh=given, loading={"history": [[0, 0], [0, 0.02], [1e-5, 0.02]]}),
    )
    for found in (ramp, jump):
        (said,) = [doubt for doubt in found.plan.model_warnings if doubt.key == "early"]
        assert "h_film" in said.message
    assert not any(doubt.key == "early" for doubt in scene().plan.model_warnings)
    finer = scene(mesh=given | {"h_film": 0.001})
    assert not any(doubt.key == "early" for doubt in finer.plan.model_warnings)


def test_a_film_needs_a_contact_size() -> None:
    with pytest.raises(ConfigError, match="h_film"):
        scene(mesh={"h_film": 0.001})


def test_rows_know_what_has_changed_before_them() -> None:
    """Every row lists the changes of a history before it, the last one as far as it has come."""
    loading = {"history": [[0, 0], [1, 0.02], [2, 0.02], [3, 0.01]], "times": [0.5, 2.0, 2.5]}
    rows = path_rows(scene(loading=loading).physics.path)
    assert [row.value for row in rows] == pytest.approx([0.5, 1.0, 0.75])
    assert rows[0].changes == pytest.approx([0.5]) and rows[0].elapsed == pytest.approx([0.5])
    assert rows[1].changes == pytest.approx([1.0]) and rows[1].durations == pytest.approx([1.0])
    assert rows[2].changes == pytest.approx([1.0, 0.25]) and rows[2].elapsed == pytest.approx(
        [2.5, 0.5]
    )
