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
MAX_REFINEMENTS = 6  # of a mesh from a file: 4096 cells for one in two dimensions
LINEAR_ELEMENTS_GONE = (
    "linear elements are gone: with as many unknowns quadratic ones give a force ten "
    "times as accurate"
)
KeptStates = Literal["none", "last", "all"]
AccuracyPreset = Literal["fast", "balanced", "accurate"]
# base radius over height of a cap: beyond it digits of its place on its large ball are lost
MAX_CAP_FLATNESS = 1e3
MAX_CAP_STEEPNESS = (
    20.0  # height over base radius of a cap: beyond it, 174 degrees, a ball stands on a point
)
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
PETSC_GONE = "is gone: a scene chooses by linear, method, rtol and max_iterations of solver"
MOVED_KEYS = {
    "relaxation": "material",
    "history": "loading",
    "force_history": "loading",
}  # from `experiment`
REMOVED_KEYS = {
    ("solver", "petsc"): (PETSC_GONE, "who must tune PETSc sets PETSC_OPTIONS in the environment")
}
REMOVED_KEYS |= {
    ("experiment", key): ("has moved", f"write {section}.{key}")
    for key, section in MOVED_KEYS.items()
}
MIN_CORE_FRACTION = (
    0.02  # of the room for skins of a cap or ball, what must be left of it inside them
)
MIN_COATING_RATIO = (
    1e-3  # of the radius of its ball: elements as small as its thickness go all around
)
SOLVENT_RTOL = 1e-6  # of kT over the volume of its molecule
MIN_CLEARANCE_FRACTION = (
    0.01  # of half the thickness of an inclusion, between it and any other surface
)
TAG_KEYS = {"shape", "model", "method"}  # keys that choose what a section is, at any depth


@dataclass(frozen=True)
class Units:
    """The units that plain numbers are meant in, by name; quantities with a unit of their own are
    converted to them.
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
    """How the equations are solved; PETSc's own options are [the
    environment's](how_do_i.md#tune-petsc).
    """

    method: Literal["auto", "theory", "condensed", "newton"] = "auto"
    linear: Literal["auto", "direct", "iterative"] = "auto"
    rtol: Annotated[float, Gt(0), Le(MAX_RTOL)] = MAX_RTOL
    max_iterations: PositiveInt = 50


@dataclass(frozen=True)
class OutputSettings:
    """What is written and where."""

    directory: Annotated[str, MinLen(1)] | None = None
    fields: Literal["auto", "none", "last", "all"] = "auto"
    nodal_stress: bool = False
    surface: KeptStates = "last"
    reactions: bool = False
    plot: bool = True


@dataclass(frozen=True)
class Source:
    """Where every key of a config was written: file and line, or the `--set` that gave it.

    All sources are equal: two configs that say the same are the same, wherever they were written.
    """

    name: str = field(default="", compare=False)
    locations: dict[KeyPath, tuple[str, int | None]] = field(
        default_factory=dict, compare=False, repr=False
    )
    quantities: dict[KeyPath, tuple[str, float]] = field(
        default_factory=dict, compare=False, repr=False
    )  # as given

    def location(self, path: KeyPath) -> tuple[str, int | None]:
        """File and line of a key, or of the nearest section around it."""
        for end in range(len(path), -1, -1):
            if path[:end] in self.locations:
                return self.locations[path[:end]]
        return self.name, None


class Config(BaseModel):
    """A scene as its file says it, checked, defaults filled in; every "auto" is still undecided."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, strict=True, allow_inf_nan=False, revalidate_instances="always"
    )

    title: str = ""
    units: Units = Units()
    body: Annotated[AnyBody, TaggedBy("shape")]
    material: Annotated[Material | None, TaggedBy("model")] = (
        None  # required unless every layer or region has its own
    )
    indenter: Annotated[Indenter, TaggedBy("shape")]
    center: Annotated[tuple[Coordinate, ...], LENGTH] | None = None  # in the file: indenter.center
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
        """Where the keys were written."""
        return self._source

    @property
    def initial_bath(self) -> float:
        """The bath when the body is at rest."""
        in_time = self.loading.prescribed_history
        return (
            self.drainage.bath_at(in_time.points[0][0] if in_time else 0.0)
            if self.drainage
            else 0.0
        )

    @property
    def instrument(self) -> Experiment:
        """How the indentation is measured; an experiment without anything where the file has none."""
        return self.experiment or Experiment()

    @property
    def layers(self) -> tuple[Layer, ...]:
        """The body's layers from the top, each with its material; a body without layers is one."""
        given = self.body.layers or (Layer(getattr(self.body, "height", None)),)
        return tuple(
            dataclasses.replace(layer, material=layer.material or self.material) for layer in given
        )

    def material_key(self, layer: int) -> str:
        """The key at which the material of a layer stands."""
        has_material = self.body.layers is not None and self.body.layers[layer].material is not None
        return f"body.layers[{layer}].material" if has_material else "material"

    def materials(self) -> Iterator[tuple[str, Material]]:
        """Every material that is given, with its key."""
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
    """What is wrong with the two ways to say how high a cap is."""
    body = config.body
    if not isinstance(body, Cap):
        return
    if body.height and body.contact_angle:
        yield ConfigError(
            "body.contact_angle", "contradicts height: each alone says the cap's shape", "give one"
        )
    elif not body.height and not body.contact_angle:
        yield ConfigError("body.height", "missing, and so is contact_angle", "give one of the two")
    elif body.apex_height < body.base_radius / MAX_CAP_FLATNESS:
        problem = (
            f"a cap {body.apex_height:.4g} high on a base of radius {body.base_radius:g} is all "
            "but flat"
        )
        yield ConfigError(
            "body", problem, f"height at least base_radius/{MAX_CAP_FLATNESS:g}, or a cylinder"
        )
    elif body.apex_height > body.base_radius * MAX_CAP_STEEPNESS:
        problem = (
            f"a cap {body.apex_height:.4g} high on a base of radius {body.base_radius:g} stands "
            "on a point"
        )
        yield ConfigError(
            "body", problem, f"height at most {MAX_CAP_STEEPNESS:g} base_radius, or a ball"
        )


