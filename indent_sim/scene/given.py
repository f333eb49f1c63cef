"""The scene before any choice: without units, its modelled part, its theory and the depths to expect."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from math import inf, isfinite, log2
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from indent_sim.mesh import inspection, meshed
from indent_sim.mesh.part import Part, Region
from indent_sim.mesh.piece import Piece, Skin
from indent_sim.model.body import Ball, Body, Cap, Dome, Drawn, Endless, Layer, Meshed, MeshFromFile
from indent_sim.model.contact import Cohesion
from indent_sim.model.experiment import Experiment
from indent_sim.model.loading import Loading, LoadPath
from indent_sim.model.materials import LOCKING, Material
from indent_sim.model.tips import FlatPunch, Indenter
from indent_sim.model.units import Scales, rounded
from indent_sim.process.errors import ConfigError
from indent_sim.scene.expected import depths_of
from indent_sim.scene.reduction import reduce
from indent_sim.scene.theories import Theory, adhesive_radii, half_space_force, relative_tip, theory_of, without_range
from indent_sim.scene.truncation import Truncation, expected_depth, truncate
from indent_sim.theory.solution import Solution

if TYPE_CHECKING:
    from indent_sim.config.schema import Config
    from indent_sim.theory.surface.adhesion import Jkr


D = TypeVar("D")
HALVINGS = 40  # of the way of a spring's base, until the depth is known
FELT = 7.0  # ranges of gap up to which an attraction counts: beyond, a thousandth of its work is left
AT_RIM = 1e-9  # of a contact surface, from the tip's axis to its rim: less is none
MOST_COMPRESSED = 0.49999  # Poisson's ratio beyond which a displacement element's matrix loses its digits


@dataclass(frozen=True)
class Given:
    """A scene as given, in units of the body's height and Young's modulus (see `scales`), before any choice."""

    scales: Scales
    body: Body
    truncation: Truncation | None  # of a body without end, for which this one stands
    layers: tuple[Layer, ...]  # from the top, each with its thickness and material
    material: Material  # of the first
    tip: Indenter
    relative: Indenter  # the tip over a flat body, see `relative_tip`
    center: tuple[float, ...]
    path: LoadPath
    part: Part
    part_why: str
    theory: Theory | None
    deltas: tuple[float, ...]  # requested, or expected at the requested forces
    experiment: Experiment | None  # in the user's units
    asked: float  # the largest depth that the experiment's history may come to; 0 without one
    attraction: Cohesion | None  # of the contact
    radius: Callable[[float], float] = field(repr=False)  # the contact radius [length] to expect at a depth [length]

    @property
    def dim(self) -> int:
        """Dimensions of the mesh."""
        return self.part.dim

    @property
    def small_strain(self) -> bool:
        """Whether the strain is small in all of the body."""
        return all(region.material.small_strain for region in self.part.regions)

    @property
    def deepest(self) -> float:
        """The largest depth [length], of the path or of the experiment."""
        return max([*self.deltas, *([self.asked] if self.asked else [])])

    @property
    def a(self) -> float:
        """The contact radius [length] to expect at the deepest point, adhesion included."""
        if self.adhesive and self.deepest <= 0:  # no other tip touches there
            return max(self.adhesive)
        return max([self.radius(self.deepest), *self.adhesive])

    @cached_property
    def adhesive(self) -> tuple[float, float] | tuple[()]:
        """Contact radii [length] with adhesion, without range: the smallest that comes off and the deepest one's."""
        adhesion = self.experiment.adhesion if self.experiment else None
        if self.attraction and self.body.dim == 3:
            force = max(self.path.values) if self.path.control == "force" else None
            return adhesive_radii(self.theory, self.relative, self.layers, self.attraction.work, self.deepest, force)
        if adhesion is None or self.part.kinematics.name != "axisymmetric":
            return ()
        work = adhesion.work / (self.scales.pressure * self.scales.length)
        return adhesive_radii(self.theory, self.relative, self.layers, work, self.deepest, None)

    @cached_property
    def jkr(self) -> Jkr | None:
        """The contact of a tip that adheres as if its attraction had no range; None where theory does not know it."""
        return without_range(self.theory, self.attraction.work) if self.attraction else None

    def solution(self, delta: float) -> Solution | None:
        """Theory's contact at a depth [length], where there is a theory."""
        return self.theory.at(delta) if self.theory else None


