"""What a scene file may say: the sections, their keys, types, ranges and defaults.

The dataclasses of `model` are the schema of body, material, indenter, contact and loading; the
settings below are that of the rest. Reader, error messages, JSON Schema and docs/config.md all take
it from here.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from itertools import accumulate, pairwise
from math import inf, isclose
from typing import Annotated, Any, Literal, get_args, get_origin

from annotated_types import Ge, Gt, Le, Len, Lt, MinLen
from pydantic import BaseModel, ConfigDict, PrivateAttr, model_validator

from indent_sim.config import number_limits
from indent_sim.config.key_types import (
    bare_type,
    default_of,
    field_names,
    field_types,
    tag_of,
    type_of_tag,
    types_by_tag,
    union_members,
)
from indent_sim.config.strict_yaml import KeyPath
from indent_sim.model.body import AnyBody, Cylinder
from indent_sim.model.contact import AutoContact, Contact, Nitsche
from indent_sim.model.drainage import Drainage
from indent_sim.model.experiment import Experiment, JKRAdhesion
from indent_sim.model.gel import Gel
from indent_sim.model.hyperelasticity import NeoHookean
from indent_sim.model.imported_body import MeshFromFile
from indent_sim.model.inclusions import (
    POSITION_TOLERANCE,
    BoxInclusion,
    EllipsoidInclusion,
    Inclusion,
)
from indent_sim.model.layers import Layer
from indent_sim.model.loading import PATH_KEYS, Loading
from indent_sim.model.materials import Material, ShearRelaxingLaw
from indent_sim.model.relaxation import Relaxation
from indent_sim.model.spherical_bodies import Ball, Cap
from indent_sim.model.tips import FlatPunch, Indenter, Plate, Profile
from indent_sim.model.unbounded_bodies import HalfSpace, UnboundedBody
from indent_sim.model.units import LENGTH, Auto, Coordinate, Length, PositiveInt, TaggedBy
from indent_sim.model.walled_bodies import Box, Strip
from indent_sim.process.errors import ConfigError, ConfigErrors, printable

# of a folder [bytes]; room for the names beside it
MAX_NAME_BYTES = 200
MAX_PATH_LENGTH = 1000

# Every row's contact force must equal the reactions to 1e-8 (run/single_run.py). A looser residual
# would save an iteration, and leave a row that fails that audit or an error of the force that
# nobody could state.
MAX_RTOL = 1e-9
# Uniform refinements of a mesh from a file; 6 make 4096 cells of one in two dimensions.
MAX_REFINEMENTS = 6
LINEAR_ELEMENTS_GONE = (
    "linear elements were removed: with as many unknowns quadratic ones give a force ten "
    "times as accurate"
)
KeptStates = Literal["none", "last", "all"]
AccuracyPreset = Literal["fast", "balanced", "accurate"]
# Base radius over height of a cap, beyond which digits of its position on its large ball are lost.
MAX_CAP_FLATNESS = 1e3
# Height over base radius of a cap, beyond which (174 degrees) it is a ball on a point.
MAX_CAP_STEEPNESS = 20.0
MESH_SIZE_KEYS = (
    "h_contact",
    "h_axis",
    "h_edge",
    "h_corner",
    "h_film",
    "h_inclusions",
    "h_layers",
    "h_far",
    "grading",
)
MIRROR_PLANE = "the mirror plane"
PETSC_GONE = "was removed: a scene sets linear, method, rtol and max_iterations of solver"
# Keys that were in `experiment` and the sections that they are in now.
MOVED_KEYS = {"relaxation": "material", "history": "loading", "force_history": "loading"}
REMOVED_KEYS = {
    ("solver", "petsc"): (PETSC_GONE, "set PETSC_OPTIONS in the environment to tune PETSc")
}
REMOVED_KEYS |= {
    ("experiment", key): ("has moved", f"write {section}.{key}")
    for key, section in MOVED_KEYS.items()
}
# Fraction of the largest total thickness of coatings that has to remain for the core.
MIN_CORE_FRACTION = 0.02
# Thickness of a coating over the radius of its ball; elements as small as it go all around.
MIN_COATING_RATIO = 1e-3
# Relative difference of kT over the molecular volume up to which two solvents are the same.
SOLVENT_RTOL = 1e-6
# Distance of an inclusion from any other surface, in units of half its smallest thickness.
MIN_CLEARANCE_FRACTION = 0.01
# Keys that select the dataclass of a section, at any depth.
TAG_KEYS = {"shape", "model", "method"}


@dataclass(frozen=True)
class Units:
    """Units of plain numbers, by name.

    Quantities with a unit of their own are converted to them.
    """

    length: str = ""
    force: str = ""


@dataclass(frozen=True)
class MeshSettings:
    """Element sizes [length] and the part of the body that is modelled."""

    h_contact: Length | Auto = "auto"
    h_axis: Length | None = None
    h_edge: Length | None = None
    h_corner: Length | None = None
    h_film: Length | None = None
    h_inclusions: Annotated[tuple[Annotated[float, Gt(0)], ...], Len(1, 50), LENGTH] | None = None
    h_layers: Annotated[tuple[Annotated[float, Gt(0)], ...], Len(1, 50), LENGTH] | None = None
    h_far: Length | Auto = "auto"
    grading: Annotated[float, Gt(0), Le(1)] | Auto = "auto"
    order: Annotated[Literal[2], LINEAR_ELEMENTS_GONE] = 2
    refinements: Annotated[int, Ge(0), Le(MAX_REFINEMENTS)] | None = None
    symmetry: Literal["auto", "axisymmetric", "plane_strain", "quarter", "half", "full"] = "auto"


@dataclass(frozen=True)
class SolverSettings:
    """Solution of the equations.

    PETSc's own options are [the environment's](how_do_i.md#tune-petsc).
    """

    method: Literal["auto", "theory", "condensed", "newton"] = "auto"
    linear: Literal["auto", "direct", "iterative"] = "auto"
    rtol: Annotated[float, Gt(0), Le(MAX_RTOL)] = MAX_RTOL
    max_iterations: PositiveInt = 50


@dataclass(frozen=True)
class OutputSettings:
    """Output of a run, and its folder."""

    directory: Annotated[str, MinLen(1)] | None = None
    fields: Literal["auto", "none", "last", "all"] = "auto"
    nodal_stress: bool = False
    surface: KeptStates = "last"
    reactions: bool = False
    plot: bool = True


@dataclass(frozen=True)
class Source:
    """Source of every key of a config: file and line, or the `--set` that gave it.

    All sources are equal: two configs with the same values are equal, wherever they were written.
    """

    name: str = field(default="", compare=False)
    locations: dict[KeyPath, tuple[str, int | None]] = field(
        default_factory=dict, compare=False, repr=False
    )
    # Quantities as given, and as numbers in the units of the scene.
    quantities: dict[KeyPath, tuple[str, float]] = field(
        default_factory=dict, compare=False, repr=False
    )

    def location(self, path: KeyPath) -> tuple[str, int | None]:
        """Return file and line of a key, or of the nearest section around it."""
        for end in range(len(path), -1, -1):
            if path[:end] in self.locations:
                return self.locations[path[:end]]
        return self.name, None


class Config(BaseModel):
    """Checked scene file with its defaults; every "auto" is still undecided."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, strict=True, allow_inf_nan=False, revalidate_instances="always"
    )

    title: str = ""
    units: Units = Units()
    body: Annotated[AnyBody, TaggedBy("shape")]
    # Required unless every layer or region has its own material.
    material: Annotated[Material | None, TaggedBy("model")] = None
    indenter: Annotated[Indenter, TaggedBy("shape")]
    # In the file it is `indenter.center`.
    center: Annotated[tuple[Coordinate, ...], LENGTH] | None = None
    contact: Annotated[Contact, TaggedBy("method")] = AutoContact()
    drainage: Drainage | None = None
    loading: Loading
    experiment: Experiment | None = None
    mesh: MeshSettings = MeshSettings()
    accuracy: Annotated[float, Gt(0), Lt(1)] | AccuracyPreset | None = None
    solver: SolverSettings = SolverSettings()
    output: OutputSettings = OutputSettings()

    _source: Source = PrivateAttr(default_factory=Source)

    @property
    def source(self) -> Source:
        """Source of every key."""
        return self._source

    @property
    def initial_bath(self) -> float:
        """Value of the bath in the undeformed state."""
        in_time = self.loading.prescribed_history
        return (
            self.drainage.bath_at(in_time.points[0][0] if in_time else 0.0)
            if self.drainage
            else 0.0
        )

    @property
    def instrument(self) -> Experiment:
        """Experiment of the scene; one without any part if the file has none."""
        return self.experiment or Experiment()

    @property
    def layers(self) -> tuple[Layer, ...]:
        """Layers of the body from the top, each with its material; at least one."""
        given = self.body.layers or (Layer(getattr(self.body, "height", None)),)
        return tuple(
            dataclasses.replace(layer, material=layer.material or self.material) for layer in given
        )

    def material_key(self, layer: int) -> str:
        """Return the key of the material of a layer."""
        has_material = self.body.layers is not None and self.body.layers[layer].material is not None
        return f"body.layers[{layer}].material" if has_material else "material"

    def materials(self) -> Iterator[tuple[str, Material]]:
        """Yield every given material with its key."""
        keyed_materials = [("material", self.material)]
        keyed_materials += [
            (f"{key_of_layer(k)}.material", layer.material)
            for k, layer in enumerate(self.body.layers or ())
        ]
        keyed_materials += [
            (f"body.regions.{name}", region_material)
            for name, region_material in (getattr(self.body, "regions", None) or {}).items()
        ]
        inclusions = enumerate(self.body.inclusions or ())
        keyed_materials += [
            (f"{key_of_inclusion(k)}.material", inclusion.material) for k, inclusion in inclusions
        ]
        yield from ((key, material) for key, material in keyed_materials if material is not None)

    @model_validator(mode="after")
    def _check_consistency(self) -> Config:
        """Raise ConfigErrors with everything that keys contradict in each other."""
        body_checks = (
            _cap_errors,
            _layer_errors,
            _surface_tension_errors,
            _inclusion_errors,
            _material_errors,
            _flow_errors,
        )
        tip_checks = _contact_errors, _load_path_errors, _center_errors, _tip_errors
        checks = (
            *body_checks,
            *tip_checks,
            _history_errors,
            _relaxation_errors,
            _experiment_errors,
            _accuracy_errors,
            _mesh_file_errors,
            _directory_errors,
        )
        given = {name: part for name in sections() if (part := getattr(self, name)) is not None}
        if problems := number_limits.limit_errors(given) or [
            problem for check in checks for problem in check(self)
        ]:
            raise ConfigErrors.combine(problems)
        return self


