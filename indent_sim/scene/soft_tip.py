"""The scene of a soft tip: its elastic lens, upside down under a rigid plate.

Body and tip are condensed separately to their contact surfaces. The tip's mesh is that of a cap
which a plate compresses to the contact radius that is expected between tip and body.
"""

from __future__ import annotations

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.config.schema import Config
from indent_sim.mesh.model_domain import ModelDomain
from indent_sim.mesh.sizes import Sizes
from indent_sim.process.errors import ConfigError
from indent_sim.scene.choices import Choice
from indent_sim.scene.problem_setup import ProblemSetup

# Largest approach of the plate that chooses the lens's mesh, relative to the lens's thickness.
MAX_APPROACH = 0.3


def check_soft_tip(setup: ProblemSetup) -> None:
    """Raise ConfigError if a soft tip is not on the axis of an axisymmetric body."""
    physics = setup.physics
    if physics.indenter.lens is None or physics.domain.kinematics.name == "axisymmetric":
        return
    raise ConfigError(
        "indenter.material",
        "a soft tip is modelled in axisymmetric scenes only",
        "leave indenter.center, body.kinematics and mesh.symmetry out",
    )


def soft_tip_choices(setup: ProblemSetup, tip_domain: ModelDomain) -> list[Choice]:
    """Return the choices of a soft tip: its thickness, formulation and the contact modulus.

    Parameters
    ----------
    setup : ProblemSetup
        The problem of the scene.
    tip_domain : ModelDomain
        The model domain of the lens.
    """
    physics = setup.physics
    lens = physics.indenter.lens
    assert lens is not None
    scales = physics.scales
    (region,) = tip_domain.regions
    thickness_choices = (
        [Choice("indenter.thickness", lens.thickness * scales.length, "auto: R, half a ball")]
        if lens.thickness == lens.radius
        else []
    )
    reason = "1/E* = 1/E_body* + 1/E_tip*: the modulus of the half-space formula"
    return [
        *thickness_choices,
        Choice("indenter.material.formulation", region.formulation, f"nu = {lens.material.nu:g}"),
        Choice("contact modulus", physics.contact_modulus * scales.pressure, reason),
    ]


def soft_tip_config(config: Config, setup: ProblemSetup, sizes: Sizes) -> Config:
    """Return the config of the lens of a soft tip under a plate.

    Parameters
    ----------
    config : Config
        The config of the scene.
    setup : ProblemSetup
        Its problem, with the expected contact radius.
    sizes : Sizes
        The element sizes of the body, whose size in the contact the lens has, too.
    """
    lens = config.indenter.lens
    assert lens is not None
    length = setup.physics.scales.length
    a = setup.a * length
    E, nu = lens.material.constants
    units = {name: unit for name, unit in vars(config.units).items() if unit}
    return config_from_mapping(
        {
            "title": "soft tip",
            **({"units": units} if units else {}),
            "body": {"shape": "cap", "base_radius": lens.base_radius, "height": lens.thickness},
            "material": {
                "model": "linear_elastic",
                "E": E,
                "nu": nu,
                "formulation": lens.material.formulation,
            },
            "indenter": {"shape": "plate"},
            "loading": {"delta": min(a * a / lens.radius, MAX_APPROACH * lens.thickness)},
            "mesh": {"h_contact": sizes.h_contact * length},
            "solver": {"method": "condensed"},
        }
    )
