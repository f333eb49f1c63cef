"""Even polynomials are the kernel of a small contact."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import jv

from indent_sim.theory import hankel
from indent_sim.theory.hankel import EvenKernel, Kernel, axisymmetric_kernel, contact_kernel
from indent_sim.theory.stack import Ply, Stack

STACKS = {
    "rubber": Stack((Ply(1.0, 1.0, 0.5),)),
    "a layer": Stack((Ply(1.0, 1.0, 0.3),)),
    "a half-space": Stack.half_space(1.0, 1.0),
    "a stiff film on a soft half-space": Stack((Ply(1.0, 1000.0, 0.3), Ply(math.inf, 1.0, 0.4)), None),
    "three layers": Stack((Ply(1.0, 1.0, 0.5), Ply(0.1, 100.0, 0.3), Ply(3.0, 0.1, 0.4))),
}
# Of the kernel's largest value: it is a sum of a hundred terms, of either sign, in both forms
ROUNDING = 1e-13


def values(kernel: Kernel | EvenKernel, x: np.ndarray, of: str) -> np.ndarray:
    """The kernel between places (n,), or how it changes with the second of them (n, n)."""
    return kernel.basis(x).T @ kernel.applied(getattr(kernel, of)(x))


@pytest.mark.parametrize("a", [1e-5, 0.01, 0.3, 1.0])
@pytest.mark.parametrize("name", STACKS)
def test_even_polynomials_are_the_kernel(name, a):
    even, whole = contact_kernel(a, STACKS[name], math.inf), axisymmetric_kernel(a, STACKS[name], math.inf)
    assert isinstance(even, EvenKernel) and len(even.matrix) < 20  # of 86 cosines and more
    x = np.linspace(0.0, a, 30)
    size = np.abs(values(whole, x, "basis")).max()
    np.testing.assert_allclose(values(even, x, "basis"), values(whole, x, "basis"), atol=ROUNDING * size)
    for name, power in (("slope_over_x", 2), ("slope_integrals", 1)):
        found, expected = (values(kernel, x[1:], name) for kernel in (even, whole))
        np.testing.assert_allclose(found, expected, atol=ROUNDING * size / even.reach**power)


@pytest.mark.parametrize(("a", "wall"), [(5.0, math.inf), (0.3, 2.0)])
def test_a_wide_contact_and_one_between_walls_have_the_kernel_itself(a, wall):
    kernel = contact_kernel(a, STACKS["rubber"], wall)
    assert kernel is axisymmetric_kernel(a, STACKS["rubber"], wall)


def test_bessel_functions_are_those_of_scipy():
    """Also beside zeros of J_0, where the recurrence divides by nearly nothing."""
    x = np.concatenate([np.geomspace(1e-6, 44.0, 500), [2.404825557695773, 5.520078110286311]])
    orders = 2 * np.arange(hankel.MOST_EVEN)[:, None]
    found, expected = hankel._even_bessel(x, hankel.MOST_EVEN), jv(orders, x)
    np.testing.assert_allclose(found, expected, atol=1e-14)  # of J_0(0) = 1: ninety steps, each rounded
    small = np.broadcast_to(orders, expected.shape) > x  # there they have no zeros, and each has its own digits
    seen = small & (np.abs(expected) > 1e-290)
    np.testing.assert_allclose(found[seen], expected[seen], rtol=1e-12)