def _cap_errors(config: Config) -> Iterator[ConfigError]:
    """Yield errors of the height and the contact angle of a cap."""
    body = config.body
    if not isinstance(body, Cap):
        return
    if body.height and body.contact_angle:
        yield ConfigError(
            "body.contact_angle",
            "contradicts height: each of them alone defines the shape of the cap",
            "give one",
        )
    elif not body.height and not body.contact_angle:
        yield ConfigError("body.height", "missing, and so is contact_angle", "give one of the two")
    elif body.apex_height < body.base_radius / MAX_CAP_FLATNESS:
        problem = (
            f"a cap {body.apex_height:.4g} high on a base of radius {body.base_radius:g} is nearly "
            "flat"
        )
        yield ConfigError(
            "body", problem, f"height at least base_radius/{MAX_CAP_FLATNESS:g}, or a cylinder"
        )
    elif body.apex_height > body.base_radius * MAX_CAP_STEEPNESS:
        problem = (
            f"a cap {body.apex_height:.4g} high on a base of radius {body.base_radius:g} is almost "
            "a whole ball on a point"
        )
        yield ConfigError(
            "body", problem, f"height at most {MAX_CAP_STEEPNESS:g} base_radius, or a ball"
        )


def _layer_errors(config: Config) -> Iterator[ConfigError]:
    """Yield errors of the materials and of the thicknesses of layers."""
    layers = config.body.layers or ()
    bare_layers = [k for k, layer in enumerate(layers) if layer.material is None]
    if not layers and not getattr(config.body, "regions", None):
        bare_layers = [0]
    if bare_layers and config.material is None:
        problem = "this section is missing"
        if layers:
            problem += f", and {key_of_layer(bare_layers[0])} has no material of its own"
        kinds = ", ".join(types_by_tag(field_types(Config)["material"], "model"))
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
            "mesh.h_layers", "is for the layers around the core of a cap or ball", "leave it out"
        )
    yield from (
        ConfigError(f"{key_of_layer(k)}.thickness", "missing", "give a number > 0")
        for k in without_thickness
    )
    if layers and not without_thickness and isinstance(config.body, Cylinder | Strip | Box):
        thick = sum(layer.thickness or 0.0 for layer in layers)
        height = config.body.height
        if not isclose(thick, height, rel_tol=1e-9):
            problem = (
                f"the total thickness of the layers is {thick:.10g}, and the body is "
                f"{height:.10g} high"
            )
            yield ConfigError("body.layers", problem, "make their thicknesses add up to the height")


