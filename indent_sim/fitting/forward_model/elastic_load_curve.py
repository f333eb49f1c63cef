"""Elastic tables: force over depth of a scene at any values of its parameters, each solved once on
a lattice.

A table is the polynomial g of F = delta^p exp g(sqrt(delta/deepest)), a smooth function of depth
and parameters; between the nodes of a lattice its coefficients are interpolated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.polynomial import Chebyshev

from indent_sim.config.scene_file import config_from_mapping, to_mapping
from indent_sim.config.schema import Config
from indent_sim.config.strict_yaml import key_path
from indent_sim.fitting.forward_model.parameter_grid import (
    NUMERICAL_ERRORS,
    ForwardModelUnavailable,
    ParameterGrid,
)
from indent_sim.fitting.forward_model.parameters import Parameter
from indent_sim.process.errors import ConfigError, NotConverged
from indent_sim.run.planned_run import PlannedRun
from indent_sim.run.solvers.elastic_curve import ElasticForces, elastic_forces, flat_punches

# depths at which a scene is solved, and of the polynomial through them: 5e-11 by theory
SOLVED_DEPTHS = 20
DEGREE = 12
MIN_DEPTH_ROOT = 0.02  # of sqrt(delta/deepest): a power law below
# a contact of 5 % of the depth has few elements; degree of what a mesh adds to theory
MIN_MESH_ROOT = 0.2236
MESH_DEGREE = 5
GRID_NODES = 6  # of the lattice around a value: 2e-6 of the force at steps of 0.2
EXPONENT_STEP = 0.5  # exponents of depth are multiples of it, up to SAME_EXPONENT, or as they are
EXPONENT_TOLERANCE = 0.02
# of the polynomials through flat punches
RADIUS_DEGREE = 12
MIN_RADIUS_FRACTION = 0.02
NODE_ANGLES = np.pi * (np.arange(SOLVED_DEPTHS) + 0.5) / SOLVED_DEPTHS
DEPTH_ROOTS = 0.5 * (1 + MIN_DEPTH_ROOT) - 0.5 * (1 - MIN_DEPTH_ROOT) * np.cos(NODE_ANGLES)
ROOT_DOMAIN = (MIN_DEPTH_ROOT, 1.0)


@dataclass(frozen=True)
class ElasticLoadCurve:
    """The elastic curve of one scene: F = delta^power exp g(s), s = sqrt(delta/deepest), in the
    scene's units.

    coefficients (13,) of Chebyshev's polynomials of s; punches (4, 13) of ln delta_1, ln F_1, ln K,
    ln K' over ln a up to the radius `widest`, where adhesion asks for them; error: relative
    half-width of the force's error bar; radius [length]: of the contact at the deepest.
    """

    max_depth: float
    exponent: float
    coefficients: np.ndarray
    punch_coefficients: np.ndarray | None = None
    max_radius: float = 0.0
    relative_error: float = 0.0
    contact_radius: float = 0.0

    def force(self, delta: np.ndarray) -> np.ndarray:
        """The force [force] at depths [length] (n,), 0 out of contact; beyond the deepest it goes
        on as a power.
        """
        positive_depth = np.maximum(delta, 1e-300)
        s = np.clip(np.sqrt(positive_depth / self.max_depth), *ROOT_DOMAIN)
        g = np.polynomial.chebyshev.chebval(_map_to_unit_interval(s), self.coefficients)
        return np.where(delta > 0, positive_depth**self.exponent * np.exp(g), 0.0)


def _map_to_unit_interval(s: np.ndarray) -> np.ndarray:
    """s on the interval of Chebyshev's polynomials."""
    return (2.0 * s - (ROOT_DOMAIN[0] + ROOT_DOMAIN[1])) / (ROOT_DOMAIN[1] - ROOT_DOMAIN[0])


