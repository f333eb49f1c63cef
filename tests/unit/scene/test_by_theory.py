"""Scenes that theory solves instead of a mesh, and the reasons why it does not solve others."""

from __future__ import annotations

from math import inf
from typing import Any

import pytest
from scenes import CYLINDER, ELASTIC, STRIP, WALLED, scene

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.model.body import Cylinder
from indent_sim.model.layers import Layer as BodyLayer
from indent_sim.model.linear_elasticity import LinearElastic
from indent_sim.model.tips import FlatPunch, Paraboloid
from indent_sim.process.errors import ConfigError
from indent_sim.scene.domain_truncation import TRUNCATION_SAFETY, truncate
from indent_sim.scene.reference_theory import half_space_theory, layer_theory
from indent_sim.scene.solver_choices import needs_mesh
from indent_sim.theory import profiles
from indent_sim.theory.films import dimitriadis_force, gao_modulus
from indent_sim.theory.layer import Layer
from indent_sim.theory.stack import Stack, StackLayer

HALF_SPACE = {"shape": "half_space"}
LAYER = {"shape": "layer", "height": 0.5}
STIFF = {"model": "linear_elastic", "E": 10.0, "nu": 0.3}
COATED = {"shape": "half_space", "layers": [{"thickness": 0.1, "material": STIFF}, {}]}
THEORY = "solver.method=theory"


def why(name: str, found: Any) -> str:
    return next(choice.why for choice in found.plan.choices if choice.key == name)


@pytest.mark.parametrize(
    "body", [HALF_SPACE, LAYER, LAYER | {"base": "roller"}], ids=["half_space", "layer", "roller"]
)
def test_bodies_without_end_are_solved_by_theory(body: dict[str, Any]) -> None:
    found = scene(body)
    assert found.solver.method == found.method == "theory" and not found.is_meshed
    assert "theory describes this" in why("solver.method", found) and "no mesh is needed" in why(
        "solver.method", found
    )
    assert not {"mesh.h_contact", "body", "contact"} & {choice.key for choice in found.plan.choices}
    assert "dofs" not in found.plan.prediction and "truncation_error" not in found.plan.prediction


@pytest.mark.parametrize("body", [CYLINDER, WALLED, STRIP], ids=["free", "walled", "strip"])
def test_other_bodies_are_meshed_unless_asked(body: dict[str, Any]) -> None:
    assert scene(body).is_meshed


@pytest.mark.parametrize("body", [WALLED, STRIP], ids=["walled", "strip"])
def test_a_body_of_theorys_own_is_solved_on_request(body: dict[str, Any]) -> None:
    assert "theory describes this" in why("solver.method", scene(body, THEORY))


REASONS: dict[str, tuple[list[str], str]] = {
    "material": (["material={model: neo_hookean, E: 1.0, nu: 0.3}"], "not linear"),
    "tip": (["indenter={shape: pyramid, half_angle: 65}"], "theory needs an axisymmetric tip"),
    "gap": (["contact.gap=current"], "undeformed point"),
    "method": (["contact.method=uzawa"], "contact.method: uzawa"),
    "sizes": (["mesh.h_contact=0.01"], "keys of the section 'mesh'"),
    "symmetry": (["mesh.symmetry=quarter"], "keys of the section 'mesh'"),
    "rtol": (["solver.rtol=1e-10"], "rtol"),
    "formulation": (["material.formulation=mixed"], "formulation"),
    "fields": (["output.fields=last"], "output.fields: last"),
    "accuracy": (["accuracy=1e-9"], "the theory is 1e-08"),
    "nu": (["material.nu=-0.2"], "nu >= 0"),
    "wide": (
        ["body.height=0.001", "loading.delta=0.0005", "indenter.R=1000"],
        "100 layer thicknesses",
    ),
}


@pytest.mark.parametrize("name", REASONS)
def test_what_theory_cannot_is_refused_with_its_reason(name: str) -> None:
    changes, reason = REASONS[name]
    with pytest.raises(ConfigError, match="'theory' does not fit this scene") as caught:
        scene(LAYER, THEORY, *changes)
    assert (
        caught.value.exit_code == 3
        and caught.value.key == "solver.method"
        and reason in caught.value.problem
    )


@pytest.mark.parametrize(
    "name", [name for name in REASONS if name not in ("accuracy", "wide", "symmetry")]
)
def test_auto_takes_a_mesh_then_and_says_why(name: str) -> None:
    changes, reason = REASONS[name]
    found = scene(LAYER, *changes)
    assert found.is_meshed and reason in why("solver.method", found)


def test_a_free_body_is_not_theorys() -> None:
    with pytest.raises(ConfigError, match="infinitely wide"):
        scene(CYLINDER, THEORY)


@pytest.mark.parametrize("body", [HALF_SPACE, LAYER], ids=["half_space", "layer"])
def test_a_plate_is_no_tip_for_a_flat_top(body: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match="touches all of an unbounded surface"):
        scene(body, indenter={"shape": "plate"})