def _coating_errors(config: Config, body: Cap | Ball) -> Iterator[ConfigError]:
    """Yield errors of the thicknesses of coatings and of the element sizes in them."""
    coatings = (body.layers or ())[:-1]
    sizes = config.mesh.h_layers
    if sizes is not None and len(sizes) != len(coatings):
        problem = f"has {len(sizes)} sizes, and the body {len(coatings)} layers around its core"
        yield ConfigError("mesh.h_layers", problem, "give one for each, or leave it out")
    if isinstance(body, Cap) and bool(body.height) == bool(body.contact_angle):
        # Without a valid height the shape of the cap is unknown.
        return
    total_thickness = sum(layer.thickness or 0.0 for layer in coatings)
    dome = body.spherical_body
    thinnest = min((layer.thickness or inf for layer in coatings), default=inf)
    if total_thickness > (1 - MIN_CORE_FRACTION) * dome.max_coating_thickness:
        core_text = "no core" if isinstance(body, Ball) else "a core that does not reach the base"
        problem = (
            f"the layers around the core are {total_thickness:.6g} thick together, "
            f"leaving {core_text}"
        )
        yield ConfigError(
            "body.layers",
            problem,
            f"at most {(1 - MIN_CORE_FRACTION) * dome.max_coating_thickness:.6g}",
        )
    elif thinnest < MIN_COATING_RATIO * dome.radius:
        problem = (
            f"a layer {thinnest:.4g} thick on a {body.shape} of radius {dome.radius:.4g} is "
            "too thin to mesh"
        )
        yield ConfigError("body.layers", problem, f"at least {MIN_COATING_RATIO * dome.radius:.3g}")


def _surface_tension_errors(config: Config) -> Iterator[ConfigError]:
    """Yield errors of a surface tension together with other effects."""
    if not config.body.surface_tension:
        return
    key = "body.surface_tension"
    remedy = "give one of the two"
    if config.experiment and config.experiment.adhesion:
        problem = (
            "cannot be combined with experiment.adhesion: the JKR limit holds for a surface "
            "without tension"
        )
        yield ConfigError(key, problem, remedy)
    if config.contact.may_snap_through:
        yield ConfigError(key, "together with contact.adhesion is not verified", remedy)
    if relaxing := next((where for where, law in config.materials() if law.relaxation), None):
        problem = (
            f"does not relax, but {relaxing}.relaxation needs a load curve that relaxes as a whole"
        )
        yield ConfigError(key, problem, remedy)


def _inclusion_errors(config: Config) -> Iterator[ConfigError]:
    """Yield errors of inclusions that leave a layer or are too near to another surface."""
    inclusions = config.body.inclusions or ()
    if config.mesh.h_inclusions is not None and len(config.mesh.h_inclusions) != len(inclusions):
        problem = (
            f"has {len(config.mesh.h_inclusions)} sizes, and the body {len(inclusions)} inclusions"
        )
        yield ConfigError("mesh.h_inclusions", problem, "give one for each, or leave it out")
    faces = _level_faces(config) if inclusions else []
    for k, inclusion in enumerate(inclusions):
        overlapping = [
            m
            for m in range(k)
            if inclusion.overlaps(inclusions[m], _min_clearance(inclusion, inclusions[m]))
        ]
        problem_found = (
            _side_problem(config.body, inclusion)
            or _level_face_problem(faces, inclusion)
            or _coating_face_problem(config.body, inclusion)
        )
        if foreign := _unsupported_inclusion(config.body, inclusion):
            yield ConfigError(key_of_inclusion(k), *foreign)
        elif problem_found or overlapping:
            problem = problem_found or f"overlaps or touches {key_of_inclusion(overlapping[0])}"
            remedy = (
                f"move it, or make it smaller: {_min_clearance(inclusion):.3g} must be left "
                "between it and any surface"
            )
            yield ConfigError(key_of_inclusion(k), problem, remedy)


def _unsupported_inclusion(body: AnyBody, inclusion: Inclusion) -> tuple[str, str] | None:
    """Return why a body of this shape cannot have an inclusion, and a remedy; None if it can."""
    if isinstance(body, Strip) and inclusion.center[1]:
        return (
            f"a strip is infinite along y, but the center is at y = {inclusion.center[1]:g}",
            "set y to 0",
        )
    if isinstance(body, Cap | Ball) and not inclusion.is_axisymmetric_about((0.0, 0.0)):
        reason = (
            "a box is no body of revolution"
            if isinstance(inclusion, BoxInclusion)
            else "it is off the axis"
        )
        if (
            isinstance(inclusion, EllipsoidInclusion)
            and inclusion.semi_axes[0] != inclusion.semi_axes[1]
        ):
            reason = (
                f"semi-axes of {inclusion.semi_axes[0]:g} along x and {inclusion.semi_axes[1]:g} "
                "along y differ"
            )
        remedy = "use a ball, a cylinder or an ellipsoid as long along x as along y, at x = y = 0"
        return f"a {body.shape} is modelled about its axis: {reason}", remedy
    return None