def given_by(config: Config, piece: Piece | None = None) -> Given:
    """The scene without units, its body as given; ConfigError for one that cannot exist.

    piece: what `piece_of` finds in the config's mesh file, where somebody has read it.
    """
    body = config.body
    if isinstance(body, MeshFromFile):
        meshed_body, piece = _from_file(config, body, piece or piece_of(config, body))
        return _given(config, meshed_body, meshed_body.layers, piece=piece)
    layers = _layers(config)
    if isinstance(body, Cap | Ball):
        dome = body.dome
        return _given(config, dome, tuple(replace(layer, thickness=dome.height) for layer in layers))
    return _given(config, body, layers)


def on_finite_body(config: Config, given: Given) -> Given:
    """The scene on a body that can be meshed: one large enough stands for a body without end."""
    if not isinstance(config.body, Endless):
        return given
    deepest = given.deepest
    if given.adhesive:  # as deep as a tip that does not adhere has this contact
        deepest = max(deepest, 2 * float(given.tip.height(given.a, 0.0)))
    if given.attraction:  # or as far as it is felt
        deepest = max(deepest, 2 * FELT * (given.attraction.range or 0.0))
    found = truncate(config.body, config.indenter, _layers(config), deepest * given.scales.length)
    return _given(config, found.body, found.layers, found)


def _given(
    config: Config, whole: Body, layers: tuple[Layer, ...], truncation: Truncation | None = None,
    piece: Piece | None = None,
) -> Given:  # fmt: skip
    material = _material_of(layers[0])
    center = whole.center if truncation else config.center or whole.center
    pieces = whole.pieces if isinstance(whole, Dome) else 1
    history = history_path(config.experiment, config.indenter, layers)
    path = config.loading.path() if config.loading else history
    assert path is not None
    for one, key in ((path, "loading" if config.loading else "experiment"), (history, "experiment")):
        if one is not None:
            _check_scene(whole, config.indenter, center, one, pieces, key)
            _check_room(whole, layers, config.indenter, center, one, key)
            _check_ends(whole, config.indenter, center, one, key)
    scales = Scales(_unit_of_length(whole, layers, config.indenter, path), material.constants.E, whole.dim, pieces)
    body, tip, material = scales.scaled(whole), scales.scaled(config.indenter), scales.scaled(material)
    layers = tuple(map(scales.scaled, layers))
    center = tuple(rounded(c / scales.length) for c in center)
    path, history = (_scaled(one, scales) for one in (path, history))
    assert path is not None
    part, part_why = _modelled(config, body, center, tip, layers, piece, scales)
    asked = scales.scaled(config.body) if isinstance(config.body, Endless) else body
    theory, relative = theory_of(asked, layers, tip, center), relative_tip(tip, body)
    reached = depths_of(history, theory, relative, material, body.height, scales) if history else (0.0,)
    deltas = depths_of(path, theory, relative, material, body.height, scales)
    return Given(
        scales, body, truncation, layers, material, tip, relative, center, path, part, part_why,
        theory=theory and theory.along((*deltas, *reached)), deltas=deltas,
        experiment=config.experiment, asked=max(reached), attraction=scales.scaled(config.contact).adhesion,
        radius=cache(partial(_expected_radius, theory, (relative, tip), body, center)),
    )  # fmt: skip


def _scaled(path: LoadPath | None, scales: Scales) -> LoadPath | None:
    if path is None:
        return None
    return LoadPath(path.control, tuple(value / scales.of(path.control) for value in path.values))


