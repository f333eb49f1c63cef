"""Config -> Scene: every "auto" becomes a number or a choice here, each with its reason."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from functools import cache, partial
from typing import TYPE_CHECKING, Any

from indent_sim import confinement, elements
from indent_sim.accuracy import Fineness
from indent_sim.blunting import blunted
from indent_sim.costing import DENSE, Cost, Work, candidates, machine_memory
from indent_sim.costing import cost as cost_of
from indent_sim.errors import ConfigError
from indent_sim.expectation import (
    contact_warnings,
    depths_of,
    prediction_of,
    shallow_doubts,
    stated_error,
    warnings_of,
)
from indent_sim.model.body import Body, HalfSpace
from indent_sim.model.contact import AugmentedLagrangian, AutoContact, Contact, ContactLaw, Penalty
from indent_sim.model.indenters import FlatPunch, Indenter
from indent_sim.model.kinematics import Kinematics
from indent_sim.model.loading import LoadPath
from indent_sim.model.materials import LOCKING, Material
from indent_sim.model.quantities import scaled
from indent_sim.oracle import Oracle, oracle
from indent_sim.reduction import Pins, Reduction, reduce
from indent_sim.sizing import Sizes, rounded
from indent_sim.state import Scales
from indent_sim.truncation import Truncation, expected_depth, half_space_oracle, truncate

if TYPE_CHECKING:
    from indent_sim.config import Config

WALL_STIFFNESS = 1e3  # of E/h_far: a curved roller wall gives way by less than 1e-3 of an element under the pressure E
STIFFEST = 1e3  # E*/h of a penalty that `accuracy` chooses: beyond it the pressures oscillate
SEARCH = 2  # times the linear solves of a step to a known depth are needed to find the depth of a force
MOST_CANDIDATES = 5000  # nodes that a body is condensed to: beyond it the dense matrices are gigabytes
MOST_COMPRESSED = 0.49999  # beyond it a displacement element's matrix loses its digits


FORCE_WHY = "forces are given: each depth is found from the curve force(depth), which has one depth for a force"
WALL_WHY = f"u.n = 0 with the cylinder's own normal, weakly, by {WALL_STIFFNESS:g} E/h_far"


@dataclass(frozen=True)
class Choice:
    """One thing the program decided (or was told), and why."""

    key: str
    value: str | float | int
    why: str


@dataclass(frozen=True)
class Scene:
    """A completely decided simulation; every number is non-dimensional (see `scales`)."""

    title: str
    units: dict[str, str]
    scales: Scales
    kinematics: Kinematics
    symmetry: str  # axisymmetric | quarter | half | full
    copies: int  # how many times the modelled part makes the whole body
    body: Body
    extent: tuple[tuple[float, float], ...]  # of the modelled part, (min, max) along each axis
    supports: dict[str, str]  # named surface -> free | roller | fixed; symmetry planes are rollers
    pins: Pins  # (point, component) that remove rigid modes
    wall_stiffness: float  # of the weak u . n = 0 on the curved wall of a cylinder in three dimensions; 0: none
    material: Material
    formulation: str  # displacement | mixed
    indenter: Indenter
    center: tuple[float, ...]
    contact: ContactLaw
    gap: str  # reference | current
    deltas: tuple[float, ...]  # requested, or expected at the requested forces
    sizes: Sizes
    solver: dict[str, Any]
    forces: tuple[float, ...] | None = None  # of the whole body, when they are requested instead of depths
    fineness: Fineness | None = None  # where `accuracy` chose the sizes
    oracle: Oracle | None = field(default=None, repr=False)
    choices: tuple[Choice, ...] = ()
    warnings: tuple[str, ...] = ()
    prediction: dict[str, float] = field(default_factory=dict)  # in the user's units

    @property
    def path(self) -> LoadPath:
        """What is prescribed, step by step."""
        return LoadPath("depth", self.deltas) if self.forces is None else LoadPath("force", self.forces)


def resolve(config: Config, per_radius: float | None = None) -> Scene:
    """Decide everything the config leaves open.

    With `accuracy` there are `per_radius` elements in every contact radius, or as many as it is expected to need.
    Raises ConfigError for a scene that cannot exist or that this machine cannot hold.
    """
    material = _material(config)
    whole, truncation = _finite(config, material)
    center = whole.centre if truncation else config.center or whole.centre
    path = config.loading.path()
    _check_scene(whole, config.indenter, center, path)
    _check_room(whole, material, config.indenter, center, path)
    E, _ = material.constants
    scales = Scales(whole.height, E, 2 if whole.shape == "strip" else 3)
    unit = (scales.length, scales.pressure)
    body, tip = scaled(whole, *unit), scaled(config.indenter, *unit)
    material = scaled(material, *unit)
    center = tuple(rounded(c / scales.length) for c in center)
    path = LoadPath(path.control, tuple(value / scales.of(path.control) for value in path.values))
    reduction = reduce(_rounded_body(body), center, config.mesh.symmetry, tip)
    theory = half_space_oracle(tip, material, 1.0) if truncation else oracle(body, material, tip, center)
    deltas = depths_of(path, theory, tip, material, body.height, scales)
    radius = cache(partial(_expected_radius, theory, tip, body, center))
    a = radius(max(deltas))

    def expect(delta: float) -> elements.Expected:
        return radius(delta), theory.at(delta) if theory else None

    fineness = elements.fineness(config, per_radius, reduction.kinematics.dim, deltas, expect, material, body.height)
    sizes = elements.sizes(config, reduction, tip, a, scales, fineness)
    contact, contact_choice = _contact(config.contact, sizes, material, scales, fineness)
    gap, gap_choice = _gap(config.contact, reduction, material)
    blunt = blunted(tip, a, body, material, center, max(deltas)) if gap == "current" else None
    wall = WALL_STIFFNESS * material.constants[0] / sizes.h_far if _guided(reduction) else 0.0
    formulation, formulation_choice = _formulation(config, material)
    solver_choice = _solver(config, material, contact, gap, candidates(sizes, reduction.extent, center))
    solves = len(deltas) * (SEARCH if path.control == "force" else 1)
    work = Work(str(solver_choice.value), formulation == "mixed", solves, gap == "current" or not
                material.small_strain)  # fmt: skip
    cost = _affordable(sizes, reduction, center, work)
    cost = cost.with_error_bars if fineness else cost
    choices = (
        *([Choice("body", f"{body.shape}, height {whole.height:.4g}", truncation.why)] if truncation else []),
        Choice("symmetry", reduction.symmetry, reduction.why),
        Choice("kinematics", reduction.kinematics.name, reduction.kinematics.why),
        Choice("strain", *_strain_measure(material)),
        *([Choice("control", "force", FORCE_WHY)] if path.control == "force" else []),
        formulation_choice,
        gap_choice,
        contact_choice,
        *([Choice(blunt.key, blunt.radius * scales.length, blunt.why)] if blunt else []),
        *([Choice("wall", wall * scales.pressure / scales.length, WALL_WHY)] if wall else []),
        *_mesh_choices(config, sizes, scales, a, fineness),
        solver_choice,
        *_pin_choices(reduction),
    )
    return Scene(
        title=config.title, units=_labels(config), scales=scales, kinematics=reduction.kinematics,
        symmetry=reduction.symmetry, copies=reduction.copies, body=body, extent=reduction.extent,
        supports=dict(reduction.supports), pins=reduction.pins, wall_stiffness=wall,
        material=material, formulation=formulation, indenter=blunt.tip if blunt else tip, center=center,
        contact=contact, gap=gap, deltas=deltas, sizes=sizes, fineness=fineness, oracle=theory, choices=choices,
        forces=path.values if path.control == "force" else None,
        solver=dataclasses.asdict(config.solver) | {"method": solver_choice.value},
        warnings=(*warnings_of(body, material, tip, center, max(deltas), a, theory, formulation),
                  *contact_warnings(contact, material, sizes, theory, max(deltas), a),
                  *(sizes.doubts(a, material.constants[1], contact.method == "penalty") if max(deltas) > 0 else ()),
                  *shallow_doubts(sizes, material, deltas, radius)),
        prediction=prediction_of(path, theory, tip, material, max(deltas), a, scales) | {
            **({"truncation_error": truncation.error} if truncation else {}),
            "force_error": stated_error(contact, material, sizes, theory, deltas[-1], radius(deltas[-1])),
            "cells": round(cost.cells), "dofs": round(cost.dofs), "memory_MB": round(cost.memory / 1e6),
            "seconds": float(f"{cost.seconds:.2g}")},
    )  # fmt: skip


def _strain_measure(material: Material) -> tuple[str, str]:
    """Which strains, and why."""
    return ("small", "the material is linear elastic") if material.small_strain else ("finite", "it is hyperelastic")


def _labels(config: Config) -> dict[str, str]:
    return {"length": config.units.length, "force": config.units.force}


def _finite(config: Config, material: Material) -> tuple[Body, Truncation | None]:
    """The body as given, or the one that stands for a half-space."""
    if not isinstance(config.body, HalfSpace):
        return config.body, None
    path = config.loading.path()
    delta = max(path.values)
    if path.control == "force":
        delta = expected_depth(config.indenter, material, delta)
    truncation = truncate(config.indenter, material, delta)
    return truncation.body, truncation


def _guided(reduction: Reduction) -> bool:
    return reduction.radius is not None and reduction.supports["r_max"] == "roller"


# ---- checks ---------------------------------------------------------------------------------------------------


def _material(config: Config) -> Material:
    try:
        material = config.material.canonical()
    except ValueError as wrong:
        raise ConfigError("material", str(wrong)) from wrong
    return material


def _check_scene(body: Body, tip: Indenter, center: tuple[float, ...], path: LoadPath) -> None:
    if body.rim_distance(center) < 0:
        raise ConfigError("indenter.center", f"{list(center)} lies outside the body's top surface", "move it inside")
    width = 2 * body.rim_distance(body.centre)
    if isinstance(tip, FlatPunch) and 2 * tip.radius > width:
        raise ConfigError("indenter.radius", f"a flat punch of radius {tip.radius:g} is wider than the body",
                          f"at most {width / 2:g}")  # fmt: skip
    if path.control == "depth" and max(path.values) >= body.height:
        raise ConfigError("loading", f"depth {max(path.values):g} is beyond the body's thickness {body.height:g}",
                          f"stay below {body.height:g}")  # fmt: skip


def _check_room(body: Body, material: Material, tip: Indenter, center: tuple[float, ...], path: LoadPath) -> None:
    delta, room = max(path.values), confinement.deepest(body, material, tip, center)
    if path.control == "depth" and delta >= room:
        raise ConfigError(
            "loading",
            f"depth {delta:g} leaves no room to an incompressible body held on all sides: at {room:g} the tip would "
            "cover its whole top",
            "stay well below, free a side, or nu < 0.5",
        )


def _affordable(sizes: Sizes, reduction: Reduction, center: tuple[float, ...], work: Work) -> Cost:
    found = cost_of(sizes, reduction.extent, center, work, is_round=reduction.radius is not None)
    available = machine_memory()
    if found.memory > available:
        raise ConfigError("mesh.h_contact", f"about {found.dofs:.2g} unknowns need {found.memory / 1e9:.3g} GB; this "
                          f"machine has {available / 1e9:.3g} GB", "use a larger h_contact, or symmetry")  # fmt: skip
    return found


# ---- choices --------------------------------------------------------------------------------------------------


def _formulation(config: Config, material: Material) -> tuple[str, Choice]:
    (_, nu), wanted = material.constants, material.formulation
    formulation = wanted if wanted != "auto" else "mixed" if nu >= LOCKING else "displacement"
    if formulation == "displacement" and nu > MOST_COMPRESSED:
        raise ConfigError("material.formulation", f"displacement elements cannot carry nu = {nu:g}", "use 'mixed'")
    if formulation == "mixed" and nu <= 0:
        raise ConfigError("material.formulation", f"'mixed' needs nu > 0, got {nu:g}", "use 'displacement'")
    if formulation == "mixed" and config.mesh.order == 1:
        raise ConfigError("mesh.order", "the mixed formulation needs quadratic displacement", "use order: 2")
    why = "as given" if wanted != "auto" else f"nu = {nu:g} {'>=' if formulation == 'mixed' else '<'} {LOCKING:g}"
    return formulation, Choice("material.formulation", formulation, why)


def _rounded_body(body: Body) -> Body:
    def to_digits(value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(map(rounded, value))
        return rounded(value) if isinstance(value, float) else value

    return dataclasses.replace(body, **{f.name: to_digits(getattr(body, f.name)) for f in dataclasses.fields(body)})


def _expected_radius(
    theory: Oracle | None, tip: Indenter, body: Body, center: tuple[float, ...], delta: float
) -> float:
    """Contact radius at the deepest point: layer theory, else the tip's section there; within the body."""
    rim = max(body.rim_distance(center), 0.05 * body.rim_distance(body.centre))
    if delta <= 0:
        return 0.2 * rim
    solution = theory.at(delta) if theory else None
    return min(solution.a if solution else tip.radius_at(delta), rim)