def test_what_can_be_told_at_a_look() -> None:
    """Whether a scene needs a mesh is known before it is resolved.

    The mesher is started by it, and never for a scene that theory solves.
    """

    def config(*changes: str) -> Any:
        given = {"body": LAYER, "material": ELASTIC, "indenter": {"shape": "sphere", "R": 1.0}}
        return config_from_mapping(given | {"loading": {"delta": 0.01}}, changes)

    assert not needs_mesh(config()) and not needs_mesh(config("body={shape: half_space}"))
    walled = "body={shape: cylinder, radius: 1, height: 1, sides: roller}"
    assert needs_mesh(config(walled)) and not needs_mesh(config(walled, THEORY))
    assert all(
        needs_mesh(config(change)) for change in ("solver.method=newton", "output.fields=all")
    )


def test_its_depths_are_the_config_s_to_the_last_digit() -> None:
    """The depths of a half-space keep all digits, as its length scale is a power of two."""
    found = scene(HALF_SPACE, loading={"deltas": [0.0037, 0.0111]})
    L = found.physics.scales.length
    assert [delta * L for delta in found.physics.deltas] == [0.0037, 0.0111]


def test_infinite_pressures_are_empty() -> None:
    sharp, blunt = (
        scene(LAYER, indenter={"shape": "cone", "half_angle": 80} | radius)
        for radius in ({}, {"tip_radius": 1e-4})
    )
    assert why("p_max", sharp).endswith("sharp apex is infinite")
    assert "p_max" not in {choice.key for choice in blunt.plan.choices}
    punched = scene(LAYER, indenter={"shape": "flat_punch", "radius": 0.1})
    assert why("p_max", punched).endswith("sharp edge is infinite")


# ---- usual formulas


def test_gao_and_perriot_barthel_stand_beside_a_coating() -> None:
    """Gao's and Perriot-Barthel's formulas of a coating are Hertz's with a modulus of their own."""
    found = scene(COATED)
    film, substrate = StackLayer(0.1, 10.0, 0.3), StackLayer(inf, 1.0, 0.3)
    hertz = 4 / 3 * gao_modulus(film, substrate, 0.1) * 0.01**1.5
    assert found.plan.prediction["force_Gao"] == pytest.approx(
        hertz, rel=1e-8
    )  # a = sqrt(R delta) = 0.1
    assert set(found.plan.theory.formulas) == {"Gao", "Perriot-Barthel"}  # type: ignore[union-attr]


@pytest.mark.parametrize("body", [LAYER, WALLED | {"height": 0.5}], ids=["layer", "cylinder"])
def test_dimitriadis_stands_beside_a_single_layer(body: dict[str, Any]) -> None:
    expected = dimitriadis_force(0.01, 1.0, StackLayer(0.5, 1.0, 0.3))
    assert scene(body).plan.prediction["force_Dimitriadis"] == pytest.approx(expected, rel=1e-12)


def test_at_a_force_the_formulas_give_depths() -> None:
    """At a force the formulas give depths, which give the force again."""
    theory = scene(LAYER).plan.theory
    assert theory is not None
    depth = theory.formula_value("Dimitriadis", 0.01, force=0.002)
    assert depth and theory.formula_value("Dimitriadis", depth) == pytest.approx(0.002, rel=1e-10)


def test_where_no_formula_belongs_there_is_none() -> None:
    ply = LinearElastic(E=1.0, nu=0.3)
    three = [BodyLayer(0.1, ply), BodyLayer(0.1, ply), BodyLayer(inf, ply)]
    for theory in (
        half_space_theory(Paraboloid(1.0), three),
        half_space_theory(Paraboloid(1.0), three[2:]),
        layer_theory(Cylinder(1.0, 0.2), three[:2], Paraboloid(1.0), (0.0, 0.0)),
        layer_theory(Cylinder(1.0, 0.1), three[:1], FlatPunch(0.1), (0.0, 0.0)),
    ):
        assert theory is not None and not theory.formulas


@pytest.mark.parametrize(("contrast", "stated"), [(1.0, 1e-8), (1e4, 1e-8), (1e5, 3.2e-6)])
def test_theory_states_what_it_loses_to_contrast(contrast: float, stated: float) -> None:
    """Theory states an error that grows with the contrast of the layers' moduli.

    2e-6 was measured on a substrate 1e5 times softer.
    """
    layers = [
        BodyLayer(0.1, LinearElastic(E=contrast, nu=0.3)),
        BodyLayer(inf, LinearElastic(E=1.0, nu=0.3)),
    ]
    theory = half_space_theory(Paraboloid(1.0), layers)
    assert theory is not None and theory.error == pytest.approx(stated, rel=0.02)


# ---- the finite body that stands for a layer


