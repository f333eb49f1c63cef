"""The elements a scene asks for: sizes from the config, or from the accuracy it wants."""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING

from indent_sim import sizing
from indent_sim.accuracy import Fineness, fineness_of, target_of
from indent_sim.errors import ConfigError
from indent_sim.model.indenters import FlatPunch, Indenter, reach
from indent_sim.premises import Premises
from indent_sim.sizing import Given, Sizes, rounded
from indent_sim.state import Scales

if TYPE_CHECKING:
    from indent_sim.config import Config, MeshSettings

NEARLY_SHARP = 0.5  # of a punch's radius: with a smaller radius of its edge the pressure has a peak where contact ends
AT_END = 0.999  # of the radius at which a tip ends: a contact that reaches it ends as under a punch
FINEST, ON_AXIS = 1e-9, 1e-10  # of the longest side of what is meshed: with smaller elements, even where the tip is at
# r = 0 and coordinates have all their digits, gmsh aborts or never ends
WIDE = 1.0  # contact radius over height from which a layer is squeezed rather than indented
INCOMPRESSIBLE = 0.45  # Poisson ratio from which it then gives way to the sides alone


def fineness(config: Config, given: Premises, per_radius: float | None) -> Fineness | None:
    """What `accuracy` asks of the mesh; the shallowest and the deepest contact know it."""
    target = target_of(config.accuracy)
    if target is None:
        return None
    inside = [delta for delta in given.deltas if delta > 0] or [max(map(abs, given.deltas)) or 1.0]
    contacts = [_contact(given, delta) for delta in (min(inside), max(inside))]
    stiffness_given = getattr(config.contact, "epsilon_n", "auto") != "auto"
    squeezed = max(a for _, a, _ in contacts) >= WIDE * given.body.height
    gives_way = squeezed and given.material.constants[1] >= INCOMPRESSIBLE
    confined = gives_way and not _is_sharp(given.tip)  # a sharp edge says where contact ends: nothing scatters
    return fineness_of(target, per_radius, contacts, given.dim, config.mesh.order, confined, stiffness_given)


def _is_sharp(tip: Indenter) -> bool:
    """Whether contact ends at a punch's edge, with a peak of the pressure there."""
    return isinstance(tip, FlatPunch) and tip.edge_radius < NEARLY_SHARP * tip.radius


def _contact(given: Premises, delta: float) -> tuple[float, float, float]:
    """A depth, the contact radius and the mean pressure to expect there."""
    a, solution = given.radius(delta), given.solution(delta)
    area = pi * a**2 if given.body.shape != "strip" else 2 * a
    return delta, a, solution.force / area if solution else given.material.E_star * delta / (2 * a)


def _edge(given: Premises, gap: str) -> float | None:
    """Radius of an edge at which the pressure is singular, or nearly: a punch's, or where contact reaches a tip's end.

    With a gap at the deformed point the body goes around the end of a tip.
    """
    tip, a = given.tip, given.a
    if isinstance(tip, FlatPunch):
        return (a if tip.edge_radius else tip.radius) if _is_sharp(tip) else None
    return reach(tip) if gap == "reference" and a >= AT_END * reach(tip) else None


def sizes(config: Config, given: Premises, wanted: Fineness | None, gap: str) -> Sizes:
    """The element sizes: the config's, those of the fineness that `accuracy` wants, or those of `sizing`."""
    mesh, reduction, a = config.mesh, given.reduction, given.a
    edge = _edge(given, gap)
    edge = rounded(edge) if edge is not None else None
    height = reduction.extent[-1][1] - reduction.extent[-1][0]
    width = max(high - low for low, high in reduction.extent[:-1])
    bend = reduction.radius
    settled = wanted.sizes(height, width, edge, bend) if wanted else _settled(mesh, given.scales, height, edge)
    last = given.radius(given.deltas[-1]) if given.deltas[-1] > 0 and edge is None else None
    found = sizing.choose(a, height, width, given.dim, mesh.order, settled, edge=edge, last=last, round_radius=bend)
    least = (ON_AXIS if reduction.kinematics.name == "axisymmetric" else FINEST) * max(width, height)
    _refuse_lost(found.finest * given.scales.length, least * given.scales.length)
    return found


def _refuse_lost(smallest: float, least: float) -> None:
    """ConfigError for elements so small beside the body that their corners are rounding errors."""
    if smallest < least * (1 - 1e-9):
        problem = f"elements of {smallest:.3g} are too small for a body of this size, at least {least:.3g}"
        raise ConfigError("mesh", problem, "make the body smaller: one of 1e5 contact radii feels like a half-space")


def _settled(mesh: MeshSettings, scales: Scales, height: float, edge: float | None) -> Given:
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
        problem = "is for the sharp edge of a flat punch, or of a tip that ends inside the contact"
        raise ConfigError("mesh.h_edge", problem, "leave it out")
    grading = None if mesh.grading == "auto" else mesh.grading
    return Given(**{name: length / scales.length for name, length in lengths.items()}, grading=grading)
