"""Scene: physics, sizes, solver and plan; `resolve` makes it from a Config."""

from __future__ import annotations

import contextlib
import dataclasses
from dataclasses import dataclass, field
from math import inf
from typing import TYPE_CHECKING, Any

from indent_sim.mesh.part import Part
from indent_sim.mesh.piece import Piece
from indent_sim.mesh.sizes import Sizes
from indent_sim.model.body import Body, HalfSpace
from indent_sim.model.contact import ActiveSet, Anchor, ContactLaw
from indent_sim.model.experiment import Experiment
from indent_sim.model.loading import LoadPath
from indent_sim.model.materials import Material
from indent_sim.model.state import OF_FRICTION
from indent_sim.model.tips import FlatPunch, Indenter, reach
from indent_sim.model.units import Scales
from indent_sim.process.errors import ConfigError
from indent_sim.process.usage import machine_memory
from indent_sim.scene import choices, sizing
from indent_sim.scene.choices import Choice
from indent_sim.scene.cost import PER_ROW, THEORY, Cost, Work, candidates
from indent_sim.scene.cost import cost as cost_of
from indent_sim.scene.doubts import Doubt, doubts, of_theory, of_whole_contact
from indent_sim.scene.expected import Adherence, Stick, peakless, prediction_of, rubbed, stick
from indent_sim.scene.fineness import Fineness
from indent_sim.scene.given import Given, given_by, on_finite_body, unused_material
from indent_sim.scene.sizing import AT_END
from indent_sim.scene.theories import Theory
from indent_sim.theory.surface.no_slip import Rubbed

if TYPE_CHECKING:
    from indent_sim.config.schema import Config, SolverSettings, Units
    from indent_sim.theory.surface.adhesion import Jkr


WALL_STIFFNESS = 1e3  # of E/h_far: a curved roller wall gives way by less than 1e-3 of an element under the pressure E
WALL_WHY = f"u.n = 0 with the cylinder's own normal, weakly, by {WALL_STIFFNESS:g} E/h_far"
ROUGH = "the surface is rough, theory's frictionless"
MIRROR = 1e-12  # distance [length] of a tip to the mirror plane that it stands over
SEARCH = 2  # times the linear solves of a step to a known depth are needed to find the depth of a force


