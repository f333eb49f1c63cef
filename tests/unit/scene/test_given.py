"""Problem setup: the relaxation of its material."""

from __future__ import annotations

import numpy as np
import pytest

from indent_sim.model.relaxation import PowerLaw, PronySeries, Relaxation
from indent_sim.scene.prescribed_history import prony_series


def modulus(law: PronySeries, t: np.ndarray) -> np.ndarray:
    """Modulus G(t)/G(0) of a Prony series."""
    parts = (g * np.exp(-t / tau) for g, tau in zip(law.fractions, law.times, strict=True))
    return law.long_term + sum(parts)


def test_terms_are_taken_as_they_are() -> None:
    law = prony_series(Relaxation(prony=((0.4, 0.1), (0.3, 1.0))), 1e-3, 1e3)
    assert law == (pytest.approx(0.3, rel=1e-15), (0.4, 0.3), (0.1, 1.0))


@pytest.mark.parametrize(("exponent", "time"), [(0.1, 1.0), (0.3, 0.01), (0.7, 5.0)])
def test_a_power_law_is_a_sum_of_exponentials(exponent: float, time: float) -> None:
    """A power law between two times is a sum of exponentials to 1e-5; 5e-6 was measured.

    All rates slower than both times are part of the long-term modulus.
    """
    t = np.geomspace(1e-3, 1e3, 61)
    law = prony_series(Relaxation(power_law=PowerLaw(exponent, time)), 1e-3, 1e3)
    assert modulus(law, t) == pytest.approx((t / time) ** -exponent, rel=1e-5)
    assert law.long_term >= 0 and min(law.fractions) > 0
