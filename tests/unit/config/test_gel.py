"""Gels in a scene file: refusals with key and remedy, and the decided scene."""

from __future__ import annotations

from typing import Any

import pytest

from indent_sim.config.scene_file import config_from_mapping, loads, to_yaml
from indent_sim.model.gel import Gel
from indent_sim.process.errors import ConfigError
from indent_sim.run.explicit_config import automatic_keys, explicit_config
from indent_sim.scene.scene import Scene, resolve

GEL: dict[str, Any] = {"model": "gel", "G": 1.0, "n_omega": 1e-3, "chi": 0.6, "stretch": 1.4}
WET = GEL | {"flow": {"diffusivity": 1.0}}
OTHER = {"model": "neo_hookean", "E": 1.0, "nu": 0.2, "flow": {"permeability": 1.0}}
BODY = {"shape": "cylinder", "radius": 2.0, "height": 1.0, "sides": "roller"}
SCENE: dict[str, Any] = {
    "body": BODY,
    "material": WET,
    "drainage": {"bath": 0.0},
    "indenter": {"shape": "sphere", "R": 1.0},
    "loading": {"history": [[0, 0], [310, 0]]},
    "mesh": {"h_contact": 0.06},
}


def layers(*materials: dict[str, Any]) -> dict[str, Any]:
    return {
        "body": BODY
        | {"layers": [{"thickness": 1.0 / len(materials), "material": one} for one in materials]}
    }


@pytest.mark.parametrize(
    ("sections", "key", "words"),
    [
        (
            {"material": GEL | {"flow": {"permeability": 1.0}}},
            "material.flow.permeability",
            "follows from its swelling",
        ),
        (
            {"material": GEL | {"flow": {"diffusivity": 1.0, "alpha": 0.9}}},
            "material.flow.alpha",
            "incompressible",
        ),
        (
            {"material": GEL | {"flow": {"diffusivity": 1.0, "holmes_mow": {"phi0": 0.2}}}},
            "material.flow.holmes_mow",
            "follows from its swelling",
        ),
        ({"material": WET | {"stretch": 1.0}}, "material.stretch", "must be > 1"),
        (
            {"material": WET | {"stretch": "auto"}, "drainage": {"bath": 5.0}},
            "material.stretch",
            "no free swelling",
        ),
        (
            {"material": WET | {"relaxation": {"prony": [[0.5, 1.0]]}}},
            "material.relaxation",
            "not verified",
        ),
        ({"material": WET | {"formulation": "mixed"}}, "material.formulation", "displacement"),
        (layers(WET, OTHER), "body.layers[1].material.flow", "chemical potential"),
        (
            layers(WET, WET | {"n_omega": 2e-3}),
            "body.layers[1].material.n_omega",
            "the same ratio for all gels",
        ),
        ({"material": GEL, "drainage": {"bath": 0.0}}, "drainage", "no material has a flow"),
        (
            {"material": GEL | {"stretch": "auto"}, "drainage": {"bath": [[0, 0], [1, 0]]}},
            "drainage.bath",
            "changes in time",
        ),
        ({"body": {"shape": "half_space"}}, "drainage.bath", "rises without bound"),
        ({"solver": {"method": "condensed"}}, "solver.method", "not linear"),
        ({"contact": {"method": "nitsche"}}, "contact.method", "stress of the solid"),
    ],
)
def test_what_does_not_go_with_a_gel_is_refused(
    sections: dict[str, Any], key: str, words: str
) -> None:
    with pytest.raises(ConfigError) as error:
        resolve(config_from_mapping(SCENE | sections))
    assert key in str(error.value) and words in str(error.value)


def test_a_bath_of_a_gel_has_no_unit() -> None:
    text = to_yaml(config_from_mapping(SCENE | {"units": {"length": "mm", "force": "mN"}}))
    with pytest.raises(ConfigError, match="over kT"):
        resolve(loads(text.replace("bath: 0.0", "bath: 5 kPa")))


def test_a_scene_comes_back_from_its_own_text() -> None:
    config = config_from_mapping(SCENE)
    assert loads(to_yaml(config)) == config


def found(**sections: Any) -> Scene:
    return resolve(config_from_mapping(SCENE | sections))


def test_stretch_of_the_first_bath() -> None:
    law = Gel(G=1.0, n_omega=1e-3, chi=0.6)
    baths = [[0, law.free_swelling_potential(1.4)], [10, 0.0]]
    scene = found(material=WET | {"stretch": "auto"}, drainage={"bath": baths})
    (region,) = scene.physics.domain.regions
    assert isinstance(region.material, Gel)
    assert region.material.stretch == pytest.approx(1.4, rel=1e-9)
    assert abs(scene.physics.bath_pressure(region, 1e-9)) < 1e-9 and scene.physics.is_swelling


def test_a_bath_comes_within_some_steps() -> None:
    physics = found().physics
    (region,) = physics.domain.regions
    whole = region.material.bath_pressure(0.0)
    ramp = physics.bath_ramp
    assert whole == pytest.approx(
        8.7678581 / physics.scales.pressure, rel=1e-6
    )  # of this gel, by the closed form
    assert [
        physics.bath_pressure(region, share * ramp) / whole for share in (0, 0.5, 1, 2)
    ] == pytest.approx([0, 0.5, 1, 1], rel=1e-12)
    assert physics.path.times[1] <= ramp / 8


