"""Elastic load curves of a scene from the surrogate of a study, in place of solutions.

    F = delta^p exp g(s),   s = sqrt(delta/max_depth)

as in `elastic_load_curve`. The surrogate is evaluated at the depths of its range. At smaller depths
g continues as a quadratic function of s: the force of a round tip on a layer is a power series of
s times that on a half-space.
"""

from __future__ import annotations

import hashlib
import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.polynomial import Chebyshev, chebyshev

from indent_sim.config.key_dimensions import DEPTH_KEY, key_numbers
from indent_sim.config.scene_file import config_from_mapping, to_mapping
from indent_sim.config.schema import Config
from indent_sim.fitting.forward_model.elastic_load_curve import (
    DEPTH_ROOTS,
    ROOT_DOMAIN,
    ElasticLoadCurve,
    elastic_document,
    plan_elastic_run,
)
from indent_sim.fitting.forward_model.measured_path_forces import needs_time_stepping
from indent_sim.fitting.forward_model.parameter_grid import ForwardModelUnavailable
from indent_sim.fitting.forward_model.parameters import Parameter
from indent_sim.fitting.measured_constants import DEGREE
from indent_sim.process.errors import ConfigError
from indent_sim.results.json_text import to_json

# Sections that do not change the elastic force.
OTHER_SECTIONS = ("title", "output", "loading")
# Exponents of the depth at small depths, by the shape of a tip without a rounded apex.
FIRST_EXPONENTS = {"sphere": 1.5, "paraboloid": 1.5, "cone": 2.0}
# Degree of the polynomial through the forces of the surrogate.
SURROGATE_DEGREE = 10
# Largest fraction of the depth of a curve at which the range of the surrogate may begin.
MAX_FIRST_DEPTH = 0.25
# Margin of the smallest depth of the range for other values of the fitted keys.
DEPTH_MARGIN = 1.1


class ForceSurrogate(Protocol):
    """Force as a function of the keys of a scene, which the surrogate of a study is."""

    @property
    def column(self) -> str:
        """Name of the column."""
        ...

    @property
    def ranges(self) -> Mapping[str, tuple[float, float]]:
        """Smallest and largest value of each varied key."""
        ...

    @property
    def fixed(self) -> Mapping[str, float]:
        """Values of the keys with a dimension that did not vary."""
        ...

    @property
    def is_logarithmic(self) -> bool:
        """True if the errors are relative."""
        ...

    @property
    def error(self) -> Mapping[str, Any]:
        """Error at held-out runs."""
        ...

    @property
    def information(self) -> Mapping[str, Any]:
        """Units, runs and scene of the study."""
        ...

    def continued(self, keys: Mapping[str, Any]) -> np.ndarray:
        """Return the force, also outside the range."""
        ...

    def inside(self, keys: Mapping[str, Any]) -> np.ndarray:
        """Return for each point whether it is inside the range."""
        ...

    def range_text(self) -> str:
        """Return the range as text."""
        ...

    def as_json(self) -> dict[str, Any]:
        """Return the surrogate as an object for its file."""
        ...