def _layer_errors(config: Config) -> Iterator[ConfigError]:
    """What is wrong with the layers: a material that is missing, thicknesses that are not the
    body's.
    """
    layers = config.body.layers or ()
    bare_layers = [k for k, layer in enumerate(layers) if layer.material is None]
    if not layers and not getattr(config.body, "regions", None):
        bare_layers = [0]
    if bare_layers and config.material is None:
        problem_text = (
            f"this section is missing, and {key_of_layer(bare_layers[0])} has no material of its own"
            if layers
            else ""
        )
        kinds = ", ".join(types_by_tag(field_types(Config)["material"], "model"))
        yield ConfigError(
            "material", problem_text or "this section is missing", f"give model: one of {kinds}"
        )
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
                f"the layers are {thick:.10g} thick together, and the body is {height:.10g} high"
            )
            yield ConfigError("body.layers", problem, "make their thicknesses add up to the height")


def _coating_errors(config: Config, body: Cap | Ball) -> Iterator[ConfigError]:
    """What is wrong with the thicknesses of a body's skins and the sizes of elements in them."""
    coatings = (body.layers or ())[:-1]
    sizes = config.mesh.h_layers
    if sizes is not None and len(sizes) != len(coatings):
        problem = f"has {len(sizes)} sizes, and the body {len(coatings)} layers around its core"
        yield ConfigError("mesh.h_layers", problem, "give one for each, or leave it out")
    if isinstance(body, Cap) and bool(body.height) == bool(body.contact_angle):
        return  # it has no shape yet
    total_thickness = sum(layer.thickness or 0.0 for layer in coatings)
    dome = body.spherical_body
    thinnest = min((layer.thickness or inf for layer in coatings), default=inf)
    if total_thickness > (1 - MIN_CORE_FRACTION) * dome.max_coating_thickness:
        core_text = "no core" if isinstance(body, Ball) else "a core that does not reach the base"
        problem = f"the layers around the core are {total_thickness:.6g} thick together, which leaves {core_text}"
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
    """What is not known together with a surface tension."""
    if not config.body.surface_tension:
        return
    key = "body.surface_tension"
    remedy = "give one of the two"
    if config.experiment and config.experiment.adhesion:
        problem = (
            "is not known together with experiment.adhesion: its limit is that of a surface "
            "without tension"
        )
        yield ConfigError(key, problem, remedy)
    if config.contact.may_snap_through:
        yield ConfigError(key, "together with contact.adhesion is not verified", remedy)
    if relaxing := next((where for where, law in config.materials() if law.relaxation), None):
        problem = (
            f"does not relax, and {relaxing}.relaxation is made of a curve that does so as a whole"
        )
        yield ConfigError(key, problem, remedy)


