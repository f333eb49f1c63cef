"""Expected depths of a scene, and the largest depths that the body and the tip allow."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from math import isfinite
from typing import Any

import numpy as np

from indent_sim.model.body import Body
from indent_sim.model.body_base import Points
from indent_sim.model.history import History
from indent_sim.model.imported_body import ImportedBody
from indent_sim.model.layers import Layer
from indent_sim.model.load_path import LoadPath
from indent_sim.model.loading import Loading
from indent_sim.model.materials import Material
from indent_sim.model.spherical_bodies import SphericalBody
from indent_sim.model.tips import FlatPunch, Indenter
from indent_sim.model.units import Scales
from indent_sim.process.errors import ConfigError
from indent_sim.scene.compression_theory import covers_top
from indent_sim.scene.half_space_formulas import half_space_force
from indent_sim.scene.regions import Layers, layer_material
from indent_sim.theory.half_space import estimate_depth
from indent_sim.theory.theory import Theory

Center = tuple[float, ...]  # Horizontal position of the tip's axis [length].
# Distance from the tip's axis to the edge of an imported contact surface, relative to the largest
# such distance, up to which the axis counts as lying on the edge.
RIM_TOLERANCE = 1e-9


def expected_depths(
    path: LoadPath,
    theory: Theory | None,
    tip: Indenter,
    material: Material,
    height: float,
    scales: Scales,
    mirror_multiplicity: int = 1,
    yielding_depth: Callable[[float, float], float | None] | None = None,
) -> tuple[float, ...]:
    """Return the prescribed depths, or the depths expected at the prescribed forces.

    Depths at forces follow from theory, or from the cross-section of the tip if there is no theory;
    between three forces they are interpolated by power laws.

    Parameters
    ----------
    path : LoadPath
        The prescribed depths or forces, nondimensional.
    theory : Theory or None
        The reference theory.
    tip : Indenter
        The equivalent tip: over a flat body it has the gap that the real tip has over the curved
        one.
    material : Material
        The material below the tip.
    height : float
        Height of the body [length]; depths are at most 0.9 of it.
    scales : Scales
        Scales of the problem, for messages.
    mirror_multiplicity : int, optional
        Number of bodies in contact with the tip, including mirror images (1, 2 or 4). The theory is
        evaluated at the total force, which is this number times the prescribed force.
    yielding_depth : callable, optional
        Function that returns the depth of a body that yields at a force, or None, from the force
        and the depth of the elastic body.

    Returns
    -------
    tuple of float
        One depth per value of the path [length].

    Raises
    ------
    ConfigError
        If a linear body would be compressed too far by the largest force, according to theory.
    """
    if path.control == "depth":
        return path.values
    # Largest depth that prescribed forces are expected to reach, as a fraction of the thickness.
    max_depth_fraction = 0.9
    max_depth = max_depth_fraction * height
    forces = [mirror_multiplicity * force for force in path.values]
    positive_forces = np.unique([force for force in forces if force > 0])
    # Number of forces at which theory is solved for a depth; others are interpolated. The mesh
    # depends on the largest depth only, and load control needs no better initial guess.
    max_theory_forces = 3
    sample_forces = (
        positive_forces
        if len(positive_forces) <= max_theory_forces
        else np.geomspace(positive_forces[0], positive_forces[-1], max_theory_forces)
    )
    sample_depths = []
    E_star = material.E_star
    for force in map(float, sample_forces):
        start = estimate_depth(tip.radius_at, force, E_star) if scales.dim == 3 else force / E_star
        depth = (theory and theory.depth_of_force(force, max_depth)) or min(start, max_depth / 2)
        if yielding_depth:
            depth = min(yielding_depth(force, depth) or depth, max_depth)
        # Rounding makes the depth, and with it the mesh, independent of the user's units.
        sample_depths.append(float(f"{depth:.9g}"))
    interpolate_log = partial(np.interp, xp=np.log(sample_forces), fp=np.log(sample_depths))
    depths = tuple(
        float(np.exp(interpolate_log(np.log(force)))) if force > 0 else 0.0 for force in forces
    )
    # Theory returns at most max_depth, which is rounded to 9 digits above.
    if material.is_small_strain and theory and max(depths) > (1 - 1e-6) * max_depth:
        largest = max(path.values) * scales.force
        problem = (
            f"a force of {largest:g} would press the tip to {max_depth_fraction:.0%} of the body's "
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
    """Check that the tip is above the body and can reach the depths of the path.

    Parameters
    ----------
    body : Body
        The body, in the user's units.
    layers : tuple of Layer
        The layers of the body from the top.
    tip : Indenter
        The tip, in the user's units.
    center : tuple of float
        Horizontal position of the tip's axis [length].
    path : LoadPath
        The prescribed depths or forces.
    contacts : int
        Number of equal contacts of the body, which share its height.
    key : str
        The key of the path in the scene file.

    Raises
    ------
    ConfigError
        If a check fails.
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
        raise ConfigError(key, problem, f"use a depth below {thickness:g}")
    if delta >= (coverage_depth := top_coverage_depth(body, layers, tip, center)):
        problem = (
            f"depth {delta:g} is impossible for an incompressible body held on all sides: at "
            f"{coverage_depth:g} the tip would cover its whole top"
        )
        raise ConfigError(
            key, problem, f"use a depth well below {coverage_depth:g}, a free side, or nu < 0.5"
        )
    if delta > (side_depth := side_contact_depth(body, tip, center)):
        problem = (
            f"at the depth {side_depth:g} the tip touches the upper edge of a fixed side, which "
            f"cannot move: at {delta:g} the force would grow without bound as the elements shrink"
        )
        raise ConfigError(
            key, problem, f"use a depth of at most {side_depth:g}, a free side, or a wider body"
        )


