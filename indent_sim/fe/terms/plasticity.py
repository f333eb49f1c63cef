"""Incremental potential of a region that yields, from which the return mapping follows.

Over a load increment a von Mises material with isotropic hardening has a potential W(X) of one
scalar, the square X = dev e : dev e of the trial elastic strain e (Ortiz & Stainier 1999, Comput.
Methods Appl. Mech. Eng. 171, 419). With the trial von Mises stress q = mu sqrt(6 X), the plastic
strain increment d (`model.plasticity`) and its derivative d' = dd/dq,

    dW/dX = mu (1 - 3 mu d/q),    d2W/dX2 = -9 mu^4/q^2 (d' - d/q),

so that the tangent is symmetric and consistent with the increment for every hardening law. At small
strain e = sym H - eps_p; at finite strain e = ln(b)/2 with b = F C_p^-1 F^T. The volume change is
elastic.

Internal variables at the quadrature points are eps_p, or G = C_p^-1 - 1, the equivalent plastic
strain alpha and, with creep, the work per volume of the overstress; all are zero in the undeformed
body. They follow from the converged state in closed form: the radial return (return mapping)
shortens the deviator of the logarithmic elastic strain by 3 mu d/q. Source: Weber & Anand (1990),
Comput. Methods Appl. Mech. Eng. 79, 173; Simo (1992), ibid. 99, 61.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from indent_sim.fe import compat
from indent_sim.fe.discrete_body import Body
from indent_sim.fe.kernel_cache import compile_expression, compile_form
from indent_sim.fe.terms.quadrature_field import (
    TENSOR_COMPONENTS,
    QuadratureField,
    symmetric_tensor,
)
from indent_sim.fe.terms.strain_energy import CellSample, StrainEnergy
from indent_sim.fe.terms.time_integration import Stage
from indent_sim.fe.terms.variation import variations
from indent_sim.fe.unknowns import TimeLevel
from indent_sim.mesh.model_domain import Region
from indent_sim.model.algebra import maximum, where_less
from indent_sim.model.logarithmic_strain import deviator_square
from indent_sim.model.materials import Material, YieldingLaw


class _Increment(NamedTuple):
    """Radial return of a load increment as UFL expressions.

    Attributes
    ----------
    scalars : list of Expr
        UFL variables of which X is a function.
    X : Expr
        dev e : dev e of the trial elastic strain.
    slope, curvature : Expr
        dW/dX [pressure] and d2W/dX2 [pressure].
    stored : Expr
        Isochoric part of the stored energy density [pressure].
    alpha : Expr
        Equivalent plastic strain at the end of the increment.
    viscous_work : Expr
        Work per volume of the overstress in the increment [pressure].
    """

    scalars: list[Expr]
    X: Expr
    slope: Expr
    curvature: Expr
    stored: Expr
    alpha: Expr
    viscous_work: Expr


class PlasticStrainEnergy(StrainEnergy):
    """Incremental potential of a region that yields.

    Attributes
    ----------
    energy : ufl.Form
        Stored elastic energy; the virtual work is not its variation.
    psi : Expr
        Stored elastic energy density [pressure].
    """

    has_memory = True

    def __init__(self, body: Body, region: Region):
        pairs = TENSOR_COMPONENTS[body.body_mesh.dim]
        plasticity = region.material.plasticity
        assert plasticity
        self._state = QuadratureField(body, len(pairs) + (2 if plasticity.creep else 1))
        self._alpha_index = len(pairs)
        self._yield_switch = fem.Constant(body.mesh, 1.0)
        self._dt = fem.Constant(body.mesh, 0.0)
        self.history = (self._state.function,)
        super().__init__(body, region)
        self.has_constant_tangent = False
        self.begin_stage(Stage(0.0))

    def _energy_densities(self, material: Material, H: Expr, q: Expr | None) -> tuple[Expr, Expr]:
        """Return the stored energy density for the state at quadrature points and for cell means.

        The volumetric part is that of the law, with a field q that is the mean stress.
        """
        assert isinstance(material, YieldingLaw)
        self._law = material
        theta = material.energy_parts(H)[1]
        self._volume = (
            theta**2 / (2 * material.inverse_bulk_modulus)
            if q is None
            else q * theta - q * q * material.inverse_bulk_modulus / 2
        )
        self._increment, self._mean_increment = (
            self._radial_return(H, state) for state in (self._state.function, self._state.mean)
        )
        self.psi = self._mean_increment.stored + self._volume
        return self._increment.stored + self._volume, self.psi

    def _radial_return(self, H: Expr, state: fem.Function) -> _Increment:
        """Return the radial return from an accepted state to the displacement gradient H."""
        dim = self.body.body_mesh.dim
        plastic_tensor = symmetric_tensor(state, dim)
        alpha = state[self._alpha_index]
        material = self._law
        if material.is_small_strain:
            deviator = ufl.dev(ufl.sym(H) - plastic_tensor)
            X = ufl.variable(ufl.inner(deviator, deviator))
            scalars = [X]
        else:
            F = ufl.Identity(3) + H
            a = H + H.T + H * H.T + F * plastic_tensor * F.T
            deviator = ufl.dev(a)
            square = ufl.inner(deviator, deviator) / 6
            scalars = [ufl.variable(s) for s in (ufl.tr(a), square, ufl.det(deviator))]
            X = deviator_square(*scalars)
        mu = material.shear_modulus
        E = material.E
        plasticity = material.plasticity
        assert plasticity
        q = mu * ufl.sqrt(6 * maximum(X, 0.0 * X))
        flow = plasticity.flow_increment(q, alpha, mu, E, self._dt)
        d = self._yield_switch * flow.strain
        # Where d > 0, q is at least the yield stress, so that this bound changes nothing there.
        safe_q = maximum(q, plasticity.yield_stress)
        reduction = 3 * mu * d / safe_q
        curvature = -9 * mu**4 / safe_q**2 * (flow.compliance - d / safe_q)
        return _Increment(
            scalars,
            X,
            mu * (1 - reduction),
            where_less(0.0 * d, d, curvature, 0.0 * d),
            mu * X * (1 - reduction) ** 2,
            alpha + d,
            self._yield_switch * flow.viscous_work,
        )

    def _stress_of(self, potential: Expr, H: Expr) -> Expr:
        """Return the stress dW/dH; it is not the derivative of the stored energy alone."""
        return self._stress_of_increment(self._mean_increment, H)

    def _stress_of_increment(self, increment: _Increment, H: Expr) -> Expr:
        """Return the first Piola-Kirchhoff stress (3, 3) of an increment [pressure]."""
        scalars, X, slope, *_ = increment
        # The chain rule is used because the direct derivative takes minutes to compile.
        isochoric = sum(ufl.diff(X, s) * ufl.diff(s, H) for s in scalars)
        return slope * isochoric + ufl.diff(self._volume, H)

    def virtual_work(self, now: TimeLevel, before: TimeLevel, dt: fem.Constant) -> ufl.Form:
        """First variation of the incremental potential along `now.test`, a UFL form."""
        isochoric, _ = self._variations_of_increment(now)
        return self.body.region_integral(isochoric + variations(self._volume, now)[0], self.region)

    def tangent(self, now: TimeLevel, before: TimeLevel, dt: fem.Constant) -> ufl.Form:
        """Second variation of the incremental potential, a UFL form."""
        _, isochoric = self._variations_of_increment(now)
        return self.body.region_integral(isochoric + variations(self._volume, now)[1], self.region)

    def _variations_of_increment(self, now: TimeLevel) -> tuple[Expr, Expr]:
        """Return both variations of the incremental potential, by the chain rule."""
        scalars, X, slope, curvature, *_ = self._increment
        derivatives = [ufl.diff(X, s) for s in scalars]
        tested = [ufl.derivative(s, now.function, now.test) for s in scalars]
        tried = [ufl.derivative(s, now.function, now.trial) for s in scalars]
        dX = sum(derivative * v for derivative, v in zip(derivatives, tested, strict=True))
        DX = sum(derivative * w for derivative, w in zip(derivatives, tried, strict=True))
        DdX = sum(
            derivative * ufl.derivative(v, now.function, now.trial)
            for derivative, v in zip(derivatives, tested, strict=True)
        )
        for derivative, v in zip(derivatives, tested, strict=True):
            for s, w in zip(scalars, tried, strict=True):
                DdX += ufl.diff(derivative, s) * v * w
        return slope * dX, curvature * dX * DX + slope * DdX

    def begin_stage(self, stage: Stage) -> None:
        """Set the duration of the increment, and update the cell means of the accepted state."""
        self._dt.value = stage.dt
        self._state.update_means(self.cells)

    def hold_plastic_flow(self, *, is_held: bool) -> None:
        """Suppress plastic flow, so that the body responds elastically, or allow it again."""
        self._yield_switch.value = 0.0 if is_held else 1.0

    @cached_property
    def _plastic_work_form(self) -> fem.Form:
        assert self._law.plasticity
        work = self._law.plasticity.plastic_work(self._increment.alpha, self._law.E)
        if self._law.plasticity.creep:
            work += self._state.function[self._alpha_index + 1] + self._increment.viscous_work
        return compile_form(self.body.region_integral(work, self.region))

    def plastic_dissipation(self) -> float:
        """Energy dissipated by plastic flow since the undeformed state, this rank's part."""
        return float(fem.assemble_scalar(self._plastic_work_form).real)

    @property
    def cell_sample(self) -> CellSample:
        """The fields that represent a cell: means over its quadrature points.

        The mean internal variables of a cell and the strain at its centroid give a stress that is
        off the yield surface by up to the variation of both in the cell.
        """
        stress = self._stress_of_increment(self._increment, self._H)
        if not self.region.material.is_small_strain:
            F = ufl.Identity(3) + self._H
            stress = stress * F.T / ufl.det(F)
        psi = self._increment.stored + self._volume
        alpha = self._increment.alpha
        return CellSample(self._state.points, self._state.weights, stress, psi, alpha)

    @cached_property
    def _gradient_expression(self) -> fem.Expression:
        return compile_expression(
            ufl.as_vector([self._H[i, j] for i, j in np.ndindex(3, 3)]), self._state.points
        )

    def accept(self) -> None:
        """Update the internal variables by the radial return."""
        H = compat.evaluate_expression(
            self._gradient_expression, self.body.mesh, self.cells
        ).reshape(-1, 3, 3)
        state = self._state.values(self.cells)
        rows = state.reshape(-1, self._state.width)
        pairs = TENSOR_COMPONENTS[self.body.body_mesh.dim]
        tensor = np.zeros((len(rows), 3, 3))
        for k, (i, j) in enumerate(pairs):
            tensor[:, i, j] = tensor[:, j, i] = rows[:, k]
        accepted = accepted_state(
            self.region.material, H, tensor, rows[:, self._alpha_index], float(self._dt.value)
        )
        columns = [accepted.tensor[:, i, j] for i, j in pairs]
        columns.append(accepted.alpha)
        if state.shape[-1] > len(columns):
            columns.append(rows[:, self._alpha_index + 1] + accepted.viscous_work)
        self._state.set_values(self.cells, np.stack(columns, axis=1).reshape(state.shape))
        # Until the next increment begins, no time passes.
        self._dt.value = 0.0


