"""Forward model: the force of a scene with its experiment for any values of the parameters.

    F(x, t; theta),   x: depth delta, or with a spring the displacement of its base,
                      z = delta + compliance F

Signs: x > 0 into the body, F > 0 compressive; F = 0 before first contact. Units are those of the
scene, times are in seconds.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from indent_sim.config.schema import Config
from indent_sim.config.strict_yaml import key_path
from indent_sim.fitting.forward_model.elastic_load_curve import (
    ElasticLoadCurve,
    ElasticLoadCurveGrid,
    TabulatedLoadCurve,
    plan_elastic_run,
)
from indent_sim.fitting.forward_model.jkr_branch import JkrBranch
from indent_sim.fitting.forward_model.measured_path_forces import (
    MeasuredPath,
    MeasuredPathForces,
    first_contact_time,
    needs_time_stepping,
)
from indent_sim.fitting.forward_model.parameters import (
    ADHESION_WORK_KEY,
    RETRACT_WORK_KEY,
    Parameter,
    parameters_of,
    replace_numbers,
)
from indent_sim.fitting.forward_model.surrogate_load_curves import (
    ForceSurrogate,
    SurrogateLoadCurves,
    refuse_time_stepping,
)
from indent_sim.process.errors import ConfigError
from indent_sim.run.history_on_curve import relaxation_modulus
from indent_sim.run.planned_run import PlannedRun

# Key of the exponent of the depth by which an alternative model multiplies the force.
FREE_EXPONENT_KEY = "exponent"
# Key of the exponent of the contact radius by which an alternative model multiplies the work of
# adhesion.
WORK_EXPONENT_KEY = "work_exponent"
# below this depth the factor by a free power of the depth is constant, since it may diverge at 0
MIN_RELATIVE_DEPTH = 1e-9
# Branches of the samples of an adhesive tip that is in contact.
APPROACH = 1
RETRACT = 2
# Function of times that returns an operator from elastic forces at these times to relaxed forces.
LoadCurve = ElasticLoadCurve | TabulatedLoadCurve
RelaxationOperator = Callable[[np.ndarray], Callable[[np.ndarray], np.ndarray]]


@dataclass(frozen=True)
class ExperimentSettings:
    """Parameter values, sorted by their role in the forward model.

    Attributes
    ----------
    scale
        Factor of the force (..., 1).
    shape_coordinates
        Transformed values (theta) of the shape parameters.
    adhesion_work
        Work of adhesion [force/length].
    retract_work
        Work of adhesion during the retraction [force/length].
    compliance
        Compliance of cantilever and frame [length/force].
    relaxation
        Relaxation of the force; None if the material does not relax.
    extra_exponent
        Exponent n of the factor (depth/reference depth)^n of the force. It is 0 except in the
        alternative model in which the tip has another shape.
    work_exponent
        Exponent m of the factor (contact radius/largest punch)^m of the work of adhesion. It is 0
        except in the alternative model in which the adhesion changes as the contact grows.
    """

    scale: np.ndarray
    shape_coordinates: tuple[float, ...]
    adhesion_work: float
    retract_work: float
    compliance: float
    relaxation: RelaxationOperator | None
    extra_exponent: float = 0.0
    work_exponent: float = 0.0


class ForwardModel:
    """Force of a scene for any values of its varied keys.

    Parameters
    ----------
    config
        The scene with its experiment.
    varied_keys
        Keys of the parameters.
    max_depth
        Largest depth of the load curves [length].
    measured_path
        Load path of the tip, for poroelastic scenes and stress relaxation in shear only.
    surrogate
        Surrogate that gives the elastic forces; None to solve the scene.

    Raises
    ------
    ConfigError
        If the scene is not valid, or not that of the surrogate.
    ForwardModelUnavailable
        If the scene has no solution.
    """

    def __init__(
        self,
        config: Config,
        varied_keys: Sequence[str],
        max_depth: float,
        measured_path: MeasuredPath | None = None,
        surrogate: ForceSurrogate | None = None,
    ):
        self.config = config
        self.surrogate = surrogate
        self.varied_keys = tuple(varied_keys)
        self.max_depth = max_depth
        self.parameters = parameters_of(config, varied_keys, max_depth)
        self.experiment = config.instrument
        self.pivot_depth = max_depth
        self.has_adhesion = self.experiment.adhesion is not None
        self.lowest_work = 0.0
        self.path_forces: MeasuredPathForces | None = None
        self._curve_rows: np.ndarray | None = None
        self._tabulate(measured_path)
        self.is_time_dependent = (
            self.path_forces is not None or relaxation_of(self.config) is not None
        )

    def _tabulate(self, measured_path: MeasuredPath | None) -> None:
        """Prepare the tables of forces, and set the roles and bounds of the parameters."""
        config = self.config
        max_depth = self.max_depth
        self._shape_indices = [
            k for k, parameter in enumerate(self.parameters) if parameter.role == "shape"
        ]
        shape_parameters = [self.parameters[k] for k in self._shape_indices]
        is_time_stepped = needs_time_stepping(config)
        curve_parameters = [] if is_time_stepped else shape_parameters
        self.elastic_curves: ElasticLoadCurveGrid | SurrogateLoadCurves
        if self.surrogate is None:
            self.elastic_curves = ElasticLoadCurveGrid(
                config, curve_parameters, max_depth, self.has_adhesion
            )
        else:
            refuse_time_stepping(config)
            self.elastic_curves = SurrogateLoadCurves(
                self.surrogate, config, curve_parameters, max_depth
            )
        if is_time_stepped:
            self.path_forces = _build_path_forces(
                config, shape_parameters, measured_path, self.elastic_curves.scene_curve
            )
        radius = self.elastic_curves.scene_curve.contact_radius
        self.parameters = tuple(_bound_height(parameter, radius) for parameter in self.parameters)

    @property
    def follows_loop(self) -> bool:
        """True if the forces of unloading and of loading differ, as those of a body that yields."""
        return False

    @property
    def initial_coordinates(self) -> np.ndarray:
        """Transformed parameters theta for the parameter values in the scene."""
        return np.array([parameter.theta(parameter.initial_value) for parameter in self.parameters])

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds (p,) of the transformed parameters, in the order of the keys."""
        low, high = (
            zip(*(parameter.bounds for parameter in self.parameters), strict=True)
            if self.parameters
            else ((), ())
        )
        lower = np.array(low, dtype=float)
        if self.lowest_work > 0.0:
            is_work = [parameter.role == "work" for parameter in self.parameters]
            lower[is_work] = np.maximum(lower[is_work], math.log(self.lowest_work))
        return lower, np.array(high, dtype=float)

    @property
    def scale_index(self) -> int | None:
        """Index of the parameter that multiplies the force; None if no parameter does."""
        return next(
            (k for k, parameter in enumerate(self.parameters) if parameter.role == "scale"), None
        )

    @property
    def effects(self) -> set[str]:
        """Effects that the scene already has, of those an alternative model can add."""
        has_effect = {"adhesion": self.has_adhesion, "relaxation": self.is_time_dependent}
        return {name for name, is_present in has_effect.items() if is_present}

    @property
    def relative_error(self) -> float:
        """Relative discretisation error of the force."""
        return self.elastic_curves.scene_curve.relative_error

    def __call__(
        self,
        theta: np.ndarray,
        x: np.ndarray,
        t: np.ndarray | None = None,
        branch: np.ndarray | None = None,
    ) -> np.ndarray:
        """Return the forces of the scene.

        Parameters
        ----------
        theta
            Transformed parameters (..., k).
        x
            Displacements (..., n) [length].
        t
            Times (n,) [s] in increasing order, or None.
        branch
            Branch of every sample (..., n) of an adhesive tip, `APPROACH`, `RETRACT` or another
            number for a sample out of contact; None if the model decides what is in contact.

        Returns
        -------
        ndarray, shape (..., n)
            Forces [force].
        """
        if theta.ndim > 1 and not self.is_batchable:
            curves = curves_of_batch(theta, x, branch)
            return np.stack(
                [self(theta_row, row, t, branches) for theta_row, row, branches in curves]
            )
        settings = self._experiment_settings(theta)
        if self.is_time_dependent and t is None:
            raise ValueError("a scene that relaxes needs times")
        if self.path_forces is not None and t is not None:
            return self._force_along_path(self.path_forces, settings, x, t)
        if self.has_adhesion:
            return self._adhesive_force(settings, x, branch)
        load_curve = self._load_curve(settings)
        if settings.relaxation is not None and t is not None:
            return self._relaxed_force(load_curve, settings, x, settings.relaxation(t))
        return self._spring_balance(load_curve, settings, x)[1]

    def linearize(
        self,
        theta: np.ndarray,
        x: np.ndarray,
        t: np.ndarray | None,
        branch: np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the forces, and their derivatives by theta and by a shift of the curve.

        Parameters
        ----------
        theta
            Transformed parameters (..., k).
        x
            Displacements (..., n) [length].
        t
            Times (n,) [s], or None.
        branch
            Branch of every sample (..., n) of an adhesive tip, or None.

        Returns
        -------
        force : ndarray, shape (..., n)
            Forces [force].
        derivatives : ndarray, shape (..., k + 1, n)
            dF/dtheta, and -dF/dx as the last row. The derivatives are analytic for elastic bodies,
            and central differences for other bodies.
        """
        if theta.ndim > 1 and not self.is_batchable:
            results = [
                self.linearize(theta_row, row, t, branches)
                for theta_row, row, branches in curves_of_batch(theta, x, branch)
            ]
            forces, derivatives = zip(*results, strict=True)
            return np.stack(forces), np.stack(derivatives)
        if not self.has_analytic_derivatives:
            force = self(theta, x, t, branch)
            return force, self._difference_quotients(theta, x, t, branch)
        settings = self._experiment_settings(theta)
        if self.has_adhesion:
            return self._linearize_adhesive_force(theta, settings, x, branch)
        load_curve = self._load_curve(settings)
        delta, force, stiffness = self._spring_balance(load_curve, settings, x)
        rows = [
            self._fixed_depth_derivative(k, theta, delta, force, stiffness)
            for k in range(theta.shape[-1])
        ]
        derivatives = np.stack([*rows, -stiffness], axis=-2)
        if settings.compliance:
            derivatives /= (1.0 + settings.compliance * stiffness)[..., None, :]
        return force, derivatives

    @property
    def has_analytic_derivatives(self) -> bool:
        """True for an elastic body."""
        return self.has_adhesion or not self.is_time_dependent

    @property
    def is_batchable(self) -> bool:
        """True if the forces of many curves, whose moduli differ, are computed at once."""
        is_elastic = not (self.has_adhesion or self.is_time_dependent)
        return is_elastic and all(parameter.role == "scale" for parameter in self.parameters)

    def select(self, curves: np.ndarray) -> ForwardModel:
        """Return the forward model of some curves of a batch."""
        if self._curve_rows is None:
            return self
        model = copy.copy(self)
        model._curve_rows = self._curve_rows[curves]
        return model

    def copy_for_depth(self, max_depth: float) -> ForwardModel:
        """Return a copy of the model of a self-similar scene for another largest depth."""
        assert isinstance(self.elastic_curves, ElasticLoadCurveGrid)
        model = copy.copy(self)
        for name in ("tabulated_curve", "elastic_run"):
            model.__dict__.pop(name, None)
        model.max_depth = max_depth
        model.pivot_depth = max_depth
        model.elastic_curves = self.elastic_curves.copy_for_depth(max_depth)
        return model

    def replace_load_curves(
        self, load_curves: TabulatedLoadCurve, rows: np.ndarray
    ) -> ForwardModel:
        """Return a copy of the model with a separate load curve for each measured curve.

        Parameters
        ----------
        load_curves
            Table of the load curves.
        rows
            Row of the table for each measured curve of the batch (B,).
        """
        model = copy.copy(self)
        model.tabulated_curve = load_curves
        model._curve_rows = rows
        return model

    def _fixed_depth_derivative(
        self,
        k: int,
        theta: np.ndarray,
        delta: np.ndarray,
        force: np.ndarray,
        stiffness: np.ndarray,
    ) -> np.ndarray:
        """Return dF/dtheta_k (..., n) at fixed depths delta (..., n)."""
        parameter = self.parameters[k]
        if parameter.role == "scale":
            return force
        if parameter.role == "power":
            return force * np.log(np.maximum(delta / self.pivot_depth, MIN_RELATIVE_DEPTH))
        if parameter.role == "spring":
            return -force * stiffness * _compliance_derivative(parameter, theta[k])
        low, high = self._neighbours(k, theta)
        curves = [
            self.elastic_curves.load_curve(tuple(changed[self._shape_indices]))
            for changed in (low, high)
        ]
        difference = curves[1].coefficients - curves[0].coefficients
        variation = curves[0].log_variation(delta, difference)
        return force * variation / max(float(high[k] - low[k]), 1e-300)

    def _neighbours(self, k: int, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the parameters theta with the k-th one decreased and increased by a small step.

        The step of the difference of polynomials is far above their round-off.
        """
        step = np.zeros(theta.shape[-1])
        step[k] = 1e-3 * self.parameters[k].grid_step
        return np.clip(theta - step, *self.bounds), np.clip(theta + step, *self.bounds)

    def _difference_quotients(
        self,
        theta: np.ndarray,
        x: np.ndarray,
        t: np.ndarray | None,
        branch: np.ndarray | None,
    ) -> np.ndarray:
        """Return the derivatives by central differences, one-sided at bounds."""
        columns = []
        for k in range(len(theta)):
            step = np.zeros(len(theta))
            step[k] = 1e-4
            low, high = (np.clip(changed, *self.bounds) for changed in (theta - step, theta + step))
            difference = self(high, x, t, branch) - self(low, x, t, branch)
            columns.append(difference / max(float(high[k] - low[k]), 1e-300))
        h = 1e-5 * self.max_depth
        shift_derivative = (self(theta, x - h, t, branch) - self(theta, x + h, t, branch)) / (
            2.0 * h
        )
        return np.vstack([*columns, shift_derivative])

    def _load_curve(self, settings: ExperimentSettings) -> LoadCurve:
        """Return the load curve, as a table if it is the same for all parameters."""
        if self._shape_indices:
            return self.elastic_curves.load_curve(settings.shape_coordinates)
        return self.tabulated_curve

    @cached_property
    def tabulated_curve(self) -> TabulatedLoadCurve:
        """Load curve of the unchanged scene."""
        return TabulatedLoadCurve(self.elastic_curves.scene_curve)

    @cached_property
    def elastic_run(self) -> PlannedRun:
        """Planned run of the unchanged scene, elastic, without its experiment."""
        return plan_elastic_run(self.config, self.max_depth)

    def _spring_balance(
        self, load_curve: LoadCurve, settings: ExperimentSettings, x: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return depth, force, and stiffness (..., n) at displacements of the base of the spring.

        Without a spring the displacements are the depths.
        """
        compliance = settings.compliance
        if not compliance:
            return x, *self._elastic_force_and_stiffness(load_curve, settings, x)
        if isinstance(load_curve, TabulatedLoadCurve) and not settings.extra_exponent:
            force, stiffness = load_curve.force_and_stiffness_behind_spring(
                x, compliance * settings.scale, self._curve_rows
            )
            force = settings.scale * force
            return x - compliance * force, force, settings.scale * stiffness
        force = self._solve_spring_balance(
            x,
            compliance,
            lambda delta: self._elastic_force_and_stiffness(load_curve, settings, delta),
        )
        delta = x - compliance * force
        return delta, *self._elastic_force_and_stiffness(load_curve, settings, delta)

    def unit_forces(self, delta: np.ndarray) -> np.ndarray:
        """Return the elastic forces of the unchanged scene at depths (..., n) [length].

        In a batch with one load curve for each measured curve, the first dimension counts the
        curves.
        """
        rows = self._curve_rows
        if rows is not None:
            rows = rows.reshape(-1, *[1] * (delta.ndim - 2))
        return self.tabulated_curve.force_and_stiffness(delta, rows)[0]

    def force_without_spring(self, theta: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """Return the force over depths (..., n) without spring and relaxation, for a first guess.

        An adhesive tip is in contact from first contact until pull-off.
        """
        settings = self._experiment_settings(theta)
        path_forces = self.path_forces
        if path_forces is not None:
            return lambda delta: (
                settings.scale
                * path_forces.peak_force_factor
                * np.maximum(delta, 0.0) ** path_forces.exponent
            )
        if self.has_adhesion:
            rigid_settings = replace(settings, compliance=0.0)
            approach = self._jkr_branch(rigid_settings, APPROACH)
            return lambda delta: np.where(approach.is_in_contact(delta), approach.force(delta), 0.0)
        load_curve = self._load_curve(settings)
        return lambda delta: self._elastic_force(load_curve, settings, delta)

    def _elastic_force(
        self, load_curve: LoadCurve, settings: ExperimentSettings, delta: np.ndarray
    ) -> np.ndarray:
        """Return the elastic force at depths, multiplied by the additional power of the depth."""
        return self._elastic_force_and_stiffness(load_curve, settings, delta)[0]

    def _elastic_force_and_stiffness(
        self, load_curve: LoadCurve, settings: ExperimentSettings, delta: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the elastic force at depths (n,) and its derivative with respect to the depth."""
        if isinstance(load_curve, TabulatedLoadCurve):
            force, stiffness = load_curve.force_and_stiffness(delta, self._curve_rows)
        else:
            force, stiffness = load_curve.force_and_stiffness(delta)
        force = settings.scale * force
        stiffness = settings.scale * stiffness
        if not settings.extra_exponent:
            return force, stiffness
        relative_depth = np.maximum(delta / self.pivot_depth, MIN_RELATIVE_DEPTH)
        factor = relative_depth**settings.extra_exponent
        power_slope = settings.extra_exponent / (self.pivot_depth * relative_depth)
        return factor * force, factor * (stiffness + power_slope * force)

    def _force_along_path(
        self,
        path_forces: MeasuredPathForces,
        settings: ExperimentSettings,
        x: np.ndarray,
        t: np.ndarray,
    ) -> np.ndarray:
        """Return the force of a path-dependent body."""
        if not (x > 0).any():
            return np.zeros(len(x))
        exponent = path_forces.exponent + settings.extra_exponent
        positive_x = np.maximum(x, 0.0)
        force_factor = (
            settings.scale
            * path_forces.force_factor(settings.shape_coordinates, t - first_contact_time(t, x))
            * self.pivot_depth**-settings.extra_exponent
        )
        if not settings.compliance:
            return force_factor * positive_x**exponent  # type: ignore[no-any-return]

        def force_and_stiffness(delta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            force = force_factor * np.maximum(delta, 0.0) ** exponent
            return force, exponent * force / np.maximum(delta, MIN_RELATIVE_DEPTH * self.max_depth)

        return self._solve_spring_balance(positive_x, settings.compliance, force_and_stiffness)

    def time_step_error(self, theta: np.ndarray, x: np.ndarray, t: np.ndarray | None) -> np.ndarray:
        """Return the error (n,) of a path-dependent force due to time steps and interpolation.

        The error is the difference from a run at these parameters with half the time step. The
        error is 0 for a body that is not path-dependent.
        """
        path_forces = self.path_forces
        settings = self._experiment_settings(theta)
        if path_forces is None or t is None or not (x > 0).any():
            return np.zeros(len(x))
        values = {
            parameter.key: parameter.value(float(theta[k]))
            for k in self._shape_indices
            for parameter in (self.parameters[k],)
        }
        factor_error = path_forces.time_step_error(
            replace_numbers(self.config, values),
            settings.shape_coordinates,
            t - first_contact_time(t, x),
        )
        depth = np.maximum(x - settings.compliance * self(theta, x, t), 0.0)
        error: np.ndarray = settings.scale * factor_error * depth**path_forces.exponent
        return error

    def _experiment_settings(self, theta: np.ndarray) -> ExperimentSettings:
        values = {
            parameter.key: parameter.value(float(theta[k]))
            for k, parameter in enumerate(self.parameters)
            if parameter.role != "scale"
        }
        scale_index = self.scale_index
        scale = np.ones((*theta.shape[:-1], 1))
        if scale_index is not None:
            log_change = theta[..., scale_index, None] - self.initial_coordinates[scale_index]
            scale = np.exp(np.clip(log_change, -700.0, 700.0))
        adhesion = self.experiment.adhesion
        adhesion_work = values.get(ADHESION_WORK_KEY, adhesion.work if adhesion else 0.0)
        retract_work = values.get(RETRACT_WORK_KEY, adhesion_work)
        cantilever = self.experiment.cantilever
        frame = self.experiment.frame
        compliance = (
            1.0 / values.get("experiment.cantilever.stiffness", cantilever.stiffness)
            if cantilever
            else 0.0
        )
        compliance += values.get("experiment.frame.compliance", frame.compliance) if frame else 0.0
        relaxation_values = {
            parameter.key: values[parameter.key]
            for parameter in self.parameters
            if parameter.role == "relaxation"
        }
        extra_exponent = values.get(FREE_EXPONENT_KEY, 0.0)
        relaxation = (
            relaxation_of(self.config, relaxation_values) if self.is_time_dependent else None
        )
        return ExperimentSettings(
            scale,
            tuple(theta[self._shape_indices]) if self._shape_indices else (),
            adhesion_work,
            retract_work,
            compliance,
            relaxation,
            extra_exponent,
            values.get(WORK_EXPONENT_KEY, 0.0),
        )

    def relative_error_at(self, theta: np.ndarray) -> float:
        """Return the relative error of the force at transformed parameters (k,)."""
        if self.surrogate is None:
            return self.relative_error
        assert isinstance(self.elastic_curves, SurrogateLoadCurves)
        return self.elastic_curves.relative_error(tuple(theta[self._shape_indices]))

    def add_free_exponent(self, pivot_depth: float) -> ForwardModel:
        """Return the model with the force multiplied by a free power of delta/pivot_depth.

        The factor represents a tip of another shape; it is 1 at pivot_depth [length].
        """
        model = copy.copy(self)
        model.parameters = (
            *self.parameters,
            Parameter(FREE_EXPONENT_KEY, 0.0, "power", -1.0, 1.0, is_linear=True),
        )
        model.varied_keys = (*self.varied_keys, FREE_EXPONENT_KEY)
        model.pivot_depth = pivot_depth
        return model

    def _adhesive_force(
        self, settings: ExperimentSettings, x: np.ndarray, branch: np.ndarray | None
    ) -> np.ndarray:
        """Return the force of an adhesive tip at displacements (n,)."""
        force = np.zeros(x.shape)
        for _, jkr_branch, is_on_branch in self._branches_in_contact(settings, x, branch):
            force[is_on_branch] = jkr_branch.force(x[is_on_branch])
        return force

    def _linearize_adhesive_force(
        self,
        theta: np.ndarray,
        settings: ExperimentSettings,
        x: np.ndarray,
        branch: np.ndarray | None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return forces (n,), their derivatives by theta, and -dF/dx (k + 1, n)."""
        force = np.zeros(x.shape)
        derivatives = np.zeros((len(theta) + 1, len(x)))
        for name, jkr_branch, is_on_branch in self._branches_in_contact(settings, x, branch):
            changes = np.empty((len(theta), *jkr_branch.contacts.shape))
            for k in range(len(theta)):
                changes[k] = self._change(k, theta, name, jkr_branch)
            selected_x = x[is_on_branch]
            force[is_on_branch] = jkr_branch.force(selected_x)
            derivatives[:, is_on_branch] = jkr_branch.derivatives(selected_x, changes)
        return force, derivatives

    def _branches_in_contact(
        self, settings: ExperimentSettings, x: np.ndarray, branch: np.ndarray | None
    ) -> Iterator[tuple[int, JkrBranch, np.ndarray]]:
        """Yield the branches of an adhesive tip that have samples (n,), by name, and their samples.

        If the branch of the samples is None, the tip is in contact from first contact (x = 0) until
        pull-off.
        """
        if branch is None:
            approach = self._jkr_branch(settings, APPROACH)
            yield APPROACH, approach, approach.is_in_contact(x)
            return
        for name in (APPROACH, RETRACT):
            is_on_branch = branch == name
            if is_on_branch.any():
                yield name, self._jkr_branch(settings, name), is_on_branch

    def _jkr_branch(self, settings: ExperimentSettings, name: int) -> JkrBranch:
        """Return the branch of the approach or of the retraction."""
        return JkrBranch(
            self.elastic_curves.load_curve(settings.shape_coordinates).punches,
            float(settings.scale[0]),
            settings.adhesion_work if name == APPROACH else settings.retract_work,
            settings.work_exponent,
            settings.compliance,
        )

    def _change(self, k: int, theta: np.ndarray, name: int, jkr_branch: JkrBranch) -> np.ndarray:
        """Return the change (2, m) of displacement and force of all contacts by theta_k."""
        parameter = self.parameters[k]
        if parameter.role == "scale":
            return jkr_branch.change_by_modulus()
        if parameter.role == "spring":
            derivative = _compliance_derivative(parameter, theta[k])
            return derivative * jkr_branch.change_by_compliance()
        if parameter.key == WORK_EXPONENT_KEY:
            return jkr_branch.change_by_work_exponent()
        if parameter.key == self._work_key(name):
            return jkr_branch.change_by_work()
        if parameter.role != "shape":
            return np.zeros_like(jkr_branch.contacts)
        low, high = self._neighbours(k, theta)
        contacts = [
            self._jkr_branch(self._experiment_settings(changed), name).contacts
            for changed in (low, high)
        ]
        difference: np.ndarray = contacts[1] - contacts[0]
        return difference / max(float(high[k] - low[k]), 1e-300)

    def _work_key(self, name: int) -> str:
        """Return the key of the work of adhesion of the approach or of the retraction."""
        has_retract_work = RETRACT_WORK_KEY in self.varied_keys
        return RETRACT_WORK_KEY if name == RETRACT and has_retract_work else ADHESION_WORK_KEY

    def work_of_shift(self, theta: np.ndarray, shift: float) -> float:
        """Return the work of adhesion [force/length] that shifts the largest contact by q [length].

        At constant contact radius the depth is smaller by q than without adhesion.
        """
        settings = self._experiment_settings(theta)
        load_curve = self.elastic_curves.load_curve(settings.shape_coordinates)
        scale = float(settings.scale[..., 0])
        slope = float(load_curve.punches.slope[-1])
        return shift**2 * scale * slope / (4.0 * math.pi * load_curve.max_radius)

    def bound_work(self, lowest: float) -> ForwardModel:
        """Return the model with a lower bound of its works of adhesion during fits [force/length].

        Below this bound the work of adhesion is so small that its logarithm has no effect on the
        force.
        """
        model = copy.copy(self)
        model.lowest_work = lowest
        return model

    def largest_displacement(self, theta: np.ndarray) -> float:
        """Return the displacement of the base [length] up to which contacts were solved."""
        settings = self._experiment_settings(theta)
        branches = (self._jkr_branch(settings, name) for name in (APPROACH, RETRACT))
        return min(jkr_branch.largest_displacement for jkr_branch in branches)

    def add_work_exponent(self) -> ForwardModel:
        """Return the model with the work of adhesion multiplied by a free power of the radius."""
        model = copy.copy(self)
        exponent = Parameter(WORK_EXPONENT_KEY, 0.0, "power", -2.0, 4.0, is_linear=True)
        model.parameters = (*self.parameters, exponent)
        model.varied_keys = (*self.varied_keys, WORK_EXPONENT_KEY)
        return model

    def _relaxed_force(
        self,
        load_curve: LoadCurve,
        settings: ExperimentSettings,
        x: np.ndarray,
        relaxation: Callable[[np.ndarray], np.ndarray],
    ) -> np.ndarray:
        """Return the force of a relaxing body, indented through a spring if the scene has one."""
        if not settings.compliance:
            return relaxation(self._elastic_force(load_curve, settings, x))

        def force_and_stiffness(delta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            force, stiffness = self._elastic_force_and_stiffness(load_curve, settings, delta)
            return relaxation(force), stiffness

        return self._solve_spring_balance(x, settings.compliance, force_and_stiffness)

    def _solve_spring_balance(
        self,
        x: np.ndarray,
        compliance: float,
        force_and_stiffness: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    ) -> np.ndarray:
        """Return the forces at displacements x (n,) of the base of a spring, by Newton's method.

        `force_and_stiffness` returns the force and its derivative at depths. The balance at each
        time is solved independently of other times.
        """
        delta = x.copy()
        # The tolerance of Newton's method for the depth is relative to the largest depth.
        max_iterations = 60
        tolerance = 1e-9
        for _ in range(max_iterations):
            force, stiffness = force_and_stiffness(delta)
            change = (x - delta - compliance * force) / (1.0 + compliance * stiffness)
            delta = delta + change
            if np.abs(change).max(initial=0.0) < tolerance * self.max_depth:
                break
        return force


def curves_of_batch(
    theta: np.ndarray, x: np.ndarray, branch: np.ndarray | None
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray | None]]:
    """Yield parameters (k,), displacements (n,) and branches (n,) of each curve of a batch."""
    shape = (len(theta), x.shape[-1])
    branches = [None] * len(theta) if branch is None else np.broadcast_to(branch, shape)
    return zip(theta, np.broadcast_to(x, shape), branches, strict=True)


def _compliance_derivative(parameter: Parameter, theta: float) -> float:
    """Return the derivative of the compliance by theta of a spring [length/force].

    Theta is the logarithm of the stiffness of a cantilever or of the compliance of a frame.
    """
    value = parameter.value(float(theta))
    return -1.0 / value if parameter.key.endswith("stiffness") else value


def _build_path_forces(
    config: Config,
    shape_parameters: Sequence[Parameter],
    measured_path: MeasuredPath | None,
    load_curve: ElasticLoadCurve,
) -> MeasuredPathForces:
    """Return the force factors along a path.

    The exponent of the depth in the factors is that of the elastic force at the largest depth.
    """
    if config.experiment and config.experiment.adhesion:
        raise ConfigError(
            "experiment.adhesion",
            "a fit cannot combine adhesion with a time-dependent material",
            "leave it out",
        )
    if measured_path is None:
        raise ConfigError(
            "loading",
            "a poroelastic material, or one that relaxes in shear, needs a load path in time",
            "give a history",
        )
    lower_force, upper_force = load_curve.force(np.array([0.95, 1.05]) * measured_path.max_depth)
    return MeasuredPathForces(
        config,
        shape_parameters,
        measured_path,
        math.log(upper_force / lower_force) / math.log(1.05 / 0.95),
    )


def _bound_height(parameter: Parameter, contact_radius: float) -> Parameter:
    """Return a parameter; a height or thickness gets the bounds 0.2 and 20 contact radii.

    The bounds are widened if they do not contain the initial value. The lower bound of the
    parameter is kept if it is larger.
    """
    if parameter.key.rpartition(".")[2] not in ("height", "thickness"):
        return parameter
    # Bounds of a height in contact radii: a thicker body behaves as a half-space, a thinner one
    # takes too long to solve.
    min_radii = 0.2
    max_radii = 20.0
    thinnest = min_radii * contact_radius
    thickest = max_radii * contact_radius
    low = max(parameter.low, min(thinnest, 0.99 * parameter.initial_value))
    return replace(parameter, low=low, high=max(thickest, 1.01 * parameter.initial_value))


def relaxation_of(
    config: Config, values: Mapping[str, float] | None = None
) -> RelaxationOperator | None:
    """Return the relaxation of a scene with other values of some keys; None if there is none."""
    law = next((law.relaxation for _, law in config.materials() if law.relaxation), None)
    if law is None:
        return None
    numbers = {_relaxation_subkey(key): value for key, value in (values or {}).items()}
    if power_law := law.power_law:
        changed = {
            name: numbers.get(("power_law", name), getattr(power_law, name))
            for name in ("exponent", "time")
        }
        return relaxation_modulus(
            replace(law, power_law=replace(power_law, **changed))
        ).force_relaxation
    terms = tuple(
        tuple(numbers.get(("prony", k, i), value) for i, value in enumerate(term))
        for k, term in enumerate(law.prony or ())
    )
    return relaxation_modulus(replace(law, prony=terms)).force_relaxation


def is_time_dependent(config: Config) -> bool:
    """Return True if the force of a scene depends on time."""
    return needs_time_stepping(config) or relaxation_of(config) is not None


def _relaxation_subkey(key: str) -> tuple[str | int, ...]:
    """Return the part of a key after `relaxation`; it is the same for all materials."""
    path = key_path(key)
    return tuple(path[path.index("relaxation") + 1 :])
