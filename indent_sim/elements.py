"""The elements a scene asks for: sizes from the config, or from the accuracy it wants."""

from __future__ import annotations

from collections.abc import Callable
from math import pi
from typing import TYPE_CHECKING

from indent_sim import sizing
from indent_sim.accuracy import Fineness, fineness_of, target_of
from indent_sim.errors import ConfigError
from indent_sim.model.indenters import FlatPunch, Indenter
from indent_sim.model.materials import Material
from indent_sim.reduction import Reduction
from indent_sim.sizing import Given, Sizes, rounded
from indent_sim.state import Scales
from indent_sim.theory.solution import Solution

if TYPE_CHECKING:
    from indent_sim.config import Config, MeshSettings

NEARLY_SHARP = 0.5  # of a punch's radius: with a smaller radius of its edge the pressure has a peak where contact ends
WIDE = 0.75  # contact radius over height from which a layer is squeezed rather than indented
INCOMPRESSIBLE = 0.45  # Poisson ratio from which it then gives way to the sides alone
Expected = tuple[float, Solution | None]  # at some depth: the contact radius, theory's solution


def fineness(config: Config, per_radius: float | None, dim: int, deltas: tuple[float, ...],
             expect: Callable[[float], Expected], material: Material, height: float) -> Fineness | None:  # fmt: skip
    """What `accuracy` asks of the mesh; the shallowest and the deepest contact know it."""
    target, contacts = target_of(config.accuracy), []
    if target is None:
        return None
    inside = [delta for delta in deltas if delta > 0] or [max(abs(delta) for delta in deltas) or 1.0]
    for delta in (min(inside), max(inside)):
        a, solution = expect(delta)
        area = pi * a**2 if config.body.shape != "strip" else 2 * a
        contacts.append((delta, a, solution.force / area if solution else material.E_star * delta / (2 * a)))
    given = getattr(config.contact, "epsilon_n", "auto") != "auto"
    squeezed = max(a for _, a, _ in contacts) >= WIDE * height and material.constants[1] >= INCOMPRESSIBLE
    confined = squeezed and not _is_sharp(config.indenter)
    return fineness_of(target, per_radius, contacts, dim, config.mesh.order, confined, given)


def _is_sharp(tip: Indenter) -> bool:
    """Whether contact ends at a punch's edge, wherever its surface ends, with a peak of pressure there."""
    return isinstance(tip, FlatPunch) and tip.edge_radius < NEARLY_SHARP * tip.radius


def sizes(config: Config, reduction: Reduction, tip: Indenter, a: float, scales: Scales,
           wanted: Fineness | None) -> Sizes:  # fmt: skip
    """The element sizes: the config's, those of the fineness that `accuracy` wants, or those of `sizing`."""
    mesh, dim = config.mesh, reduction.kinematics.dim
    edge = rounded(a if tip.edge_radius else tip.radius) if isinstance(tip, FlatPunch) and _is_sharp(tip) else None
    height = reduction.extent[-1][1] - reduction.extent[-1][0]
    width = max(high - low for low, high in reduction.extent[:-1])
    bend = reduction.radius
    given = wanted.sizes(height, width, edge, bend) if wanted else _given(mesh, scales, height, edge)
    return sizing.choose(a, height, width, dim, mesh.order, given, edge=edge, round_radius=bend)


def _given(mesh: MeshSettings, scales: Scales, height: float, edge: float | None) -> Given:
    """The sizes of the config; ConfigError where they contradict one another or the scene."""
    names = ("h_contact", "h_axis", "h_edge", "h_far")
    lengths = {name: getattr(mesh, name) for name in names if getattr(mesh, name) not in (None, "auto")}
    h = lengths.get("h_contact", 0.0)
    if h and lengths.get("h_far", h) < h:
        raise ConfigError("mesh.h_far", "is smaller than h_contact", f"at least {h:g}")
    if h > height * scales.length:
        raise ConfigError("mesh.h_contact", "is larger than the body is thick", f"at most {height * scales.length:g}")
    for name in ("h_axis", "h_edge"):
        if name in lengths and not h:
            raise ConfigError(f"mesh.{name}", "needs h_contact, up to which sizes grow", "give both")
        if lengths.get(name, 0.0) > h:
            raise ConfigError(f"mesh.{name}", "is larger than h_contact", f"at most {h:g}")
    if edge is None and "h_edge" in lengths:
        raise ConfigError("mesh.h_edge", "is for a flat punch with a sharp edge", "leave it out")
    grading = None if mesh.grading == "auto" else mesh.grading
    return Given(**{name: length / scales.length for name, length in lengths.items()}, grading=grading)