def _inclusion_errors(config: Config) -> Iterator[ConfigError]:
    """What is wrong with inclusions: out of the body or of a layer, too near to a surface or to one
    another.
    """
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
                f"move it, or make it smaller: {_min_clearance(inclusion):.3g} must be left between it "
                "and any surface"
            )
            yield ConfigError(key_of_inclusion(k), problem, remedy)


def _unsupported_inclusion(body: AnyBody, inclusion: Inclusion) -> tuple[str, str] | None:
    """Why a body of this kind has no such inclusion, and what it may have."""
    if isinstance(body, Strip) and inclusion.center[1]:
        return (
            f"a strip is the same all along y, and the center is at y = {inclusion.center[1]:g}",
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
    """That an inclusion leaves the body through a side, or nearly does."""
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
    """That an inclusion crosses the top, the base, or an interface, or nearly does."""
    z = inclusion.center[2]
    half_height = inclusion.half_width(2)
    min_clearance = _min_clearance(inclusion)
    for name, height in faces:
        if name == MIRROR_PLANE and isclose(z, height, rel_tol=POSITION_TOLERANCE):
            return ""
        if abs(z - height) < half_height:
            return f"crosses {name} at z = {height:.6g}: it spans z = {z - half_height:.6g} to {z + half_height:.6g}"
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
    """That an inclusion crosses the inner face of a skin, or nearly does."""
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
    """Names and heights of the level faces from the top; a mirror plane is none for an inclusion
    centered on it.
    """
    body = config.body
    depths = list(accumulate(layer.thickness or inf for layer in config.layers))
    if isinstance(body, Cap | Ball):
        depths = [body.spherical_body.height]
    ends = [f"the interface below {key_of_layer(k)}" for k in range(len(depths) - 1)]
    ends.append(MIRROR_PLANE if isinstance(body, Ball) and body.base == "roller" else "the base")
    return [("the top", 0.0), *((name, -depth) for name, depth in zip(ends, depths, strict=True))]


def _min_clearance(*inclusions: Inclusion) -> float:
    """What must be left between inclusions, or one and any surface [length]: elements have to fit
    in.
    """
    return MIN_CLEARANCE_FRACTION * min(inclusion.min_half_width for inclusion in inclusions)


def key_of_inclusion(number: int) -> str:
    """The key of one of the body's inclusions."""
    return f"body.inclusions[{number}]"


def key_of_layer(layer: int) -> str:
    """The key of one of the body's layers, from the top."""
    return f"body.layers[{layer}]"


def _material_errors(config: Config) -> Iterator[ConfigError]:
    for key, material in config.materials():
        try:
            material.canonical()
        except ArithmeticError:
            yield ConfigError(key, "these constants belong to no stable material")
        except ValueError as error:
            yield ConfigError(key, str(error))


def _flow_errors(config: Config) -> Iterator[ConfigError]:
    """What is wrong with fluid in the pores: what it needs, and what does not go with it."""
    flows = {f"{key}.flow": material for key, material in config.materials() if material.flow}
    if config.loading.per_doubling is not None and not any(
        material.is_time_dependent for _, material in config.materials()
    ):
        problem = (
            "is for a body that takes time, and nothing of this one flows, nor relaxes in "
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
        problem = "nitsche takes the body's own stress, and with fluid that is not the whole"
        yield ConfigError("contact.method", problem, "use augmented_lagrangian")
    drainage = config.drainage or Drainage()
    if isinstance(config.body, MeshFromFile) and drainage.sides != "sealed":
        problem = (
            "of a body from a mesh file are not known: a side without a name has no facets "
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
            f"time does not go on from {times[backward_index - 1]:g} to {times[backward_index]:g}",
        )


def _has_own_bath(config: Config) -> bool:
    """Whether the stretch of a gel is that of its bath."""
    return any(
        isinstance(material, Gel) and material.stretch == "auto"
        for _, material in config.materials()
    )


def _gel_errors(config: Config) -> Iterator[ConfigError]:
    """What is wrong with gels, which share the scene's bath and its solvent."""
    gels = {key: material for key, material in config.materials() if isinstance(material, Gel)}
    for key, gel in gels.items():
        try:
            gel.with_free_swelling(config.initial_bath).canonical()
        except ValueError as error:
            yield ConfigError(f"{key}.stretch", str(error))
        if gel.relaxation:
            yield ConfigError(f"{key}.relaxation", "of a gel was never verified", "leave it out")
    for key, material in config.materials():
        if gels and material.flow and not isinstance(material, Gel):
            problem = (
                "of another law than a gel's, and the bath is the solvent's chemical potential"
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
                "is for other laws: a gel's pores are its solvent",
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
    """That `epsilon_t` steers friction and nothing else, and that a tip that adheres has a range
    and slips freely.
    """
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
    loading = config.loading
    attraction = config.contact.adhesion
    if not loading.given_path_keys:
        yield ConfigError(
            "loading", "says no depth and no force", f"give one of {', '.join(PATH_KEYS)}"
        )
    elif len(loading.given_path_keys) > 1:
        first, second = loading.given_path_keys[:2]
        yield ConfigError(
            f"loading.{second}", f"contradicts {first}", f"give one of {', '.join(PATH_KEYS)}"
        )
    elif (forces := loading.forces) and not attraction and min(forces) < 0:
        pull_index = next(k for k, force in enumerate(forces) if force < 0)
        problem = f"a force of {forces[pull_index]:g} pulls, and nothing holds on to the tip"
        yield ConfigError(
            f"loading.forces[{pull_index}]", problem, "a force >= 0, or give contact.adhesion"
        )
    elif forces and not attraction and not any(forces):
        yield ConfigError(
            "loading.forces", "presses nothing: every force is 0", "give at least one above 0"
        )


def _center_errors(config: Config) -> Iterator[ConfigError]:
    center = config.center
    needed = len(config.body.center)
    if isinstance(config.body, UnboundedBody | Cap | Ball) and any(center or ()):
        is_dome = isinstance(config.body, Cap | Ball)
        reason = (
            "over a {} the tip stands on the axis" if is_dome else "a {} is the same everywhere"
        )
        yield ConfigError("indenter.center", reason.format(config.body.shape), "leave it out")
    elif center is not None and len(center) != needed:
        form = "[x]" if needed == 1 else "[x, y]"
        problem = f"over a {config.body.shape} a tip stands at {form}, got {len(center)} numbers"
        yield ConfigError("indenter.center", problem, f"give {needed}")


def _tip_errors(config: Config) -> list[ConfigError]:
    tip = config.indenter
    if getattr(config.body, "kinematics", "") == "axisymmetric" and not tip.is_axisymmetric:
        return [
            ConfigError(
                "indenter.shape",
                f"a {tip.shape} is no tip of revolution",
                "use body.kinematics: 3d",
            )
        ]
    if config.body.dim == 2 and not tip.is_axisymmetric:
        return [
            ConfigError(
                "indenter.shape",
                f"a {tip.shape} over a strip",
                "use a box, a cylinder or a half_space",
            )
        ]
    if isinstance(config.body, Cap | Ball) and not tip.is_axisymmetric:
        problem = f"a {tip.shape} over a {config.body.shape}, which is modelled about its axis"
        return [
            ConfigError(
                "indenter.shape", problem, "use a tip of revolution, a cone of equal sections"
            )
        ]
    if isinstance(tip, Plate) and isinstance(config.body, UnboundedBody):
        problem = f"a plate on a {config.body.shape} touches all of a top without end"
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
        problem = "of a plate that touches all of a flat top is not verified"
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
    """What of an experiment contradicts itself or the scene, as far as the file alone tells."""
    experiment = config.experiment
    if experiment is None:
        return
    if experiment.adhesion:
        yield from _jkr_errors(config, experiment.adhesion)
    if experiment.calibration and experiment.calibration.stiffness and not experiment.cantilever:
        problem = "is the uncertainty of a cantilever's stiffness, and there is none"
        yield ConfigError(
            "experiment.calibration.stiffness",
            problem,
            "give experiment.cantilever, or leave it out",
        )
    if experiment.calibration and experiment.calibration.R and not hasattr(config.indenter, "R"):
        problem = f"is the uncertainty of a tip's radius R, and a {config.indenter.shape} has none"
        yield ConfigError("experiment.calibration.R", problem, "leave it out")
    if not any(vars(experiment).values()):
        yield ConfigError(
            "experiment", "says nothing", f"its keys are {', '.join(field_names(Experiment))}"
        )


def _history_errors(config: Config) -> Iterator[ConfigError]:
    """What is wrong with a path in time."""
    path_in_time = config.loading.prescribed_history
    times = config.loading.times
    if path_in_time is None:
        if not isinstance(times, str):
            yield ConfigError(
                "loading.times", "is for a path in time", "give loading.history, or leave it out"
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
            f"time goes back from {point_times[backward_index - 1]:g} to {point_times[backward_index]:g}",
        )
    elif point_times[0] == point_times[-1]:
        yield ConfigError(key, "lasts no time", "let time go on")
    for k, (before, t) in enumerate(pairwise((-inf, *path_in_time.times))):
        if not max(before, point_times[0]) <= t <= point_times[-1] or t == before:
            problem = (
                f"{t:g} lies outside the history"
                if not point_times[0] <= t <= point_times[-1]
                else "does not go on"
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
        problem = f"a force of {lowest_force:g} pulls, and pulls in time have depths of their own"
        yield ConfigError(key, problem, "give loading.history, of depths, or forces of 0 and more")
    elif lowest_force < 0 and not (config.experiment and config.experiment.adhesion):
        yield ConfigError(
            key,
            f"a force of {lowest_force:g} pulls, and nothing holds on to the tip",
            "give experiment.adhesion",
        )


def _relaxation_errors(config: Config) -> Iterator[ConfigError]:
    """What is wrong with how the materials relax."""
    laws = dict(config.materials())
    frequencies = config.experiment and config.experiment.frequencies
    history = config.loading.prescribed_history
    relaxations = {
        f"{key}.relaxation": law.relaxation for key, law in laws.items() if law.relaxation
    }
    if not relaxations:
        if frequencies:
            yield ConfigError(
                "experiment.frequencies", "needs a body that relaxes", "give material.relaxation"
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
        problem = (
            f"is not that of {different_key}: what relaxes as a whole must do so alike everywhere"
        )
        yield ConfigError(key, problem, f"the same {different_key}.relaxation, or of: shear")
    if not history and not frequencies:
        remedy = "give loading.history, loading.force_history or experiment.frequencies"
        yield ConfigError(key, "needs a time", remedy)


def _shear_relaxation_errors(config: Config, laws: Mapping[str, Material]) -> Iterator[ConfigError]:
    """What a body whose shear alone relaxes, in part of it at least, is not followed with."""
    for key, law in laws.items():
        if law.relaxation and law.relaxation.of == "all":
            problem = (
                "all: is for a body that relaxes alike everywhere, and elsewhere shear relaxes "
                "alone"
            )
            yield ConfigError(f"{key}.relaxation.of", problem, "of: shear")
        if law.relaxation and not isinstance(law, ShearRelaxingLaw | Gel):
            alternative_law = (
                "mooney_rivlin with C10 = mu/2" if isinstance(law, NeoHookean) else "linear_elastic"
            )
            yield ConfigError(
                f"{key}.relaxation.of",
                f"{law.model} has no shear apart from its volume",
                f"use {alternative_law}",
            )
    if config.experiment and config.experiment.frequencies:
        problem = "is made of a curve, and none knows a bulk modulus that stays while shear relaxes"
        yield ConfigError("experiment.frequencies", problem, "of: all")
    if isinstance(config.contact, Nitsche):
        problem = "nitsche takes the body's own stress, which relaxes"
        yield ConfigError("contact.method", problem, "use augmented_lagrangian")
    if config.contact.may_snap_through:
        problem = "together with relaxation is not verified"
        yield ConfigError("contact.adhesion", problem, "leave one of the two out")


def _relaxation_law_errors(config: Config, key: str, given: Relaxation) -> Iterator[ConfigError]:
    """What is wrong with a law by itself, and with a history that it cannot bear."""
    if (given.prony is None) == (given.power_law is None):
        yield ConfigError(key, "must be one of two laws", "give prony or power_law")
    for k, (fraction, time) in enumerate(given.prony or ()):
        if not (0 <= fraction < 1 and time > 0):
            problem = (
                f"[{fraction:g}, {time:g}] is no term [fraction of the instantaneous modulus, time]"
            )
            yield ConfigError(
                f"{key}.prony[{k}]", problem, "a fraction from 0 to below 1, a time above 0"
            )
    if (total := sum(fraction for fraction, _ in given.prony or ())) >= 1:
        yield ConfigError(
            f"{key}.prony",
            f"the fractions sum to {total:g}: nothing would bear in the end",
            "below 1",
        )
    history = config.loading.prescribed_history
    if given.power_law and history and history.has_jumps:
        problem = "jumps, and the instantaneous modulus of a power law is infinite"
        yield ConfigError(f"loading.{config.loading.given_path_keys[0]}", problem, "use a ramp")


def _jkr_errors(config: Config, adhesion: JKRAdhesion) -> Iterator[ConfigError]:
    """That the contact is no disc that grows and shrinks, as Griffith's balance at its edge needs."""
    body = config.body
    tip = config.indenter
    key = "experiment.adhesion"
    if any(material.relaxation for _, material in config.materials()):
        problem = (
            "is not known together with relaxation: the work that a relaxing body gives to "
            "its edge has no limit"
        )
        yield ConfigError(key, problem, "give one of the two")
    problem = "the JKR limit is that of a disc, and a {} has none"
    if isinstance(body, Strip | Box):
        remedy = "use a cylinder, a layer, a half_space, a cap or a ball"
        yield ConfigError(key, problem.format(body.shape), remedy)
    if not tip.is_axisymmetric:
        yield ConfigError(key, problem.format(tip.shape), "use a tip of revolution")
    if isinstance(tip, Plate) and not isinstance(body, Cap | Ball):
        problem = "the contact of a plate on a flat top does not shrink before it comes off at once"
        yield ConfigError(key, problem, "use another tip")
    if isinstance(tip, FlatPunch) and not tip.edge_radius and not isinstance(body, Cap | Ball):
        problem = "the contact of a sharp flat punch does not shrink before it comes off at once"
        yield ConfigError(key, problem, "give the punch an edge_radius")
    if adhesion.range and not hasattr(tip, "R"):
        problem = f"is for the Tabor number of a round tip, and a {tip.shape} has no R"
        yield ConfigError(f"{key}.range", problem, "leave it out")


def _accuracy_errors(config: Config) -> list[ConfigError]:
    """`accuracy` chooses the sizes itself."""
    given = _given_mesh_keys(config.mesh, "refinements") if config.accuracy is not None else []
    return [
        ConfigError(key, "contradicts accuracy, which chooses it", "give one of the two")
        for key in given
    ]


def _given_mesh_keys(mesh: MeshSettings, extra_key: str) -> list[str]:
    """The keys of sizes, and one other, that a scene gives."""
    return [
        f"mesh.{name}"
        for name in (*MESH_SIZE_KEYS, extra_key)
        if getattr(mesh, name) not in (None, "auto")
    ]


def _mesh_file_errors(config: Config) -> Iterator[ConfigError]:
    """A mesh from a file has its own sizes, and it alone has refinements; the file lies with the
    scene.
    """
    body = config.body
    mesh = config.mesh
    if not isinstance(body, MeshFromFile):
        if mesh.refinements is not None:
            yield ConfigError(
                "mesh.refinements", "is for body.shape: mesh", "leave it out, or give h_contact"
            )
        return
    why = "is for bodies that are meshed here, and this one has its mesh"
    for key in _given_mesh_keys(mesh, "symmetry"):
        yield ConfigError(key, why, "leave it out, or refine it with mesh.refinements")
    if problem := _path_problem(body.file, "the scene's folder"):
        yield ConfigError("body.file", problem, "put the mesh beside the scene file")
    if body.kinematics == "axisymmetric" and any(config.center or ()):
        problem = "the tip stands on the axis of an axisymmetric mesh"
        yield ConfigError("indenter.center", problem, "leave it out, or use kinematics: 3d")


def _directory_errors(config: Config) -> Iterator[ConfigError]:
    if config.output.directory and (problem := directory_problem(config.output.directory)):
        yield ConfigError("output.directory", problem, "choose any other folder with --output")


def directory_problem(directory: str) -> str:
    """What is wrong with a result folder that a file names: it must lie below the working
    directory; "" if nothing.

    Scene and study files come from other people; where else results may go is for the command line
    to say.
    """
    if problem := _path_problem(directory, "the working directory"):
        return problem
    try:
        here = os.path.realpath(".")
        leads_out = os.path.commonpath([here, os.path.realpath(directory)]) != here
    except OSError:  # the working directory was deleted: nothing can be written there
        return ""
    return "leads out of the working directory through a link" if leads_out else ""


def _path_problem(path: str, root_name: str) -> str:
    """What is wrong with a path by its words alone: it must lie below a folder; "" if nothing."""
    parts = path.split("/")
    if path.startswith("/") or ".." in parts:
        return f"must be below {root_name}, not absolute and without .."
    if any(part.startswith((".", "~")) and part != "." for part in parts):
        return "may not begin with . or ~, nor any folder in it"
    if printable(path) != path or "\\" in path:
        return "holds a character that does not belong in the name of a folder"
    if (
        any(len(os.fsencode(part)) > MAX_NAME_BYTES for part in parts)
        or len(path) > MAX_PATH_LENGTH
    ):
        return "is too long"
    return ""


@cache
def section_tags() -> dict[str, str]:
    """The tag key of every section that has one: body -> shape."""
    return {
        name: tag for name, hint in field_types(Config).items() if (tag := tag_of(hint)) is not None
    }


@cache
def sections() -> dict[str, tuple[type, ...]]:
    """The sections of the file in order, with the dataclasses each may be."""
    types_by_name = {name: union_members(hint) for name, hint in field_types(Config).items()}
    return {
        name: kinds for name, kinds in types_by_name.items() if dataclasses.is_dataclass(kinds[0])
    }


@dataclass(frozen=True)
class SchemaNode:
    """A place in a document, however deep: the type that belongs there, its default, and the value
    that stands there.

    `type` is None where nothing belongs; `value` is None where nothing stands.
    """

    path: KeyPath
    type: Any
    default: Any
    value: Any

    @property
    def tag(self) -> str | None:
        """The key that chooses what this section is."""
        return tag_of(self.type)

    @cached_property
    def tag_value(self) -> Any:
        """What the section, or its default, chooses."""
        default = getattr(self.default, self.tag, None) if self.tag else None
        return (
            self.value.get(self.tag, default)
            if isinstance(self.value, Mapping) and self.tag
            else default
        )

    @cached_property
    def section_type(self) -> Any:
        """The dataclass of this section; None for a value, and where none is chosen."""
        return (
            Config
            if not self.path
            else type_of_tag(self.type, self.tag_value)
            if self.type is not None
            else None
        )

    def child(self, part: str | int) -> SchemaNode:
        """The place of a key or of a list's item."""
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
        container = next(
            (member_type for member_type in kinds if get_origin(member_type) in (tuple, dict)),
            bare_type(self.type),
        )  # or a word
        item = {tuple: lambda: get_args(container)[0], dict: lambda: get_args(container)[1]}.get(
            get_origin(container)
        )
        return SchemaNode(path, item() if item else None, None, value)

    def children(self) -> Iterator[SchemaNode]:
        """The places of what stands inside this one."""
        if isinstance(self.value, Mapping):
            yield from (self.child(key) for key in self.value)
        elif isinstance(self.value, (list, tuple)) and len(self.value):
            item = self.child(0)  # the others are of its type
            for k, value in enumerate(self.value):
                yield dataclasses.replace(item, path=(*self.path, k), value=value)

    def allowed_keys(self) -> tuple[str, ...]:
        """The keys that may stand in this section."""
        if not self.path:
            return tuple(name for name in field_names(Config) if name != "center")
        names = file_order(self.section_type) if dataclasses.is_dataclass(self.section_type) else ()
        return (*names, "center") if self.path == ("indenter",) else names


def node_at(path: KeyPath, document: Any) -> SchemaNode:
    """The place of a key path in a document."""
    spot = SchemaNode((), Config, None, document)
    for part in path:
        spot = spot.child(part)
    return spot


def allowed_keys_at(path: KeyPath, document: Mapping[str, Any]) -> tuple[str, ...]:
    """The keys that may stand in a section of the document, the root's for ()."""
    return node_at(path, document).allowed_keys()


def file_order(kind: Any) -> tuple[str, ...]:
    """The fields of a dataclass as a file gives them: the tag first."""
    return _file_order(kind)


@cache  # every run writes what its scene says, and what it became
def _file_order(kind: Any) -> tuple[str, ...]:
    tags = [
        name
        for name in TAG_KEYS & set(field_names(kind))
        if len(get_args(field_types(kind)[name])) == 1
    ]
    return tuple(sorted(field_names(kind), key=lambda name: name not in tags))


def has_part(value: Any, part: str | int) -> bool:
    """Whether a section has a key, or a list an item of this number."""
    if isinstance(value, (list, tuple)):
        return isinstance(part, int) and part < len(value)
    return isinstance(value, Mapping) and part in value
