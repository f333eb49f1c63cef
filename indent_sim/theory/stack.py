"""Surface compliance of a stack of elastic layers in wavenumber space.

A pressure p of wavenumber k displaces the surface by w = (2/E*) L(k)/k p, > 0 into the body, with
E* of the top layer. L = 1 for a half-space, and M = 1 - L is the effect of everything below the top
layer. L is the same in axial symmetry (J0(kr)) and in plane strain (cos kx). With s = kz, the
amplitudes v = (U, V, T/(mu k), N/(mu k)) of u_r, u_z, sigma_rz, sigma_zz obey v' = A v in each
layer, with z pointing down; A has the double eigenvalues -1 and +1.

The compliance is propagated upwards from the base through each layer: by exp(-A s) where a layer is
thin (s < WAVE_THICKNESS), which loses no digits for k -> 0, and otherwise by waves that decay
downwards and their reflections, so that no term grows.

Sources: Thomson (1950), J. Appl. Phys. 21, 89; Kausel & Roesset (1981), Bull. Seismol. Soc. Am. 71,
1743; Burmister (1945), J. Appl. Phys. 16, 89, for the layered half-space.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from indent_sim.theory.half_space import E_star
from indent_sim.theory.solution import require_positive

BASE_SUPPORTS = ("fixed", "roller")
# The value of k h above which a layer is computed by reflected waves; both methods are accurate to
# 1e-15 between 0.3 and 3.
WAVE_THICKNESS = 1.0


class StackLayer(NamedTuple):
    """Layer of a stack: thickness [L], Young's modulus [F/L^2] and Poisson's ratio.

    A layer of infinite thickness is an elastic half-space.
    """

    thickness: float
    E: float
    nu: float


@dataclass(frozen=True)
class Stack:
    """Perfectly bonded elastic layers, listed from the top.

    Parameters
    ----------
    layers
        The layers; only the last one may have an infinite thickness (half-space).
    base
        Support of the last layer: "fixed" (bonded to a rigid base), "roller" (frictionless), or
        None if the last layer is a half-space.

    Raises
    ------
    ValueError
        Unless moduli and thicknesses are > 0, nu lies in [0, 0.5] and the base fits the last layer.
    """

    layers: tuple[StackLayer, ...]
    base: str | None = "fixed"

    def __post_init__(self) -> None:
        """Raise ValueError if a layer is invalid or the base does not fit the last layer."""
        if not self.layers:
            raise ValueError("a stack needs at least one layer")
        for number, (thickness, E, nu) in enumerate(self.layers, 1):
            half_space = 1 < number == len(self.layers) and thickness == math.inf
            require_positive(E=E, h=1.0 if half_space else thickness)
            if not 0.0 <= nu <= 0.5:
                raise ValueError(f"nu must lie in [0, 0.5], got {nu!r}")
        if self.is_bottomless and self.base is not None:
            raise ValueError(f"nothing lies below a half-space, but base is {self.base!r}")
        if not self.is_bottomless and self.base not in BASE_SUPPORTS:
            raise ValueError(f"base must be one of {BASE_SUPPORTS}, got {self.base!r}")

    @classmethod
    def half_space(cls, E_star: float, unit: float) -> Stack:
        """Return a homogeneous half-space with the modulus E*, as a stack.

        The result depends only on E*, so that nu = 0 is used. `unit` [L] is the unit of length,
        which should be of the order of a contact radius.
        """
        return cls((StackLayer(unit, E_star, 0.0), StackLayer(math.inf, E_star, 0.0)), None)

    @property
    def is_bottomless(self) -> bool:
        """True if the last layer is a half-space."""
        return self.layers[-1].thickness == math.inf

    @property
    def E_star(self) -> float:
        """E* of the top layer [F/L^2]."""
        return E_star(self.layers[0].E, self.layers[0].nu)

    @property
    def h(self) -> float:
        """Thickness of the top layer [L]."""
        return self.layers[0].thickness

    @property
    def height(self) -> float:
        """Total thickness of all layers above a half-space [L]."""
        return sum(layer.thickness for layer in self.layers if layer.thickness < math.inf)

    @property
    def confined_compliance(self) -> float:
        """Compliance E*/h sum h_i/E_oed,i under a uniform pressure, with the oedometric moduli.

        The compliance is 0 for incompressible layers.
        """
        compliance = sum(
            t * (1.0 + nu) * (1.0 - 2.0 * nu) / ((1.0 - nu) * E) for t, E, nu in self.layers
        )
        return self.E_star / self.h * compliance

    @property
    def min_wavenumber(self) -> float:
        """Wavenumber k [1/h] below which the compliance L(k) is a power of k.

        The ranges of k in which membrane, bending or substrate stiffness dominates lie above it.
        """
        moduli = [layer.E for layer in self.layers]
        return min(moduli) / max(moduli) * self.h / self.height

    def scaled(self, length: float, modulus: float) -> Stack:
        """Return the stack with all thicknesses and moduli multiplied by these factors."""
        return Stack(
            tuple(StackLayer(t * length, E * modulus, nu) for t, E, nu in self.layers), self.base
        )

    def scaled_by_top(self) -> Stack:
        """Return the stack in units of the thickness and modulus of its top layer."""
        top = self.layers[0]
        return Stack(
            tuple(StackLayer(t / top.thickness, E / top.E, nu) for t, E, nu in self.layers),
            self.base,
        )

    def scaled_wall_distance(self, distance: float | None) -> float:
        """Return the distance of side walls in thicknesses of the top layer; inf without walls.

        Raises
        ------
        ValueError
            If the distance is not > 0, or for walls around a half-space, which would have an
            infinite indentation depth.
        """
        if distance is not None and not distance > 0.0:
            raise ValueError(f"wall must be > 0 or None, got {distance!r}")
        if distance is None or math.isinf(distance):
            return math.inf
        if self.is_bottomless:
            raise ValueError(
                "a half-space between side walls has no finite indentation depth: give a base, or "
                "wall=None"
            )
        # Farther walls change the force by less than 1e-9.
        return distance / self.h if distance < 1e6 * self.height else math.inf

    def compliance_complement(self, k: np.ndarray) -> np.ndarray:
        """Return M(k) = 1 - L(k) [-] for an array of wavenumbers k > 0 [1/L]."""
        top = self.layers[0]
        layers = self.layers[:-1] if self.is_bottomless else self.layers
        states = np.broadcast_to(self._base_states(), (k.size, 4, 2)).copy()
        for layer in reversed(layers):
            shear = _shear_modulus(layer) / _shear_modulus(top)
            states[:, 2:] /= shear
            states[:, :2], excess = _compliance_at_top(layer, k * layer.thickness, states)
            states[:, :2] /= shear
            states[:, 2:] = np.eye(2)
        return excess[:, 1, 1] / (1.0 - top.nu)

    def _base_states(self) -> np.ndarray:
        """Return a basis (4, 2) of the states (rows U, V, T, N) that are possible at the base.

        Stresses are in units of the top layer's mu k.
        """
        if self.base == "fixed":
            return np.eye(4)[:, 2:]
        if self.base == "roller":
            return np.eye(4)[:, [0, 3]]
        waves = _wave_matrix(self.layers[-1].nu)[:, :2]
        waves[2:] *= _shear_modulus(self.layers[-1]) / _shear_modulus(self.layers[0])
        return waves


def _shear_modulus(layer: StackLayer) -> float:
    """Return mu = E/(2 (1 + nu)) [F/L^2]."""
    return layer.E / (2.0 * (1.0 + layer.nu))


def _compliance_at_top(
    layer: StackLayer, s: np.ndarray, state: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the compliance (T, N) -> (U, V) at a layer's top, and the excess over a half-space.

    `state` (n, 4, 2) is a basis of the states at the layer's bottom; both results are (n, 2, 2).
    """
    compliance = np.empty((s.size, 2, 2))
    excess = np.empty((s.size, 2, 2))
    is_thin = s < WAVE_THICKNESS
    half_space, excess[~is_thin] = _compliance_by_reflection(layer.nu, s[~is_thin], state[~is_thin])
    compliance[~is_thin] = half_space + excess[~is_thin]
    top = _transfer_matrix(layer.nu, s[is_thin]) @ state[is_thin]
    compliance[is_thin] = top[:, :2] @ _inverse_2x2(top[:, 2:])
    excess[is_thin] = compliance[is_thin] - half_space
    return compliance, excess


