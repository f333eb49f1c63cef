"""Bodies that adhere to the flat on which they rest: which contact is lost first, and when."""

from __future__ import annotations

import csv
import json
from math import pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.process.errors import ConfigError
from indent_sim.run.pipeline import simulate

NU = 0.3
E_STAR = 1 / (1 - NU**2)
SPHERE = {"shape": "sphere", "R": 1 / 3}
BALL = {"shape": "ball", "radius": 1.0, "base": "unbonded"}
Rows = dict[str, np.ndarray]


def document(body: dict[str, Any], adhesion: dict[str, float], **sections: Any) -> dict[str, Any]:
    return {
        "body": body,
        "material": {"model": "linear_elastic", "E": 1.0, "nu": NU},
        "indenter": SPHERE,
        "loading": {"delta": 2e-5, "steps": 1},
        "experiment": {"adhesion": adhesion},
        "output": {"fields": "none", "plot": False},
        **sections,
    }


def experiment(folder: Path, *scene: Any, **sections: Any) -> tuple[dict[str, Any], Rows]:
    """Run a scene; return the adhesion in run.json, and the stable rows of experiment.csv."""
    simulate(document(*scene, **sections), directory=folder)
    report = json.loads((folder / "run.json").read_text())["experiment"]["adhesion"]
    with (folder / "experiment.csv").open() as lines:
        table = [row for row in csv.DictReader(lines) if row["branch"] == "stable"]
    names = [name for name in ("delta", "force", "a", "a_base") if name in table[0]]
    return report, {name: np.array([float(row[name]) for row in table]) for name in names}


def at_force(force: float, rows: Rows, name: str) -> float:
    """Return a column at a force, beyond the largest tension."""
    growing = slice(int(np.argmin(rows["force"])), None)
    return float(np.interp(force, rows["force"][growing], rows[name][growing]))


def jkr(force: float, R: float, work: float) -> np.ndarray:
    """Return radius and approach of a stable contact on a half-space: Johnson (1985), 5.5."""
    root = sqrt(6 * pi * work * R * force + (3 * pi * work * R) ** 2)
    a = (0.75 * R / E_STAR * (force + 3 * pi * work * R + root)) ** (1 / 3)
    return np.array([a, a * a / R - sqrt(2 * pi * work * a / E_STAR)])


@pytest.mark.parametrize(
    ("body", "base_work", "lost"),
    [
        (BALL, 3e-8, "tip"),
        (BALL, 1e-9, "base"),
        ({"shape": "ellipsoid", "radius": 1.0, "height": 4.0, "base": "unbonded"}, 2e-9, "base"),
    ],
)
def test_small_contacts_are_two_jkr_contacts_in_series(
    tmp_path: Path, body: dict[str, Any], base_work: float, lost: str
) -> None:
    """Each has a radius of its own. Contacts of a/R = 0.002 to 0.007 displace each other.

    Measured: pull-off force 4e-4, depth 7e-4, radii 5e-4.
    """
    work = 1e-8
    report, rows = experiment(tmp_path / "run", body, {"work": work, "base_work": base_work})
    base_radius = 2 / body.get("height", 2.0)
    tip_radius = 1 / (3 + 1 / base_radius)
    assert report["lost_contact"] == lost
    pull_off = -1.5 * pi * min(tip_radius * work, base_radius * base_work)
    assert report["pull_off"]["force_control"]["force"] == pytest.approx(pull_off, rel=1e-3)
    for k in (-1, -10):
        upper = jkr(rows["force"][k], tip_radius, work)
        lower = jkr(rows["force"][k], base_radius, base_work)
        assert rows["delta"][k] == pytest.approx(upper[1] + lower[1], rel=2e-3)
        assert rows["a"][k] == pytest.approx(upper[0], rel=2e-3)
        assert rows["a_base"][k] == pytest.approx(lower[0], rel=2e-3)


