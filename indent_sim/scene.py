"""Config -> Scene: every "auto" becomes a number or a choice here, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass, field

from indent_sim.model.body import Body
from indent_sim.model.contact import Penalty
from indent_sim.model.indenters import Indenter
from indent_sim.model.kinematics import Kinematics
from indent_sim.model.materials import Material


@dataclass(frozen=True)
class Scales:
    """One length and one pressure of the scene; the solver and gmsh see everything divided by them.

    force [pressure length^2] and energy [pressure length^3] follow, one power of length less in plane strain.
    """

    length: float
    pressure: float
    dim: int = 3  # 2 in plane strain, where forces are per unit length

    @property
    def force(self) -> float:
        """Unit of force."""
        return self.pressure * self.length ** (self.dim - 1)

    @property
    def energy(self) -> float:
        """Unit of energy."""
        return self.pressure * self.length**self.dim


@dataclass(frozen=True)
class Choice:
    """One thing the program decided (or was told), and why."""

    key: str
    value: str | float | int
    why: str


@dataclass(frozen=True)
class Sizes:
    """Element sizes [length] and order.

    h_contact inside `patch` of the tip's axis, growing by `grading` per unit distance outside it up to h_far;
    around a sharp edge at radius `edge` it shrinks to h_edge.
    """

    h_contact: float
    h_far: float
    patch: float
    order: int = 2
    grading: float = 0.2
    edge: float | None = None
    h_edge: float | None = None


@dataclass(frozen=True)
class Scene:
    """A completely decided simulation; every number is non-dimensional (see `scales`)."""

    title: str
    units: dict[str, str]
    scales: Scales
    kinematics: Kinematics
    symmetry: str  # axisymmetric | plane_strain | quarter | half | full
    copies: int  # how many times the modelled part makes the whole body
    body: Body
    extent: tuple[tuple[float, float], ...]  # of the modelled part, (min, max) along each axis
    supports: dict[str, str]  # named surface -> free | roller | fixed; symmetry planes are rollers
    pins: tuple[tuple[tuple[float, ...], int], ...]  # (point, component) that remove rigid modes
    material: Material
    indenter: Indenter
    center: tuple[float, ...]
    contact: Penalty
    gap: str  # reference | current
    deltas: tuple[float, ...]
    sizes: Sizes
    choices: tuple[Choice, ...] = ()
    warnings: tuple[str, ...] = ()
    prediction: dict[str, float] = field(default_factory=dict)
    solver: dict = field(default_factory=dict)