class SurrogateLoadCurves:
    """Elastic load curves of a scene as a function of its shape parameters, from a surrogate.

    Parameters
    ----------
    surrogate
        Surrogate of the force.
    config
        The scene.
    shape_parameters
        Parameters of the fit that do not only multiply the force.
    max_depth
        Largest depth [length].

    Raises
    ------
    ConfigError
        If the surrogate is not that of the scene.
    ForwardModelUnavailable
        If the scene is outside the range of the surrogate.
    """

    def __init__(
        self,
        surrogate: ForceSurrogate,
        config: Config,
        shape_parameters: Sequence[Parameter],
        max_depth: float,
    ):
        refuse_other_scene(surrogate, config)
        self._surrogate = surrogate
        self._parameters = tuple(shape_parameters)
        self._max_depth = max_depth
        numbers = key_numbers(to_mapping(config))
        known = [key for key in (*surrogate.ranges, *surrogate.fixed) if key != DEPTH_KEY]
        self._values = {key: numbers[key].value for key in known}
        depths = max_depth * DEPTH_ROOTS**2
        is_inside = self._inside(self._values, depths)
        is_inside &= self._inside(self._values, depths / DEPTH_MARGIN)
        first = int(np.argmax(is_inside))
        if not is_inside[first:].all() or DEPTH_ROOTS[first] ** 2 > MAX_FIRST_DEPTH:
            raise ForwardModelUnavailable(
                f"the scene at depths of {MAX_FIRST_DEPTH * max_depth:.4g} to {max_depth:.4g} is "
                f"outside the range of the surrogate: {surrogate.range_text()}"
            )
        self._roots = DEPTH_ROOTS[first:]
        self._operator = _continuation_operator(self._roots)
        tip = to_mapping(config)["indenter"]
        exponent = None if tip.get("tip_radius") else FIRST_EXPONENTS.get(tip["shape"])
        self._exponent = exponent or self._shallow_exponent()
        scene = plan_elastic_run(config, max_depth).scene
        scales = scene.physics.scales
        self._contact_radius = (
            scene.physics.indenter.radius_at(max_depth / scales.depth) * scales.length
        )
        self.scene_curve = self._load_curve(self._values)

    def load_curve(self, theta: Sequence[float]) -> ElasticLoadCurve:
        """Return the load curve at coordinates theta of the shape parameters.

        Outside the range of the surrogate the curve only leads a fit back; see `refuse_outside`.
        """
        if not self._parameters:
            return self.scene_curve
        return self._load_curve(self._values_at(theta))

    def outside_text(self, low: Sequence[float], high: Sequence[float]) -> str:
        """Return a reason if an interval of the shape parameters leaves the range, else "".

        Parameters
        ----------
        low, high
            Ends of the intervals of the coordinates theta of the shape parameters.
        """
        ends = self._max_depth * self._roots[[0, -1]] ** 2
        for corner in itertools.product(*zip(low, high, strict=True)):
            if not self._inside(self._values_at(corner), ends).all():
                values = ", ".join(
                    f"{parameter.key} = {parameter.value(theta):.4g}"
                    for parameter, theta in zip(self._parameters, corner, strict=True)
                )
                return (
                    f"the interval of the fit reaches {values}, which at depths of {ends[0]:.3g} "
                    f"to {ends[1]:.3g} is outside the range of the surrogate: "
                    f"{self._surrogate.range_text()}; fit with the scene, or give the study a "
                    "wider range"
                )
        return ""

    def _values_at(self, theta: Sequence[float]) -> dict[str, float]:
        """Return the values of the keys of the surrogate at coordinates theta."""
        changed = {
            parameter.key: parameter.value(float(value))
            for parameter, value in zip(self._parameters, theta, strict=True)
        }
        return self._values | changed

    def _inside(self, values: Mapping[str, float], depths: np.ndarray) -> np.ndarray:
        return self._surrogate.inside({**values, DEPTH_KEY: depths})

    def _shallow_exponent(self) -> float:
        """Return the exponent of the depth at the smallest depths of the surrogate."""
        depths = self._max_depth * self._roots[:2] ** 2
        forces = self._surrogate.continued({**self._values, DEPTH_KEY: depths})
        return float(np.log(forces[1] / forces[0]) / np.log(depths[1] / depths[0]))

    def _logarithm(self, values: Mapping[str, float]) -> np.ndarray:
        """Return g at the depths of the surrogate."""
        depths = self._max_depth * self._roots**2
        forces = self._surrogate.continued({**values, DEPTH_KEY: depths})
        logarithm: np.ndarray = np.log(forces) - self._exponent * np.log(depths)
        return logarithm

    def _load_curve(self, values: Mapping[str, float]) -> ElasticLoadCurve:
        """Return the load curve at values of the keys, without its error."""
        return ElasticLoadCurve(
            self._max_depth,
            self._exponent,
            self._operator @ self._logarithm(values),
            contact_radius=self._contact_radius,
        )

    def relative_error(self, theta: Sequence[float]) -> float:
        """Return the relative error of the force at coordinates theta of the shape parameters.

        It is that of the surrogate and of the runs of its study, and in quadrature the quadratic
        term of the continuation to small depths, relative to the largest force.
        """
        logarithm = self._logarithm(self._values_at(theta))
        roots = _chebyshev_roots()
        g, quadratic = _continuation(self._roots, logarithm, roots)
        coefficients = self._operator @ logarithm
        interpolation = np.abs(chebyshev.chebval(_NODES, coefficients) - g)
        fraction = roots ** (2 * self._exponent) * np.exp(g - logarithm[-1])
        continuation = float(np.max(fraction * (np.abs(quadratic) + interpolation)))
        error = float(self._surrogate.error["error"]) + self._stated_error
        return math.hypot(error, continuation)

    @property
    def _stated_error(self) -> float:
        """Largest relative error that the runs of the study state."""
        return float(self._surrogate.information["runs"]["stated_error"])


# Points of [-1, 1] at which the polynomial g is determined.
_NODES = chebyshev.chebpts1(4 * DEGREE)


def _chebyshev_roots() -> np.ndarray:
    """Return the values of s at the points that determine g."""
    roots: np.ndarray = ROOT_DOMAIN[0] + 0.5 * (_NODES + 1) * (ROOT_DOMAIN[1] - ROOT_DOMAIN[0])
    return roots


