"""Sections of a scene file: dataclasses, defaults and ranges, and the source of every key."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Le, Len, Lt, MinLen
from pydantic import BaseModel, ConfigDict, PrivateAttr

from indent_sim.config.strict_yaml import KeyPath
from indent_sim.model.body import AnyBody
from indent_sim.model.contact import AutoContact, Contact
from indent_sim.model.drainage import Drainage
from indent_sim.model.experiment import Experiment
from indent_sim.model.layers import Layer
from indent_sim.model.loading import Loading
from indent_sim.model.materials import Material
from indent_sim.model.tilted_tip import tilted
from indent_sim.model.tips import Indenter
from indent_sim.model.units import ANGLE, LENGTH, Auto, Coordinate, Length, PositiveInt, TaggedBy

# Largest relative tolerance of the residual. The contact force of every row must equal the
# reactions to 1e-8 (run/single_run.py); with a larger tolerance, which would save one iteration, a
# row could fail this check.
MAX_RTOL = 1e-9
# Largest number of uniform refinements of a mesh from a file. Six of them divide a cell of a
# two-dimensional mesh into 4096.
MAX_REFINEMENTS = 6
LINEAR_ELEMENTS_GONE = (
    "linear elements were removed: with the same number of unknowns, quadratic elements give a "
    "force that is ten times as accurate"
)
# States of the load path that are written.
KeptStates = Literal["none", "last", "all"]
AccuracyPreset = Literal["fast", "balanced", "accurate"]


@dataclass(frozen=True)
class Units:
    """Units of plain numbers, by name; quantities with another unit are converted."""

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
    """Settings of the solver: method, linear solver and tolerances.

    Options of PETSc come from the environment variable
    [PETSC_OPTIONS](how_do_i.md#tune-petsc).
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
class MapBase:
    """Base of the body in a map: a plane through the pixels on the bare substrate."""

    plane: Literal["fitted"] = "fitted"


@dataclass(frozen=True)
class MapSettings:
    """Thickness of the body at each pixel of a map. Only `fit` of a map uses this section."""

    thickness: Literal["height"] = "height"
    mean: Length | None = None
    base: MapBase | None = None


@dataclass(frozen=True)
class Source:
    """Source of every key of a config: file and line, or the `--set` option.

    All sources compare equal, so that two configs with the same values are equal.
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
        """Return file and line of a key, or of its enclosing section."""
        for end in range(len(path), -1, -1):
            if path[:end] in self.locations:
                return self.locations[path[:end]]
        return self.name, None


class SceneSections(BaseModel):
    """Sections of a scene file with their defaults, before checks of their consistency."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, strict=True, allow_inf_nan=False, revalidate_instances="always"
    )

    title: str = ""
    units: Units = Units()
    body: Annotated[AnyBody, TaggedBy("shape")]
    # Required unless every layer or region has its own material.
    material: Annotated[Material | None, TaggedBy("model")] = None
    indenter: Annotated[Indenter, TaggedBy("shape")]
    # In a file these keys belong to `indenter`.
    center: Annotated[tuple[Coordinate, ...], LENGTH] | None = None
    tilt: Annotated[float, Ge(0), Lt(90), ANGLE] = 0.0
    tilt_towards: Annotated[float, ANGLE] = 0.0
    contact: Annotated[Contact, TaggedBy("method")] = AutoContact()
    drainage: Drainage | None = None
    loading: Loading
    experiment: Experiment | None = None
    map: MapSettings | None = None
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
    def tip(self) -> Indenter:
        """The tip with its tilt."""
        return tilted(self.indenter, self.tilt, self.tilt_towards)

    @property
    def initial_bath(self) -> float:
        """Value of the bath in the undeformed state."""
        if not self.drainage:
            return 0.0
        history = self.loading.prescribed_history
        return self.drainage.bath_at(history.points[0][0] if history else 0.0)

    @property
    def instrument(self) -> Experiment:
        """Experiment of the scene; an empty Experiment if the file has no such section."""
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

    @property
    def yields(self) -> bool:
        """True if a material of the scene may yield."""
        return any(material.plasticity for _, material in self.materials())

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


def key_of_layer(layer: int) -> str:
    """Return the key of a layer of the body, counted from the top."""
    return f"body.layers[{layer}]"


def key_of_inclusion(number: int) -> str:
    """Return the key of an inclusion of the body."""
    return f"body.inclusions[{number}]"