@pytest.mark.parametrize("base", ["fixed", "roller"])
@pytest.mark.parametrize("nu", [0.0, 0.3, 0.5])
@pytest.mark.parametrize("delta", [1e-4, 1e-2, 0.2])
def test_the_stated_error_of_the_wall_is_theorys(base: str, nu: float, delta: float) -> None:
    """The stated truncation error is theory's force with the wall over that without it.

    It is at most 1e-3.
    """
    found = scene(
        LAYER | {"base": base},
        "solver.method=newton",
        material=ELASTIC | {"nu": nu},
        loading={"delta": delta, "steps": 1},
    )
    body, L = found.physics.body, found.physics.scales.length
    assert isinstance(body, Cylinder) and body.sides == "roller" and body.base == base
    stack = Stack((StackLayer(0.5, 1.0, nu),), base)
    free, walled = (
        Layer.from_stack(profiles.paraboloid(1.0), stack, wall)
        .solutions_at_depths([delta])[0]
        .force
        for wall in (None, body.radius * L)
    )
    stated = found.plan.prediction["truncation_error"]
    assert abs(walled / free - 1) <= stated * (1 + 1e-6) / TRUNCATION_SAFETY + 1e-6
    assert stated < 1e-3 and f"at most {100 * stated:.2g} % too large" in why("body", found)


def test_a_tip_without_theory_has_a_wall_too() -> None:
    """A tip without theory, or a contact wider than theory's, gets a truncated domain, too."""
    pyramid = scene(LAYER, indenter={"shape": "pyramid", "half_angle": 65}).physics
    assert (
        pyramid.body.shape == "box"
        and pyramid.body.lateral_extent(pyramid.center) > 3 * pyramid.body.height
    )
    config = config_from_mapping(
        {
            "body": LAYER | {"height": 1e-3},
            "material": ELASTIC,
            "loading": {"delta": 1e-4},
            "indenter": {"shape": "flat_punch", "radius": 1.0},
        }
    )
    wide = truncate(config.body, config.indenter, [config.layers], 1e-4)  # type: ignore[arg-type]
    assert wide.body.lateral_extent((0.0, 0.0)) > 1.0 and wide.error < 1e-3


@pytest.mark.parametrize("shape", ["layer", "half_space"])
def test_a_body_that_changes_with_time_is_wide_enough_for_all_it_becomes(shape: str) -> None:
    """A time-dependent body is truncated as far away as an incompressible one.

    Undrained, or with relaxed shear, it is incompressible, and on a roller base the wall acts eight
    times as far away.
    """
    body = {"shape": shape} | ({"height": 1.0, "base": "roller"} if shape == "layer" else {})
    common = {"indenter": {"shape": "paraboloid", "R": 1.0}}
    drained = ELASTIC | {"nu": 0.05}
    held = {"loading": {"history": [[0, 0], [1, 0.05], [9, 0.05]]}}

    def width(material: dict[str, Any], loading: dict[str, Any]) -> float:
        return scene(
            body, "solver.method=newton", material=material, **common, **loading
        ).physics.domain.extent[0][1]

    once = {"loading": {"delta": 0.05}}
    stiff, soft = width(drained | {"nu": 0.5}, once), width(drained, once)
    porous = width(drained | {"flow": {"diffusivity": 1.0}}, held)
    relaxing = width(drained | {"relaxation": {"prony": [[0.9999, 0.1]], "of": "shear"}}, held)
    assert porous == pytest.approx(max(stiff, soft), rel=1e-5)
    assert relaxing == pytest.approx(max(stiff, soft), rel=0.1)  # all but 0.4999 at the end
    assert shape == "half_space" or stiff > 4 * soft


def test_a_film_far_thinner_than_its_contact_is_cut_off_with_what_lies_below() -> None:
    """A very thin coating is truncated at least as far away as the bare body.

    Its contact is wider than the theory of layers covers.
    """
    film = [{"thickness": 1e-4, "material": STIFF}, {}]
    blunt = {"shape": "cone", "half_angle": 70.3, "tip_radius": 2.0}
    coated, bare = (
        scene(HALF_SPACE | layers, "solver.method=newton", indenter=blunt, loading={"delta": 0.4})
        for layers in ({"layers": film}, {})
    )
    wide, least = (
        found.physics.domain.extent[0][1] * found.physics.scales.length for found in (coated, bare)
    )
    assert least <= wide <= 2 * least and coated.plan.prediction["truncation_error"] < 1e-3


def test_layers_of_a_layer_are_those_of_its_body() -> None:
    layers = [{"thickness": 0.1, "material": STIFF}, {"thickness": 0.4}]
    found = scene(LAYER | {"layers": layers}, "solver.method=condensed")
    assert [region.material.constants.E for region in found.physics.domain.regions] == [1.0, 0.1]
    assert (
        found.plan.theory is not None
        and found.plan.theory.is_exact
        and not found.plan.theory.formulas
    )