def _contact(wanted: Contact, sizes: Sizes, material: Material, scales: Scales, fineness: Fineness | None
             ) -> tuple[ContactLaw, Choice]:  # fmt: skip
    if isinstance(wanted, AutoContact):
        kind, why = AugmentedLagrangian, "auto: no penetration to pay for, smooth pressures, fewest iterations"
    else:
        kind, why = type(wanted), "as given"  # type: ignore[assignment]
    name = next((f.name for f in dataclasses.fields(kind) if f.name in ("epsilon_n", "gamma")), None)
    if name is None:
        return kind(), Choice("contact", kind().method, why)
    unit = material.E_star / sizes.h_contact
    given = getattr(wanted, name, "auto")
    if isinstance(given, str):
        given = auto_stiffness(kind, sizes, material, scales, fineness)
    value = given * scales.length / scales.pressure
    _refuse_soft(kind, name, value / unit, unit * scales.pressure / scales.length)
    source = "auto" if getattr(wanted, name, "auto") == "auto" else "as given"
    law = dataclasses.replace(kind(), **{name: value})  # type: ignore[arg-type]
    text = f"{law.method}, {name} = {value * scales.pressure / scales.length:.6g}"
    return law, Choice("contact", text, f"{why}; {name} {source}: {value / unit:.3g} E*/h_contact")


