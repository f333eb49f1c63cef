"""The strain energy of a material whose shear stress relaxes, while its bulk modulus does not.

With S = 2 mu dev eps and the strain eps, or at finite strain S = J^(2/3) F^-1 dpsi_shear/dF and
J^(-2/3) C/2 in its place (Simo 1987), the shear stress of G(t) = rest + sum g_k exp(-t/tau_k) is

    (rest + sum g_k) S - sum g_k A_k,    tau_k dA_k/dt = S - A_k.

Over a stage of length dt that sets out from S*, A_k*, with x = dt/tau_k,

    A_k = c_A A_k* + c_S S* + (1 - c_A - c_S) S,
    c_A = e^-x, c_S = (1 - e^-x)/x - e^-x    (S is straight in time; exact where it stands still)
    c_A = 1/(1 + x), c_S = 0                 (a stage of backward Euler, where fluid flows),

so that the stage has a potential, psi_shear (rest + sum g_k (c_A + c_S)) + h : eps + volume, in
which only a number and the tensor h = -sum g_k (c_A A_k* + c_S S*) change from one to the next. A_k
and S are kept at the points of the quadrature. Source: Simo (1987), Comput. Methods Appl. Mech.
Eng. 60, 153.

The share of the elastic shear stress that is left is ((rest + sum g_k) S - sum g_k A_k) : S/(S :
S), summed over these points, which are close together where the tip presses. The contact is as
stiff, and its edge is read off, as an elastic body of that share of the shear modulus has it: with
the modulus of the first moment `a` was 60 % too small where 1e-4 of it is left.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from indent_sim.fe import compat
from indent_sim.fe.discrete_body import VOLUME_DEGREE, Body
from indent_sim.fe.terms.strain_energy import StrainEnergy
from indent_sim.fe.terms.term import Stage
from indent_sim.mesh.model_domain import Region
from indent_sim.model.materials import Material, ShearRelaxingLaw

# Components of a symmetric tensor that a model has: those of (r, theta, z) or (x, y, z) with no
# shear along the second
TENSOR_COMPONENTS = {
    2: ((0, 0), (1, 1), (2, 2), (0, 2)),
    3: ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)),
}


class ViscoelasticStrainEnergy(StrainEnergy):
    """The virtual work of a region whose `relaxing` says how its shear stress falls.

    `energy` is the potential of the stage, which no elastic body has stored; psi [pressure] is what
    stays stored when all has relaxed.
    """

    has_memory = True

    def __init__(self, body: Body, region: Region):
        assert region.relaxation_series
        self._long_term_fraction, self._prony_weights, self._relaxation_times = (
            region.relaxation_series.long_term,
            *map(np.array, region.relaxation_series[1:]),
        )
        dim = body.body_mesh.dim
        degree = VOLUME_DEGREE[body.body_mesh.dim]
        self._points, self._weights = compat.quadrature_rule(compat.CELL_NAMES[dim], degree)
        width = len(TENSOR_COMPONENTS[dim])
        space = compat.function_space(body.mesh, compat.quadrature_element(dim, degree, width))
        means = compat.function_space(body.mesh, compat.cellwise_element(dim, width))
        self._shear_factor, self._long_term_factor = (
            fem.Constant(body.mesh, share) for share in (1.0, self._long_term_fraction)
        )
        self._stage_end_stresses: list[
            np.ndarray
        ] = []  # S and the A_k at the end of the last stage
        self._held_stress_fraction = (
            1.0  # share of the shear stress that a stage leaves where the strain stands still
        )
        self._h = fem.Function(space)
        self._mean_h = fem.Function(means)
        self._start_stress, *self._relaxed_stresses = (
            fem.Function(space) for _ in range(1 + len(self._prony_weights))
        )  # S*, and the A_k
        self.history = (self._start_stress, *self._relaxed_stresses)
        super().__init__(body, region)
        self.has_constant_tangent = False  # it changes with the length of a step
        self._point_dofs = compat.cell_dofs(space.dofmap)[self.cells]
        self.begin_stage(Stage(0.0))

    def _energy_densities(self, material: Material, H: Expr, q: Expr | None) -> tuple[Expr, Expr]:
        """The potential of a stage, with h at the points of the quadrature, and with its mean in a
        cell.
        """
        assert isinstance(material, ShearRelaxingLaw)
        shear, theta = material.isochoric_parts(H)
        # the meaning of q stays the same while the shear relaxes: it is the one of the body that
        # has relaxed
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
            elastic + _prestress_work(_symmetric_tensor(h), material, H, theta)
            for h in (self._h, self._mean_h)
        )
        return with_h, with_mean

    @cached_property
    def _shear_stress_expression(self) -> fem.Expression:
        dim = self.body.body_mesh.dim
        return fem.Expression(
            ufl.as_vector([self._elastic_shear_stress[i, j] for i, j in TENSOR_COMPONENTS[dim]]),
            self._points,
        )

    def _evaluate_shear_stress(self) -> np.ndarray:
        """S at the points of the quadrature, as the local array of a function; 0 outside the
        region.
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
        """Set out from S* and from A_k*, which lies beyond the first of two stages for the second."""
        accepted_stresses = [A.x.array for A in self._relaxed_stresses]
        stage_stresses = (
            self._stage_end_stresses[1:]
            if self._stage_end_stresses and stage.extrapolation_factor
            else accepted_stresses
        )
        self._start_relaxed_stresses = [
            old + stage.extrapolation_factor * (one - old)
            for old, one in zip(accepted_stresses, stage_stresses, strict=True)
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
        self._update_cell_means()
        self._stage_end_stresses = []
        self._held_stress_fraction = self._remaining_stress_fraction(
            self._start_stress.x.array, self._end_relaxed_stresses(self._start_stress.x.array)
        )
        self.E_star = self._relaxed_E_star(self._held_stress_fraction)

    def predict_modulus(self, start_depth: float, depth: float) -> None:
        """Take the modulus between that of a strain that stands still and that of a further step,
        by the share of the depth that is new: nothing is solved twice for it, and in a hold it
        is exact.
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
        """((rest + sum g_k) S - sum g_k A_k) : S/(S : S) over all points of the quadrature
        (collective); where nothing is strained that of a further step.

        Parameters
        ----------
        S : ndarray
            Elastic shear stress, as the local array of a function [pressure].
        relaxed : sequence of ndarray
            The A_k, likewise.
        """
        remaining = (self._long_term_fraction + sum(self._prony_weights)) * S - sum(
            g * A for g, A in zip(self._prony_weights, relaxed, strict=True)
        )
        pairs = TENSOR_COMPONENTS[self.body.body_mesh.dim]
        multiplicity = np.array(
            [1.0 if i == j else 2.0 for i, j in pairs]
        )  # a shear stands for two components
        owned_dofs = self._point_dofs  # the points of this rank's own cells
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
        """E* [pressure] of an elastic body of a share of the shear modulus, no less than when all
        has relaxed.
        """
        return self.region.material.relaxed_constants(
            max(shear_fraction, self._long_term_fraction)
        ).E_star

    def _update_cell_means(self) -> None:
        """The mean of h in every cell, by which a stress can be read off anywhere in it."""
        width = self._mean_h.function_space.dofmap.index_map_bs
        point_values = self._h.x.array.reshape(-1, width)[self._point_dofs]
        cells = compat.cell_dofs(self._mean_h.function_space.dofmap)[self.cells, 0]
        self._mean_h.x.array.reshape(-1, width)[cells] = np.tensordot(
            self._weights, point_values, (0, 1)
        ) / sum(self._weights)

    def end_stage(self, stage: Stage) -> None:
        """Find S and the A_k at the end of the stage."""
        S = self._evaluate_shear_stress()
        self._stage_end_stresses = [S, *self._end_relaxed_stresses(S)]
        self.E_star = self._relaxed_E_star(
            self._remaining_stress_fraction(S, self._stage_end_stresses[1:])
        )

    def _end_relaxed_stresses(self, S: np.ndarray) -> list[np.ndarray]:
        """The A_k at the end of the stage, where it leads to S."""
        stress_terms = zip(self._c_A, self._c_S, self._start_relaxed_stresses, strict=True)
        return [
            a * A + b * self._start_stress.x.array + (1 - a - b) * S for a, b, A in stress_terms
        ]

    def accept(self) -> None:
        """S and the A_k at the end of the step are those that the next one sets out from."""
        if not self._stage_end_stresses:
            S = self._evaluate_shear_stress()
            self._stage_end_stresses = [S, *self._end_relaxed_stresses(S)]
        for function, values in zip(self.history, self._stage_end_stresses, strict=True):
            function.x.array[:] = values


def _symmetric_tensor(h: fem.Function) -> Expr:
    """The tensor (3, 3) of its components."""
    pairs = TENSOR_COMPONENTS[h.function_space.mesh.topology.dim]
    number = {pair: k for k, pair in enumerate(pairs)} | {
        (j, i): k for k, (i, j) in enumerate(pairs)
    }
    return ufl.as_tensor(
        [[h[number[i, j]] if (i, j) in number else 0.0 for j in range(3)] for i in range(3)]
    )


def _prestress_work(h: Expr, material: ShearRelaxingLaw, H: Expr, theta: Expr) -> Expr:
    """h : eps, or h : J^(-2/3) C/2 by way of scalars, through which all derivatives can pass."""
    if material.is_small_strain:
        return ufl.inner(h, ufl.sym(H))
    F = ufl.Identity(3) + H
    return ufl.exp(-2 * theta / 3) * ufl.variable(ufl.inner(h, F.T * F) / 2)


def _integration_weights(stage: Stage, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """c_A and c_S of every term."""
    x = stage.dt / tau
    if stage.end_fraction < 1.0 or stage.extrapolation_factor:
        return 1 / (1 + x), 0.0 * x
    c_A = np.exp(-x)
    return c_A, np.where(x > 0, -np.expm1(-x) / np.where(x > 0, x, 1.0), 1.0) - c_A