def _side_problem(body: AnyBody, inclusion: Inclusion) -> str:
    """Return the problem of an inclusion that crosses a side or is too near to it.

    "" if there is none.
    """
    shape = body.spherical_body if isinstance(body, Cap | Ball) else body
    clearance = shape.wall_clearance(inclusion)  # type: ignore[union-attr]
    if clearance >= _min_clearance(inclusion):
        return ""
    return (
        f"leaves the body through its side, by {-clearance:.4g}"
        if clearance < 0
        else f"is {clearance:.3g} from the body's side"
    )


def _level_face_problem(faces: Sequence[tuple[str, float]], inclusion: Inclusion) -> str:
    """Return the problem of an inclusion at the top, the base or an interface.

    "" if it crosses none and is not too near to one.
    """
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
    return (
        ""
        if bottom < z < top
        else f"is outside the body, which spans z = {bottom:.6g} to {top:.6g}"
    )


def _coating_face_problem(body: AnyBody, inclusion: Inclusion) -> str:
    """Return the problem of an inclusion at the inner face of a coating.

    "" if it crosses none and is not too near to one.
    """
    if not isinstance(body, Cap | Ball):
        return ""
    radius = body.spherical_body.radius
    near, far = (
        float(reach((0.0, 0.0, -radius)))
        for reach in (inclusion.distance, inclusion.farthest_distance)
    )
    for k, depth in enumerate(
        accumulate(layer.thickness or 0.0 for layer in (body.layers or ())[:-1])
    ):
        face = f"the inner face of {key_of_layer(k)}"
        clearance = max(near - (radius - depth), radius - depth - far)
        if clearance < 0:
            overlap = min(far - (radius - depth), radius - depth - near)
            return f"crosses {face}, {depth:.6g} below the surface, by {overlap:.3g}"
        if clearance < _min_clearance(inclusion):
            return f"is {clearance:.3g} from {face}, {depth:.6g} below the surface"
    return ""


def _level_faces(config: Config) -> list[tuple[str, float]]:
    """Return names and heights of the level faces from the top.

    The mirror plane of a ball is no obstacle for an inclusion centered on it.
    """
    body = config.body
    depths = list(accumulate(layer.thickness or inf for layer in config.layers))
    if isinstance(body, Cap | Ball):
        depths = [body.spherical_body.height]
    ends = [f"the interface below {key_of_layer(k)}" for k in range(len(depths) - 1)]
    ends.append(MIRROR_PLANE if isinstance(body, Ball) and body.base == "roller" else "the base")
    return [("the top", 0.0), *((name, -depth) for name, depth in zip(ends, depths, strict=True))]


def _min_clearance(*inclusions: Inclusion) -> float:
    """Return the smallest distance [length] of inclusions from any surface.

    Elements have to fit into it.
    """
    return MIN_CLEARANCE_FRACTION * min(inclusion.min_half_width for inclusion in inclusions)


def key_of_inclusion(number: int) -> str:
    """Return the key of an inclusion of the body."""
    return f"body.inclusions[{number}]"


def key_of_layer(layer: int) -> str:
    """Return the key of a layer of the body, counted from the top."""
    return f"body.layers[{layer}]"


def _material_errors(config: Config) -> Iterator[ConfigError]:
    """Yield errors of the constants of each material."""
    for key, material in config.materials():
        try:
            material.canonical()
        except ArithmeticError:
            yield ConfigError(key, "these constants belong to no stable material")
        except ValueError as error:
            yield ConfigError(key, str(error))


def _flow_errors(config: Config) -> Iterator[ConfigError]:
    """Yield errors of the pore flow: what it needs, and what cannot be combined with it."""
    flows = {f"{key}.flow": material for key, material in config.materials() if material.flow}
    if config.loading.per_doubling is not None and not any(
        material.is_time_dependent for _, material in config.materials()
    ):
        problem = (
            "is for a time-dependent body, but no material of this one has a flow or relaxes in "
            "shear alone"
        )
        yield ConfigError("loading.per_doubling", problem, "leave it out")
    if not flows:
        if config.drainage and not (
            _has_own_bath(config) and config.drainage == Drainage(bath=config.drainage.bath)
        ):
            yield ConfigError(
                "drainage", "no material has a flow", "give material.flow, or leave it out"
            )
        elif config.drainage and not isinstance(config.drainage.bath, float | int):
            yield ConfigError(
                "drainage.bath", "changes in time, and no material has a flow", "give material.flow"
            )
        yield from _gel_errors(config)
        return
    key = next(iter(flows))
    if config.loading.prescribed_history is None:
        remedy = "give loading.history, or leave it out: nu as given is drained, nu: 0.5 undrained"
        yield ConfigError(key, "needs a time", remedy)
    yield from (
        error for key, material in flows.items() for error in _flow_law_errors(key, material)
    )
    yield from _gel_errors(config)
    if isinstance(config.contact, Nitsche):
        problem = (
            "nitsche uses the stress of the solid, which with pore fluid is not the total stress"
        )
        yield ConfigError("contact.method", problem, "use augmented_lagrangian")
    drainage = config.drainage or Drainage()
    if isinstance(config.body, MeshFromFile) and drainage.sides != "sealed":
        problem = (
            "cannot be drained for a body from a mesh file: a side without a name has no facets "
            "of its own"
        )
        yield ConfigError("drainage.sides", problem, "use sealed")
    times = [t for t, _ in drainage.bath] if isinstance(drainage.bath, tuple) else []
    backward_index = next(
        (k for k, (earlier, later) in enumerate(pairwise(times), start=1) if later <= earlier), None
    )
    if backward_index is not None:
        yield ConfigError(
            f"drainage.bath[{backward_index}]",
            f"time does not increase from {times[backward_index - 1]:g} to "
            f"{times[backward_index]:g}",
        )


