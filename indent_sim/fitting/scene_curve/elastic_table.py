"""Elastic tables: force over depth of a scene at any values of its parameters, each solved once on a lattice.

A table is the polynomial g of F = delta^p exp g(sqrt(delta/deepest)), a smooth function of depth and parameters;
between the nodes of a lattice its coefficients are interpolated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.polynomial import Chebyshev

from indent_sim.config.scene_file import from_mapping, to_mapping
from indent_sim.config.schema import Config
from indent_sim.config.strict_yaml import key_path
from indent_sim.fitting.scene_curve.lattice import Lattice, NoTable
from indent_sim.fitting.scene_curve.parameters import Parameter
from indent_sim.model.state import State
from indent_sim.process.errors import ConfigError
from indent_sim.run.chain import condense, states
from indent_sim.run.companions.error_bars import Companion, ErrorBars, beside, softer
from indent_sim.run.readings import punches_of
from indent_sim.scene.scene import Scene, resolve
from indent_sim.theory.solution import UNSOLVED
from indent_sim.theory.surface.punches import Punches, radius_at

SOLVED_DEPTHS, DEGREE = 20, 12  # depths at which a scene is solved, and of the polynomial through them: 5e-11 by theory
SHALLOWEST_ROOT = 0.02  # of sqrt(delta/deepest): a power law below
ON_MESH, MESH_DEGREE = 0.2236, 5  # a contact of 5 % of the depth has few elements; degree of what a mesh adds to theory
NODES = 6  # of the lattice around a value: 2e-6 of the force at steps of 0.2
HALF = 0.5  # exponents of depth are multiples of it, up to SAME_EXPONENT, or as they are
SAME_EXPONENT = 0.02
PUNCH_RADII, RADIUS_DEGREE, LEAST_RADIUS = 40, 12, 0.02  # of flat punches, and of the polynomials through them
ADHERING_DEPTH = 1.6  # times the depth: an adhering tip has the contact of a deeper one
NODE_ANGLES = np.pi * (np.arange(SOLVED_DEPTHS) + 0.5) / SOLVED_DEPTHS
S = 0.5 * (1 + SHALLOWEST_ROOT) - 0.5 * (1 - SHALLOWEST_ROOT) * np.cos(NODE_ANGLES)
DOMAIN = (SHALLOWEST_ROOT, 1.0)


@dataclass(frozen=True)
class ElasticTable:
    """The elastic curve of one scene: F = delta^power exp g(s), s = sqrt(delta/deepest), in the scene's units.

    coefficients (13,) of Chebyshev's polynomials of s; punches (4, 13) of ln delta_1, ln F_1, ln K, ln K' over ln a up
    to the radius `widest`, where adhesion asks for them; error: relative half-width of the force's error bar; radius
    [length]: of the contact at the deepest.
    """

    deepest: float
    power: float
    coefficients: np.ndarray
    punches: np.ndarray | None = None
    widest: float = 0.0
    error: float = 0.0
    radius: float = 0.0

    def force(self, delta: np.ndarray) -> np.ndarray:
        """The force [force] at depths [length] (n,), 0 out of contact; beyond the deepest it goes on as a power."""
        inside = np.maximum(delta, 1e-300)
        s = np.clip(np.sqrt(inside / self.deepest), *DOMAIN)
        g = np.polynomial.chebyshev.chebval(_unit(s), self.coefficients)
        return np.where(delta > 0, inside**self.power * np.exp(g), 0.0)


def _unit(s: np.ndarray) -> np.ndarray:
    """s on the interval of Chebyshev's polynomials."""
    return (2.0 * s - (DOMAIN[0] + DOMAIN[1])) / (DOMAIN[1] - DOMAIN[0])


