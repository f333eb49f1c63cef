"""Viscoelastic strain energy: the shear stress relaxes, the bulk modulus does not.

Let S = 2 mu dev eps be the elastic shear stress at the strain eps; at finite strain S = J^(2/3)
F^-1 dpsi_shear/dF, and J^(-2/3) C/2 takes the place of eps (Simo 1987). For the relaxation function
G(t) = g_inf + sum g_k exp(-t/tau_k), relative to the shear modulus of the law, the shear stress is

    (g_inf + sum g_k) S - sum g_k A_k,    tau_k dA_k/dt = S - A_k.

Over a stage of length dt that starts from S*, A_k*, with x = dt/tau_k,

    A_k = c_A A_k* + c_S S* + (1 - c_A - c_S) S,
    c_A = e^-x, c_S = (1 - e^-x)/x - e^-x    if S is linear in time; exact for constant S,
    c_A = 1/(1 + x), c_S = 0                 for a stage of backward Euler, if fluid flows.

The stage thus has the potential

    psi_shear (g_inf + sum g_k (c_A + c_S)) + h : eps + psi_volume,

in which only the factor of psi_shear and the tensor h = -sum g_k (c_A A_k* + c_S S*) depend on the
stage. A_k and S are internal variables at the quadrature points. Source: Simo (1987), Comput.
Methods Appl. Mech. Eng. 60, 153.

The remaining fraction of the elastic shear stress is ((g_inf + sum g_k) S - sum g_k A_k) : S/(S :
S), with sums over all quadrature points, most of which are near the contact. The modulus E* that
corresponds to this fraction of the shear modulus scales the contact stiffness and the gap criterion
of the contact edge. If the initial modulus was used instead, the contact radius was 60 % too small
after relaxation to 1e-4 of the modulus.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from indent_sim.fe import compat
from indent_sim.fe.discrete_body import Body
from indent_sim.fe.kernel_cache import compile_expression
from indent_sim.fe.terms.quadrature_field import (
    TENSOR_COMPONENTS,
    QuadratureField,
    symmetric_tensor,
)
from indent_sim.fe.terms.strain_energy import StrainEnergy
from indent_sim.fe.terms.time_integration import Stage
from indent_sim.mesh.model_domain import Region
from indent_sim.model.materials import Material, ShearRelaxingLaw


class ViscoelasticStrainEnergy(StrainEnergy):
    """Incremental potential of a region whose shear stress relaxes.

    Attributes
    ----------
    energy : ufl.Form
        Potential of the stage; it is not a stored energy.
    psi : Expr
        Strain energy density that remains after complete relaxation [pressure].
    """

    has_memory = True

    def __init__(self, body: Body, region: Region):
        assert region.relaxation_series
        self._long_term_fraction, self._prony_weights, self._relaxation_times = (
            region.relaxation_series.long_term,
            *map(np.array, region.relaxation_series[1:]),
        )
        dim = body.body_mesh.dim
        # The prestress h of the stage.
        self._prestress = QuadratureField(body, len(TENSOR_COMPONENTS[dim]))
        self._h = self._prestress.function
        self._shear_factor, self._long_term_factor = (
            fem.Constant(body.mesh, share) for share in (1.0, self._long_term_fraction)
        )
        # S and the A_k at the end of the last stage
        self._stage_end_stresses: list[np.ndarray] = []
        # Remaining fraction of the shear stress at the end of a stage with constant strain
        self._held_stress_fraction = 1.0
        # S* and the A_k of the accepted state
        self._start_stress, *self._relaxed_stresses = (
            fem.Function(self._h.function_space) for _ in range(1 + len(self._prony_weights))
        )
        self.history = (self._start_stress, *self._relaxed_stresses)
        super().__init__(body, region)
        self.has_constant_tangent = False  # it depends on the length of a step
        self._point_dofs = compat.cell_dofs(self._h.function_space.dofmap)[self.cells]
        self.begin_stage(Stage(0.0))

    def _energy_densities(self, material: Material, H: Expr, q: Expr | None) -> tuple[Expr, Expr]:
        """Return the stage's potential density, for the prestress at points and as cell means."""
        assert isinstance(material, ShearRelaxingLaw)
        shear, theta = material.isochoric_parts(H)
        # The field q is defined by the relaxed body, so that its meaning does not change in time
        volume = (
            theta**2 / (2 * material.inverse_bulk_modulus)
            if q is None
            else material.mixed_volumetric_energy(H, theta, q, self._long_term_factor)
        )
        P = ufl.diff(shear, H)
        self._elastic_shear_stress = (
            P
            if material.is_small_strain
            else ufl.exp(2 * theta / 3) * ufl.inv(ufl.Identity(3) + H) * P
        )
        self.psi = self._long_term_fraction * shear + volume
        elastic = self._shear_factor * shear + volume
        with_h, with_mean = (
            elastic
            + _prestress_work(symmetric_tensor(h, self.body.body_mesh.dim), material, H, theta)
            for h in (self._h, self._prestress.mean)
        )
        return with_h, with_mean

    @cached_property
    def _shear_stress_expression(self) -> fem.Expression:
        dim = self.body.body_mesh.dim
        return compile_expression(
            ufl.as_vector([self._elastic_shear_stress[i, j] for i, j in TENSOR_COMPONENTS[dim]]),
            self._prestress.points,
        )

    def _evaluate_shear_stress(self) -> np.ndarray:
        """Return the elastic shear stress at the quadrature points as a local array.

        It is 0 outside the region.
        """
        values: np.ndarray = np.zeros_like(self._h.x.array)
        width = self._h.function_space.dofmap.index_map_bs
        components = compat.evaluate_expression(
            self._shear_stress_expression, self.body.mesh, self.cells
        )
        values.reshape(-1, width)[self._point_dofs] = components.reshape(
            *self._point_dofs.shape, width
        )
        return values

    def begin_stage(self, stage: Stage) -> None:
        """Compute the relaxed stresses, the prestress and the shear factor at the start of a stage.

        The relaxed stresses of the second stage of SDIRK2 are extrapolated from the result of the
        first stage.
        """
        accepted_stresses = [A.x.array for A in self._relaxed_stresses]
        stage_stresses = (
            self._stage_end_stresses[1:]
            if self._stage_end_stresses and stage.extrapolation_factor
            else accepted_stresses
        )
        self._start_relaxed_stresses = [
            accepted_stress + stage.extrapolation_factor * (stage_stress - accepted_stress)
            for accepted_stress, stage_stress in zip(accepted_stresses, stage_stresses, strict=True)
        ]
        self._c_A, self._c_S = _integration_weights(stage, self._relaxation_times)
        self._shear_factor.value = self._long_term_fraction + self._prony_weights @ (
            self._c_A + self._c_S
        )
        self._h.x.array[:] = -(self._prony_weights @ self._c_S) * self._start_stress.x.array
        for weight, A in zip(
            self._prony_weights * self._c_A, self._start_relaxed_stresses, strict=True
        ):
            self._h.x.array[:] -= weight * A
        self._prestress.update_means(self.cells)
        self._stage_end_stresses = []
        self._held_stress_fraction = self._remaining_stress_fraction(
            self._start_stress.x.array, self._end_relaxed_stresses(self._start_stress.x.array)
        )
        self.E_star = self._relaxed_E_star(self._held_stress_fraction)

    def predict_modulus(self, start_depth: float, depth: float) -> None:
        """Predict `E_star` at the end of a step, without an additional solution.

        The modulus is interpolated between its values for constant strain and for a newly strained
        body, according to the relative increase of the depth. During a hold the prediction is
        exact.
        """
        new_depth = abs(depth - start_depth)
        kept_depth = abs(start_depth)
        if new_depth + kept_depth > 0:
            shear_fraction = (
                self._held_stress_fraction * kept_depth
                + float(self._shear_factor.value) * new_depth
            ) / (new_depth + kept_depth)
            self.E_star = self._relaxed_E_star(shear_fraction)

    def _remaining_stress_fraction(self, S: np.ndarray, relaxed: Sequence[np.ndarray]) -> float:
        """Fraction of the elastic shear stress that remains after relaxation (collective).

        The fraction is ((g_inf + sum g_k) S - sum g_k A_k) : S/(S : S), with sums over all
        quadrature points. In an unstrained region, the fraction for a strain imposed now is
        returned.

        Parameters
        ----------
        S : ndarray
            Elastic shear stress, as the local array of a function [pressure].
        relaxed : sequence of ndarray
            The A_k, as local arrays [pressure].
        """
        remaining = (self._long_term_fraction + sum(self._prony_weights)) * S - sum(
            g * A for g, A in zip(self._prony_weights, relaxed, strict=True)
        )
        pairs = TENSOR_COMPONENTS[self.body.body_mesh.dim]
        # A shear component occurs twice in a symmetric tensor
        multiplicity = np.array([1.0 if i == j else 2.0 for i, j in pairs])
        owned_dofs = self._point_dofs
        elastic_values, remaining_values = (
            values.reshape(-1, len(pairs))[owned_dofs] for values in (S, remaining)
        )
        local_sums = np.array(
            [
                np.sum(multiplicity * remaining_values * elastic_values),
                np.sum(multiplicity * elastic_values * elastic_values),
            ]
        )
        work, norm_squared = self.body.comm.allreduce(local_sums)
        return float(work / norm_squared) if norm_squared > 0 else float(self._shear_factor.value)

    def _relaxed_E_star(self, shear_fraction: float) -> float:
        """Plane-strain modulus E* of a partly relaxed body [pressure].

        The fraction of the shear modulus is at least the long-term fraction g_inf.
        """
        return self.region.material.relaxed_constants(
            max(shear_fraction, self._long_term_fraction)
        ).E_star

    def end_stage(self, stage: Stage) -> None:
        """Evaluate the shear stress, its relaxed parts and `E_star` at the end of the stage."""
        S = self._evaluate_shear_stress()
        self._stage_end_stresses = [S, *self._end_relaxed_stresses(S)]
        self.E_star = self._relaxed_E_star(
            self._remaining_stress_fraction(S, self._stage_end_stresses[1:])
        )

    def _end_relaxed_stresses(self, S: np.ndarray) -> list[np.ndarray]:
        """Return the relaxed stresses at the end of a stage with the elastic shear stress S."""
        stress_terms = zip(self._c_A, self._c_S, self._start_relaxed_stresses, strict=True)
        return [
            a * A + b * self._start_stress.x.array + (1 - a - b) * S for a, b, A in stress_terms
        ]

    def accept(self) -> None:
        """Store the shear stress and its relaxed parts at the end of the step."""
        if not self._stage_end_stresses:
            S = self._evaluate_shear_stress()
            self._stage_end_stresses = [S, *self._end_relaxed_stresses(S)]
        for function, values in zip(self.history, self._stage_end_stresses, strict=True):
            function.x.array[:] = values


def _prestress_work(h: Expr, material: ShearRelaxingLaw, H: Expr, theta: Expr) -> Expr:
    """Work of the prestress h per volume: h : eps, at finite strain h : J^(-2/3) C/2.

    The finite-strain form uses scalar UFL variables, see `terms.variation`.
    """
    if material.is_small_strain:
        return ufl.inner(h, ufl.sym(H))
    F = ufl.Identity(3) + H
    return ufl.exp(-2 * theta / 3) * ufl.variable(ufl.inner(h, F.T * F) / 2)


def _integration_weights(stage: Stage, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients c_A and c_S of every Prony term with relaxation times tau [time]."""
    x = stage.dt / tau
    if stage.end_fraction < 1.0 or stage.extrapolation_factor:
        return 1 / (1 + x), 0.0 * x
    c_A = np.exp(-x)
    return c_A, np.where(x > 0, -np.expm1(-x) / np.where(x > 0, x, 1.0), 1.0) - c_A