def _compliance_by_reflection(
    nu: float, s: np.ndarray, state: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the compliance of a half-space of this layer, and the effect of the layer's bottom."""
    waves = _wave_matrix(nu)
    down = waves[:, :2]
    up = waves[:, 2:]
    amplitudes = np.linalg.inv(waves) @ state
    propagator = np.exp(-s)[:, None, None] * (np.eye(2) + s[:, None, None] * np.eye(2, k=1))
    reflection = propagator @ amplitudes[:, 2:] @ _inverse_2x2(amplitudes[:, :2]) @ propagator
    half_space = down[:2] @ np.linalg.inv(down[2:])
    return half_space, (up[:2] - half_space @ up[2:]) @ reflection @ _inverse_2x2(
        down[2:] + up[2:] @ reflection
    )


def _wave_matrix(nu: float) -> np.ndarray:
    """Return the generalised eigenvectors x1, x2, y1, y2 of A (see the module) as columns.

    The waves x1 e^-s and (x2 + s x1) e^-s decay downwards, y1 e^s and (y2 - s y1) e^s upwards.
    """
    x1 = np.array([1.0, 1.0, -2.0, -2.0])
    x2 = np.array([0.0, 3.0 - 4.0 * nu, 4.0 * nu - 2.0, 4.0 * nu - 4.0])
    mirror = np.array([1.0, -1.0, -1.0, 1.0])
    return np.column_stack([x1, x2, mirror * x1, mirror * x2])


def _transfer_matrix(nu: float, s: np.ndarray) -> np.ndarray:
    """Return exp(-A s) for s < WAVE_THICKNESS, shape (len(s), 4, 4), by Hermite's polynomial in A.

    The formula has no differences of nearly equal terms.
    """
    q = nu / (1.0 - nu)
    c = (1.0 - 2.0 * nu) / (2.0 * (1.0 - nu))
    e = 1.0 + q
    m = 1.0 + 2.0 * q
    A = np.array([[0, 1, 1, 0], [-q, 0, 0, c], [2 * e, 0, 0, q], [0, 0, -1, 0]])
    A2 = np.array(
        [[2 + q, 0, 0, e / 2], [0, -q, -e / 2, 0], [0, 2 * e, 2 + q, 0], [-2 * e, 0, 0, -q]]
    )
    A3 = np.array([[0, 2 + q, 2 - c, 0], [-m, 0, 0, -q], [4 * e, 0, 0, m], [0, -2 * e, -2 - q, 0]])
    sinh = np.sinh(s)
    cosh = np.cosh(s)
    # The series of (s cosh s - sinh s)/2.
    cubic = sum(j * s ** (2 * j + 1) / math.factorial(2 * j + 1) for j in range(1, 10))
    factors = [cosh - 0.5 * s * sinh, 0.5 * (s * cosh - 3.0 * sinh), 0.5 * s * sinh, -cubic]
    return np.einsum("pk,pij->kij", factors, [np.eye(4), A, A2, A3])


def _inverse_2x2(matrix: np.ndarray) -> np.ndarray:
    """Return the inverses (n, 2, 2) of 2 x 2 matrices by cofactors, accurate for small entries."""
    (a, b), (c, d) = np.moveaxis(matrix, 0, -1)
    return np.moveaxis(np.array([[d, -b], [-c, a]]) / (a * d - b * c), -1, 0)