class AcceptedState(NamedTuple):
    """Internal variables at the end of an increment, and the work of the overstress in it.

    Attributes
    ----------
    tensor : ndarray, (n, 3, 3)
        eps_p at small strain, C_p^-1 - 1 at finite strain.
    alpha : ndarray, (n,)
        Equivalent plastic strain.
    viscous_work : ndarray, (n,)
        Work per volume of the overstress in the increment [pressure].
    """

    tensor: np.ndarray
    alpha: np.ndarray
    viscous_work: np.ndarray


def accepted_state(
    material: Material, H: np.ndarray, tensor: np.ndarray, alpha: np.ndarray, dt: float = 0.0
) -> AcceptedState:
    """Return the internal variables at the end of an increment.

    Parameters
    ----------
    material : Material
        Law with plasticity, with numbers.
    H : ndarray, (n, 3, 3)
        Displacement gradient at the end of the increment.
    tensor : ndarray, (n, 3, 3)
        At the beginning of the increment, eps_p at small strain or C_p^-1 - 1 at finite strain.
    alpha : ndarray, (n,)
        Equivalent plastic strain at the beginning of the increment.
    dt : float
        Duration of the increment [time].
    """
    assert isinstance(material, YieldingLaw) and material.plasticity and material.E
    transposed = np.swapaxes(H, 1, 2)
    if material.is_small_strain:
        elastic_strain = (H + transposed) / 2 - tensor
        logs, axes = np.linalg.eigh(elastic_strain)
    else:
        F = np.eye(3) + H
        growth = H + transposed + H @ transposed
        a, axes = np.linalg.eigh(growth + F @ tensor @ np.swapaxes(F, 1, 2))
        logs = np.log1p(a) / 2
    deviator = logs - logs.mean(axis=1, keepdims=True)
    mu = material.shear_modulus
    q = mu * np.sqrt(6 * (deviator**2).sum(axis=1))
    increment = material.plasticity.flow_increment(q, alpha, mu, material.E, dt)
    d = increment.strain
    has_yielded = d > 0
    flow = (3 * mu * d / np.where(has_yielded, q, 1.0))[:, None] * deviator
    axes_transposed = np.swapaxes(axes, 1, 2)
    if material.is_small_strain:
        new_tensor = tensor + (axes * flow[:, None, :]) @ axes_transposed
    else:
        elastic_growth = (axes * np.expm1(2 * (logs - flow))[:, None, :]) @ axes_transposed
        inverse = np.linalg.inv(F)
        new_tensor = inverse @ (elastic_growth - growth) @ np.swapaxes(inverse, 1, 2)
    return AcceptedState(
        np.where(has_yielded[:, None, None], new_tensor, tensor), alpha + d, increment.viscous_work
    )