def history_path(experiment: Experiment | None, tip: Indenter, layers: Sequence[Layer]) -> LoadPath | None:
    """Equal steps to the largest depth, or force, that an experiment's history may come to; None without a history.

    What relaxes lets the tip in as far as a body of its last modulus, and a spring keeps the tip back by the least
    force that a half-space of the softest layer has.
    """
    if experiment is None or not experiment.points:
        return None
    softest, largest = remaining(experiment), max(value for _, value in experiment.points)
    if experiment.force_history:
        return Loading(force=largest / softest).path()
    if not experiment.compliance:
        return Loading(delta=largest).path()
    E_star = softest * min(_material_of(layer).E_star for layer in layers)

    def beyond(depth: float) -> bool:
        closed = half_space_force(tip, depth, E_star)
        force = closed[1] if closed else 0.5 * E_star * tip.radius_at(depth) * depth
        return depth + experiment.compliance * force >= largest

    low, high = 0.0, largest
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if beyond(middle) else (middle, high)
    return Loading(delta=high).path()


def remaining(experiment: Experiment) -> float:
    """The least share of material.E that the body has during the history; of a power law it may be above 1."""
    law = experiment.relaxation
    if law is None:
        return 1.0
    if law.power_law is None:
        return 1.0 - sum(fraction for fraction, _ in law.prony or ())
    last = experiment.points[-1][0] - experiment.points[0][0]
    return float((last / law.power_law.time) ** -law.power_law.exponent)


def _unit_of_length(body: Body, layers: Sequence[Layer], tip: Indenter, path: LoadPath) -> float:
    """The body's height; of a half-space about the contact radius, a power of two, which costs no digit."""
    if isfinite(body.height):
        return body.height
    deepest = max(path.values)
    depth = expected_depth(tip, layers, deepest) if path.control == "force" else abs(deepest) or 1.0
    return float(2.0 ** round(log2(tip.radius_at(depth))))


def _layers(config: Config) -> tuple[Layer, ...]:
    """The layers from the top, each with its thickness (a half-space's last: infinite) and its material's constants."""
    return tuple(
        replace(layer, thickness=layer.thickness or inf, material=_material_of(layer).canonical())
        for layer in config.layers
    )


def _material_of(layer: Layer) -> Material:
    assert layer.material is not None
    return layer.material


def _regions(config: Config, layers: tuple[Layer, ...]) -> tuple[Region, ...]:
    """The regions of layers, z of their lower faces rounded as all lengths of a mesh."""
    names = [f"layers[{k}]" for k in range(len(layers))] if len(layers) > 1 else ["body"]
    depths = np.cumsum([layer.thickness for layer in layers])
    materials = [_material_of(layer) for layer in layers]
    formulations = [_formulation(config.material_key(k), material) for k, material in enumerate(materials)]
    return tuple(Region(name, material, formulation, -rounded(float(depth)))
                 for name, material, formulation, depth
                 in zip(names, materials, formulations, depths, strict=True))  # fmt: skip


def _inclusions(config: Config, body: Drawn | Endless, scales: Scales) -> Iterator[Region]:
    """The regions of inclusions, lengths rounded likewise."""
    own = [inclusion.material.canonical() for inclusion in config.body.inclusions or ()]
    for k, (inclusion, material) in enumerate(zip(body.inclusions or (), own, strict=True)):
        matter, name = scales.scaled(material), f"inclusions[{k}]"
        yield Region(name, matter, _formulation(f"body.{name}.material", matter), inclusion=_to_digits(inclusion))


def _formulation(key: str, material: Material) -> str:
    """Displacements alone, or with a pressure; ConfigError where the material or the elements cannot."""
    nu, wanted = material.constants.nu, material.formulation
    chosen = wanted if wanted != "auto" else "mixed" if nu >= LOCKING else "displacement"
    said = f"nu = {nu:g}" if material.is_isotropic else f"matter as compressible as nu = {nu:.6g}"
    if chosen == "displacement" and nu > MOST_COMPRESSED:
        raise ConfigError(f"{key}.formulation", f"displacement elements cannot carry {said}", "use 'mixed'")
    if chosen == "mixed" and nu <= 0:
        raise ConfigError(f"{key}.formulation", f"'mixed' needs nu > 0, and this is {said}", "use 'displacement'")
    return chosen


