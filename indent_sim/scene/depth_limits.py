"""Depths to expect, and the limits that the body and the tip set to them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from math import isfinite
from typing import Any

import numpy as np

from indent_sim.model.body import (
    Body,
    ImportedBody,
    Layer,
    Points,
    SphericalBody,
)
from indent_sim.model.loading import History, Loading, LoadPath
from indent_sim.model.materials import Material
from indent_sim.model.tips import FlatPunch, Indenter
from indent_sim.model.units import Scales
from indent_sim.process.errors import ConfigError
from indent_sim.scene.compression_theory import covers_top
from indent_sim.scene.half_space_formulas import half_space_force
from indent_sim.scene.regions import Layers, layer_material
from indent_sim.theory.half_space import estimate_depth
from indent_sim.theory.theory import Theory

Center = tuple[float, ...]  # horizontal position of the tip's axis [length]
MAX_DEPTH_FRACTION = 0.9  # of the thickness: there no force is expected to find its depth
# at which theory is asked for a depth: the largest sizes the mesh, and a search needs no more
MAX_THEORY_FORCES = 3
RIM_TOLERANCE = 1e-9  # of a contact surface, from the tip's axis to its rim: less is none


def expected_depths(
    path: LoadPath,
    theory: Theory | None,
    tip: Indenter,
    material: Material,
    height: float,
    scales: Scales,
    mirror_multiplicity: int = 1,
) -> tuple[float, ...]:
    """The requested depths, or those to expect at the requested forces, within DEEPEST of the
    body's height.

    Of forces by theory, or by the tip's section where there is none or it ends; between MOST_FORCES
    by power laws. seen: how many times the body the tip sees, each with the prescribed force.
    ConfigError when theory says that a linear body does not bear the largest force.
    """
    if path.control == "depth":
        return path.values
    max_depth = MAX_DEPTH_FRACTION * height
    forces = [mirror_multiplicity * force for force in path.values]
    positive_forces = np.unique([force for force in forces if force > 0])
    sample_forces = (
        positive_forces
        if len(positive_forces) <= MAX_THEORY_FORCES
        else np.geomspace(positive_forces[0], positive_forces[-1], MAX_THEORY_FORCES)
    )
    sample_depths = []
    E_star = material.E_star
    for force in map(float, sample_forces):
        start = estimate_depth(tip.radius_at, force, E_star) if scales.dim == 3 else force / E_star
        depth = (theory and theory.depth_of_force(force, max_depth)) or min(start, max_depth / 2)
        sample_depths.append(float(f"{depth:.9g}"))  # the same in all units, and so is the mesh
    interpolate_log = partial(np.interp, xp=np.log(sample_forces), fp=np.log(sample_depths))
    depths = tuple(
        float(np.exp(interpolate_log(np.log(force)))) if force > 0 else 0.0 for force in forces
    )
    if material.is_small_strain and theory and max(depths) > (1 - 1e-6) * max_depth:
        largest = max(path.values) * scales.force
        problem = (
            f"a force of {largest:g} would press the tip to {MAX_DEPTH_FRACTION:.0%} of the body's "
            "thickness or deeper"
        )
        raise ConfigError("loading", problem, "use a smaller force")
    return depths


def check_scene(
    body: Body,
    layers: Layers,
    tip: Indenter,
    center: Center,
    path: LoadPath,
    contacts: int,
    key: str,
) -> None:
    """ConfigError for a tip that does not stand on a body, or a path that leads it where it cannot
    go.
    """
    if body.lateral_extent(center) < 0:
        raise ConfigError(
            "indenter.center",
            f"{list(center)} lies outside the body's top surface",
            "move it inside",
        )
    delta = max(path.values)
    thickness = contacts * body.height
    _check_punch_width(body, tip, center)
    if path.control == "force":
        return
    if delta >= thickness:
        problem = f"depth {delta:g} is beyond the body's thickness {thickness:g}"
        raise ConfigError(key, problem, f"stay below {thickness:g}")
    if delta >= (coverage_depth := top_coverage_depth(body, layers, tip, center)):
        coverage_text = f"at {coverage_depth:g} the tip would cover its whole top"
        problem = f"depth {delta:g} leaves no room to an incompressible body held on all sides: {coverage_text}"
        raise ConfigError(key, problem, "stay well below, free a side, or nu < 0.5")
    if delta > (side_depth := side_contact_depth(body, tip, center)):
        side = f"the top of a fixed side, which it meets at {side_depth:g}"
        problem = (
            f"depth {delta:g} presses the tip onto {side}: nothing moves it, and the force "
            "has no bound"
        )
        raise ConfigError(
            key, problem, f"stay below {side_depth:g}, free that side, or take a wider body"
        )


def _check_punch_width(body: Body, tip: Indenter, center: Center) -> None:
    """ConfigError for a sharp punch wider than a flat top that it does not cover: its edge would
    cross that of the body.
    """
    if (
        not isinstance(tip, FlatPunch)
        or tip.edge_radius
        or isinstance(body, SphericalBody)
        or covers_top(tip, body, center)
    ):
        return
    widest = body.lateral_extent(body.center)
    if tip.radius > widest:
        problem = f"the edge of a flat punch of radius {tip.radius:g} crosses that of the body"
        covering = (
            ""
            if isinstance(body, ImportedBody)
            else f", at least {body.max_lateral_extent(center):g}, or shape: plate"
        )
        raise ConfigError("indenter.radius", problem, f"at most {widest:g}{covering}")


def expected_radius(
    theory: Theory | None, tips: Sequence[Indenter], body: Body, center: Center, delta: float
) -> float:
    """Contact radius at the deepest point: layer theory, else the smallest of the tips' sections;
    within the body.
    """
    rim = max(body.lateral_extent(center), 0.05 * body.lateral_extent(body.center))
    if isinstance(body, ImportedBody) and rim <= RIM_TOLERANCE * body.max_lateral_extent(center):
        rim = body.max_lateral_extent(center)  # half of a symmetric body, cut where the tip stands
    if delta <= 0:
        return 0.2 * rim if isfinite(rim) else 1.0
    if isinstance(body, ImportedBody):
        return min(_overlap_radius(tips[0], body, center, delta), rim)
    solution = theory.solution_at_depth(delta) if theory else None
    return min(solution.a if solution else min(tip.radius_at(delta) for tip in tips), rim)


def _overlap_radius(tip: Indenter, body: ImportedBody, center: Center, delta: float) -> float:
    """How far from its axis [length] a tip at a depth would overlap the undeformed surface, to a
    part of a facet.
    """
    distances = body.corner_distances(center).ravel()
    gap = (_tip_heights(tip, body.top_points(), center) - body.facets[..., -1]).ravel()
    order = np.argsort(np.where(np.isfinite(gap), distances, np.inf))[: np.isfinite(gap).sum()]
    return float(
        np.interp(delta, np.maximum.accumulate([0.0, *gap[order]]), [0.0, *distances[order]])
    )


def top_coverage_depth(body: Body, layers: Sequence[Layer], tip: Indenter, center: Center) -> float:
    """The depth [length] at which the tip would cover the whole top; infinity for a body that can
    give way.

    The volume under the undeformed top stays what it is, so the surface's mean height stays 0, and
    under a tip that touches it everywhere that is the tip's mean height minus the depth. The force
    grows beyond all bounds before.
    """
    materials = [layer_material(layer) for layer in layers]
    materials += [inclusion.material.canonical() for inclusion in body.inclusions or ()]
    if any(material.constants.nu < 0.5 for material in materials) or not body.is_laterally_confined:
        return float("inf")
    return float(np.mean(_tip_heights(tip, body.top_points(), center)))


def side_contact_depth(body: Body, tip: Indenter, center: Center) -> float:
    """The depth [length] at which the tip meets the top of a fixed side; infinity where no side is
    fixed.

    Deeper, the surface would have to jump from u_z = 0 at the side to the tip beside it: no
    displacement of finite energy does, and the force of a mesh grows as the logarithm of its
    elements there.
    """
    z = body.fixed_points[:, -1] if isinstance(body, ImportedBody) else 0.0
    return float(np.min(_tip_heights(tip, body.fixed_edge_points(), center) - z, initial=np.inf))


def _tip_heights(tip: Indenter, points: Points, center: Center) -> Any:
    """How high a tip is above its apex [length] over points, seen from above."""
    along_x, along_y = (*center, 0.0)[:2]
    return tip.height(points[0] - along_x, points[1] - along_y)


BISECTIONS = 40  # of the way of a spring's base, until the depth is known


def path_to_max_depth(
    history: History,
    least_modulus_fraction: float,
    compliance: float,
    tip: Indenter,
    layers: Sequence[Layer],
) -> LoadPath:
    """Equal steps to the largest depth, or force, that a history may come to.

    What relaxes lets the tip in as far as a body of the least share `least_modulus_fraction` of its modulus, and a
    spring keeps the tip back by the least force that a half-space of the softest layer has.
    """
    largest = history.largest_value
    if history.control == "force":
        return Loading(force=largest / least_modulus_fraction).path()
    if not compliance:
        return Loading(delta=largest).path()
    E_star = least_modulus_fraction * min(layer_material(layer).E_star for layer in layers)

    def beyond(depth: float) -> bool:
        half_space_formula = half_space_force(tip, depth, E_star)
        radius = tip.radius_at(depth)
        if not half_space_formula and not isfinite(
            radius
        ):  # a plate: the least force of a body is not known
            return depth >= largest
        force = half_space_formula[1] if half_space_formula else 0.5 * E_star * radius * depth
        return depth + compliance * force >= largest

    low = 0.0
    high = largest
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if beyond(middle) else (middle, high)
    return Loading(delta=high).path()
