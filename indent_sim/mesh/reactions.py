"""Support reactions of the whole body, computed from the reactions of the model domain.

Sign convention: a reaction is the force of a support on the body. In equilibrium the reactions of
all supports sum to the force of the body on the tip, and their z components to `force`, which is >
0 while the tip pushes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import product

from indent_sim.mesh.model_domain import ModelDomain
from indent_sim.model.state import REACTION_COLUMNS, REACTION_PREFIX

# Name of a surface of the model domain, and a component of the force on it.
SurfaceComponent = tuple[str, int]


def bearing_surfaces(domain: ModelDomain) -> list[SurfaceComponent]:
    """Return the supported surfaces of the model domain, once for each reaction component.

    A curved roller wall in three dimensions constrains the displacement along its normal only.
    """
    surfaces = [(surface, component) for component, surface in domain.constrained_components]
    if domain.rests_on_flat:
        surfaces += [("base", domain.dim - 1)]
    if domain.has_curved_roller:
        surfaces += [("r_max", component) for component in (0, 1)]
    return surfaces


def reactions_of_whole_body(
    domain: ModelDomain, domain_reactions: Mapping[SurfaceComponent, float]
) -> dict[str, float]:
    """Return the support reactions of the whole body, and the forces across mirror planes.

    An image of the model domain in the mirror plane x = c has the same reactions, with x components
    of opposite sign. Components that cancel between the images are omitted, as is the axis of an
    axisymmetric body, across which no force acts.

    Parameters
    ----------
    domain
        The modelled part of the body.
    domain_reactions
        Force of the support on the model domain [force] for each of `bearing_surfaces`. Component 0
        of an axisymmetric domain is the integral of the radial traction over the surface.

    Returns
    -------
    dict
        Reactions by the name of the support in the scene and the axis, such as `base_z` or
        `x_max_x`. For an axisymmetric body, `sides_r` is the integral of the radial traction over
        the wall. `mirror_x` is the x component of the force that the half x < c of the body exerts
        on the half x > c.
    """
    axes = {"axisymmetric": "rz", "plane_strain": "xz"}.get(domain.kinematics.name, "xyz")
    reactions: dict[str, float] = {}
    for (surface, component), force in domain_reactions.items():
        axis = axes[component]
        if surface in domain.mirror_planes:
            reactions[f"mirror_{axis}"] = (
                reactions.get(f"mirror_{axis}", 0.0) + force * domain.symmetry_factor / 2
            )
        elif surface == "r_min" or (axis == "r" and surface == "base"):
            continue
        elif axis not in domain.mirror_axes or surface[:2] == f"{axis}_":
            for name, sign in _mirror_images(domain, surface, axis):
                key = f"{name}_{axis}"
                reactions[key] = reactions.get(key, 0.0) + sign * force
    ordered_names = (column.removeprefix(REACTION_PREFIX) for column in REACTION_COLUMNS)
    return {name: reactions[name] for name in ordered_names if name in reactions}


def _mirror_images(domain: ModelDomain, surface: str, axis: str) -> Iterable[tuple[str, int]]:
    """Yield the name of a support on each image of the domain, and the sign of its reaction."""
    for mirror_flags in product((False, True), repeat=len(domain.mirror_axes)):
        mirrored = {
            mirror_axis
            for mirror_axis, is_mirrored in zip(domain.mirror_axes, mirror_flags, strict=True)
            if is_mirrored
        }
        name = "sides" if surface == "r_max" or surface.startswith("sides") else surface
        if name == f"{name[0]}_max" and name[0] in mirrored:
            name = f"{name[0]}_min"
        yield name, -1 if axis in mirrored else 1


def reaction_columns(domain: ModelDomain) -> tuple[str, ...]:
    """Return the names of the columns of the force table for the support reactions, in order."""
    no_forces = dict.fromkeys(bearing_surfaces(domain), 0.0)
    return tuple(f"{REACTION_PREFIX}{name}" for name in reactions_of_whole_body(domain, no_forces))
