"""The scene of a soft tip: its elastic lens or cylinder, upside down under a rigid tip.

Body and tip are condensed separately to their contact surfaces. The tip is meshed like a cap that a
plate compresses to the contact radius expected between tip and body, or like a cylinder that is
pressed over this radius.
"""

from __future__ import annotations

from typing import Any

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.config.schema import Config
from indent_sim.mesh.model_domain import ModelDomain
from indent_sim.mesh.sizes import Sizes
from indent_sim.model.spherical_bodies import SphericalBody
from indent_sim.model.tips import Lens, SoftCylinder
from indent_sim.process.errors import ConfigError
from indent_sim.scene.choices import Choice
from indent_sim.scene.local_refinement import (
    nearby_corners,
    needed_corner_size,
    sizes_with_corners,
)
from indent_sim.scene.measured_constants import ERROR_CONSTANT
from indent_sim.scene.problem_definition import ProblemDefinition
from indent_sim.scene.problem_setup import ProblemSetup
from indent_sim.scene.resolution import error_decay

# Largest approach of the plate that chooses the lens's mesh, relative to the lens's thickness.
MAX_APPROACH = 0.3


def check_soft_tip(setup: ProblemSetup) -> None:
    """Raise ConfigError if a soft tip is not on the axis of an axisymmetric body."""
    physics = setup.physics
    if physics.indenter.elastic_part is None or physics.domain.kinematics.name == "axisymmetric":
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
    lens = physics.indenter.elastic_part
    assert lens is not None
    scales = physics.scales
    (region,) = tip_domain.regions
    thickness_choices = (
        [Choice("indenter.thickness", lens.thickness * scales.length, "auto: R, half a ball")]
        if isinstance(lens, Lens) and lens.thickness == lens.radius
        else []
    )
    reason = "1/E* = 1/E_body* + 1/E_tip*: the modulus of the half-space formula"
    return [
        *thickness_choices,
        Choice("indenter.material.formulation", region.formulation, f"nu = {lens.material.nu:g}"),
        Choice("contact modulus", physics.contact_modulus * scales.pressure, reason),
    ]


def soft_tip_config(config: Config, setup: ProblemSetup, sizes: Sizes) -> Config:
    """Return the config of the elastic part of a soft tip, upside down under a rigid tip.

    Parameters
    ----------
    config : Config
        The config of the scene.
    setup : ProblemSetup
        Its problem, with the expected contact radius.
    sizes : Sizes
        The element sizes of the body; the lens has the same size in the contact.
    """
    lens = config.indenter.elastic_part
    assert lens is not None
    pressed = (
        _pressed_lens(lens, setup)
        if isinstance(lens, Lens)
        else _pressed_cylinder(lens, setup, sizes)
    )
    length = setup.physics.scales.length
    E, nu = lens.material.constants
    units = {name: unit for name, unit in vars(config.units).items() if unit}
    return config_from_mapping(
        {
            "title": "soft tip",
            **({"units": units} if units else {}),
            "material": {
                "model": "linear_elastic",
                "E": E,
                "nu": nu,
                "formulation": lens.material.formulation,
            },
            "solver": {"method": "condensed"},
            **pressed,
            "mesh": {"h_contact": sizes.h_contact * length, **pressed.get("mesh", {})},
        }
    )


def refine_tip_corners(sizes: Sizes, physics: ProblemDefinition) -> Sizes:
    """Return the sizes of a soft tip with smaller elements where it is bonded to its holder.

    The permitted error of the force is the one that elements of the size in the contact have in
    general, since the config has no key for the sizes of the tip.

    Parameters
    ----------
    sizes, physics
        Sizes and problem of the scene of the soft tip.
    """
    n = sizes.a / sizes.h_contact
    near_corners = nearby_corners(physics, sizes, sizes.a)
    h = needed_corner_size(sizes, near_corners, ERROR_CONSTANT[2] * error_decay(n), n)
    return sizes_with_corners(sizes, near_corners, h)


def _pressed_lens(lens: Lens, setup: ProblemSetup) -> dict[str, Any]:
    """Return body, tip and loading of a cap that a plate compresses to the expected contact."""
    a = setup.a * setup.physics.scales.length
    return {
        "body": {"shape": "cap", "base_radius": lens.base_radius, "height": lens.thickness},
        "indenter": {"shape": "plate"},
        "loading": {"delta": min(a * a / lens.radius, MAX_APPROACH * lens.thickness)},
    }


def _pressed_cylinder(lens: SoftCylinder, setup: ProblemSetup, sizes: Sizes) -> dict[str, Any]:
    """Return body, tip, loading and size at the edge of a cylinder under the expected contact.

    The contact with a flat body ends at the edge of the punch or of the body, the contact with a
    ball or a cap ends inside both.
    """
    length = setup.physics.scales.length
    body = setup.physics.body
    # The depth does not matter to a flat tip.
    depth = {"delta": 1e-3 * lens.thickness}
    tip: dict[str, Any] = {"shape": "plate"}
    h_edge = {} if sizes.h_edge is None else {"h_edge": sizes.h_edge * length}
    if isinstance(body, SphericalBody) and setup.a * length < lens.radius:
        a = setup.a * length
        curvature_radius = max(body.apex_radius * length, a * a / (MAX_APPROACH * lens.thickness))
        tip = {"shape": "paraboloid", "R": curvature_radius}
        depth = {"delta": a * a / curvature_radius}
        h_edge = {}
    elif body.lateral_extent(setup.physics.center) * length < lens.radius * (1 - 1e-9):
        tip = {"shape": "flat_punch", "radius": body.lateral_extent(setup.physics.center) * length}
    return {
        "body": {
            "shape": "cylinder",
            "radius": lens.radius,
            "height": lens.thickness,
            "base": "fixed",
            "sides": "free",
        },
        "indenter": tip,
        "loading": depth,
        "mesh": h_edge,
    }