class ElasticLoadCurveGrid:
    """The tables of a scene over its shape parameters.

    wants_punches: for an adhering tip. ConfigError where the scene as it stands cannot exist.
    """

    def __init__(
        self,
        config: Config,
        shape_parameters: Sequence[Parameter],
        max_depth: float,
        wants_punches: bool = False,
    ):
        self.scene_curve = solve_load_curve(config, max_depth, wants_punches)

        def solve(scene: Config) -> np.ndarray:
            return _pack_coefficients(
                solve_load_curve(scene, max_depth, wants_punches, self.scene_curve.exponent)
            )

        self._grid = ParameterGrid(
            config, shape_parameters, _pack_coefficients(self.scene_curve), solve, GRID_NODES
        )

    def load_curve(self, theta: Sequence[float]) -> ElasticLoadCurve:
        """The table at coordinates of the shape parameters; NoTable where the scene has none."""
        if not self._grid.shape_parameters:
            return self.scene_curve
        values = self._grid.interpolate(theta)
        coefficients = values[: DEGREE + 1]
        punch_values = values[DEGREE + 1 :]
        punches, max_radius = (
            (punch_values[:-1].reshape(4, -1), math.exp(punch_values[-1]))
            if len(punch_values)
            else (None, 0.0)
        )
        return replace(
            self.scene_curve,
            coefficients=coefficients,
            punch_coefficients=punches,
            max_radius=max_radius,
        )


def _pack_coefficients(load_curve: ElasticLoadCurve) -> np.ndarray:
    """The numbers of a table that depend on its parameters."""
    punch_values = (
        []
        if load_curve.punch_coefficients is None
        else [*load_curve.punch_coefficients.ravel(), math.log(load_curve.max_radius)]
    )
    return np.array([*load_curve.coefficients, *punch_values])


def plan_elastic_run(config: Config, max_depth: float) -> PlannedRun:
    """The scene without its experiment, of matter that is drained and does not relax, pressed to a
    depth, by a load path to the depths of a table; ConfigError where it cannot exist.
    """
    if config.contact.adhesion:
        raise ConfigError(
            "contact.adhesion", "a fit takes adhesion without range", "give experiment.adhesion"
        )
    document = _elastic_document(config)
    planned_run = PlannedRun.resolve(
        config_from_mapping(document | {"loading": {"delta": float(max_depth), "steps": 1}})
    )
    if planned_run.accepts_any_depth:
        return planned_run
    return PlannedRun.resolve(
        config_from_mapping(
            document | {"loading": {"deltas": [float(max_depth * s * s) for s in DEPTH_ROOTS]}}
        )
    )


def _elastic_document(config: Config) -> dict[str, Any]:
    """The sections of a scene without its experiment, of matter that does not relax and has no
    fluid.
    """
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


def elastic_config(config: Config, max_depth: float) -> Config:
    """The scene without its experiment, of matter that is drained and does not relax, pressed to a
    depth.
    """
    return config_from_mapping(_elastic_document(config) | {"loading": {"delta": float(max_depth)}})


def solve_load_curve(
    config: Config, max_depth: float, wants_punches: bool = False, exponent: float | None = None
) -> ElasticLoadCurve:
    """The table of a scene by its own solver: theory, a condensed body, or a load path.

    power: of the depth, where it is known. NoTable where there is no solution, ConfigError where
    there is no scene.
    """
    planned_run = plan_elastic_run(config, max_depth)
    try:
        solved_forces = elastic_forces(planned_run, max_depth * DEPTH_ROOTS**2)
        load_curve = (_curve_from_mesh if planned_run.scene.is_meshed else _curve_from_theory)(
            solved_forces, max_depth, exponent
        )
        punches, max_radius = (
            _punch_coefficients(planned_run, max_depth) if wants_punches else (None, 0.0)
        )
    except (NotConverged, *NUMERICAL_ERRORS) as error:
        raise ForwardModelUnavailable(str(error)) from error
    return replace(load_curve, punch_coefficients=punches, max_radius=max_radius)