def _from_file(config: Config, source: MeshFromFile, piece: Piece) -> tuple[Meshed, Piece]:
    """The body that a file has, lowered so that the tip first touches it at z = 0."""
    center = config.center or source.center
    if source.hash not in (None, piece.hash):
        raise ConfigError("body.hash", f"'{source.file}' holds another mesh, {piece.hash}",
                          "find the mesh that this scene was made with, or leave the hash out")  # fmt: skip
    piece = piece.led_by(meshed.under_axis(piece, center))
    placed = piece.lowered(meshed.first_touch(config.indenter, piece, center))
    return meshed.body_of(placed, source, center, _materials(placed, config)[0][1]), placed


def piece_of(config: Config, source: MeshFromFile) -> Piece:
    """The body as its file, beside the scene's, has it."""
    return inspection.piece_in(os.path.dirname(config.source.name), source, config.material is not None)


def mapped_skin(config: Config, source: MeshFromFile) -> Skin:
    """The skin of that body, read in the process that meshes; of the whole this one has arrays that lie in a file."""
    from indent_sim.mesh import gmsh

    what = f"'{source.file}' could not be read"
    folder = os.path.dirname(config.source.name)
    return gmsh.elsewhere(what, inspection.skin_in, folder, source, config.material is not None)()


def _materials(piece: Piece, config: Config) -> list[tuple[str, Material]]:
    """The materials of a piece's regions with the keys where they stand, in their order."""
    regions = getattr(config.body, "regions", None) or {}
    own = {name: (f"body.regions.{name}", material) for name, material in regions.items()}
    found = [own.get(name, ("material", config.material)) for name in piece.names]
    return [(key, material.canonical()) for key, material in found if material is not None]


def unused_material(config: Config, part: Part) -> str:
    """That nothing of a body has the material of the section `material`, in words; empty where something has."""
    if config.material is None:
        return ""
    if isinstance(config.body, MeshFromFile):
        parts, is_used = "region", any(region.name == "body" for region in part.regions)
    else:
        parts, is_used = "layer", any(config.material_key(k) == "material" for k in range(len(config.layers)))
    return "" if is_used else f"nothing uses `material`: every {parts} has its own"


def with_used_material(config: Config, part: Part) -> Config:
    """The config without the section `material` where nothing of the body has it."""
    return config.model_copy(update={"material": None}) if unused_material(config, part) else config


def _modelled(
    config: Config, body: Body, center: tuple[float, ...], tip: Indenter, layers: tuple[Layer, ...],
    piece: Piece | None, scales: Scales,
) -> tuple[Part, str]:  # fmt: skip
    """The part of the body that is modelled, and why."""
    if not isinstance(body, Meshed):
        regions = (*_regions(config, layers), *_inclusions(config, body, scales))
        return reduce(_to_digits(body), center, config.mesh.symmetry, tip, regions)
    assert piece is not None and isinstance(config.body, MeshFromFile)
    materials = [(key, scales.scaled(material)) for key, material in _materials(piece, config)]
    regions = tuple(Region(f"regions.{name}" if name else "body", matter, _formulation(key, matter), 0.0)
                    for name, (key, matter) in zip(piece.names, materials, strict=True))  # fmt: skip
    part = meshed.part_of(piece.measured(scales.length), config.body, regions)
    return part, "a mesh from a file is modelled as it is"


