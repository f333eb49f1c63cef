"""Elastic load curve of a scene, interpolated over depth and over the parameters of the scene.

    F = delta^p exp g(s),   s = sqrt(delta/max_depth)

g is a polynomial in s. Its coefficients are smooth functions of the parameters, which are computed
at the nodes of a grid and interpolated between them.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.polynomial import Chebyshev, chebyshev

from indent_sim.config.scene_file import config_from_mapping, to_mapping
from indent_sim.config.schema import Config
from indent_sim.config.strict_yaml import key_path
from indent_sim.fitting.forward_model.parameter_grid import (
    NUMERICAL_ERRORS,
    ForwardModelUnavailable,
    ParameterGrid,
)
from indent_sim.fitting.forward_model.parameters import Parameter
from indent_sim.fitting.measured_constants import DEGREE, SOLVED_DEPTHS
from indent_sim.process.errors import ConfigError, NotConverged
from indent_sim.run.planned_run import PlannedRun
from indent_sim.run.solvers.elastic_curve import (
    ElasticForces,
    elastic_forces,
    flat_punches,
    is_self_similar,
    self_similar_force,
)

MIN_DEPTH_ROOT = 0.02  # lower end of s; the force is a power law of the depth below
MESH_DEGREE = 5  # degree of the polynomial for the ratio of a mesh's force to that of theory
MIN_RADIUS_FRACTION = 0.02  # smallest radius of the punches relative to the largest
DEPTH_ROOTS = 0.5 * (1 + MIN_DEPTH_ROOT) - 0.5 * (1 - MIN_DEPTH_ROOT) * np.cos(
    np.pi * (np.arange(SOLVED_DEPTHS) + 0.5) / SOLVED_DEPTHS
)
ROOT_DOMAIN = (MIN_DEPTH_ROOT, 1.0)


@dataclass(frozen=True)
class PunchTable:
    """Flat punches of geometrically spaced radii (m,).

    Attributes
    ----------
    log_radius
        Logarithms of the radii relative to the largest one.
    radius
        Radii [length].
    depth, force
        Depth [length] and force [force] at which a tip without adhesion has this contact radius.
    stiffness, slope
        Stiffness K of the punch [force/length], and its derivative dK/da [force/length^2].
    """

    log_radius: np.ndarray
    radius: np.ndarray
    depth: np.ndarray
    force: np.ndarray
    stiffness: np.ndarray
    slope: np.ndarray


@dataclass(frozen=True)
class ElasticLoadCurve:
    """Elastic load curve of one scene: F = delta^exponent exp g(s), s = sqrt(delta/max_depth).

    All attributes are in units of the scene.

    Attributes
    ----------
    coefficients
        Chebyshev coefficients of g(s), shape (13,).
    punch_coefficients
        Chebyshev coefficients of ln delta_1, ln F_1, ln K and ln K' over ln a up to max_radius
        [length], for adhesive tips, shape (4, 13).
    relative_error
        Relative error estimate of the force.
    contact_radius
        Contact radius at max_depth [length].
    """

    max_depth: float
    exponent: float
    coefficients: np.ndarray
    punch_coefficients: np.ndarray | None = None
    max_radius: float = 0.0
    relative_error: float = 0.0
    contact_radius: float = 0.0

    def force(self, delta: np.ndarray) -> np.ndarray:
        """Return the force [force] at depths (n,) [length]; it is 0 out of contact.

        Beyond max_depth the curve continues as a power law.
        """
        g = self.log_variation(delta, self.coefficients)
        return np.where(delta > 0, np.maximum(delta, 1e-300) ** self.exponent * np.exp(g), 0.0)

    def force_and_stiffness(self, delta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the force [force] and dF/d(delta) [force/length] at depths (n,) [length].

        At max_depth, where the power law begins, the derivative from smaller depths is returned.
        """
        positive_depth = np.maximum(delta, 1e-300)
        root = np.sqrt(positive_depth / self.max_depth)
        force = self.force(delta)
        slope = self.log_variation(delta, chebyshev.chebder(self.coefficients))
        slope *= 2.0 / (ROOT_DOMAIN[1] - ROOT_DOMAIN[0])
        is_inside = (root > ROOT_DOMAIN[0]) & (root < ROOT_DOMAIN[1] + 1e-9)
        log_slope = self.exponent + np.where(is_inside, 0.5 * root * slope, 0.0)
        return force, force * log_slope / positive_depth

    @cached_property
    def punches(self) -> PunchTable:
        """Flat punches up to the largest contact radius."""
        assert self.punch_coefficients is not None
        log_min_radius = math.log(MIN_RADIUS_FRACTION)
        punch_count = 1500
        log_radius = np.linspace(log_min_radius, 0.0, punch_count)
        columns = np.exp(
            chebyshev.chebval(1.0 - 2.0 * log_radius / log_min_radius, self.punch_coefficients.T)
        )
        return PunchTable(log_radius, self.max_radius * np.exp(log_radius), *columns)

    def log_variation(self, delta: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
        """Return a Chebyshev series in s, such as g(s), at depths (n,) [length].

        The series is continued by constants below the smallest s and above s = 1.
        """
        s = np.clip(np.sqrt(np.maximum(delta, 1e-300) / self.max_depth), *ROOT_DOMAIN)
        values: np.ndarray = chebyshev.chebval(_map_to_unit_interval(s), coefficients)
        return values


class TabulatedLoadCurve:
    """Elastic load curves as tables over s, for many evaluations of force and stiffness.

    Between the nodes, the force is a cubic polynomial in s with the values and slopes of the load
    curve at the nodes. Beyond the table, at 2.25 times the largest depth, the last polynomial
    continues.

    Parameters
    ----------
    load_curve
        One curve, or several ones: coefficients of shape (13,) or (rows, 13).
    interval_count
        Number of intervals of each table. Multiples of 75 have nodes at both ends of the power
        laws, s = 0.02 and 1.
    """

    def __init__(self, load_curve: ElasticLoadCurve, interval_count: int = 1200):
        max_root = 1.5
        roots = np.linspace(0.0, max_root, interval_count + 1)
        depths = load_curve.max_depth * roots**2
        h = max_root / interval_count
        polynomials = []
        forces = []
        for coefficients in np.atleast_2d(load_curve.coefficients):
            curve = replace(load_curve, coefficients=coefficients)
            force, stiffness = curve.force_and_stiffness(depths)
            # dF/ds times the length of an interval.
            slope = stiffness * 2.0 * load_curve.max_depth * roots * h
            rise = np.diff(force)
            forces.append(force)
            polynomials.append(
                [
                    force[:-1],
                    slope[:-1],
                    3.0 * rise - 2.0 * slope[:-1] - slope[1:],
                    slope[:-1] + slope[1:] - 2.0 * rise,
                ]
            )
        self._interval_count = interval_count
        self.max_depth = load_curve.max_depth
        self._interval = h
        self._polynomials = np.concatenate(polynomials, axis=1)
        self._node_forces = np.array(forces)

    def force_and_stiffness(
        self, delta: np.ndarray, rows: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return force and stiffness at depths.

        Parameters
        ----------
        delta
            Depths (..., n) [length].
        rows
            Row of the table for each curve (...), by default the first one for all.

        Returns
        -------
        force, stiffness
            F [force] and dF/d(delta) [force/length], 0 out of contact.
        """
        samples, shift = self._samples_in_contact(delta, rows)
        root = np.sqrt(delta.reshape(-1)[samples] / self.max_depth)
        position = root / self._interval
        node = np.minimum(position.astype(np.intp), self._interval_count - 1)
        force, stiffness = self._values(self._coefficients(node + shift), node, position - node)
        return _scattered(force, samples, delta.shape), _scattered(stiffness, samples, delta.shape)

    def _values(
        self, coefficients: Sequence[np.ndarray], node: np.ndarray, u: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return force and stiffness (k,) at a fraction u of the interval after a node."""
        c0, c1, c2, c3 = coefficients
        force = c0 + u * (c1 + u * (c2 + u * c3))
        slope = c1 + u * (2.0 * c2 + 3.0 * u * c3)
        # The smallest position avoids 0/0 at first contact.
        root = self._interval * np.maximum(node + u, 1e-9)
        return force, slope / (2.0 * self.max_depth * self._interval * root)

    def _samples_in_contact(
        self, x: np.ndarray, rows: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray | int]:
        """Return flat indices (k,) of positive x (..., n), and where their tables begin (k,)."""
        is_in_contact = x > 0
        samples = np.flatnonzero(is_in_contact)
        if rows is None:
            return samples, 0
        counts = np.count_nonzero(is_in_contact, axis=-1)
        begins = self._interval_count * np.broadcast_to(rows, counts.shape)
        return samples, np.repeat(begins.reshape(-1), counts.reshape(-1))

    def _coefficients(self, position: np.ndarray) -> list[np.ndarray]:
        """Return the four coefficients of the polynomials at positions (k,) in the table."""
        return [np.take(column, position, mode="clip") for column in self._polynomials]

    def force(self, delta: np.ndarray) -> np.ndarray:
        """Return the forces [force] at depths (..., n) [length] of the first curve."""
        return self.force_and_stiffness(delta)[0]

    def force_and_stiffness_behind_spring(
        self, x: np.ndarray, compliance: np.ndarray, rows: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return force and stiffness at displacements x = delta + compliance F of a spring's base.

        Between the nodes x is a cubic polynomial of s like F, so that the depth is its root.

        Parameters
        ----------
        x
            Displacements (..., n) [length].
        compliance
            Compliance of the spring for each curve (..., 1) [length/force].
        rows
            Row of the table for each curve (...), by default the first one for all.

        Returns
        -------
        force, stiffness
            F [force] and dF/d(delta) [force/length], 0 out of contact; NaN if no root is found.
        """
        x = np.broadcast_to(x, np.broadcast_shapes(x.shape, compliance.shape))
        samples, shift = self._samples_in_contact(x, rows)
        curves = samples // x.shape[-1]
        displacement = x.reshape(-1)[samples]
        compliances = np.broadcast_to(compliance, (*x.shape[:-1], 1)).reshape(-1)
        # Displacement at every node of the table of each curve.
        square = self.max_depth * self._interval**2
        numbers = np.arange(self._interval_count + 1)
        node_forces = self._node_forces[np.broadcast_to(0 if rows is None else rows, x.shape[:-1])]
        node_forces = node_forces.reshape(-1, len(numbers))
        nodes = square * numbers**2 + compliances[:, None] * node_forces
        parts = np.split(displacement, np.searchsorted(curves, np.arange(1, len(nodes))))
        pairs = zip(nodes, parts, strict=True)
        node = np.concatenate([np.searchsorted(row[1:-1], part, "right") for row, part in pairs])
        begin = nodes[curves, node]
        end = nodes[curves, node + 1]
        coefficients = self._coefficients(node + shift)
        _, c1, c2, c3 = coefficients
        compliance_of = compliances[curves]
        q1 = 2.0 * square * node + compliance_of * c1
        q2 = square + compliance_of * c2
        q3 = compliance_of * c3
        excess = displacement - begin
        # Initial guess: x is linear in s^2 within the interval.
        u = np.sqrt(node**2 + excess / (end - begin) * (2 * node + 1)) - node
        # Newton's method converges quadratically: after a change by this fraction of an interval
        # the error is one of round-off.
        max_iterations = 20
        tolerance = 1e-8
        for _ in range(max_iterations):
            slope = np.maximum(q1 + u * (2.0 * q2 + 3.0 * u * q3), 1e-300)
            change = (excess - u * (q1 + u * (q2 + u * q3))) / slope
            u = u + change
            is_converged = np.abs(change) < tolerance
            if is_converged.all():
                break
        force, stiffness = self._values(coefficients, node, np.where(is_converged, u, np.nan))
        return _scattered(force, samples, x.shape), _scattered(stiffness, samples, x.shape)


def _scattered(values: np.ndarray, positions: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Return an array of zeros with values (k,) at flat positions (k,)."""
    array = np.zeros(shape)
    array.reshape(-1)[positions] = values
    return array


def _map_to_unit_interval(s: np.ndarray) -> np.ndarray:
    """Return the curve coordinate s, mapped to the interval [-1, 1]."""
    return (2.0 * s - (ROOT_DOMAIN[0] + ROOT_DOMAIN[1])) / (ROOT_DOMAIN[1] - ROOT_DOMAIN[0])


class ElasticLoadCurveGrid:
    """Elastic load curves of a scene as a function of its shape parameters.

    If `wants_punches` is True, flat punches are included, which an adhesive tip needs. Raises
    ConfigError if the unchanged scene is not valid.
    """

    def __init__(
        self,
        config: Config,
        shape_parameters: Sequence[Parameter],
        max_depth: float,
        wants_punches: bool = False,
    ):
        self.scene_curve = solve_load_curve(config, max_depth, wants_punches)
        solve = partial(_solve_coefficients, max_depth, wants_punches, self.scene_curve.exponent)
        # Number of interpolation nodes around a value; with steps of 0.2 in theta the interpolation
        # error is 2e-6 of the force.
        grid_nodes = 6
        self._grid = ParameterGrid(
            config, shape_parameters, _pack_coefficients(self.scene_curve), solve, grid_nodes
        )

    def copy_for_depth(self, max_depth: float) -> ElasticLoadCurveGrid:
        """Return the curves of a self-similar scene up to another depth, without a solution."""
        grid = copy.copy(self)
        curve = self.scene_curve
        radius = curve.contact_radius * max_depth / curve.max_depth
        grid.scene_curve = replace(curve, max_depth=max_depth, contact_radius=radius)
        return grid

    def load_curve(self, theta: Sequence[float]) -> ElasticLoadCurve:
        """Return the load curve at coordinates theta of the shape parameters.

        Raises
        ------
        ForwardModelUnavailable
            If the scene has no solution there.
        """
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


def _solve_coefficients(
    max_depth: float, wants_punches: bool, exponent: float, config: Config
) -> np.ndarray:
    """Return the coefficients of the load curve of a scene, as one array."""
    return _pack_coefficients(solve_load_curve(config, max_depth, wants_punches, exponent))


def _pack_coefficients(load_curve: ElasticLoadCurve) -> np.ndarray:
    """Return all coefficients of a load curve that depend on parameters, as one array."""
    punch_values = (
        []
        if load_curve.punch_coefficients is None
        else [*load_curve.punch_coefficients.ravel(), math.log(load_curve.max_radius)]
    )
    return np.array([*load_curve.coefficients, *punch_values])


def plan_elastic_run(config: Config, max_depth: float) -> PlannedRun:
    """Return the planned run of the scene without experiment, with drained elastic material.

    If the solver needs a load path, the path consists of the depths max_depth s^2 with s in
    DEPTH_ROOTS. Raises ConfigError if the scene is not valid, has adhesion with a range, or adheres
    to a flat below.
    """
    if config.contact.adhesion:
        raise ConfigError(
            "contact.adhesion",
            "a fit needs adhesion in the JKR limit, without the key range",
            "give experiment.adhesion",
        )
    adhesion = config.experiment.adhesion if config.experiment else None
    if adhesion and adhesion.base_work is not None:
        raise ConfigError(
            "experiment.adhesion.base_work",
            "a fit needs a body with one adhesive contact",
            "fit the approach of the scene without experiment.adhesion",
        )
    document = elastic_document(config)
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


def elastic_document(config: Config) -> dict[str, Any]:
    """Return the document of a scene without experiment, relaxation and flow."""
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
    """Return the scene without experiment, with drained elastic material, to a depth."""
    return config_from_mapping(elastic_document(config) | {"loading": {"delta": float(max_depth)}})


def solve_load_curve(
    config: Config, max_depth: float, wants_punches: bool = False, exponent: float | None = None
) -> ElasticLoadCurve:
    """Solve the load curve of a scene by theory, static condensation, or a load path.

    Parameters
    ----------
    max_depth
        The largest depth [length].
    wants_punches
        True if flat punches, which an adhesive tip needs, are also solved.
    exponent
        Exponent of the depth; None to find it from the shallowest points.

    Raises
    ------
    ForwardModelUnavailable
        The scene has no solution.
    ConfigError
        The scene is not valid.
    """
    planned_run = plan_elastic_run(config, max_depth)
    if is_self_similar(config) and not wants_punches:
        return _self_similar_curve(planned_run, max_depth)
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


def _self_similar_curve(planned_run: PlannedRun, max_depth: float) -> ElasticLoadCurve:
    """Return the curve F = C delta^2 with C from one solution at the depth of the scene's mesh."""
    try:
        solved = self_similar_force(planned_run, max_depth)
    except (NotConverged, *NUMERICAL_ERRORS) as error:
        raise ForwardModelUnavailable(str(error)) from error
    exponent = 2.0
    coefficients = np.zeros(DEGREE + 1)
    coefficients[0] = math.log(float(solved.forces[0])) - exponent * math.log(max_depth)
    return ElasticLoadCurve(
        max_depth,
        exponent,
        coefficients,
        relative_error=solved.error,
        contact_radius=solved.contact_radius,
    )


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
    """Return the load curve from a solution on a mesh, smoothed by a polynomial.

    The ratio of the computed force to the force by theory is smoothed. The scatter around the
    polynomial is added to the relative error.
    """
    depths = max_depth * DEPTH_ROOTS**2
    forces = elastic_forces.forces
    theory_forces = elastic_forces.theory_forces
    theory_forces = (
        theory_forces if theory_forces is not None and (theory_forces > 0).all() else None
    )
    # At less than 5 % of the depth (the square of this s) the contact of a mesh has too few
    # elements.
    min_root = 0.2236
    is_resolved = (min_root <= DEPTH_ROOTS) & (forces > 0)
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
    """Return the exponent of the depth at the smallest depths.

    The exponent is rounded to a multiple of 0.5 if it is close to one.
    """
    slope = float(np.log(forces[1] / forces[0]) / np.log(depths[1] / depths[0]))
    # The exponent is rounded to the nearest multiple of the step if it is within the tolerance of
    # it.
    step = 0.5
    tolerance = 0.02
    nearest_half = step * round(slope / step)
    return nearest_half if abs(slope - nearest_half) < tolerance else slope


def _punch_coefficients(planned_run: PlannedRun, max_depth: float) -> tuple[np.ndarray, float]:
    """Return Chebyshev coefficients of flat punches of radius a, and the largest radius.

    The approximated functions are the logarithms of depth, force, stiffness K and dK/da over ln a.
    """
    radius_fractions, columns, max_radius = flat_punches(
        planned_run, max_depth, MIN_RADIUS_FRACTION
    )
    x = np.log(radius_fractions)
    log_columns = np.log(columns)
    # Degree of the polynomials through flat punches.
    radius_degree = 12
    fits = [
        Chebyshev.fit(x, values, radius_degree, domain=(math.log(MIN_RADIUS_FRACTION), 0.0)).coef
        for values in log_columns
    ]
    return np.array(fits), max_radius