def _has_own_bath(config: Config) -> bool:
    """Return whether the stretch of a gel is that of its bath."""
    return any(
        isinstance(material, Gel) and material.stretch == "auto"
        for _, material in config.materials()
    )


def _gel_errors(config: Config) -> Iterator[ConfigError]:
    """Yield errors of gels, which share the bath of the scene and its solvent."""
    gels = {key: material for key, material in config.materials() if isinstance(material, Gel)}
    for key, gel in gels.items():
        try:
            gel.with_free_swelling(config.initial_bath).canonical()
        except ValueError as error:
            yield ConfigError(f"{key}.stretch", str(error))
        if gel.relaxation:
            yield ConfigError(f"{key}.relaxation", "is not verified for a gel", "leave it out")
    for key, material in config.materials():
        if gels and material.flow and not isinstance(material, Gel):
            problem = (
                "belongs to a law other than gel, but the bath is the chemical potential of a "
                "solvent"
            )
            yield ConfigError(f"{key}.flow", problem, "leave it out, or use gels alone")
    ratios = {key: gel.G / gel.n_omega for key, gel in gels.items() if gel.flow}
    first = next(iter(ratios.values()), 0.0)
    for key, ratio in ratios.items():
        if not isclose(ratio, first, rel_tol=SOLVENT_RTOL):
            problem = (
                f"gives G/n_omega = {ratio:g}, and another gel {first:g}: kT over the solvent's "
                "molecular volume"
            )
            yield ConfigError(f"{key}.n_omega", problem, "one ratio for all gels of one solvent")


def _flow_law_errors(key: str, material: Material) -> Iterator[ConfigError]:
    """Yield errors of the flow of one material."""
    flow = material.flow
    assert flow
    if isinstance(material, Gel):
        if flow.permeability is not None or flow.diffusivity is None:
            name = "permeability" if flow.permeability is not None else "diffusivity"
            problem = (
                "of a gel follows from its swelling"
                if flow.permeability is not None
                else "is missing"
            )
            yield ConfigError(f"{key}.{name}", problem, "give diffusivity, that of the solvent")
        if flow.holmes_mow:
            yield ConfigError(
                f"{key}.holmes_mow",
                "is for other laws: the permeability of a gel follows from its swelling",
                "leave it out",
            )
    if not material.is_small_strain and (flow.alpha, flow.storage) != (1.0, 0.0):
        name = "alpha" if flow.alpha != 1 else "storage"
        problem = "at finite strain grains and fluid are incompressible"
        yield ConfigError(f"{key}.{name}", problem, "alpha: 1, storage: 0")
    if material.is_small_strain and flow.holmes_mow:
        yield ConfigError(
            f"{key}.holmes_mow", "is for finite strain, and this law has none", "leave it out"
        )


def _contact_errors(config: Config) -> Iterator[ConfigError]:
    """Yield errors of `epsilon_t` without friction, and of adhesion."""
    adhesion = config.contact.adhesion
    if config.contact.epsilon_t != "auto" and config.contact.is_conservative:
        yield ConfigError(
            "contact.epsilon_t", "there is no friction", "leave it out, or give contact.friction"
        )
    if adhesion and not config.contact.is_conservative:
        yield ConfigError(
            "contact.adhesion", "together with friction is not verified", "leave one of the two out"
        )
    if adhesion and adhesion.range == 0:
        problem = "is 0, a limit that no mesh resolves"
        remedy = "give a range above 0, or experiment.adhesion: {work: ...} for that limit"
        yield ConfigError("contact.adhesion.range", problem, remedy)


def _load_path_errors(config: Config) -> Iterator[ConfigError]:
    """Yield errors of the load path."""
    loading = config.loading
    attraction = config.contact.adhesion
    if not loading.given_path_keys:
        yield ConfigError(
            "loading", "gives no depth and no force", f"give one of {', '.join(PATH_KEYS)}"
        )
    elif len(loading.given_path_keys) > 1:
        first, second = loading.given_path_keys[:2]
        yield ConfigError(
            f"loading.{second}", f"contradicts {first}", f"give one of {', '.join(PATH_KEYS)}"
        )
    elif (forces := loading.forces) and not attraction and min(forces) < 0:
        pull_index = next(k for k, force in enumerate(forces) if force < 0)
        problem = f"a force of {forces[pull_index]:g} pulls, but there is no adhesion"
        yield ConfigError(
            f"loading.forces[{pull_index}]", problem, "a force >= 0, or give contact.adhesion"
        )
    elif forces and not attraction and not any(forces):
        yield ConfigError(
            "loading.forces",
            "never press the tip in: every force is 0",
            "give at least one above 0",
        )


def _center_errors(config: Config) -> Iterator[ConfigError]:
    """Yield errors of the position of the tip's axis."""
    center = config.center
    needed = len(config.body.center)
    if isinstance(config.body, UnboundedBody | Cap | Ball) and any(center or ()):
        is_dome = isinstance(config.body, Cap | Ball)
        reason = (
            "the tip is on the axis of a {}" if is_dome else "all positions on a {} are equivalent"
        )
        yield ConfigError("indenter.center", reason.format(config.body.shape), "leave it out")
    elif center is not None and len(center) != needed:
        form = "[x]" if needed == 1 else "[x, y]"
        problem = f"the position on a {config.body.shape} is {form}, got {len(center)} numbers"
        yield ConfigError("indenter.center", problem, f"give {needed}")


