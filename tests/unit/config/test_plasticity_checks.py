"""Plasticity in scene files: what is refused, where, and what a scene makes of it."""

from __future__ import annotations

from typing import Any

import pytest

from indent_sim.config.scene_file import config_from_mapping, to_mapping
from indent_sim.fitting.forward_model.forward_model_cache import ForwardModelCache
from indent_sim.model.plasticity import Hardening
from indent_sim.process.errors import ConfigError, ConfigErrors
from indent_sim.run.sensitivities import sensitivities
from indent_sim.scene.scene import resolve

METAL = {"model": "hencky", "E": 100.0, "nu": 0.3, "plasticity": {"yield_stress": 1.0}}
SCENE: dict[str, Any] = {
    "body": {"shape": "cylinder", "radius": 10.0, "height": 10.0},
    "material": METAL,
    "indenter": {"shape": "cone", "half_angle": 70.3},
    "loading": {"delta": 0.5, "steps": 5},
}


def metal(**plasticity: Any) -> dict[str, Any]:
    """Material with one more key of plasticity."""
    return METAL | {"plasticity": {"yield_stress": 1.0} | plasticity}


REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "no yield stress": (
        {"material": METAL | {"plasticity": {"n": 0.1}}},
        "material.plasticity.yield_stress",
    ),
    "frequencies": ({"experiment": {"frequencies": [1.0]}}, "experiment.frequencies"),
    "an accuracy of forces": (
        {"accuracy": 0.01, "loading": {"force": 1.0, "steps": 5}},
        "accuracy",
    ),
    "a soft tip": (
        {
            "indenter": {
                "shape": "sphere",
                "R": 1.0,
                "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.3},
            }
        },
        "indenter.material",
    ),
    "a soft tip that is incomplete": (
        {
            "indenter": {
                "shape": "sphere",
                "R": 1.0,
                "material": {"model": "linear_elastic", "E": 1.0},
            }
        },
        "indenter.material",
    ),
    "two hardening laws": ({"material": metal(n=0.1, linear=1.0)}, "material.plasticity.linear"),
    "softening": ({"material": metal(linear=-1.0)}, "material.plasticity.linear"),
    "an exponent of one": ({"material": metal(n=1.0)}, "material.plasticity.n"),
    "two hardening laws in hardening": (
        {"material": metal(hardening={"n": 0.1, "linear": 1.0})},
        "material.plasticity.hardening.linear",
    ),
    "hardening twice": (
        {"material": metal(n=0.1, hardening={"linear": 1.0})},
        "material.plasticity.n",
    ),
    "no hardening law": ({"material": metal(hardening={})}, "material.plasticity.hardening"),
    "an exponent beyond its range": (
        {"material": metal(hardening={"n": 1.0})},
        "material.plasticity.hardening.n",
    ),
    "steeper than Young's modulus": (
        {"material": metal(hardening={"voce": {"rise": 2.0, "strain": 0.01}})},
        "material.plasticity.hardening.voce",
    ),
    "another law": (
        {"material": METAL | {"model": "neo_hookean"}},
        "material.plasticity",
    ),
    "fluid": ({"material": METAL | {"flow": {"permeability": 1.0}}}, "material.flow"),
    "relaxation": (
        {"material": METAL | {"relaxation": {"prony": [[0.5, 1.0]]}}},
        "material.relaxation",
    ),
    "adhesion": (
        {"contact": {"adhesion": {"work": 0.1, "range": 0.1}}},
        "contact.adhesion",
    ),
    "the stress of the body": ({"contact": {"method": "nitsche"}}, "contact.method"),
    "surface tension": (
        {"body": SCENE["body"] | {"surface_tension": 1.0}},
        "body.surface_tension",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_refused(name: str) -> None:
    changes, key = REFUSED[name]
    with pytest.raises((ConfigError, ConfigErrors)) as caught:
        config_from_mapping(SCENE | changes)
    assert f"{key}: " in str(caught.value)


@pytest.mark.parametrize(
    "law", [{"n": 0.1}, {"linear": 10.0}, {"voce": {"rise": 0.5, "strain": 0.05}}]
)
def test_the_short_form_is_the_hardening_that_it_stands_for(law: dict[str, Any]) -> None:
    """A resolved scene has the full form, which gives the same config again."""
    short = config_from_mapping(SCENE | {"material": metal(**law)})
    full = config_from_mapping(SCENE | {"material": metal(hardening=law)})
    assert short.material == full.material
    written = to_mapping(short)["material"]["plasticity"]
    assert written == {"yield_stress": 1.0, "hardening": law}


def test_keys_of_hardening_are_set_by_their_dotted_names() -> None:
    """A quantity in another unit is converted, and a new law beside the old one is refused."""
    units = {"units": {"length": "um", "force": "mN"}}
    config = config_from_mapping(SCENE | units | {"material": metal(hardening={"linear": "2 GPa"})})
    assert config.material is not None and config.material.plasticity is not None
    assert config.material.plasticity.hardening == Hardening(linear=2.0)


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"contact": {"gap": "reference"}}, "contact.gap"),
        ({"solver": {"method": "condensed"}}, "solver.method"),
        ({"solver": {"method": "theory"}}, "solver.method"),
    ],
)
def test_what_a_scene_refuses(changes: dict[str, Any], key: str) -> None:
    with pytest.raises(ConfigError) as caught:
        resolve(config_from_mapping(SCENE | changes))
    assert key in str(caught.value)


