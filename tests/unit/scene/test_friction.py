"""Scenes with friction: refusals, the slip reference, and the effect of no slip."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.model.tips import FlatPunch
from indent_sim.process.errors import ConfigError
from indent_sim.run.explicit_config import explicit_config
from indent_sim.scene.no_slip_effect import NoSlipEffect, tensile_rim_width
from indent_sim.scene.scene import Scene, resolve

CYLINDER = {"shape": "cylinder", "radius": 4.0, "height": 1.0, "base": "fixed", "sides": "roller"}
STRIP = {"shape": "strip", "width": 4.0, "height": 1.0, "base": "roller", "sides": "free"}
SOFT = {"model": "linear_elastic", "E": 1.0, "nu": 0.3}


def config(contact: dict[str, Any], **sections: Any) -> Any:
    tip = {"shape": "paraboloid", "R": 1.0}
    return config_from_mapping(
        {
            "body": CYLINDER,
            "material": SOFT,
            "indenter": tip,
            "contact": contact,
            "loading": {"delta": 0.01},
        }
        | sections
    )


def scene(contact: dict[str, Any], **sections: Any) -> Scene:
    return resolve(config(contact, **sections))


@pytest.mark.parametrize("method", ["uzawa", "nitsche", "active_set"])
@pytest.mark.parametrize(
    "key", [{"friction": 0.3}, {"epsilon_t": 1.0}], ids=["friction", "epsilon_t"]
)
def test_methods_without_friction_refuse_its_keys(method: str, key: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match=method) as refusal:
        config({"method": method, **key})
    assert refusal.value.key == f"contact.{next(iter(key))}"


@pytest.mark.parametrize("friction", [-0.1, 5.1, "slip", True, [0.3], ".inf"])
def test_no_such_friction(friction: Any) -> None:
    with pytest.raises(ConfigError) as refusal:
        config({"friction": friction})
    assert refusal.value.key == "contact.friction"
    assert "stick" in (refusal.value.remedy or "") or "stick" in refusal.value.problem


def test_epsilon_t_without_friction_is_refused() -> None:
    with pytest.raises(ConfigError, match="applies only with friction") as refusal:
        config({"epsilon_t": 2.0})
    assert refusal.value.key == "contact.epsilon_t"


def test_a_body_that_may_slide_away_is_refused() -> None:
    with pytest.raises(ConfigError, match="no support prevents sliding") as refusal:
        scene(
            {"friction": 0.3},
            body=STRIP,
            indenter={"shape": "paraboloid", "R": 1.0, "center": [1.5]},
        )
    assert refusal.value.key == "contact.friction"


def test_theory_knows_no_friction() -> None:
    body = {"shape": "half_space"}
    assert scene({}, body=body).method == "theory"
    assert scene({"friction": 0.3}, body=body).method == "augmented_lagrangian"
    with pytest.raises(ConfigError, match="does not include friction"):
        scene({"friction": 0.3}, body=body, solver={"method": "theory"})


@pytest.mark.parametrize(
    ("friction", "anchor"), [(0.0, "implicit"), (0.3, "implicit"), (0.31, "mid"), ("stick", "mid")]
)
def test_new_contact_sticks_half_way_where_it_matters(friction: float | str, anchor: str) -> None:
    found = scene({"friction": friction}).physics
    assert found.slip_reference == anchor
    assert found.contact.is_path_dependent == bool(friction)


def test_a_run_says_the_friction_that_it_had() -> None:
    """The written config has the friction of the run with its epsilon_t, or auto without it."""
    rough, smooth = config({"friction": "stick"}), config({})
    contact = explicit_config(rough, resolve(rough)).contact
    assert contact.friction == "stick" and contact.epsilon_t == contact.epsilon_n
    assert explicit_config(smooth, resolve(smooth)).contact.epsilon_t == "auto"


def test_epsilon_t_is_measured_in_the_scenes_units() -> None:
    """epsilon_t has the units of the scene."""
    small = scene({"friction": 0.3, "epsilon_t": 7.0}).physics
    large = scene(
        {"friction": 0.3, "epsilon_t": 7.0 * 1e6 / 1e3},
        body=CYLINDER | {"radius": 4e3, "height": 1e3},
        material=SOFT | {"E": 1e6},
        indenter={"shape": "paraboloid", "R": 1e3},
        loading={"delta": 10.0},
    ).physics
    assert large.contact.epsilon_t == pytest.approx(small.contact.epsilon_t, rel=1e-12)


def test_what_stick_would_change() -> None:
    """The no-slip effect is exact on a half-space, a range on a bonded layer, and else unknown.

    It is not stated where friction is modelled.
    """
    exact = scene({}, body={"shape": "half_space"}).plan.stick
    assert exact and exact.percent == pytest.approx(1.6213, abs=1e-4)
    thin = scene({}, material=SOFT | {"nu": 0.49}, loading={"delta": 0.3}).plan.stick
    assert thin and thin.percent is None and thin.low <= 4.4 <= thin.high
    assert "%" in thin.sentence and thin.is_noticeable
    assert scene({"friction": 0.3}).plan.stick is None
    assert scene({}, body=CYLINDER | {"base": "roller"}).plan.stick is None


SPHERE = {"shape": "sphere", "R": 1.0}


@pytest.mark.parametrize(
    "beyond",
    [
        {
            "material": {"model": "neo_hookean", "E": 1.0, "nu": 0.49},
            "indenter": SPHERE,
            "loading": {"delta": 0.3},
        },
        {"material": SOFT | {"nu": 0.49}, "contact": {"gap": "current"}, "loading": {"delta": 0.3}},
        {
            "material": {"model": "neo_hookean", "E": 1.0, "nu": 0.3},
            "body": {"shape": "half_space"},
        },
    ],
    ids=["finite strain", "current gap", "half-space"],
)
def test_beyond_small_strain_stick_has_no_number(beyond: dict[str, Any]) -> None:
    """Beyond small strain the no-slip effect has no number, and --error-bars is advised.

    The sphere would gain 10.0 %, where the map at small strain has less than five.
    """
    said = scene(**({"contact": {}} | beyond)).plan.stick
    assert said and said.is_noticeable and (said.percent, said.low, said.high) == (None, None, None)
    assert "%" not in said.sentence and "--error-bars" in said.sentence


def test_what_error_bars_do_not_solve_they_do_not_promise() -> None:
    """--error-bars is advised only where the no-slip effect is solved: on a factorized body."""
    box = {
        "body": {"shape": "box", "size": [8.0, 8.0, 1.0], "base": "fixed"},
        "mesh": {"h_contact": 0.2},
        "material": {"model": "neo_hookean", "E": 1.0, "nu": 0.45},
        "loading": {"delta": 0.2},
    }
    for linear, promised in (("direct", True), ("iterative", False)):
        said = scene({}, solver={"linear": linear}, **box).plan.stick
        assert said and ("--error-bars" in said.sentence) == promised


def test_what_would_not_tell_at_small_strain_is_not_said() -> None:
    """A thick and nearly incompressible body has no stated no-slip effect."""
    material = {"model": "neo_hookean", "E": 1.0, "nu": 0.49}
    assert scene({}, material=material, loading={"delta": 0.001}).plan.stick is None


def test_a_change_that_rounds_to_nothing_has_no_sign_and_no_range() -> None:
    assert "by +0.0 % (a map)" in NoSlipEffect(None, -0.04, -0.01, "a map").sentence
    assert "by +0.0 % (a map)" in NoSlipEffect(-0.02, -0.04, -0.01, "a map").sentence
    assert "between -0.1 and +0.2 % (a map)" in NoSlipEffect(None, -0.1, 0.2, "a map").sentence


def test_a_cone_is_looked_up_at_its_own_radius() -> None:
    """The no-slip effect of a cone lies in its range of the map, at its own contact radius.

    1.72 % was solved at 2.21 thicknesses, between two columns of the map.
    """
    wide = {"body": CYLINDER | {"radius": 12.0}, "indenter": {"shape": "cone", "half_angle": 80.0}}
    said = scene({}, material=SOFT | {"nu": 0.4}, loading={"delta": 0.4}, **wide).plan.stick
    assert said and said.low is not None and said.high is not None
    assert said.low < 1.72 < said.high < 2.5


HALF_SPACE = {"shape": "half_space"}


@pytest.mark.parametrize(("friction", "force"), [("stick", 1.016213), (0.3, 1.01446)])
def test_what_friction_changes_on_a_half_space(friction: float | str, force: float) -> None:
    """The friction correction on a half-space is that of superposed punches.

    It is stated where theory has this very problem.
    """
    known = scene({"friction": friction}, body=HALF_SPACE).plan.friction
    assert known and known.force == pytest.approx(force, abs=2e-5)
    assert 0.8 < known.sticks <= 1.0
    forced = scene(
        {"friction": friction}, body=HALF_SPACE, loading={"forces": [1e-3, 2e-3, 1e-3]}
    ).plan.friction
    assert forced == known


@pytest.mark.parametrize(
    "unknown",
    [
        {"body": CYLINDER},
        {"loading": {"deltas": [0.01, 0.005, 0.02]}},
        {"contact": {"friction": 5.0}},
        {"contact": {}},
        {"indenter": {"shape": "cone", "half_angle": 70.0, "tip_radius": 0.1}},
        {"body": HALF_SPACE | {"layers": [{"thickness": 1.0, "material": SOFT | {"E": 2.0}}, {}]}},
    ],
    ids=["layer", "turns back", "much", "none", "rounded", "layers"],
)
def test_where_nobody_knows_what_friction_changes(unknown: dict[str, Any]) -> None:
    sections = {"contact": {"friction": 0.3}, "body": HALF_SPACE} | unknown
    contact = sections.pop("contact")
    assert scene(contact, **sections).plan.friction is None


@pytest.mark.parametrize(
    ("nu", "h", "friction"),
    [(0.0, 0.004, "stick"), (0.0, 0.002, 5.0), (0.3, 1e-4, "stick"), (0.5, 1e-4, "stick")],
)
def test_a_surface_that_would_pull_slips_a_little(
    nu: float, h: float, friction: float | str
) -> None:
    """No slip under a sharp edge becomes a large friction where elements resolve the tension.

    Without a bound of the traction there is no equilibrium there.
    """
    punch = {"shape": "flat_punch", "radius": 0.1}
    found = scene(
        {"friction": "stick"}, material=SOFT | {"nu": nu}, indenter=punch, mesh={"h_contact": h}
    )
    assert found.physics.contact.friction == friction
    said = next(choice for choice in found.plan.choices if choice.key == "contact.friction")
    assert ("in place of stick" in said.why) == (friction == 5.0)
    rounded = scene(
        {"friction": "stick"},
        material=SOFT | {"nu": nu},
        indenter=punch | {"edge_radius": 0.01},
        mesh={"h_contact": h},
    )
    assert rounded.physics.contact.friction == "stick"


@pytest.mark.parametrize(
    ("nu", "dim", "is_seen"), [(0.1, 2, False), (0.1, 3, True), (0.4, 2, False), (0.4, 3, False)]
)
def test_elements_that_cross_the_edge_see_the_rim_that_would_pull(
    nu: float, dim: int, is_seen: bool
) -> None:
    """Facets in three dimensions see the tensile rim at nu = 0.1, and not at 0.4, as measured."""
    sizes = SimpleNamespace(punch_edge=0.1, h_edge=0.01)
    assert (tensile_rim_width(FlatPunch(0.1), nu, sizes, dim) > 0) == is_seen  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("method", "smallest"), [("auto", 0.01), ("augmented_lagrangian", 0.01), ("penalty", 0.1)]
)
@pytest.mark.parametrize("friction", [0.1, "stick"])
def test_a_surface_held_too_softly_is_refused(
    method: str, smallest: float, friction: float | str
) -> None:
    """A too small epsilon_t is refused, and the smallest value in the remedy is accepted.

    The surface would slip where it should stick, and the force would be that without friction.
    """
    mesh = {"h_contact": 0.01}
    with pytest.raises(ConfigError, match=f"below {smallest:g} ") as refusal:
        scene({"method": method, "friction": friction, "epsilon_t": 1e-4}, mesh=mesh)
    assert refusal.value.key == "contact.epsilon_t"
    least = smallest * 1.0 / (1 - 0.3**2) / 0.01
    assert f"at least {least:.4g}" in (refusal.value.remedy or "")
    scene({"method": method, "friction": friction, "epsilon_t": 1.001 * least}, mesh=mesh)


@pytest.mark.parametrize(
    ("contact", "said"),
    [
        (
            {"method": "penalty", "epsilon_t": 50.0},
            "about 47% of what friction adds to the force is lost",
        ),
        ({"method": "penalty"}, None),
        ({"method": "auto", "epsilon_t": 1.4e4}, "friction adds about 7% more"),
        ({"method": "auto", "epsilon_t": 1.5}, "friction adds about 6% less"),
        ({"method": "auto"}, None),
    ],
)
def test_what_the_tangential_stiffness_costs_is_said(
    contact: dict[str, Any], said: str | None
) -> None:
    """The loss by epsilon_t is warned of, with the share that was measured for a penalty.

    At 5 E*/a, 0.30 to 0.49 of the friction's force is lost; at 130 E*/h_contact and ten elements,
    0.09.
    """
    warnings = scene({"friction": "stick", **contact}, mesh={"h_contact": 0.01}).plan.warnings
    found = [words for words in warnings if "friction" in words]
    assert [said in words for words in found] == ([True] if said else [])
