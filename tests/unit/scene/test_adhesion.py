"""Scenes of an adhesive tip: refusals, and elements that resolve the cohesive zone."""

from __future__ import annotations

from math import pi
from typing import Any

import pytest
from scenes import CYLINDER, E_STAR, STRIP, WALLED, scene

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.model.adhesion import Adhesion
from indent_sim.process.errors import ConfigError
from indent_sim.run.explicit_config import explicit_config
from indent_sim.scene.scene import resolve
from indent_sim.theory.maugis import maugis_pull_off

THICK = {"shape": "cylinder", "radius": 200.0, "height": 200.0, "base": "fixed", "sides": "roller"}
WORK, RANGE = 1e-3, 1e-2
ZONE = pi / 4 * E_STAR * RANGE**2 / WORK


def sticky(reach: float | None = RANGE, body: Any = WALLED, **more: Any) -> Any:
    adhesion = {"work": WORK} | ({} if reach is None else {"range": reach})
    return scene(body, contact={"adhesion": adhesion}, **more)


@pytest.mark.parametrize("method", ["penalty", "uzawa", "nitsche", "active_set"])
def test_methods_without_adhesion_refuse_it(method: str) -> None:
    with pytest.raises(ConfigError, match=method) as refusal:
        scene(WALLED, contact={"method": method, "adhesion": {"work": WORK, "range": RANGE}})
    assert refusal.value.key == "contact.adhesion"


def test_adhesion_with_friction_is_refused() -> None:
    with pytest.raises(ConfigError, match="together with friction") as refusal:
        scene(WALLED, contact={"friction": 0.3, "adhesion": {"work": WORK, "range": RANGE}})
    assert refusal.value.key == "contact.adhesion"


def test_no_range_points_to_its_limit() -> None:
    with pytest.raises(ConfigError, match="limit") as refusal:
        sticky(0.0)
    assert refusal.value.key == "contact.adhesion.range" and "experiment.adhesion" in (
        refusal.value.remedy or ""
    )


def test_a_missing_range_names_the_smallest_on_this_mesh() -> None:
    """The refusal of a missing range names the smallest one that the mesh resolves.

    That is h = 1.5 l with l = (pi/4) E* range^2/work.
    """
    with pytest.raises(ConfigError, match="is missing") as refusal:
        sticky(None, mesh={"h_contact": 0.01})
    smallest = (4 / pi * WORK * 0.01 / 1.5 / E_STAR) ** 0.5
    assert f"at least {smallest:.3g}" in (refusal.value.remedy or "")


def test_elements_beyond_one_and_a_half_cohesive_zones_are_refused() -> None:
    h = 1.4 * ZONE
    sticky(mesh={"h_contact": h})
    with pytest.raises(ConfigError, match="do not resolve") as refusal:
        sticky(mesh={"h_contact": 1.6 * ZONE})
    assert refusal.value.key == "contact.adhesion.range" and "mesh.h_contact" in (
        refusal.value.remedy or ""
    )


def test_a_range_too_short_for_any_mesh_is_refused() -> None:
    with pytest.raises(ConfigError, match="too short for a mesh") as refusal:
        sticky(1e-5)
    assert "experiment.adhesion" in (refusal.value.remedy or "")


@pytest.mark.parametrize("reach", [0.004, RANGE, 0.05])
def test_two_elements_or_more_in_the_cohesive_zone(reach: float) -> None:
    found = sticky(reach)
    assert found.sizes.h_contact <= ZONE * (reach / RANGE) ** 2 / 2 * (1 + 1e-9)
    assert "cohesive zone" in next(
        choice.why for choice in found.plan.choices if choice.key == "contact.adhesion"
    )


def test_a_sharp_cone_has_elements_for_its_wider_contact() -> None:
    """The element sizes of an adhesive cone fit JKR's wider contact."""
    tip, loading = {"shape": "cone", "half_angle": 70.0}, {"delta": 0.02}
    plain = scene(WALLED, indenter=tip, loading=loading)
    found = sticky(indenter=tip, loading=loading)
    assert found.sizes.a > 1.3 * plain.sizes.a
    assert (
        found.plan.adhesion
        and found.plan.adhesion.tabor is None
        and found.plan.adhesion.jkr_pull_off
    )


def test_elements_are_counted_in_the_contact_that_adhesion_makes() -> None:
    """No warning counts elements in the narrower contact without adhesion.

    A blunt cone pulls the body up; the contact at a depth of 0.02 would have 0.92 elements without
    it.
    """
    scene_of = {
        "body": CYLINDER | {"radius": 4.0, "height": 2.0},
        "indenter": {"shape": "cone", "half_angle": 80.0},
        "loading": {"deltas": [-0.2, 0.02, -0.2]},
        "mesh": {"h_contact": 0.08},
    }
    assert any("elements" in words for words in scene(**scene_of).plan.warnings)
    sticky = scene(**scene_of, contact={"adhesion": {"work": 0.01, "range": 0.05}})
    assert not [words for words in sticky.plan.warnings if "elements" in words]


