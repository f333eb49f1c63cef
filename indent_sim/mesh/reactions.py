"""Reactions of the supports of a whole body, from what the supports of its modelled part bear.

Sign: a reaction is the force of a support on the body. In equilibrium the reactions of all supports
add up to the force of the body on the tip: their z components to `force`, > 0 where the tip pushes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import product

from indent_sim.mesh.modelled_part import Part
from indent_sim.model.state import REACTION, REACTION_COLUMNS

Surface = tuple[
    str, int
]  # name of a surface of the modelled part, and a component of the force on it


def bearing_surfaces(part: Part) -> list[Surface]:
    """The surfaces of the modelled part whose supports bear something, with each component of it.

    A curved roller wall in three dimensions holds no component of its own but the one along its
    normal.
    """
    found = [(surface, component) for component, surface in part.held_sides]
    if part.has_curved_roller:
        found += [("r_max", component) for component in (0, 1)]
    return found


def reactions_of_whole_body(part: Part, borne: Mapping[Surface, float]) -> dict[str, float]:
    """Reactions of the supports of the whole body, and the forces through its mirror planes.

    An image of the modelled part in the mirror plane x = c bears the same forces, with x components
    of the other sign. Components that cancel between the images are left out, and so is the axis of
    an axisymmetric body: what crosses it is no force.

    Parameters
    ----------
    part
        The modelled part of the body.
    borne
        For each of `bearing_surfaces` the force of its support on the modelled part [force]. Of an axisymmetric part,
        component 0: the integral of the radial traction over the surface.

    Returns
    -------
    dict
        By the support's name in the scene and the axis, as in `base_z` or `x_max_x`; in an axisymmetric body the
        radial pressure of the wall on all of it, `sides_r`. `mirror_x` is the force of the other half of the body on
        the half x > c, along x.
    """
    axes = {"axisymmetric": "rz", "plane_strain": "xz"}.get(part.kinematics.name, "xyz")
    found: dict[str, float] = {}
    for (surface, component), force in borne.items():
        axis = axes[component]
        if surface in part.mirror_planes:
            found[f"mirror_{axis}"] = found.get(f"mirror_{axis}", 0.0) + force * part.copies / 2
        elif surface == "r_min" or (axis == "r" and surface == "base"):
            continue
        elif axis not in part.cuts or surface[:2] == f"{axis}_":
            for name, sign in _images(part, surface, axis):
                key = f"{name}_{axis}"
                found[key] = found.get(key, 0.0) + sign * force
    in_order = (column.removeprefix(REACTION) for column in REACTION_COLUMNS)
    return {name: found[name] for name in in_order if name in found}


def _images(part: Part, surface: str, axis: str) -> Iterable[tuple[str, int]]:
    """The name of a support on each image of the modelled part, and the sign of its force along an
    axis there.
    """
    for is_image in product((False, True), repeat=len(part.cuts)):
        mirrored = {cut for cut, one in zip(part.cuts, is_image, strict=True) if one}
        name = "sides" if surface == "r_max" or surface.startswith("sides") else surface
        if name == f"{name[0]}_max" and name[0] in mirrored:
            name = f"{name[0]}_min"
        yield name, -1 if axis in mirrored else 1


def reaction_columns(part: Part) -> tuple[str, ...]:
    """The columns of the force table with the reactions of a part's body, in order."""
    none = dict.fromkeys(bearing_surfaces(part), 0.0)
    return tuple(f"{REACTION}{name}" for name in reactions_of_whole_body(part, none))