def _check_punch_width(body: Body, tip: Indenter, center: Center) -> None:
    """Raise ConfigError if a sharp punch is wider than a flat top that it does not cover."""
    punch = tip.upright
    is_tilted = tip.tilt_direction is not None
    if (
        not isinstance(punch, FlatPunch)
        or (punch.edge_radius and not is_tilted)
        or isinstance(body, SphericalBody)
        or covers_top(tip, body, center)
    ):
        return
    widest = body.lateral_extent(body.center)
    if punch.radius > widest:
        problem = (
            f"the edge of a flat punch of radius {punch.radius:g} crosses the edge of the body"
        )
        remedy = f"use a radius of at most {widest:g}, so that the punch is inside the top"
        if not isinstance(body, ImportedBody) and not is_tilted:
            # All digits, since a smaller radius would not cover the top.
            covering_radius = f"{body.max_lateral_extent(center):.10g}"
            remedy += (
                f", or of at least {covering_radius}, so that it covers the top, or shape: plate"
            )
        raise ConfigError("indenter.radius", problem, remedy)


def expected_radius(
    theory: Theory | None, tips: Sequence[Indenter], body: Body, center: Center, delta: float
) -> float:
    """Return the expected contact radius at a depth, at most the lateral extent of the body.

    The radius follows from theory, or without a theory from the smallest cross-section of the tips
    at that depth.

    Parameters
    ----------
    theory : Theory or None
        The reference theory.
    tips : sequence of Indenter
        The equivalent tip (over a flat body it has the gap that the real tip has over the curved
        one), and the real tip.
    body : Body
        The nondimensional body.
    center : tuple of float
        Horizontal position of the tip's axis [length].
    delta : float
        Depth [length].

    Returns
    -------
    float
        The contact radius [length].
    """
    # Near an edge of the body, the lower bound keeps the element size away from 0.
    rim = max(body.lateral_extent(center), 0.05 * body.lateral_extent(body.center))
    if isinstance(body, ImportedBody) and rim <= RIM_TOLERANCE * body.max_lateral_extent(center):
        # The mesh is half of a symmetric body, with the tip's axis on the mirror plane.
        rim = body.max_lateral_extent(center)
    if delta <= 0:
        # A tip that only touches the body has no contact radius; the mesh needs one.
        return 0.2 * rim if isfinite(rim) else 1.0
    if isinstance(body, ImportedBody):
        return min(_overlap_radius(tips[0], body, center, delta), rim)
    solution = theory.solution_at_depth(delta) if theory else None
    return min(solution.a if solution else min(tip.radius_at(delta) for tip in tips), rim)


def _overlap_radius(tip: Indenter, body: ImportedBody, center: Center, delta: float) -> float:
    """Return the radius [length] within which a tip at a depth overlaps the undeformed surface.

    The gap is interpolated between the corners of the facets.
    """
    distances = body.corner_distances(center).ravel()
    gap = (_tip_heights(tip, body.top_points(), center) - body.facets[..., -1]).ravel()
    order = np.argsort(np.where(np.isfinite(gap), distances, np.inf))[: np.isfinite(gap).sum()]
    return float(
        np.interp(delta, np.maximum.accumulate([0.0, *gap[order]]), [0.0, *distances[order]])
    )