@pytest.mark.parametrize("h", [0.02, 0.1, 0.3])
def test_how_soon_a_bath_comes_is_no_matter_of_the_mesh(h: float) -> None:
    """The automatic bath ramp does not depend on the element size, and is resolved by 8 increments.

    It is 1/75 of the time that fluid takes to diffuse through the contact.
    """
    scene = found(mesh={"h_contact": h})
    physics = scene.physics
    assert physics.bath_ramp == pytest.approx(
        found(mesh={"h_contact": 0.05}).physics.bath_ramp, rel=1e-12
    )
    (region,) = physics.permeable_regions
    a = scene.plan.prediction["a"] / physics.scales.length
    assert physics.bath_ramp == pytest.approx(
        min(a, 1.0) ** 2 / region.material.diffusivity / 75, rel=1e-9
    )
    steps = [t for _, t in physics.path.segment(1)]
    assert steps[0] <= physics.bath_ramp / 8 * (1 + 1e-12)


def test_a_given_bath_ramp_is_kept_and_one_that_is_found_is_written_down() -> None:
    config = config_from_mapping(SCENE)
    scene = resolve(config)
    own = explicit_config(config, scene)
    assert own.drainage is not None and own.drainage.bath_ramp == scene.physics.bath_ramp > 0
    again = resolve(own)
    assert (
        again.physics.bath_ramp == scene.physics.bath_ramp
        and again.physics.path == scene.physics.path
    )
    assert "drainage.bath_ramp" in automatic_keys(config, own)
    assert found(drainage={"bath": 0.0, "bath_ramp": 0.25}).physics.bath_ramp == 0.25


def test_a_bath_ramp_of_a_bath_that_is_there_already_is_said_to_be_of_no_use() -> None:
    rest = Gel(G=1.0, n_omega=1e-3, chi=0.6).free_swelling_potential(1.4)
    scene = found(drainage={"bath": rest, "bath_ramp": 0.25})
    assert scene.physics.bath_ramp == 0
    assert any(doubt.key == "bath_ramp" for doubt in scene.plan.model_warnings)


@pytest.mark.parametrize("bath", [0.0, -0.013])
@pytest.mark.parametrize("chi", [0.2, 0.37, 0.6])
def test_a_gel_at_rest_in_its_own_bath_is_not_warned_of_it(chi: float, bath: float) -> None:
    """A gel at its free swelling stretch in its own bath causes no warning.

    The stretch of free swelling is known only to rounding.
    """
    scene = resolve(
        config_from_mapping(
            {
                "body": {
                    "shape": "cylinder",
                    "radius": 10,
                    "height": 1,
                    "base": "roller",
                    "sides": "free",
                },
                "material": {
                    "model": "gel",
                    "G": 1,
                    "n_omega": 0.001,
                    "chi": chi,
                    "flow": {"diffusivity": 1},
                },
                "drainage": {"bath": bath},
                "indenter": {"shape": "sphere", "R": 1},
                "loading": {"history": [[0, 0], [0.001, 0.02], [100, 0.02]], "times": [0.001, 100]},
            }
        )
    )
    assert not scene.physics.is_swelling
    assert not any(doubt.key == "bath" for doubt in scene.plan.model_warnings)
    assert not any("bath comes" in choice.why for choice in scene.plan.choices)


def test_contact_is_expected_where_the_gel_has_swollen() -> None:
    """The predicted contact radius of a swelling gel is that of a tip pressed in by its rise.

    Held sideways, this gel rises by 0.3788 of its height.
    """
    swollen = found().plan.prediction["a"]
    rubber = {"model": "neo_hookean", "mu": 1 / 1.4, "nu": 0.49285}
    pressed = resolve(
        config_from_mapping(
            {k: v for k, v in SCENE.items() if k != "drainage"}
            | {"material": rubber, "loading": {"delta": 0.3788}}
        )
    ).plan.prediction["a"]
    assert swollen == pytest.approx(pressed, rel=1e-3)


def test_a_gel_that_separates_into_two_phases_is_told() -> None:
    """The plan names the nearest volume at which the mixture is unstable.

    With few chains Flory and Huggins' mixture is unstable below the polymer fraction 1 - 1/(2 chi),
    which is reached here 1.5 % above the volume of the reference state.
    """

    def told(chi: float) -> list[str]:
        material = WET | {"n_omega": 1e-4, "chi": chi, "stretch": 1.57}
        found = resolve(config_from_mapping(SCENE | {"material": material}))
        return [one.message for one in found.plan.model_warnings if one.key == "demixing"]

    (said,) = told(0.671)
    nearest = 1 / 1.57**3 / (1 - 1 / (2 * 0.671))
    assert nearest == pytest.approx(1.015, abs=2e-3)
    assert "unstable at 1.02 times its volume" in said
    assert told(0.6) == []