def auto_stiffness(kind: Any, sizes: Sizes, material: Material, scales: Scales, fineness: Fineness | None) -> float:
    """The epsilon_n or gamma that `auto` stands for [pressure per length of the user]."""
    stiffness = kind.auto_multiple * material.E_star / sizes.typical
    if fineness is not None and kind is Penalty:  # whose error must fit into what is asked for
        stiffness = min(fineness.penalty, STIFFEST * material.E_star / sizes.typical)
    return float(stiffness * scales.pressure / scales.length)


def _refuse_soft(kind: Any, name: str, multiple: float, unit: float) -> None:
    """ConfigError for a stiffness with which the method converges to a wrong force."""
    smallest = getattr(kind, "smallest_multiple", 0.0)
    if multiple < smallest * (1 - 1e-9):
        raise ConfigError(
            f"contact.{name}",
            f"is {multiple:.2g} E*/h_contact; below {smallest:g} E*/h_contact {kind().method} gives wrong forces",
            f"at least {smallest * unit:.4g}, or auto ({kind.auto_multiple:g} E*/h_contact)",
        )


def _gap(wanted: Contact, reduction: Reduction, material: Material) -> tuple[str, Choice]:
    auto = "reference" if material.small_strain else "current"
    gap = auto if wanted.gap == "auto" else wanted.gap
    if gap == "current" and reduction.pins:
        raise ConfigError(
            "contact.gap", "'current' pushes sideways, and nothing holds this body there (roller base, free sides)",
            "fix the base, hold a side, use gap: reference, or put the tip in the middle and use symmetry",
        )  # fmt: skip
    reasons = {"reference": "linear elastic: Hertz' own problem, tested at the undeformed point",
               "current": "finite strain: tested at the deformed point, pressure along the tip's normal"}  # fmt: skip
    why = "as given" if wanted.gap != "auto" else reasons[gap]
    return gap, Choice("contact.gap", gap, why)