@dataclass(frozen=True)
class Physics:
    """What is simulated, without units: every number is divided by the `scales`."""

    scales: Scales
    body: Body
    part: Part  # of the body, modelled
    wall_stiffness: float  # of the weak u . n = 0 on the curved wall of a cylinder in three dimensions; 0: none
    indenter: Indenter
    center: tuple[float, ...]
    contact: ContactLaw
    gap: str  # reference | current
    path: LoadPath  # what is prescribed, step by step
    deltas: tuple[float, ...]  # prescribed, or expected at the prescribed forces
    anchor: Anchor = "implicit"  # of what comes into contact during a step, with friction

    @property
    def has_friction(self) -> bool:
        """Whether the tip drags on the surface."""
        return bool(self.contact.friction)

    @property
    def adheres(self) -> bool:
        """Whether the tip pulls the surface across the gap."""
        return self.contact.adhesion is not None

    @property
    def has_memory(self) -> bool:
        """Whether an equilibrium depends on the path to it: with adhesion two may be stable at one depth."""
        return self.has_friction or self.adheres

    @property
    def sideways(self) -> dict[str, int]:
        """The horizontal axes, by name, along which friction may push the tip: it does not stand over a mirror plane
        across, which is a roller wall, there; an edge that is free or fixed is none."""
        if not self.has_friction or self.part.kinematics.name == "axisymmetric":
            return {}
        under = {wall for wall, distance in self.part.distances(self.center).items() if distance <= MIRROR}
        mirrors = {wall for wall in under if self.part.supports.get(wall) == "roller"}
        axes = {name: axis for axis, name in enumerate("xy"[: self.part.dim - 1])}
        return {name: axis for name, axis in axes.items() if not mirrors & {f"{name}_min", f"{name}_max"}}

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns of the force table that only some scenes have, in order."""
        if not self.has_friction:
            return ()
        across = [f"side_force_{axis}" for axis in self.sideways]
        return tuple(name for name in OF_FRICTION if not name.startswith("side") or name in across)

    @property
    def material(self) -> Material:
        """What the tip touches: its E* compares pressures with lengths."""
        return self.part.regions[0].material

    @property
    def small_strain(self) -> bool:
        """Whether the strain is small in all of the body."""
        return all(region.material.small_strain for region in self.part.regions)


@dataclass(frozen=True)
class Plan:
    """What is said of a simulation before it runs: names, theory, choices with their reasons, doubts, predictions."""

    title: str
    units: Units
    theory: Theory | None = field(repr=False)
    fineness: Fineness | None  # where `accuracy` chose the sizes
    choices: tuple[Choice, ...]
    doubts: tuple[Doubt, ...]
    prediction: dict[str, float]  # in the user's units
    stick: Stick | None = None  # what no slip would change; None where there is friction, or nothing is known
    friction: Rubbed | None = None  # what it changes of theory's contact, where that is known
    adhesion: Adherence | None = None  # of a tip that adheres
    jkr: Jkr | None = field(default=None, repr=False)  # the same tip without range, without units

    @property
    def warnings(self) -> tuple[str, ...]:
        """Where the model or the mesh is a poor one for what is asked, a sentence each."""
        return tuple(doubt.words for doubt in self.doubts if doubt.words)


@dataclass(frozen=True)
class Scene:
    """A completely decided simulation: what is simulated, on which elements, how it is solved, and what is said."""

    physics: Physics
    sizes: Sizes
    solver: SolverSettings
    plan: Plan
    experiment: Experiment | None = None  # what is computed from the solved curve, in the user's units
    asked: float = 0.0  # the largest depth that its history may come to, without units

    @property
    def is_meshed(self) -> bool:
        """Whether a mesh is solved; where theory is, `sizes` are distances between points of the surface."""
        return self.solver.method != "theory"

    @property
    def method(self) -> str:
        """The contact method, or theory."""
        return self.physics.contact.method if self.is_meshed else "theory"

    def with_physics(self, **changes: Any) -> Scene:
        """The same simulation of something else: another tip, path or contact law on the same elements."""
        return dataclasses.replace(self, physics=dataclasses.replace(self.physics, **changes))

    @property
    def differences(self) -> tuple[str, ...]:
        """What this problem has that theory's has not, in words; empty when they are one, or there is no theory."""
        theory = self.plan.theory
        parts = (
            (not self.physics.small_strain, "strain is finite, theory's small"),
            (self.physics.has_friction, ROUGH),
            (self.physics.adheres, "the attraction has a range, theory's none"),
            (self.physics.gap == "current", "the gap is tested at the deformed point, theory's at the undeformed one"),
            (theory is not None and not theory.exact, theory.why if theory else ""),
        )
        return tuple(why for applies, why in parts if applies)

    @property
    def exact_theory(self) -> Theory | None:
        """The theory of this very problem."""
        return self.plan.theory if not self.differences else None

    def has_peak(self, a: float) -> bool:
        """Whether the pressures of a contact of radius a [length] have a largest one that a mesh can know.

        Not where contact ends at the end of a tip, as under a punch.
        """
        tip = self.physics.indenter
        ends = self.sizes.edge is not None and not isinstance(tip, FlatPunch)
        if ends and a >= AT_END * reach(tip):
            return False
        return not peakless(self.physics.body, tip, self.physics.center, self.sizes, a)


def resolve(config: Config, per_radius: float | None = None, piece: Piece | None = None) -> Scene:
    """Decide everything the config leaves open.

    With `accuracy` there are `per_radius` elements in every contact radius, or as many as it is expected to need.
    piece: the body of the config's mesh file, where it has been read.
    Raises ConfigError for a scene that cannot exist or that this machine cannot hold.
    """
    given = given_by(config, piece)
    if by_theory := choices.theory(config, given):
        return _by_theory(config, given, by_theory)
    return _meshed(config, on_finite_body(config, given), per_radius)