def _tip_errors(config: Config) -> list[ConfigError]:
    """Return errors of the tip on this body."""
    tip = config.indenter
    if getattr(config.body, "kinematics", "") == "axisymmetric" and not tip.is_axisymmetric:
        return [
            ConfigError(
                "indenter.shape",
                f"a {tip.shape} is not a tip of revolution",
                "use body.kinematics: 3d",
            )
        ]
    if config.body.dim == 2 and not tip.is_axisymmetric:
        return [
            ConfigError(
                "indenter.shape",
                f"a {tip.shape} on a strip, which is in plane strain, is not possible",
                "use a box, a cylinder or a half_space",
            )
        ]
    if isinstance(config.body, Cap | Ball) and not tip.is_axisymmetric:
        problem = f"a {tip.shape} on a {config.body.shape}, which is axisymmetric, is not possible"
        return [
            ConfigError(
                "indenter.shape", problem, "use a tip of revolution, a cone of equal sections"
            )
        ]
    if isinstance(tip, Plate) and isinstance(config.body, UnboundedBody):
        problem = f"a plate on a {config.body.shape} touches all of an unbounded surface"
        return [
            ConfigError(
                "indenter.shape", problem, "use a cylinder, a strip or a box, or another tip"
            )
        ]
    if (
        isinstance(tip, Plate)
        and config.contact.adhesion
        and isinstance(config.body, Cylinder | Strip | Box)
    ):
        problem = "is not verified for a plate that touches all of a flat top"
        return [ConfigError("contact.adhesion", problem, "leave it out")]
    if isinstance(tip, FlatPunch) and tip.edge_radius > tip.radius:
        problem = "must not be larger than the punch's radius"
        return [
            ConfigError("indenter.edge_radius", problem, f"at most {tip.radius:g}, half a ball")
        ]
    try:
        if isinstance(tip, Profile):
            tip.check_points()
    except ValueError as error:
        return [ConfigError("indenter.points", str(error))]
    return []


def _experiment_errors(config: Config) -> Iterator[ConfigError]:
    """Yield errors of an experiment that the file alone shows."""
    experiment = config.experiment
    if experiment is None:
        return
    if experiment.adhesion:
        yield from _jkr_errors(config, experiment.adhesion)
    if experiment.calibration and experiment.calibration.stiffness and not experiment.cantilever:
        problem = "is the uncertainty of a cantilever's stiffness, but there is no cantilever"
        yield ConfigError(
            "experiment.calibration.stiffness",
            problem,
            "give experiment.cantilever, or leave it out",
        )
    if experiment.calibration and experiment.calibration.R and not hasattr(config.indenter, "R"):
        problem = f"is the uncertainty of a tip's radius R, but a {config.indenter.shape} has none"
        yield ConfigError("experiment.calibration.R", problem, "leave it out")
    if not any(vars(experiment).values()):
        yield ConfigError(
            "experiment", "is empty", f"its keys are {', '.join(field_names(Experiment))}"
        )


def _history_errors(config: Config) -> Iterator[ConfigError]:
    """Yield errors of a history."""
    path_in_time = config.loading.prescribed_history
    times = config.loading.times
    if path_in_time is None:
        if not isinstance(times, str):
            yield ConfigError(
                "loading.times", "is for a history", "give loading.history, or leave it out"
            )
        return
    key = "loading.history" if config.loading.history else "loading.force_history"
    point_times = [t for t, _ in path_in_time.points]
    backward_index = next(
        (k for k, (earlier, later) in enumerate(pairwise(point_times), start=1) if later < earlier),
        None,
    )
    if backward_index is not None:
        yield ConfigError(
            f"{key}[{backward_index}]",
            f"time goes back from {point_times[backward_index - 1]:g} to "
            f"{point_times[backward_index]:g}",
        )
    elif point_times[0] == point_times[-1]:
        yield ConfigError(key, "has no duration", "give increasing times")
    for k, (before, t) in enumerate(pairwise((-inf, *path_in_time.times))):
        if not max(before, point_times[0]) <= t <= point_times[-1] or t == before:
            problem = (
                f"{t:g} lies outside the history"
                if not point_times[0] <= t <= point_times[-1]
                else "is not later than the one before"
            )
            yield ConfigError(
                f"loading.times[{k}]",
                problem,
                f"times from {point_times[0]:g} up to {point_times[-1]:g}",
            )
            break
    swells = any(isinstance(material, Gel) and material.flow for _, material in config.materials())
    if path_in_time.largest_value <= 0 and not swells:
        yield ConfigError(key, "never presses the tip in", "give a largest value above 0")
    lowest_force = (
        min(value for _, value in path_in_time.points) if path_in_time.control == "force" else 0.0
    )
    if lowest_force < 0 and config.contact.may_snap_through:
        problem = (
            f"a force of {lowest_force:g} pulls, and a history of tensile forces has no unique "
            "depths"
        )
        yield ConfigError(key, problem, "give loading.history, of depths, or forces of 0 and more")
    elif lowest_force < 0 and not (config.experiment and config.experiment.adhesion):
        yield ConfigError(
            key,
            f"a force of {lowest_force:g} pulls, but there is no adhesion",
            "give experiment.adhesion",
        )


def _relaxation_errors(config: Config) -> Iterator[ConfigError]:
    """Yield errors of the relaxation of the materials."""
    laws = dict(config.materials())
    frequencies = config.experiment and config.experiment.frequencies
    history = config.loading.prescribed_history
    relaxations = {
        f"{key}.relaxation": law.relaxation for key, law in laws.items() if law.relaxation
    }
    if not relaxations:
        if frequencies:
            yield ConfigError(
                "experiment.frequencies",
                "needs a material with relaxation",
                "give material.relaxation",
            )
        return
    yield from (
        error
        for key, given in relaxations.items()
        for error in _relaxation_law_errors(config, key, given)
    )
    key, given = next(iter(relaxations.items()))
    if any(law.has_shear_relaxation for law in laws.values()):
        yield from _shear_relaxation_errors(config, laws)
    elif different_key := next(
        (different_key for different_key, law in laws.items() if law.relaxation != given), None
    ):
        problem = f"is not that of {different_key}: with of: all every material must relax alike"
        yield ConfigError(key, problem, f"the same {different_key}.relaxation, or of: shear")
    if not history and not frequencies:
        remedy = "give loading.history, loading.force_history or experiment.frequencies"
        yield ConfigError(key, "needs a time", remedy)