def test_forces_size_the_mesh_for_the_contact_that_they_hold() -> None:
    """A prescribed force of zero sizes the mesh for JKR's contact radius.

    On a half-space it is (6 pi work R^2/K)^(1/3) with K = 4 E*/3.
    """
    found = sticky(body=THICK, loading={"forces": [0.0]})
    a = found.sizes.a * found.physics.scales.length
    assert a == pytest.approx((6 * pi * WORK / (4 / 3 * E_STAR)) ** (1 / 3), rel=1e-3)


def test_what_is_known_of_the_pull_beforehand() -> None:
    """The predicted pull-off is Maugis-Dugdale's and JKR's on a thick body, and none elsewhere.

    JKR's is -3/2 pi work R.
    """
    thick, thin = (
        sticky(body=THICK).plan.adhesion,
        sticky(body=THICK | {"height": 0.05}).plan.adhesion,
    )
    assert thick and thin
    assert thick.jkr_pull_off == pytest.approx(-1.5 * pi * WORK, rel=1e-3)
    assert thick.maugis_lambda and thick.maugis_pull_off
    assert thick.maugis_pull_off == pytest.approx(
        maugis_pull_off(thick.maugis_lambda) * pi * WORK, rel=1e-12
    )
    assert thick.cohesive_zone == pytest.approx(ZONE, rel=1e-12)
    assert (
        thin.maugis_pull_off is None and thin.jkr_pull_off and thin.jkr_pull_off < -1.6 * pi * WORK
    )


def test_forces_below_zero_need_adhesion() -> None:
    assert sticky(loading={"forces": [1e-3, -1e-3]}).physics.path.values[1] < 0
    with pytest.raises(ConfigError, match="there is no adhesion") as refusal:
        scene(WALLED, loading={"forces": [1e-3, -1e-3]})
    assert refusal.value.key == "loading.forces[1]" and "contact.adhesion" in (
        refusal.value.remedy or ""
    )


def test_the_condensed_body_is_refused() -> None:
    with pytest.raises(ConfigError, match="does not support adhesion with a range") as refusal:
        sticky(solver={"method": "condensed"})
    assert refusal.value.key == "solver.method"


def test_plane_strain_is_refused() -> None:
    with pytest.raises(ConfigError, match="plane strain") as refusal:
        sticky(body=STRIP)
    assert refusal.value.key == "contact.adhesion"


def test_an_experiment_wants_a_curve_without_adhesion() -> None:
    with pytest.raises(ConfigError, match="without friction and adhesion"):
        sticky(experiment={"adhesion": {"work": WORK}})


def test_theory_knows_no_range() -> None:
    assert sticky(body={"shape": "half_space"}).method == "augmented_lagrangian"
    with pytest.raises(ConfigError, match="does not include adhesion with a range"):
        sticky(solver={"method": "theory"})


def test_a_resolved_scene_is_the_same_scene() -> None:
    given = {
        "body": WALLED,
        "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.3},
        "indenter": {"shape": "paraboloid", "R": 1.0},
        "loading": {"deltas": [-0.01, 0.01]},
        "contact": {"adhesion": {"work": WORK, "range": RANGE}},
    }
    config = config_from_mapping(given)
    found = resolve(config)
    again = resolve(explicit_config(config, found))
    assert again.physics.contact == found.physics.contact and again.sizes == found.sizes
    assert (
        found.physics.contact.is_path_dependent
        and not found.physics.has_friction
        and not found.physics.columns
    )


def test_the_attraction_is_the_slope_of_its_energy_and_its_integral_the_work() -> None:
    import numpy as np

    law, g = Adhesion(WORK, RANGE), np.linspace(-0.02, 0.3, 20001)
    slope = np.gradient(law.energy(g), g)
    # of differences over range/600; half of one across the kink at g = 0
    assert slope[1:-1] == pytest.approx(law.attraction(g)[1:-1], rel=1e-3, abs=1e-5 * WORK / RANGE)
    assert float(law.energy(30 * RANGE) - law.energy(0.0)) == pytest.approx(WORK, rel=1e-12)


@pytest.mark.parametrize("model", ["linear_elastic", "neo_hookean"])
@pytest.mark.parametrize("body", [{"shape": "half_space"}, WALLED], ids=["half_space", "layer"])
def test_nothing_presses_but_the_attraction(body: Any, model: str) -> None:
    """Predictions of a free tip and of a tip held at first touch are JKR's closed forms.

    A free tip has a0^3 = 9 pi work R^2/(2 E*) and delta = a0^2/(3 R); a held one has the force -4/3
    pi work R.
    """
    given = {"body": body, "material": {"model": model, "E": 1.0, "nu": 0.3}}
    free, held = (
        sticky(**given, loading=path).plan.prediction
        for path in ({"forces": [0, 0]}, {"deltas": [0, 0]})
    )
    if body != WALLED:  # of which JKR's formulas are
        radius = (4.5 * pi * WORK / E_STAR) ** (1 / 3)
        assert (free["a"], free["delta_JKR"]) == pytest.approx((radius, radius**2 / 3), rel=1e-6)
        assert held["force_JKR"] == pytest.approx(-4 / 3 * pi * WORK, rel=1e-6)
    assert free["a"] > held["a"] > 0