def _by_theory(config: Config, given: Given, solver: Choice) -> Scene:
    """The scene that theory solves: what stands for its sizes are the points of the surface that are written."""
    physics = Physics(given.scales, given.body, given.part, 0.0, given.tip, given.center, ActiveSet(), "reference",
                      given.path, given.deltas)  # fmt: skip
    chosen = (*choices.quantities(config), solver, *choices.by_theory(config, given),
              *choices.experiment(config, given, solver))  # fmt: skip
    predicted = _expected(given) | {"seconds": float(f"{THEORY + PER_ROW * len(given.deltas):.2g}")}
    against = (*_of_material(config, given), *of_theory(given), *of_whole_contact(given))
    plan = Plan(config.title, config.units, given.theory, None, chosen, against, predicted, _stick(config, given))
    settings = dataclasses.replace(config.solver, method="theory")
    return Scene(physics, sizing.surface_points(given), settings, plan, config.experiment, given.asked)


def _meshed(config: Config, given: Given, per_radius: float | None) -> Scene:
    fineness = sizing.fineness(config, given, per_radius)
    gap, gap_choice = choices.gap(config.contact, given)
    sizes = sizing.sizes(config, given, fineness, gap)
    law, law_choice = choices.contact(config.contact, given, sizes, fineness)
    law, bound_choice = choices.bounded(law, given, sizes)
    anchor, friction_choice = choices.friction(law, given)
    adherence, adhesion_choice = choices.adhesion(law, given, sizes)
    solver, linear, cost = _solver(config, given, law, gap, sizes, anchor)
    wall, wall_choice = _wall(given, sizes)
    tip, tip_choice = choices.tip(given, gap)
    if cost.memory > machine_memory():
        work = _work(given, str(solver.value), str(linear.value), gap, law, anchor)
        raise _unaffordable(config, given, law, sizes, work, fineness is not None)
    doubted = (*_of_material(config, given), *doubts(given, law, gap, sizes))
    physics = Physics(given.scales, given.body, given.part, wall, tip, given.center, law, gap, given.path,
                      given.deltas, anchor)  # fmt: skip
    chosen = (*choices.quantities(config), *choices.model(given), *choices.formulations(given), gap_choice, law_choice,
              *(bound_choice or friction_choice), *adhesion_choice,
              *tip_choice, *wall_choice, *_peak(given, tip, sizes), *choices.mesh(config, given, sizes, fineness),
              solver, linear, *choices.experiment(config, given, solver))  # fmt: skip
    predicted = _prediction(given, doubted, cost.with_error_bars if fineness else cost)
    said = None if law.friction or law.adhesion else _stick(config, given, gap, str(linear.value))
    is_known = isinstance(config.body, HalfSpace) and law.friction and given.deepest > 0 and _is_linear(given, gap)
    rough = rubbed(given.part, given.tip, config.contact.friction, given.path) if is_known else None
    plan = Plan(config.title, config.units, given.theory, fineness, chosen, doubted, predicted, said, rough, adherence,
                given.jkr)  # fmt: skip
    settings = dataclasses.replace(config.solver, method=solver.value, linear=linear.value)  # type: ignore[arg-type]
    return Scene(physics, sizes, settings, plan, config.experiment, given.asked)


def _of_material(config: Config, given: Given) -> list[Doubt]:
    """That the section `material` is of no use."""
    words = unused_material(config, given.part)
    return [Doubt("material", words)] if words else []


def _stick(config: Config, given: Given, gap: str = "reference", linear: str = "direct") -> Stick | None:
    """What no slip would change at the deepest contact."""
    if given.deepest <= 0:
        return None
    return stick(given.part, given.tip, given.a, given.body.rim_distance(given.center),
                 is_half_space=isinstance(config.body, HalfSpace), is_linear=_is_linear(given, gap),
                 is_solvable=not given.part.pins and linear != "iterative")  # fmt: skip


def _is_linear(given: Given, gap: str) -> bool:
    return given.small_strain and gap == "reference"


def _wall(given: Given, sizes: Sizes) -> tuple[float, list[Choice]]:
    """The stiffness of a curved roller wall in three dimensions [pressure/length, without units]; 0: there is none."""
    if given.part.bend is None or given.part.supports["r_max"] != "roller":
        return 0.0, []
    stiffness = WALL_STIFFNESS * given.material.constants.E / sizes.h_far
    return stiffness, [Choice("wall", stiffness * given.scales.stiffness, WALL_WHY)]