@pytest.mark.parametrize("shape", [{"shape": "ball"}, {"shape": "ellipsoid", "height": 1.0}])
def test_equal_contacts_are_those_of_half_a_body_by_symmetry(
    tmp_path: Path, shape: dict[str, Any]
) -> None:
    """Plate above and flat below with one work: the mid-plane is a mirror plane of large contacts.

    The half has one contact, with the whole compliance of its own mesh. Radii are 0.2 to 0.3 of the
    ball's. Measured: depth 2e-4 of the deepest, radius 3e-4, pull-off 2e-4. The contacts of the
    ellipsoid are nearly as wide as it is high: depth 4e-3, where the run states an error of 6e-3,
    radius 7e-3.
    """
    work, delta = 1e-3, 0.1
    half = {**shape, "radius": 1.0, "base": "roller"}
    rest = {**half, "base": "unbonded"}
    sections: dict[str, Any] = {"indenter": {"shape": "plate"}, "loading": {"delta": delta}}
    # The flat is a little stronger, so that the tip lets go.
    both_works = {"work": work, "base_work": work * (1 + 1e-6)}
    report, rows = experiment(tmp_path / "rest", rest, both_works, **sections)
    half_report, half_rows = experiment(tmp_path / "half", half, {"work": work}, **sections)
    pulls = [one["pull_off"]["force_control"]["force"] for one in (report, half_report)]
    assert pulls[0] == pytest.approx(pulls[1], rel=1e-3)
    depth_error = (report["series_error"] + 5e-4) * delta
    for force in np.linspace(0.0, 0.95, 4) * rows["force"][-1]:
        depths = [at_force(force, table, "delta") for table in (rows, half_rows)]
        assert depths[0] == pytest.approx(depths[1], abs=depth_error)
        a, a_half = (at_force(force, table, "a") for table in (rows, half_rows))
        assert a == pytest.approx(a_half, rel=2 * report["series_error"] + 2e-3)
        assert at_force(force, rows, "a_base") == pytest.approx(a, rel=2e-3)


def test_a_spring_pulls_the_tip_off(tmp_path: Path) -> None:
    """A soft cantilever loses the contact at the force of force control.

    Adhesion has drawn the body to the flat before the tip touches it. The sum of small contacts is
    exact to far less than the mesh.
    """
    adhesion = {"work": 1e-8, "base_work": 3e-8}
    given = {"adhesion": adhesion, "cantilever": {"stiffness": 1e-9}}
    simulate(document(BALL, adhesion, experiment=given), directory=tmp_path / "run")
    report = json.loads((tmp_path / "run" / "run.json").read_text())["experiment"]
    assert 0 < report["adhesion"]["series_error"] < 1e-5
    assert report["adhesion"]["words"].startswith("at pull-off the tip leaves the body")
    pull_off = report["adhesion"]["pull_off"]["force_control"]["force"]
    assert report["cantilever"]["jump_out"]["force"] == pytest.approx(pull_off, rel=1e-6)
    drawn = jkr(0.0, 1.0, adhesion["base_work"])[1]
    assert report["cantilever"]["jump_in"]["z"] == pytest.approx(drawn, rel=2e-3)


def test_a_weakly_held_body_leaves_the_flat_as_soon_as_the_tip_touches_it(tmp_path: Path) -> None:
    """Where the tip touches the body, no equilibrium of both contacts exists."""
    adhesion = {"work": 1e-8, "base_work": 1e-9}
    outcome = simulate(document(BALL, adhesion), directory=tmp_path / "run")
    assert any("tears the body off the flat" in warning for warning in outcome.report["warnings"])


CAP = {"shape": "cap", "base_radius": 1.0, "height": 0.5, "base": "unbonded"}
REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "no adhesion below": (
        document(BALL, {"work": 1e-4}),
        "lifted off by a tip .* give experiment.adhesion.base_work",
    ),
    "a cap": (document(CAP, {"work": 1e-4, "base_work": 1e-4}), "separates all at once"),
    "a range": (
        document(BALL, {"work": 1e-4, "base_work": 1e-4, "range": 1e-3}),
        "experiment.adhesion.range: .* this body has two",
    ),
    "a bonded ball": (
        document({**BALL, "base": "fixed"}, {"work": 1e-4, "base_work": 1e-4}),
        "base_work: .* a ball with base fixed",
    ),
    "a half-space": (
        document({"shape": "half_space"}, {"work": 1e-4, "base_work": 1e-4}),
        "a half_space, which has no base",
    ),
    "attraction with a range": (
        document(BALL, {}, contact={"adhesion": {"work": 1e-4, "range": 0.01}}, experiment=None),
        "short range only",
    ),
    "nothing": (document(BALL, {"work": 1e-4, "base_work": 0.0}), "base_work: must be > 0"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_not_modelled_is_refused(name: str) -> None:
    sections, message = REFUSED[name]
    with pytest.raises(ConfigError, match=message):
        config_from_mapping(sections)