def _solver(config: Config, material: Material, contact: ContactLaw, gap: str, nodes: float) -> Choice:
    """A linear body under a frictionless tip with a reference gap is one compliance; anything else is not.

    The compliance is dense: beyond MOST_CANDIDATES nodes that may come into contact it is not made.
    """
    wanted = config.solver.method
    size = f"{nodes:.2g} nodes may come into contact: the dense matrices need {DENSE * nodes**2 / 1e9:.2g} GB"
    obstacles = [
        why
        for applies, why in (
            (not material.small_strain, "the material is not linear"),
            (gap == "current", "the gap at the deformed point makes the problem nonlinear"),
            (contact.multiplier == "stress", "Nitsche's method needs the stress inside the body"),
            (bool(config.solver.petsc), "solver.petsc options are for Newton's linear solves"),
            (nodes > MOST_CANDIDATES, f"about {size} (at most {MOST_CANDIDATES} nodes are condensed to)"),
        )
        if applies
    ]
    if wanted == "condensed" and obstacles:
        raise ConfigError("solver.method", f"'condensed' does not fit this scene: {obstacles[0]}", "use 'newton'")
    if wanted == "auto":
        wanted = "newton" if obstacles else "condensed"
        why = obstacles[0] if obstacles else "linear body, reference gap: one factorisation serves every step"
        return Choice("solver.method", wanted, why)
    return Choice("solver.method", wanted, "as given")