def _peak(given: Given, tip: Indenter, sizes: Sizes) -> list[Choice]:
    """That p_max is left empty, and why."""
    why = peakless(given.body, tip, given.center, sizes, given.a if given.deepest > 0 else 0.0)
    return [Choice("p_max", "empty", why)] if why else []


def _solver(config: Config, given: Given, law: ContactLaw, gap: str, sizes: Sizes, anchor: Anchor
            ) -> tuple[Choice, Choice, Cost]:  # fmt: skip
    """What solves the scene, how its linear systems are solved, and what that will cost."""
    nodes = candidates(sizes, given.part) * (given.dim if law.friction else 1)
    method = choices.solver(config, given, law, gap, nodes)
    direct = cost_of(sizes, given.part, _work(given, str(method.value), "direct", gap, law, anchor))
    iterative = cost_of(sizes, given.part, _work(given, "newton", "iterative", gap, law, anchor))
    linear = choices.linear(config, given, law, sizes, direct, iterative, machine_memory())
    if linear.value == "direct":
        return method, linear, direct
    why = method.why if method.value == "newton" else "solver.linear: iterative is for the whole body"
    return Choice("solver.method", "newton", why), linear, iterative


def _work(given: Given, method: str, linear: str, gap: str, law: ContactLaw, anchor: Anchor) -> Work:
    solves = len(given.deltas) * (SEARCH if given.path.control == "force" else 1) * (2 if anchor == "mid" else 1)
    mixed = any(region.formulation == "mixed" for region in given.part.regions)
    is_nonlinear = gap == "current" or not given.small_strain or bool(law.friction) or law.adhesion is not None
    return Work(method, linear, mixed, solves, is_nonlinear, bool(law.friction))


def _unaffordable(config: Config, given: Given, law: ContactLaw, sizes: Sizes, work: Work, is_chosen: bool
                  ) -> ConfigError:  # fmt: skip
    """What to say of a scene that is beyond this machine, and what would fit."""
    cost = cost_of(sizes, given.part, work)
    room, key, name = machine_memory(), "mesh.h_contact", "h_contact"
    if is_chosen:  # whoever set the sizes
        key, name = "accuracy", "accuracy"
    if cost_of(dataclasses.replace(sizes, inclusions=()), given.part, work).memory <= room:
        key, name = "mesh.h_inclusions", "h_inclusions, or inclusions"
    said = f"about {cost.dofs:.2g} unknowns need {cost.memory / 1e9:.3g} GB; this machine has {room / 1e9:.3g} GB"
    iterative = cost_of(sizes, given.part, dataclasses.replace(work, method="newton", linear="iterative")).memory
    if iterative <= room and not choices.against_iterative(config, given, law, sizes):
        return ConfigError(key, said, f"solver.linear: iterative needs {iterative / 1e9:.3g} GB")
    return ConfigError(key, said, f"use a larger {name}, or symmetry")


def _expected(given: Given) -> dict[str, float]:
    if given.attraction is None:
        return prediction_of(given.path, given.theory, given.relative, given.material, given.deepest, given.a,
                             given.scales)  # fmt: skip
    found = {"a": given.a * given.scales.length}
    with contextlib.suppress(ValueError, ArithmeticError):
        if given.jkr and given.path.control == "force":
            contact = given.jkr.stable(max(given.path.values), inf)
            found |= {"delta_JKR": contact.delta * given.scales.depth} if contact else {}
        elif given.jkr:
            contact = given.jkr.stable(given.deepest)
            found |= {"force_JKR": contact.force * given.scales.force} if contact else {}
    return found


def _prediction(given: Given, doubted: tuple[Doubt, ...], cost: Cost) -> dict[str, float]:
    """What to expect of the results and of the run, in the user's units."""
    truncation = {"truncation_error": given.truncation.error} if given.truncation else {}
    error = sum(doubt.force_error for doubt in doubted) if given.deltas[-1] > 0 else 0.0
    effort = {"cells": round(cost.cells), "dofs": round(cost.dofs), "memory_MB": round(cost.memory / 1e6),
              "seconds": float(f"{cost.seconds:.2g}")}  # fmt: skip
    return _expected(given) | truncation | ({"force_error": error} if error else {}) | effort