class ElasticLattice:
    """The tables of a scene over its shape parameters.

    wants_punches: for an adhering tip. ConfigError where the scene as it stands cannot exist.
    """

    def __init__(self, config: Config, shape: Sequence[Parameter], deepest: float, wants_punches: bool = False):
        self.first = solved(config, deepest, wants_punches)

        def solve(scene: Config) -> np.ndarray:
            return _array(solved(scene, deepest, wants_punches, self.first.power))

        self._lattice = Lattice(config, shape, _array(self.first), solve, NODES)

    def at(self, theta: Sequence[float]) -> ElasticTable:
        """The table at coordinates of the shape parameters; NoTable where the scene has none."""
        if not self._lattice.shape:
            return self.first
        array = self._lattice.at(theta)
        coefficients, rest = array[: DEGREE + 1], array[DEGREE + 1 :]
        punches, widest = (rest[:-1].reshape(4, -1), math.exp(rest[-1])) if len(rest) else (None, 0.0)
        return replace(self.first, coefficients=coefficients, punches=punches, widest=widest)


def _array(table: ElasticTable) -> np.ndarray:
    """The numbers of a table that depend on its parameters."""
    rest = [] if table.punches is None else [*table.punches.ravel(), math.log(table.widest)]
    return np.array([*table.coefficients, *rest])


def elastic_scene(config: Config, deepest: float) -> Scene:
    """The scene without its experiment, of matter that is drained and does not relax, pressed to a depth, by a load
    path to the depths of a table; ConfigError where it cannot exist."""
    if config.contact.adhesion:
        raise ConfigError("contact.adhesion", "a fit takes adhesion without range", "give experiment.adhesion")
    document = _at_once(config)
    scene = resolve(from_mapping(document | {"loading": {"delta": float(deepest), "steps": 1}}))
    if not scene.is_meshed or scene.solver.method == "condensed":
        return scene
    return resolve(from_mapping(document | {"loading": {"deltas": [float(deepest * s * s) for s in S]}}))


def _at_once(config: Config) -> dict[str, Any]:
    """The sections of a scene without its experiment, of matter that does not relax and has no fluid."""
    document = to_mapping(config)
    document.pop("experiment", None)
    document.pop("drainage", None)
    for key, _ in config.materials():
        section: Any = document
        for part in key_path(key):
            section = section[part]
        section.pop("relaxation", None)
        section.pop("flow", None)
    return document


def at_once(config: Config, deepest: float) -> Config:
    """The scene without its experiment, of matter that is drained and does not relax, pressed to a depth."""
    return from_mapping(_at_once(config) | {"loading": {"delta": float(deepest)}})


def solved(config: Config, deepest: float, wants_punches: bool = False, power: float | None = None) -> ElasticTable:
    """The table of a scene by its own solver: theory, a condensed body, or a load path.

    power: of the depth, where it is known. NoTable where there is no solution, ConfigError where there is no scene.
    """
    scene = elastic_scene(config, deepest)
    try:
        if not scene.is_meshed:
            return _by_theory(scene, deepest, wants_punches, power)
        return _on_mesh(scene, deepest, wants_punches, power)
    except UNSOLVED as error:
        raise NoTable(str(error)) from error


def _by_theory(scene: Scene, deepest: float, wants_punches: bool, power: float | None) -> ElasticTable:
    theory, scales = scene.plan.theory, scene.physics.scales
    assert theory is not None
    depths = deepest * S**2
    curve = theory.contact.curve([float(depth / scales.depth) for depth in depths])
    forces = np.array([one.force for one in curve]) * scales.force
    power = _power(depths, forces) if power is None else power
    g = Chebyshev.fit(S, np.log(forces) - power * np.log(depths), DEGREE, domain=DOMAIN)
    punches, widest = _punches(scene, punches_of(scene), deepest) if wants_punches else (None, 0.0)
    radius = curve[-1].a * scales.length
    return ElasticTable(deepest, power, g.coef, punches, widest, radius=radius)


