"""Checks of a body: its shape, layers, coatings, surface tension and inclusions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import accumulate
from math import inf, isclose

from indent_sim.config.key_types import types_by_tag
from indent_sim.config.scene_sections import SceneSections, key_of_inclusion, key_of_layer
from indent_sim.model.body import AnyBody, Cylinder
from indent_sim.model.inclusions import (
    POSITION_TOLERANCE,
    BoxInclusion,
    EllipsoidInclusion,
    Inclusion,
)
from indent_sim.model.materials import Material
from indent_sim.model.spherical_bodies import Ball, Cap, CurvedBody, Ellipsoid
from indent_sim.model.unbounded_bodies import HalfSpace
from indent_sim.model.walled_bodies import Box, Strip
from indent_sim.process.errors import ConfigError

MIRROR_PLANE = "the mirror plane"


def cap_errors(config: SceneSections) -> Iterator[ConfigError]:
    """Yield an error for invalid height or contact angle of a cap."""
    body = config.body
    if not isinstance(body, Cap):
        return
    max_flatness = 1e3
    max_steepness = 20.0
    if body.height and body.contact_angle:
        yield ConfigError(
            "body.contact_angle",
            "cannot be combined with height: each of the two alone defines the shape of the cap",
            "give one of the two",
        )
    elif not body.height and not body.contact_angle:
        yield ConfigError("body.height", "missing, and so is contact_angle", "give one of the two")
    elif body.apex_height < body.base_radius / max_flatness:
        problem = (
            f"a cap {body.apex_height:.4g} high on a base of radius {body.base_radius:g} is nearly "
            "flat"
        )
        yield ConfigError(
            "body", problem, f"use a height of at least base_radius/{max_flatness:g}, or a cylinder"
        )
    elif body.apex_height > body.base_radius * max_steepness:
        problem = (
            f"a cap {body.apex_height:.4g} high on a base of radius {body.base_radius:g} is almost "
            "a ball that rests on a point"
        )
        yield ConfigError(
            "body", problem, f"use a height of at most {max_steepness:g} base_radius, or a ball"
        )


def ellipsoid_errors(config: SceneSections) -> Iterator[ConfigError]:
    """Yield an error for an ellipsoid that is nearly a disk or a needle."""
    body = config.body
    # Largest ratio of the semi-axes. Elements are about as long as the smaller one divided by 8.
    max_ratio = 10.0
    if not isinstance(body, Ellipsoid):
        return
    ratio = body.height / (2 * body.radius)
    if not 1 / max_ratio <= ratio <= max_ratio:
        problem = f"an ellipsoid with a height of {ratio:.4g} times its width is not modelled"
        low, high = (f"{2 * body.radius * factor:.4g}" for factor in (1 / max_ratio, max_ratio))
        yield ConfigError("body.height", problem, f"use a height from {low} to {high}")


def resting_body_errors(config: SceneSections) -> Iterator[ConfigError]:
    """Yield errors of parts of the scene that are not supported if the body rests on a flat."""
    body = config.body
    if not isinstance(body, CurvedBody) or body.base != "unbonded":
        return
    adhesion = config.experiment.adhesion if config.experiment else None
    bonded = "use body.base: fixed"
    reasons = (
        (
            any(not material.is_small_strain for _, material in config.materials()),
            "needs a linear elastic body",
            f"give the body a linear elastic material, or {bonded}",
        ),
        (
            any(material.is_time_dependent for _, material in config.materials()),
            "needs a body that does not depend on time",
            f"leave material.flow and relaxation of shear out, or {bonded}",
        ),
        (
            config.yields,
            "may not yield: its two contacts are solved with the compliance of an elastic body",
            f"leave material.plasticity out, or {bonded}",
        ),
        (
            any(material.relaxation for _, material in config.materials())
            or config.loading.prescribed_history is not None,
            (
                "is not modelled with relaxation or a history, because its load curve is that of "
                "two contacts"
            ),
            f"give loading.delta or force, or {bonded}",
        ),
        (
            not config.contact.is_conservative,
            "is modelled without friction in both contacts",
            f"leave contact.friction out, or {bonded}",
        ),
        (
            config.contact.adhesion is not None,
            "is modelled with adhesion in the limit of a short range only",
            "give experiment.adhesion: {work: ..., base_work: ...} in place of contact.adhesion, "
            f"or {bonded}",
        ),
        (
            adhesion is not None and adhesion.base_work is None,
            "is lifted off by a tip that adheres to it, at a force of 0: the flat does not hold it",
            "give experiment.adhesion.base_work, the work of adhesion between body and flat, or "
            f"{bonded}",
        ),
        (
            adhesion is not None and isinstance(body, Cap),
            "with a flat base adheres to the flat by a contact that does not shrink, but separates "
            "all at once",
            f"use a ball or an ellipsoid, or {bonded}",
        ),
        (
            bool(body.surface_tension),
            "is not modelled with surface tension",
            f"leave body.surface_tension out, or {bonded}",
        ),
        (
            config.contact.gap == "current",
            "needs the gap at the undeformed point",
            "use contact.gap: reference",
        ),
        (
            config.contact.method == "nitsche",
            "is solved by static condensation, which is not possible with nitsche",
            "use contact.method: auto",
        ),
        (
            config.solver.method in ("newton", "theory"),
            "is solved by static condensation",
            "use solver.method: auto",
        ),
    )
    for applies, problem, remedy in reasons:
        if applies:
            yield ConfigError("body.base", f"a body that rests on a flat {problem}", remedy)


def layer_errors(config: SceneSections) -> Iterator[ConfigError]:
    """Yield errors in the materials and thicknesses of layers."""
    layers = config.body.layers or ()
    bare_layers = [k for k, layer in enumerate(layers) if layer.material is None]
    if not layers and not getattr(config.body, "regions", None):
        bare_layers = [0]
    if bare_layers and config.material is None:
        problem = "this section is missing"
        if layers:
            problem += f", and {key_of_layer(bare_layers[0])} has no material"
        kinds = ", ".join(types_by_tag(Material, "model"))
        yield ConfigError("material", problem, f"give model: one of {kinds}")
    without_thickness = [k for k, layer in enumerate(layers) if layer.thickness is None]
    if isinstance(config.body, HalfSpace | Cap | Ball):
        without_thickness = [k for k in without_thickness if k < len(layers) - 1]
        if layers and layers[-1].thickness is not None:
            last = "substrate" if isinstance(config.body, HalfSpace) else "core"
            problem = (
                f"the last layer of a {config.body.shape} is its {last}, which has no thickness"
            )
            key = f"{key_of_layer(len(layers) - 1)}.thickness"
            yield ConfigError(key, problem, "leave it out, or add a layer below")
    if isinstance(config.body, Cap | Ball) and not without_thickness:
        yield from _coating_errors(config, config.body)
    elif config.mesh.h_layers is not None and not isinstance(config.body, Cap | Ball):
        yield ConfigError(
            "mesh.h_layers",
            "applies only to the layers around the core of a cap or ball",
            "leave it out",
        )
    yield from (
        ConfigError(f"{key_of_layer(k)}.thickness", "missing", "give a number > 0")
        for k in without_thickness
    )
    if layers and not without_thickness and isinstance(config.body, Cylinder | Strip | Box):
        total_thickness = sum(layer.thickness or 0.0 for layer in layers)
        height = config.body.height
        if not isclose(total_thickness, height, rel_tol=1e-9):
            problem = (
                f"the total thickness of the layers is {total_thickness:.10g}, but the body is "
                f"{height:.10g} high"
            )
            yield ConfigError("body.layers", problem, "make their thicknesses add up to the height")


def _coating_errors(config: SceneSections, body: Cap | Ball) -> Iterator[ConfigError]:
    """Yield errors in the thicknesses and element sizes of coatings."""
    coatings = (body.layers or ())[:-1]
    sizes = config.mesh.h_layers
    if sizes is not None and len(sizes) != len(coatings):
        problem = f"has {len(sizes)} sizes, but the body has {len(coatings)} layers around its core"
        yield ConfigError("mesh.h_layers", problem, "give one for each layer, or leave it out")
    if isinstance(body, Cap) and bool(body.height) == bool(body.contact_angle):
        # The shape of a cap without a valid height is unknown.
        return
    total_thickness = sum(layer.thickness or 0.0 for layer in coatings)
    sphere = body.spherical_body
    thinnest = min((layer.thickness or inf for layer in coatings), default=inf)
    # Smallest fraction of the largest total thickness of coatings that must remain for the core.
    min_fraction = 0.02
    # Smallest thickness of a coating over the radius of its sphere. The whole circumference has
    # elements of the size of the thickness.
    min_ratio = 1e-3
    if total_thickness > (1 - min_fraction) * sphere.max_coating_thickness:
        core_text = "no core" if isinstance(body, Ball) else "a core that does not reach the base"
        problem = (
            f"the total thickness of the layers around the core is {total_thickness:.6g}, which "
            f"leaves {core_text}"
        )
        limit = (1 - min_fraction) * sphere.max_coating_thickness
        yield ConfigError("body.layers", problem, f"use a total thickness of at most {limit:.6g}")
    elif thinnest < min_ratio * sphere.radius:
        problem = (
            f"a layer {thinnest:.4g} thick on a {body.shape} of radius {sphere.radius:.4g} is "
            "too thin to mesh"
        )
        limit = min_ratio * sphere.radius
        yield ConfigError("body.layers", problem, f"use a thickness of at least {limit:.3g}")


def surface_tension_errors(config: SceneSections) -> Iterator[ConfigError]:
    """Yield an error if surface tension is combined with an incompatible effect."""
    if not config.body.surface_tension:
        return
    key = "body.surface_tension"
    remedy = "give one of the two"
    if config.experiment and config.experiment.adhesion:
        problem = (
            "cannot be combined with experiment.adhesion: the JKR limit holds for a body "
            "without surface tension"
        )
        yield ConfigError(key, problem, remedy)
    if config.contact.may_snap_through:
        yield ConfigError(key, "is not verified together with contact.adhesion", remedy)
    relaxing_key = next((law_key for law_key, law in config.materials() if law.relaxation), None)
    if relaxing_key:
        problem = f"does not relax, but {relaxing_key}.relaxation applies to the whole load curve"
        yield ConfigError(key, problem, remedy)


def inclusion_errors(config: SceneSections) -> Iterator[ConfigError]:
    """Yield errors in the inclusions: number of sizes, shape, and distance from surfaces."""
    inclusions = config.body.inclusions or ()
    if config.mesh.h_inclusions is not None and len(config.mesh.h_inclusions) != len(inclusions):
        problem = (
            f"has {len(config.mesh.h_inclusions)} sizes, but the body has {len(inclusions)} "
            "inclusions"
        )
        yield ConfigError(
            "mesh.h_inclusions", problem, "give one for each inclusion, or leave it out"
        )
    faces = _level_faces(config) if inclusions else []
    for k, inclusion in enumerate(inclusions):
        overlapping = [
            m
            for m in range(k)
            if inclusion.overlaps(inclusions[m], _min_clearance(inclusion, inclusions[m]))
        ]
        surface_problem = (
            _side_problem(config.body, inclusion)
            or _level_face_problem(faces, inclusion)
            or _coating_face_problem(config.body, inclusion)
        )
        if unsupported := _unsupported_inclusion(config.body, inclusion):
            yield ConfigError(key_of_inclusion(k), *unsupported)
        elif surface_problem or overlapping:
            problem = surface_problem or f"overlaps or touches {key_of_inclusion(overlapping[0])}"
            remedy = (
                f"move it, or make it smaller: its distance from any surface must be at least "
                f"{_min_clearance(inclusion):.3g}"
            )
            yield ConfigError(key_of_inclusion(k), problem, remedy)


def _unsupported_inclusion(body: AnyBody, inclusion: Inclusion) -> tuple[str, str] | None:
    """Return the reason why a body cannot have an inclusion, and a remedy; None if it can."""
    if isinstance(body, Strip) and inclusion.center[1]:
        return (
            f"a strip is infinite along y, but the center is at y = {inclusion.center[1]:g}",
            "use y = 0",
        )
    if isinstance(body, Cap | Ball) and not inclusion.is_axisymmetric_about((0.0, 0.0)):
        reason = "the inclusion is off the axis"
        if isinstance(inclusion, BoxInclusion):
            reason = "a box is not axisymmetric"
        elif isinstance(inclusion, EllipsoidInclusion):
            along_x, along_y, _ = inclusion.semi_axes
            if along_x != along_y:
                reason = f"the semi-axes {along_x:g} along x and {along_y:g} along y differ"
        remedy = "use a ball, a cylinder or an ellipsoid of equal x and y semi-axes at x = y = 0"
        return f"a {body.shape} is modelled as axisymmetric: {reason}", remedy
    return None


def _side_problem(body: AnyBody, inclusion: Inclusion) -> str:
    """Return a message if an inclusion crosses a side or is too close to it, otherwise ""."""
    shape = body.spherical_body if isinstance(body, Cap | Ball) else body
    clearance = shape.wall_clearance(inclusion)  # type: ignore[union-attr]
    if clearance >= _min_clearance(inclusion):
        return ""
    if clearance < 0:
        return f"leaves the body through its side, by {-clearance:.4g}"
    return f"is {clearance:.3g} from the body's side"


def _level_face_problem(faces: Sequence[tuple[str, float]], inclusion: Inclusion) -> str:
    """Return a message on an inclusion too close to top, base or interface, otherwise ""."""
    z = inclusion.center[2]
    half_height = inclusion.half_width(2)
    min_clearance = _min_clearance(inclusion)
    for name, height in faces:
        if name == MIRROR_PLANE and isclose(z, height, rel_tol=POSITION_TOLERANCE):
            return ""
        if abs(z - height) < half_height:
            span = f"it spans z = {z - half_height:.6g} to {z + half_height:.6g}"
            return f"crosses {name} at z = {height:.6g}: {span}"
        if abs(z - height) < half_height + min_clearance:
            return f"is {abs(z - height) - half_height:.3g} from {name} at z = {height:.6g}"
    top = faces[0][1]
    bottom = faces[-1][1]
    if bottom < z < top:
        return ""
    return f"is outside the body, which spans z = {bottom:.6g} to {top:.6g}"


def _coating_face_problem(body: AnyBody, inclusion: Inclusion) -> str:
    """Return a message on an inclusion too close to the inner face of a coating; else ""."""
    if not isinstance(body, Cap | Ball):
        return ""
    radius = body.spherical_body.radius
    sphere_center = (0.0, 0.0, -radius)
    near = float(inclusion.distance(sphere_center))
    far = float(inclusion.farthest_distance(sphere_center))
    thicknesses = (layer.thickness or 0.0 for layer in (body.layers or ())[:-1])
    for k, depth in enumerate(accumulate(thicknesses)):
        face = f"the inner face of {key_of_layer(k)}"
        clearance = max(near - (radius - depth), radius - depth - far)
        if clearance < 0:
            overlap = min(far - (radius - depth), radius - depth - near)
            return f"crosses {face}, {depth:.6g} below the surface, by {overlap:.3g}"
        if clearance < _min_clearance(inclusion):
            return f"is {clearance:.3g} from {face}, {depth:.6g} below the surface"
    return ""


def _level_faces(config: SceneSections) -> list[tuple[str, float]]:
    """Return names and z [length] of the horizontal faces from the top.

    The mirror plane of a ball is not included, since an inclusion may be centered on it.
    """
    body = config.body
    depths = list(accumulate(layer.thickness or inf for layer in config.layers))
    if isinstance(body, CurvedBody):
        depths = [body.spherical_body.height]
    names = [f"the interface below {key_of_layer(k)}" for k in range(len(depths) - 1)]
    names.append(MIRROR_PLANE if isinstance(body, Ball) and body.base == "roller" else "the base")
    return [("the top", 0.0), *((name, -depth) for name, depth in zip(names, depths, strict=True))]


def _min_clearance(*inclusions: Inclusion) -> float:
    """Return the smallest allowed distance [length] of inclusions from any surface.

    The gap must be large enough for elements.
    """
    # Smallest distance of an inclusion from any other surface over half of its smallest thickness.
    min_fraction = 0.01
    return min_fraction * min(inclusion.min_half_width for inclusion in inclusions)
