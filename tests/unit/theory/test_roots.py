"""Roots of increasing functions, whose inverse is known."""

from __future__ import annotations

import math

import pytest

from indent_sim.theory.roots import increasing_root


@pytest.mark.parametrize("exponent", [0.3, 1.0, 2.0, 7.0])
@pytest.mark.parametrize("start", [1e-12, 0.5, 1e6, 1e30])
def test_power_laws(exponent: float, start: float) -> None:
    """The search ends at a relative error of 1e-13; powers of large numbers lose another digit."""
    root = increasing_root(lambda x: x**exponent, 5.0, start, 1e20)
    assert root == pytest.approx(5.0 ** (1.0 / exponent), rel=1e-12)


def test_limit_is_approached_but_not_reached() -> None:
    def depth(a: float) -> float:
        assert a < 1.0
        return -math.log1p(-a)

    # 1 - a = e^-8 has a relative error e^8 times that of a, 1e-13.
    assert 1.0 - increasing_root(depth, 8.0, 0.1, 1.0) == pytest.approx(math.exp(-8.0), rel=1e-9)
    with pytest.raises(ValueError, match="would grow to 1"):
        increasing_root(depth, 20.0, 0.1, 1.0)


def test_values_without_a_logarithm() -> None:
    """A function may be zero below its root."""
    assert increasing_root(lambda x: max(x - 1.0, 0.0), 0.5, 1e-3, 1e3) == pytest.approx(1.5)


@pytest.mark.parametrize("beyond", [math.inf, math.nan])
def test_values_that_are_no_numbers(beyond: float) -> None:
    """A function may have no value above its root."""
    root = increasing_root(lambda x: x if x < 2.0 else beyond, 1.5, 100.0, 1e3)
    assert root == pytest.approx(1.5, rel=1e-12)


def test_function_above_the_target_everywhere_is_refused() -> None:
    with pytest.raises(ArithmeticError, match="as small as"):
        increasing_root(lambda x: 1.0 + x, 0.5, 1.0, 10.0)