def test_commands_that_need_an_elastic_body_refuse_it() -> None:
    config = config_from_mapping(SCENE)
    with pytest.raises(ConfigError, match="not computed"):
        sensitivities(config, ("material.E",))
    with pytest.raises(ConfigError, match="homogeneous half-space"):
        ForwardModelCache().forward_model(config, ("material.E",), 0.5)


def test_what_a_scene_warns_of() -> None:
    """A path that ends before yield, by Hertz and von Mises, and elastic strains of a third."""
    sphere = {"body": {"shape": "half_space"}, "indenter": {"shape": "sphere", "R": 1.0}}
    onset = 6.41799 * (0.91 / 100.0) ** 2
    shallow = resolve(
        config_from_mapping(SCENE | sphere | {"loading": {"delta": 0.9 * onset, "steps": 5}})
    )
    (warning,) = [text for text in shallow.plan.warnings if "yield" in text]
    assert "does not yield" in warning and f"{onset:.4g}" in warning
    deep = resolve(
        config_from_mapping(SCENE | sphere | {"loading": {"delta": 1.1 * onset, "steps": 5}})
    )
    assert not any("does not yield" in text for text in deep.plan.warnings)
    soft = resolve(config_from_mapping(SCENE | {"material": METAL | {"E": 3.0}}))
    assert any("E/yield_stress is 3" in text for text in soft.plan.warnings)


@pytest.mark.parametrize("model", ["hencky", "linear_elastic"])
def test_a_scene_that_yields(model: str) -> None:
    """It is solved on the whole mesh, depends on its path, and has its columns."""
    scene = resolve(config_from_mapping(SCENE | {"material": METAL | {"model": model}}))
    physics = scene.physics
    assert physics.yields and physics.is_path_dependent and not physics.is_linear
    assert scene.solver.method == "newton" and not scene.exact_theory
    assert physics.columns == (
        "plastic_dissipation",
        "hardness",
        "contact_area",
        "unloading_stiffness",
    )
    # 0.7 of the longest increment over the depth
    (warning,) = [entry for entry in scene.plan.model_warnings if entry.key == "increments"]
    assert "14 % too low" in warning.message and "--error-bars" in warning.message
    # stresses are divided by the scene's unit of pressure
    law = physics.material
    assert law.plasticity is not None
    assert law.constants.E / law.plasticity.yield_stress == pytest.approx(100.0)