def _to_digits(body: D) -> D:
    """A body, or an inclusion, with its own lengths rounded."""

    def to_digits(value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(map(to_digits, value))
        return rounded(value) if isinstance(value, float) else value

    fields = dataclasses.fields(body)  # type: ignore[arg-type]
    return replace(body, **{f.name: to_digits(getattr(body, f.name)) for f in fields})  # type: ignore[type-var]


def _check_scene(
    body: Body, tip: Indenter, center: tuple[float, ...], path: LoadPath, pieces: int, key: str
) -> None:
    if body.rim_distance(center) < 0:
        raise ConfigError("indenter.center", f"{list(center)} lies outside the body's top surface", "move it inside")
    width = 2 * body.rim_distance(body.center)
    if isinstance(tip, FlatPunch) and 2 * tip.radius > width:
        raise ConfigError("indenter.radius", f"a flat punch of radius {tip.radius:g} is wider than the body",
                          f"at most {width / 2:g}")  # fmt: skip
    thickness = pieces * body.height
    if path.control == "depth" and max(path.values) >= thickness:
        raise ConfigError(key, f"depth {max(path.values):g} is beyond the body's thickness {thickness:g}",
                          f"stay below {thickness:g}")  # fmt: skip


def _check_room(
    body: Body, layers: Sequence[Layer], tip: Indenter, center: tuple[float, ...], path: LoadPath, key: str
) -> None:
    delta, room = max(path.values), deepest(body, layers, tip, center)
    if path.control == "depth" and delta >= room:
        raise ConfigError(
            key,
            f"depth {delta:g} leaves no room to an incompressible body held on all sides: at {room:g} the tip would "
            "cover its whole top",
            "stay well below, free a side, or nu < 0.5",
        )


def _check_ends(body: Body, tip: Indenter, center: tuple[float, ...], path: LoadPath, key: str) -> None:
    delta, end = max(path.values), end_of_sides(body, tip, center)
    if path.control == "depth" and delta > end:
        raise ConfigError(
            key,
            f"depth {delta:g} presses the tip onto the top of a fixed side, which it meets at {end:g}: nothing "
            "moves it, and the force has no bound",
            f"stay below {end:g}, free that side, or take a wider body",
        )


def _expected_radius(
    theory: Theory | None, tips: Sequence[Indenter], body: Body, center: tuple[float, ...], delta: float
) -> float:
    """Contact radius at the deepest point: layer theory, else the smallest of the tips' sections; within the body."""
    rim = max(body.rim_distance(center), 0.05 * body.rim_distance(body.center))
    if isinstance(body, Meshed) and rim <= AT_RIM * body.reach(center):
        rim = body.reach(center)  # half of a symmetric body, cut where the tip stands
    if delta <= 0:
        return 0.2 * rim if isfinite(rim) else 1.0
    if isinstance(body, Meshed):
        return min(_overlap(tips[0], body, center, delta), rim)
    solution = theory.at(delta) if theory else None
    return min(solution.a if solution else min(tip.radius_at(delta) for tip in tips), rim)


def _overlap(tip: Indenter, body: Meshed, center: tuple[float, ...], delta: float) -> float:
    """How far from its axis [length] a tip at a depth would overlap the undeformed surface, to a part of a facet."""
    x, y = body.top()
    along_x, along_y = (*center, 0.0)[:2]
    r, gap = body.distances(center).ravel(), (tip.height(x - along_x, y - along_y) - body.facets[..., -1]).ravel()
    order = np.argsort(np.where(np.isfinite(gap), r, np.inf))[: np.isfinite(gap).sum()]
    return float(np.interp(delta, np.maximum.accumulate([0.0, *gap[order]]), [0.0, *r[order]]))


def deepest(body: Body, layers: Sequence[Layer], tip: Indenter, center: tuple[float, ...]) -> float:
    """The depth [length] at which the tip would cover the whole top; infinity for a body that can give way.

    The volume under the undeformed top stays what it is, so the surface's mean height stays 0, and under a tip that
    touches it everywhere that is the tip's mean height minus the depth. The force grows beyond all bounds before.
    """
    matter = [_material_of(layer) for layer in layers]
    matter += [inclusion.material.canonical() for inclusion in body.inclusions or ()]
    if any(material.constants.nu < 0.5 for material in matter) or not body.is_held:
        return float("inf")
    x, y = body.top()
    along_x, along_y = (*center, 0.0)[:2]
    return float(np.mean(tip.height(x - along_x, y - along_y)))


def end_of_sides(body: Body, tip: Indenter, center: tuple[float, ...]) -> float:
    """The depth [length] at which the tip meets the top of a fixed side; infinity where no side is fixed.

    Deeper, the surface would have to jump from u_z = 0 at the side to the tip beside it: no displacement of finite
    energy does, and the force of a mesh grows as the logarithm of its elements there.
    """
    x, y = body.fixed_ends()
    z = body.clamped[:, -1] if isinstance(body, Meshed) else 0.0
    along_x, along_y = (*center, 0.0)[:2]
    return float(np.min(tip.height(x - along_x, y - along_y) - z, initial=np.inf))
