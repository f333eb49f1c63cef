"""Even polynomials are the kernel of a small contact."""

from __future__ import annotations

import math

import numpy as np
import pytest

from indent_sim.theory import layer as theory_layer
from indent_sim.theory import profiles, quadrature
from indent_sim.theory.hankel import EvenKernel, Kernel, axisymmetric_kernel, contact_kernel
from indent_sim.theory.layer import Layer
from indent_sim.theory.stack import Stack, StackLayer

STACKS = {
    "rubber": Stack((StackLayer(1.0, 1.0, 0.5),)),
    "a layer": Stack((StackLayer(1.0, 1.0, 0.3),)),
    "a half-space": Stack.half_space(1.0, 1.0),
    "a stiff film on a soft half-space": Stack(
        (StackLayer(1.0, 1000.0, 0.3), StackLayer(math.inf, 1.0, 0.4)), None
    ),
    "three layers": Stack(
        (StackLayer(1.0, 1.0, 0.5), StackLayer(0.1, 100.0, 0.3), StackLayer(3.0, 0.1, 0.4))
    ),
}
# Of the kernel's largest value: it is a sum of a hundred terms, of either sign, in both forms
ROUNDING = 1e-13


def values(kernel: Kernel | EvenKernel, x: np.ndarray, of: str) -> np.ndarray:
    """The kernel between places (n,), or how it changes with the second of them (n, n)."""
    return kernel.basis(x).T @ kernel.apply_weights(getattr(kernel, of)(x))


@pytest.mark.parametrize("a", [1e-5, 0.01, 0.3, 1.0])
@pytest.mark.parametrize("name", STACKS)
def test_even_polynomials_are_the_kernel(name, a):
    even, whole = (
        contact_kernel(a, STACKS[name], math.inf),
        axisymmetric_kernel(a, STACKS[name], math.inf),
    )
    assert isinstance(even, EvenKernel) and len(even.matrix) < 20  # of 86 cosines and more
    x = np.linspace(0.0, a, 30)
    size = np.abs(values(whole, x, "basis")).max()
    np.testing.assert_allclose(
        values(even, x, "basis"), values(whole, x, "basis"), atol=ROUNDING * size
    )
    for name, power in (("slope_over_x", 2), ("slope_integrals", 1)):
        found, expected = (values(kernel, x[1:], name) for kernel in (even, whole))
        np.testing.assert_allclose(found, expected, atol=ROUNDING * size / even.max_radius**power)


@pytest.mark.parametrize(("a", "wall"), [(5.0, math.inf), (0.3, 2.0)])
def test_a_wide_contact_and_one_between_walls_have_the_kernel_itself(a, wall):
    kernel = contact_kernel(a, STACKS["rubber"], wall)
    assert kernel is axisymmetric_kernel(a, STACKS["rubber"], wall)


@pytest.mark.parametrize("tip", [profiles.paraboloid(1.0), profiles.sphere(2.0)])
def test_a_contact_that_nearly_reaches_a_wall_is_solved_to_its_digits(tip, monkeypatch):
    """On twice as many points it is the same, one alone or with others; a system of modes would
    lose four digits.
    """
    layer, sizes = Layer.from_stack(tip, STACKS["rubber"], 1.2), np.array([0.9 * 1.2, 0.999 * 1.2])

    def numbers() -> np.ndarray:
        return layer.load_values(sizes, layer.linear_solutions(sizes.tolist(), sizes[-1]))

    known, alone = numbers(), [layer.solution_at_size(a) for a in sizes]
    rule = quadrature.gauss_legendre
    monkeypatch.setattr(theory_layer, "gauss_legendre", lambda lo, hi, n: rule(lo, hi, 2 * n))
    finer = numbers()
    depth, force, stiffness, _ = known / finer - 1.0
    assert np.abs([depth, stiffness]).max() < 1e-7  # 6e-9 was seen; by modes 5e-5
    assert (
        np.abs(force).max() < 1e-5
    )  # of a sealed body nearly filled, small beside stiffness times depth: 2e-6 was seen
    np.testing.assert_allclose([one.stiffness for one in alone], finer[2], rtol=1e-7)


def test_no_contact_has_a_kernel():
    """A search may begin there."""
    assert (
        Layer.from_stack(profiles.sphere(1.0), STACKS["rubber"])
        .linear_solution(0.0)
        .indentation_of_radius
        == 0.0
    )