def _on_mesh(scene: Scene, deepest: float, wants_punches: bool, power: float | None) -> ElasticTable:
    """The same where a mesh is solved: what it adds to theory is smoothed, and its error bar kept."""
    depths = deepest * S**2
    found = _solved(scene, depths)
    if len(found) < SOLVED_DEPTHS or not found[-1].converged:
        reason = next((state.reason for state in found if not state.converged), "the path ended")
        raise NoTable(f"the depth {deepest:.4g} was not reached: {reason}")
    forces = np.array([state.force for state in found])
    theory = scene.plan.theory
    curve = theory.curve([float(depth / scene.physics.scales.depth) for depth in depths]) if theory else None
    beside_it = np.array([one.force for one in curve]) * scene.physics.scales.force if curve else None
    base = beside_it if beside_it is not None and (beside_it > 0).all() else None
    used = (S >= ON_MESH) & (forces > 0)
    if np.count_nonzero(used) <= MESH_DEGREE:
        raise NoTable("the contact has too few elements: give a smaller mesh.h_contact")
    power = _power(depths[used], forces[used]) if power is None else power
    known = np.log(base) if base is not None else power * np.log(depths)
    ratio = Chebyshev.fit(S[used], np.log(forces[used]) - known[used], MESH_DEGREE)
    scatter = float(np.std(ratio(S[used]) - (np.log(forces[used]) - known[used])))
    added = np.where(S[used][0] > S, ratio(S[used][0]), ratio(S))
    g = Chebyshev.fit(S, known + added - power * np.log(depths), DEGREE, domain=DOMAIN)
    punches, widest = _punches_on_mesh(scene, deepest) if wants_punches else (None, 0.0)
    error = math.hypot(scatter, _bar(scene, found, depths))
    return ElasticTable(deepest, power, g.coef, punches, widest, error, found[-1].a)


def _punches_on_mesh(scene: Scene, deepest: float) -> tuple[np.ndarray, float]:
    """The flat punches of a condensed body that was pressed as deep as they are asked for."""
    body = condense(scene)
    body.equilibrium.solve(deepest / scene.physics.scales.depth)
    return _punches(scene, punches_of(scene, body.equilibrium), deepest)


def _solved(scene: Scene, depths: np.ndarray) -> list[State]:
    if scene.solver.method == "condensed":
        return condense(scene).states(deltas=depths.tolist())
    return list(states(scene, with_surface=False))


def _bar(scene: Scene, found: list[State], depths: np.ndarray) -> float:
    """The relative error bar of the deepest forces, from coarser meshes."""
    companions = [Companion(ratio, _solved(other, depths), other) for ratio, other in beside(scene, [])]
    if companions[0].scene and (soft := softer(companions[0].scene)):
        bars = ErrorBars(scene, companions, _solved(soft, depths), None)
    else:
        bars = ErrorBars(scene, companions, None, None)
    judged = [bars.judged(state) for state in found]  # each knows those before it
    deep = [state for state in judged if state.delta > HALF * depths[-1] and np.isfinite(state.force_error or 0.0)]
    return max(((state.force_error or 0.0) / state.force for state in deep), default=0.0)


def _power(depths: np.ndarray, forces: np.ndarray) -> float:
    """The exponent of depth at the shallowest points, a multiple of one half where it is nearly one."""
    slope = float(np.log(forces[1] / forces[0]) / np.log(depths[1] / depths[0]))
    nearest = HALF * round(slope / HALF)
    return nearest if abs(slope - nearest) < SAME_EXPONENT else slope


def _punches(scene: Scene, punches: Punches, deepest: float) -> tuple[np.ndarray, float]:
    """ln delta_1, F_1, K, K' over ln a, in the scene's units, and the widest radius."""
    depth, force, length = scene.physics.scales.depth, scene.physics.scales.force, scene.physics.scales.length
    try:
        widest = radius_at(punches, ADHERING_DEPTH * deepest / depth)
    except UNSOLVED:
        widest = 0.999 * punches.largest
    radii = np.geomspace(max(LEAST_RADIUS * widest, punches.smallest), widest, PUNCH_RADII)
    rows = [punches.at(float(a)) for a in radii]
    units = depth, force, force / depth, force / depth / length
    columns = zip(*((one.delta, one.force, one.stiffness, one.slope) for one in rows), strict=True)
    logs = [np.log(np.array(column) * unit) for column, unit in zip(columns, units, strict=True)]
    x = np.log(radii / widest)
    fits = [Chebyshev.fit(x, values, RADIUS_DEGREE, domain=(math.log(LEAST_RADIUS), 0.0)).coef for values in logs]
    return np.array(fits), widest * length