def top_coverage_depth(body: Body, layers: Sequence[Layer], tip: Indenter, center: Center) -> float:
    """Return the depth [length] at which the tip covers the top of a confined incompressible body.

    The volume of the body is constant, so that the mean height of its surface remains 0. If the tip
    is in contact everywhere, this mean height equals the mean height of the tip minus the depth.
    The force becomes infinite at this depth. For other bodies there is no such depth, and infinity
    is returned.
    """
    materials = [layer_material(layer) for layer in layers]
    materials += [inclusion.material.canonical() for inclusion in body.inclusions or ()]
    if any(material.constants.nu < 0.5 for material in materials) or not body.is_laterally_confined:
        return float("inf")
    return float(np.mean(_tip_heights(tip, body.top_points(), center)))


def side_contact_depth(body: Body, tip: Indenter, center: Center) -> float:
    """Return the depth [length] at which the tip reaches the top of a fixed side, or infinity.

    At larger depths the surface displacement would have to jump from u_z = 0 at the side to the
    displacement of the tip, which requires infinite energy. The force on a mesh then grows
    logarithmically as the elements shrink.
    """
    z = body.fixed_points[:, -1] if isinstance(body, ImportedBody) else 0.0
    return float(np.min(_tip_heights(tip, body.fixed_edge_points(), center) - z, initial=np.inf))


def _tip_heights(tip: Indenter, points: Points, center: Center) -> Any:
    """Return the height of the tip's surface above its apex [length] at horizontal positions."""
    along_x, along_y = (*center, 0.0)[:2]
    return tip.height(points[0] - along_x, points[1] - along_y)


def _with_slides_of(history: History, path: LoadPath) -> LoadPath:
    """Return the path, continued by the slides of a history at its last depth or force."""
    if not history.slide_points:
        return path
    displacements = tuple(x for _, x in history.slide_points)
    slides = (0.0,) * len(path.values) + displacements
    return replace(path, values=path.values + path.values[-1:] * len(displacements), slides=slides)


def path_to_max_depth(
    history: History,
    least_modulus_fraction: float,
    compliance: float,
    tip: Indenter,
    layers: Sequence[Layer],
) -> LoadPath:
    """Return a path in equal steps to an upper bound of the depth or force of a history.

    If the tip slides during the history, it then slides to each of its displacements.

    Parameters
    ----------
    history : History
        The prescribed history.
    least_modulus_fraction : float
        Smallest fraction of the instantaneous modulus during the history. The depth at a prescribed
        force is that of a body with this modulus.
    compliance : float
        Compliance of the spring that carries the tip [length/force]. The force of the spring is the
        contact force, which is at least that on a half-space of the softest layer; this bounds the
        depth from above.
    tip : Indenter
        The equivalent tip: over a flat body it has the gap that the real tip has over the curved
        one.
    layers : sequence of Layer
        Layers from the top.

    Returns
    -------
    LoadPath
        The path to the largest depth or force.
    """
    largest = history.largest_value
    if history.control == "force":
        path = Loading(force=largest / least_modulus_fraction).path()
        return _with_slides_of(history, path)
    if not compliance:
        return _with_slides_of(history, Loading(delta=largest).path())
    # This import takes 0.2 s, which scenes without a spring need not spend.
    from scipy.optimize import brentq

    E_star = least_modulus_fraction * min(layer_material(layer).E_star for layer in layers)

    def excess(depth: float) -> float:
        """Return the base displacement at a depth minus the largest value of the history."""
        half_space_formula = half_space_force(tip, depth, E_star)
        radius = tip.radius_at(depth)
        if not half_space_formula and not isfinite(radius):
            # A plate has no lower bound of the force.
            return depth - largest
        # The force of a cone is 0.64 E* a d, and that of a paraboloid 0.94 E* a d, where a is the
        # radius of the cross-section at the depth d.
        force = half_space_formula[1] if half_space_formula else 0.5 * E_star * radius * depth
        return depth + compliance * force - largest

    return Loading(delta=brentq(excess, 0.0, largest, xtol=1e-12 * largest)).path()