def _curve_from_theory(
    elastic_forces: ElasticForces, max_depth: float, exponent: float | None
) -> ElasticLoadCurve:
    depths = max_depth * DEPTH_ROOTS**2
    exponent = _depth_exponent(depths, elastic_forces.forces) if exponent is None else exponent
    g = Chebyshev.fit(
        DEPTH_ROOTS,
        np.log(elastic_forces.forces) - exponent * np.log(depths),
        DEGREE,
        domain=ROOT_DOMAIN,
    )
    return ElasticLoadCurve(
        max_depth, exponent, g.coef, contact_radius=elastic_forces.contact_radius
    )


def _curve_from_mesh(
    elastic_forces: ElasticForces, max_depth: float, exponent: float | None
) -> ElasticLoadCurve:
    """The same where a mesh is solved: what it adds to theory is smoothed, and its error bar kept."""
    depths = max_depth * DEPTH_ROOTS**2
    forces = elastic_forces.forces
    theory_forces = elastic_forces.theory_forces
    theory_forces = (
        theory_forces if theory_forces is not None and (theory_forces > 0).all() else None
    )
    is_resolved = (DEPTH_ROOTS >= MIN_MESH_ROOT) & (forces > 0)
    if np.count_nonzero(is_resolved) <= MESH_DEGREE:
        raise ForwardModelUnavailable(
            "the contact has too few elements: give a smaller mesh.h_contact"
        )
    exponent = (
        _depth_exponent(depths[is_resolved], forces[is_resolved]) if exponent is None else exponent
    )
    log_reference = (
        np.log(theory_forces) if theory_forces is not None else exponent * np.log(depths)
    )
    ratio = Chebyshev.fit(
        DEPTH_ROOTS[is_resolved],
        np.log(forces[is_resolved]) - log_reference[is_resolved],
        MESH_DEGREE,
    )
    scatter = float(
        np.std(
            ratio(DEPTH_ROOTS[is_resolved])
            - (np.log(forces[is_resolved]) - log_reference[is_resolved])
        )
    )
    log_correction = np.where(
        DEPTH_ROOTS[is_resolved][0] > DEPTH_ROOTS,
        ratio(DEPTH_ROOTS[is_resolved][0]),
        ratio(DEPTH_ROOTS),
    )
    g = Chebyshev.fit(
        DEPTH_ROOTS,
        log_reference + log_correction - exponent * np.log(depths),
        DEGREE,
        domain=ROOT_DOMAIN,
    )
    return ElasticLoadCurve(
        max_depth,
        exponent,
        g.coef,
        relative_error=math.hypot(scatter, elastic_forces.error),
        contact_radius=elastic_forces.contact_radius,
    )


def _depth_exponent(depths: np.ndarray, forces: np.ndarray) -> float:
    """The exponent of depth at the shallowest points, a multiple of one half where it is nearly
    one.
    """
    slope = float(np.log(forces[1] / forces[0]) / np.log(depths[1] / depths[0]))
    nearest_half = EXPONENT_STEP * round(slope / EXPONENT_STEP)
    return nearest_half if abs(slope - nearest_half) < EXPONENT_TOLERANCE else slope


def _punch_coefficients(planned_run: PlannedRun, max_depth: float) -> tuple[np.ndarray, float]:
    """ln delta_1, F_1, K, K' over ln a, in the scene's units, and the widest radius."""
    radius_fractions, columns, max_radius = flat_punches(
        planned_run, max_depth, MIN_RADIUS_FRACTION
    )
    x = np.log(radius_fractions)
    log_columns = np.log(columns)
    fits = [
        Chebyshev.fit(x, values, RADIUS_DEGREE, domain=(math.log(MIN_RADIUS_FRACTION), 0.0)).coef
        for values in log_columns
    ]
    return np.array(fits), max_radius