def _shear_relaxation_errors(config: Config, laws: Mapping[str, Material]) -> Iterator[ConfigError]:
    """Yield errors of what cannot be combined with relaxation of the shear modulus alone."""
    for key, law in laws.items():
        if law.relaxation and law.relaxation.of == "all":
            problem = (
                "all: is for a body that relaxes alike everywhere, but elsewhere shear relaxes "
                "alone"
            )
            yield ConfigError(f"{key}.relaxation.of", problem, "of: shear")
        if law.relaxation and not isinstance(law, ShearRelaxingLaw | Gel):
            alternative_law = (
                "mooney_rivlin with C10 = mu/2" if isinstance(law, NeoHookean) else "linear_elastic"
            )
            yield ConfigError(
                f"{key}.relaxation.of",
                f"{law.model} has an energy whose shear part depends on the volume",
                f"use {alternative_law}",
            )
    if config.experiment and config.experiment.frequencies:
        problem = (
            "needs a load curve, and none holds for shear that relaxes at constant bulk modulus"
        )
        yield ConfigError("experiment.frequencies", problem, "of: all")
    if isinstance(config.contact, Nitsche):
        problem = "nitsche uses the stress of the body, which relaxes"
        yield ConfigError("contact.method", problem, "use augmented_lagrangian")
    if config.contact.may_snap_through:
        problem = "together with relaxation is not verified"
        yield ConfigError("contact.adhesion", problem, "leave one of the two out")


def _relaxation_law_errors(config: Config, key: str, given: Relaxation) -> Iterator[ConfigError]:
    """Yield errors of a relaxation by itself, and of a history with which it cannot be combined."""
    if (given.prony is None) == (given.power_law is None):
        yield ConfigError(key, "needs exactly one of its two laws", "give prony or power_law")
    for k, (fraction, time) in enumerate(given.prony or ()):
        if not (0 <= fraction < 1 and time > 0):
            problem = (
                f"[{fraction:g}, {time:g}] is not a term [fraction of the instantaneous modulus, "
                "time]"
            )
            yield ConfigError(
                f"{key}.prony[{k}]", problem, "a fraction from 0 to below 1, a time above 0"
            )
    if (total := sum(fraction for fraction, _ in given.prony or ())) >= 1:
        yield ConfigError(
            f"{key}.prony",
            f"the fractions sum to {total:g}: the modulus would relax to zero or below",
            "below 1",
        )
    history = config.loading.prescribed_history
    if given.power_law and history and history.has_jumps:
        problem = "jumps, but the instantaneous modulus of a power law is infinite"
        yield ConfigError(f"loading.{config.loading.given_path_keys[0]}", problem, "use a ramp")


def _jkr_errors(config: Config, adhesion: JKRAdhesion) -> Iterator[ConfigError]:
    """Yield errors where the JKR limit does not apply.

    It needs a circular contact whose radius varies with the depth, for Griffith's balance at its
    edge.
    """
    body = config.body
    tip = config.indenter
    key = "experiment.adhesion"
    if any(material.relaxation for _, material in config.materials()):
        problem = (
            "cannot be combined with relaxation: the work that a relaxing body supplies to "
            "its edge has no limit"
        )
        yield ConfigError(key, problem, "give one of the two")
    problem = "the JKR limit holds for a circular contact, which a {} does not have"
    if isinstance(body, Strip | Box):
        remedy = "use a cylinder, a layer, a half_space, a cap or a ball"
        yield ConfigError(key, problem.format(body.shape), remedy)
    if not tip.is_axisymmetric:
        yield ConfigError(key, problem.format(tip.shape), "use a tip of revolution")
    if isinstance(tip, Plate) and not isinstance(body, Cap | Ball):
        problem = "the contact of a plate on a flat top does not shrink before it separates at once"
        yield ConfigError(key, problem, "use another tip")
    if isinstance(tip, FlatPunch) and not tip.edge_radius and not isinstance(body, Cap | Ball):
        problem = "the contact of a sharp flat punch does not shrink before it separates at once"
        yield ConfigError(key, problem, "give the punch an edge_radius")
    if adhesion.range and not hasattr(tip, "R"):
        problem = f"is for the Tabor number of a round tip, and a {tip.shape} has no R"
        yield ConfigError(f"{key}.range", problem, "leave it out")


def _accuracy_errors(config: Config) -> list[ConfigError]:
    """Return errors of mesh sizes that `accuracy` chooses."""
    given = _given_mesh_keys(config.mesh, "refinements") if config.accuracy is not None else []
    return [
        ConfigError(key, "contradicts accuracy, which chooses it", "give one of the two")
        for key in given
    ]


def _given_mesh_keys(mesh: MeshSettings, extra_key: str) -> list[str]:
    """Return the given keys of element sizes, and one more key if it is given."""
    return [
        f"mesh.{name}"
        for name in (*MESH_SIZE_KEYS, extra_key)
        if getattr(mesh, name) not in (None, "auto")
    ]


def _mesh_file_errors(config: Config) -> Iterator[ConfigError]:
    """Yield errors of a mesh from a file.

    It has its own element sizes, it alone has refinements, and its file is in the scene's folder.
    """
    body = config.body
    mesh = config.mesh
    if not isinstance(body, MeshFromFile):
        if mesh.refinements is not None:
            yield ConfigError(
                "mesh.refinements", "is for body.shape: mesh", "leave it out, or give h_contact"
            )
        return
    why = "is for bodies that the program meshes, but this one has a mesh from a file"
    for key in _given_mesh_keys(mesh, "symmetry"):
        yield ConfigError(key, why, "leave it out, or refine it with mesh.refinements")
    if problem := _path_problem(body.file, "the scene's folder"):
        yield ConfigError("body.file", problem, "put the mesh into the folder of the scene file")
    if body.kinematics == "axisymmetric" and any(config.center or ()):
        problem = "the tip is on the axis of an axisymmetric mesh"
        yield ConfigError("indenter.center", problem, "leave it out, or use kinematics: 3d")