def _mesh_choices(config: Config, sizes: Sizes, scales: Scales, a: float, fineness: Fineness | None) -> list[Choice]:
    L, mesh = scales.length, config.mesh
    per_radius = f"{a / sizes.h_contact:.3g} elements in the expected contact radius {a * L:.4g}"
    auto = "from accuracy" if fineness else "auto: at most 0.3 % of the force at the last step"
    chosen = "as given" if mesh.h_contact != "auto" else auto
    far = "as given" if mesh.h_far != "auto" else f"sizes grow by {sizes.grading:.3g} per unit distance up to this"
    choices = [
        *([Choice("accuracy", fineness.target, fineness.why(L))] if fineness else []),
        Choice("mesh.h_contact", sizes.h_contact * L, f"{chosen}; {per_radius}"),
        *([Choice("mesh.h_axis", sizes.h_axis * L, "sizes grow from this at the axis to h_contact where the deepest "
                  "contact ends")] if sizes.h_axis else []),
        Choice("mesh.h_far", sizes.h_far * L, far),
        Choice("mesh.order", sizes.order, "quadratic" if sizes.order == 2 else "linear, as given"),
    ]  # fmt: skip
    if sizes.h_edge is not None:
        choices.append(Choice("mesh.h_edge", sizes.h_edge * L, "the pressure is singular at the punch's sharp edge"))
    return choices


def _pin_choices(reduction: Reduction) -> list[Choice]:
    if not reduction.pins:
        return []
    return [
        Choice(
            "pins", len(reduction.pins), "roller base and free sides leave rigid modes; reactions audited to be zero"
        )
    ]
