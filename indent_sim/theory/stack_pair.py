"""Surface compliance of two elastic stacks that are pressed together without friction.

A pressure p of wavenumber k brings both surfaces together by
    w = (2/E_1* L_1 + 2/E_2* L_2)/k p = (2/E*) L/k p,   1/E* = 1/E_1* + 1/E_2*,
so that a pair is a stack with the modulus E* and, with M = 1 - L,
    M = E* (M_1/E_1* + M_2/E_2*).
All theories of a layer hold for the pair: the gap between two surfaces of small slope depends on
the sum of their displacements only. Source: Johnson, Contact Mechanics (1985), 4.1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from indent_sim.theory.stack import Stack


@dataclass(frozen=True)
class StackPair(Stack):
    """A stack, and a second one that is pressed onto it; both listed from the contact.

    The inherited attributes of `Stack` describe the first stack. The thickness of its top layer is
    the unit of length, and must not exceed that of the second stack's top layer: M(k) is integrated
    up to a wavenumber in this unit.

    Parameters
    ----------
    second : Stack
        The second stack.
    """

    second: Stack = field(kw_only=True)

    @classmethod
    def join(cls, first: Stack, second: Stack) -> StackPair:
        """Return the pair of two stacks, in the order of the thickness of their top layers."""
        if _top_thickness(second) < _top_thickness(first):
            first, second = second, first
        return cls(first.layers, first.base, second=second)

    @property
    def first(self) -> Stack:
        """The first stack alone."""
        return Stack(self.layers, self.base)

    @property
    def E_star(self) -> float:
        """Contact modulus 1/(1/E_1* + 1/E_2*) of both top layers [F/L^2]."""
        return 1.0 / (1.0 / self.first.E_star + 1.0 / self.second.E_star)

    @property
    def min_wavenumber(self) -> float:
        """Wavenumber k [1/h] below which the compliance L(k) is a power of k."""
        return min(self.first.min_wavenumber, self.second.min_wavenumber * self.h / self.second.h)

    def scaled_by_top(self) -> StackPair:
        """Return the pair in units of the thickness and modulus of the first top layer."""
        top = self.layers[0]
        second = self.second.scaled(1.0 / top.thickness, 1.0 / top.E)
        first = self.first.scaled_by_top()
        return StackPair(first.layers, first.base, second=second)

    def scaled_wall_distance(self, distance: float | None) -> float:
        """Return infinity, since a pair has no side walls; raise ValueError for a wall."""
        if distance is not None and not math.isinf(distance):
            raise ValueError("a pair of stacks has no side walls")
        return math.inf

    def compliance_complement(self, k: np.ndarray) -> np.ndarray:
        """Return M(k) = 1 - L(k) [-] for an array of wavenumbers k > 0 [1/L]."""
        first = self.first
        second = self.second
        return self.E_star * (
            first.compliance_complement(k) / first.E_star
            + second.compliance_complement(k) / second.E_star
        )


def _top_thickness(stack: Stack) -> float:
    """Return the thickness of the top layer [L]; infinity for a homogeneous half-space."""
    constants = {layer[1:] for layer in stack.layers}
    is_homogeneous = stack.is_bottomless and len(constants) == 1
    return math.inf if is_homogeneous else stack.h