def _continuation(
    given_roots: np.ndarray, logarithm: np.ndarray, roots: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return g at values of s, and the quadratic part of its continuation to small ones.

    Parameters
    ----------
    given_roots, logarithm
        Values of s and of g there (n,).
    roots
        Values of s (m,), of which some are smaller than the given ones.
    """
    degree = min(SURROGATE_DEGREE, len(given_roots) - 3)
    first = float(given_roots[0])
    inner = Chebyshev.fit(given_roots, logarithm, degree, domain=(first, ROOT_DOMAIN[1]))
    below = np.minimum(roots - first, 0.0)
    quadratic = 0.5 * inner.deriv(2)(first) * below**2
    g = inner(np.maximum(roots, first)) + inner.deriv(1)(first) * below + quadratic
    return g, quadratic


def _continuation_operator(given_roots: np.ndarray) -> np.ndarray:
    """Return the matrix from g at given values of s to its Chebyshev coefficients."""
    units = np.eye(len(given_roots))
    roots = _chebyshev_roots()
    values = [_continuation(given_roots, unit, roots)[0] for unit in units]
    operator: np.ndarray = chebyshev.chebfit(_NODES, np.array(values).T, DEGREE)
    return operator


def refuse_other_scene(surrogate: ForceSurrogate, config: Config) -> None:
    """Raise ConfigError if the force of a scene does not follow from a surrogate."""
    known = {*surrogate.ranges, *surrogate.fixed}
    ours = _flat({"units": {}, **elastic_document(config)})
    stored = _flat(surrogate.information["scene"])
    for key in sorted({*ours, *stored}):
        is_free = key in known or key.split(".")[0] in OTHER_SECTIONS
        is_free |= key.startswith("units.") and not stored.get(key)
        if not is_free and ours.get(key) != stored.get(key):
            raise ConfigError(
                key,
                f"is {ours.get(key)!r}, and {stored.get(key)!r} in all runs of the study of the "
                "surrogate",
                f"a surrogate has only the keys {', '.join(sorted(known - {DEPTH_KEY}))}: fit "
                "with the scene",
            )
    if config.experiment and config.experiment.adhesion:
        raise ConfigError(
            "experiment.adhesion",
            "a fit with adhesion needs flat punches, which a surrogate of the force does not have",
            "fit with the scene",
        )


def refuse_unusable(surrogate: ForceSurrogate, config: Config, varied_keys: Sequence[str]) -> None:
    """Raise ConfigError if a surrogate cannot give the forces for a fit of keys of a scene."""
    _refuse_other_results(surrogate, config_from_mapping(surrogate.information["scene"]))
    _refuse_other_keys(surrogate, varied_keys)
    refuse_other_scene(surrogate, config)
    refuse_time_stepping(config)


def _refuse_other_keys(surrogate: ForceSurrogate, varied_keys: Sequence[str]) -> None:
    """Raise ConfigError if a fitted key changes the force, but is no key of the surrogate."""
    known = {*surrogate.ranges, *surrogate.fixed} - {DEPTH_KEY}
    for key in varied_keys:
        if key not in known and not key.startswith("experiment.") and ".relaxation" not in key:
            raise ConfigError(
                key,
                "did not vary in the study of the surrogate",
                f"the surrogate has the keys {', '.join(sorted(known))}: vary one of them, or fit "
                "with the scene",
            )


def _refuse_other_results(surrogate: ForceSurrogate, config: Config) -> None:
    """Raise ConfigError if a surrogate is not an elastic force as a function of the depth.

    `config` is the scene of its study.
    """
    remedy = "fit with the scene"
    loading = to_mapping(config)["loading"]
    has_time = "experiment" in to_mapping(config) or elastic_document(config) != {
        key: part for key, part in to_mapping(config).items() if key != "experiment"
    }
    problems = {
        "is the surrogate of another column than the force": surrogate.column != "force",
        "has forces that are not all positive, so that its error is not relative": (
            not surrogate.is_logarithmic
        ),
        "has no range of loading.delta": DEPTH_KEY not in surrogate.ranges,
        "is not loaded by a depth alone": not {*loading} <= {"delta", "steps"},
        "is that of a body that yields": config.yields,
        "is that of a scene with a spring, or whose material depends on time": has_time,
        "is that of a scene with adhesion": bool(config.contact.adhesion),
    }
    for problem, is_present in problems.items():
        if is_present:
            raise ConfigError(
                "--scene",
                f"the surrogate {problem}; a fit needs the elastic force of a tip over its depth",
                remedy,
            )


def refuse_time_stepping(config: Config) -> None:
    """Raise ConfigError if the forces of a scene are computed along its load path."""
    if needs_time_stepping(config):
        raise ConfigError(
            "material",
            "a surrogate has no forces of a material that drains, or relaxes in shear only",
            "fit with the scene",
        )


def surrogate_identity(surrogate: ForceSurrogate) -> str:
    """Return a checksum of a surrogate, by which an earlier fit with it is recognised."""
    return hashlib.sha256(to_json(surrogate.as_json()).encode()).hexdigest()[:16]


def _flat(document: Any, prefix: str = "") -> dict[str, Any]:
    """Return the numbers and words of a document by their dotted keys."""
    if isinstance(document, Mapping):
        parts = [
            (f"{prefix}.{key}" if prefix else str(key), part) for key, part in document.items()
        ]
    elif isinstance(document, list | tuple):
        parts = [(f"{prefix}[{index}]", part) for index, part in enumerate(document)]
    else:
        return {prefix: document}
    flat: dict[str, Any] = {}
    for key, part in parts:
        flat |= _flat(part, key)
    return flat