def _directory_errors(config: Config) -> Iterator[ConfigError]:
    """Yield the error of the result folder."""
    if config.output.directory and (problem := directory_problem(config.output.directory)):
        yield ConfigError("output.directory", problem, "choose any other folder with --output")


def directory_problem(directory: str) -> str:
    """Return the problem of a result folder that a file names; "" if there is none.

    The folder has to be below the working directory, because scene and study files come from other
    people. The command line may name any other folder.
    """
    if problem := _path_problem(directory, "the working directory"):
        return problem
    try:
        here = os.path.realpath(".")
        leads_out = os.path.commonpath([here, os.path.realpath(directory)]) != here
    except OSError:
        # The working directory was deleted; writing a result will fail.
        return ""
    return "leads out of the working directory through a link" if leads_out else ""


def _path_problem(path: str, root_name: str) -> str:
    """Return the problem of a path as a text; "" if there is none. It has to be below a folder."""
    parts = path.split("/")
    if path.startswith("/") or ".." in parts:
        return f"must be below {root_name}, not absolute and without .."
    if any(part.startswith((".", "~")) and part != "." for part in parts):
        return "may not begin with . or ~, nor any folder in it"
    if printable(path) != path or "\\" in path:
        return "contains a character that is not allowed in the name of a folder"
    if (
        any(len(os.fsencode(part)) > MAX_NAME_BYTES for part in parts)
        or len(path) > MAX_PATH_LENGTH
    ):
        return "is too long"
    return ""


@cache
def section_tags() -> dict[str, str]:
    """Return the tag key of every section that has one: body -> shape."""
    return {
        name: tag for name, hint in field_types(Config).items() if (tag := tag_of(hint)) is not None
    }


@cache
def sections() -> dict[str, tuple[type, ...]]:
    """Return the sections of the file in order, with the dataclasses that each may be."""
    types_by_name = {name: union_members(hint) for name, hint in field_types(Config).items()}
    return {
        name: kinds for name, kinds in types_by_name.items() if dataclasses.is_dataclass(kinds[0])
    }


@dataclass(frozen=True)
class SchemaNode:
    """Node of a document: its type by the schema, its default, and its value.

    `type` is None if the schema has no such key; `value` is None if the document has no value.
    """

    path: KeyPath
    type: Any
    default: Any
    value: Any

    @property
    def tag(self) -> str | None:
        """Key that selects the dataclass of this section."""
        return tag_of(self.type)

    @cached_property
    def tag_value(self) -> Any:
        """Value of the tag in the section, or in its default."""
        default = getattr(self.default, self.tag, None) if self.tag else None
        return (
            self.value.get(self.tag, default)
            if isinstance(self.value, Mapping) and self.tag
            else default
        )

    @cached_property
    def section_type(self) -> Any:
        """Dataclass of this section; None for a value, and if none is selected."""
        if not self.path:
            return Config
        return type_of_tag(self.type, self.tag_value) if self.type is not None else None

    def child(self, part: str | int) -> SchemaNode:
        """Return the node of a key, or of an item of a list."""
        value = self.value[part] if has_part(self.value, part) else None
        path = (*self.path, part)
        kind = self.section_type
        if path == ("indenter", "center"):
            return SchemaNode(path, field_types(Config)["center"], None, value)
        if kind is not None and part in field_names(kind):
            return SchemaNode(
                path, field_types(kind)[str(part)], default_of(kind, str(part)), value
            )
        if kind is not None:
            return SchemaNode(path, None, None, value)
        kinds = [bare_type(part) for part in union_members(self.type)]
        # A list or mapping may be an alternative to a word.
        container = next(
            (member_type for member_type in kinds if get_origin(member_type) in (tuple, dict)),
            bare_type(self.type),
        )
        item = {tuple: lambda: get_args(container)[0], dict: lambda: get_args(container)[1]}.get(
            get_origin(container)
        )
        return SchemaNode(path, item() if item else None, None, value)

    def children(self) -> Iterator[SchemaNode]:
        """Yield the nodes of all values inside this one."""
        if isinstance(self.value, Mapping):
            yield from (self.child(key) for key in self.value)
        elif isinstance(self.value, (list, tuple)) and len(self.value):
            # All items of a list have one type.
            item = self.child(0)
            for k, value in enumerate(self.value):
                yield dataclasses.replace(item, path=(*self.path, k), value=value)

    def allowed_keys(self) -> tuple[str, ...]:
        """Return the keys that this section may have."""
        if not self.path:
            return tuple(name for name in field_names(Config) if name != "center")
        names = file_order(self.section_type) if dataclasses.is_dataclass(self.section_type) else ()
        return (*names, "center") if self.path == ("indenter",) else names


def node_at(path: KeyPath, document: Any) -> SchemaNode:
    """Return the node of a key path in a document."""
    spot = SchemaNode((), Config, None, document)
    for part in path:
        spot = spot.child(part)
    return spot


def allowed_keys_at(path: KeyPath, document: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the keys that a section of the document may have; the path of the root is ()."""
    return node_at(path, document).allowed_keys()


def file_order(kind: Any) -> tuple[str, ...]:
    """Return the fields of a dataclass in the order of a file: the tag first."""
    return _file_order(kind)


@cache
def _file_order(kind: Any) -> tuple[str, ...]:
    tags = [
        name
        for name in TAG_KEYS & set(field_names(kind))
        if len(get_args(field_types(kind)[name])) == 1
    ]
    return tuple(sorted(field_names(kind), key=lambda name: name not in tags))


def has_part(value: Any, part: str | int) -> bool:
    """Return whether a section has a key, or a list an item of this number."""
    if isinstance(value, (list, tuple)):
        return isinstance(part, int) and part < len(value)
    return isinstance(value, Mapping) and part in value
