"""Hold, unloading, noise and works of synthetic curves, and the curves that are refused."""

from __future__ import annotations

import numpy as np
import pytest
from indentation_loops import FUSED_SILICA, STEEL, Loop, loop

from indent_sim.process.errors import UsageError
from indent_sim.results.measured.indentation_cycle import creep_rate, indentation_cycle, noise_of


def noisy(exact: Loop, scale: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    draw = np.random.default_rng(2)
    white = draw.standard_normal((2, len(exact.h)))
    return exact.h + 0.3 * scale * white[0], exact.F + 0.005 * scale * white[1]


@pytest.mark.parametrize("sample", [FUSED_SILICA, STEEL])
@pytest.mark.parametrize("scale", [0.0, 1.0, 5.0])
@pytest.mark.parametrize("hold_rows", [0, 60])
def test_unloading_starts_where_it_was_made(sample, scale: float, hold_rows: int) -> None:
    """The start is found to a few samples, that is 1 % of the force, at noises of 0 to 0.25 %."""
    exact = loop(sample, hold_rows=hold_rows)
    cycle = indentation_cycle(*noisy(exact, scale))
    start = 199 + hold_rows
    assert abs(cycle.start - start) <= 6 and cycle.end == len(exact.h)
    assert (cycle.hold_start is None) == (hold_rows == 0)
    # Five standard deviations of the noise of the row, and the few samples.
    assert cycle.h_max == pytest.approx(exact.h_max, rel=0.003, abs=1.5 * scale)
    assert cycle.F_max == pytest.approx(10.0, rel=0.01)


def test_creep_is_that_of_the_hold() -> None:
    """C_IT = (h_2 - h_1)/h_1; the first sample of the hold is one step of the ramp later."""
    cycle = indentation_cycle(*noisy(loop(FUSED_SILICA, creep=0.03), 0.0))
    assert cycle.creep == pytest.approx(0.03, rel=0.02)
    assert indentation_cycle(*noisy(loop(FUSED_SILICA, hold_rows=0), 0.0)).creep is None


def test_a_hold_of_few_samples_is_found() -> None:
    """Instruments that sample the ramps by depth write some ten samples of a hold of 10 s.

    Those here have 14 of 1200, and a thousandth of the largest force is a fifth of a step of the
    ramps. Ramps without a hold have no more samples near the peak than beside it.
    """
    exact = loop(FUSED_SILICA, rows=600, hold_rows=14, creep=0.01)
    cycle = indentation_cycle(exact.h, exact.F)
    assert cycle.hold_start is not None and cycle.start == 613
    assert cycle.h_max == pytest.approx(exact.h_max, rel=1e-9)
    assert cycle.creep == pytest.approx(0.01, rel=0.02)
    assert indentation_cycle(*noisy(loop(FUSED_SILICA, rows=600, hold_rows=0), 0)).creep is None


@pytest.mark.parametrize("rows", [100, 400, 2000])
def test_a_rounded_peak_is_no_hold(rows: int) -> None:
    """The force follows half a period of a sine; its peak is flat in a few per cent of the rows."""
    phase = np.linspace(0.0, np.pi, rows)
    force = np.sin(phase)
    depth = np.where(phase < np.pi / 2, force**0.5, 0.6 + 0.4 * force**0.7)
    assert indentation_cycle(depth, force).hold_start is None


def test_the_rate_of_creep() -> None:
    """The depth grows with the root of the time: 3 (1 - (2/3)^(1/2)) of the mean rate at the end.

    Unloading by 10 mN takes 10 s here.
    """
    exact = loop(FUSED_SILICA, creep=0.03, hold_rows=300)
    cycle = indentation_cycle(exact.h, exact.F)
    found = creep_rate(cycle, exact.t, cycle.upper_part(0.4, 0.98))
    mean_rate = (exact.h_max - exact.hold_start) / 15.0
    assert found is not None
    assert found.value == pytest.approx(3 * (1 - (2 / 3) ** 0.5) * mean_rate, rel=0.01)
    assert found.relative_stiffness == pytest.approx(found.value / 1.0, rel=1e-3)
    ramps = loop(FUSED_SILICA, hold_rows=0)
    assert creep_rate(indentation_cycle(ramps.h, ramps.F), ramps.t, slice(200, 300)) is None


def test_the_noise_is_found() -> None:
    """A tenth: three standard deviations of the estimate from 500 fourth differences."""
    h, F = noisy(loop(FUSED_SILICA))
    assert noise_of(h) == pytest.approx(0.3, rel=0.15)
    assert noise_of(F) == pytest.approx(0.005, rel=0.15)
    assert noise_of(h[:20]) == 0.0


def test_works_are_those_of_the_formulas() -> None:
    """W = F h/3 of the parabola and F (h_2 - h_1) of the hold; F (h_max - h_f)/(m + 1) returns."""
    exact = loop(FUSED_SILICA, rows=400)
    cycle = indentation_cycle(exact.h, exact.F)
    total = 10 * (exact.hold_start / 3 + exact.h_max - exact.hold_start)
    elastic = 10 * (exact.h_max - exact.h_f) / (FUSED_SILICA.m + 1)
    work = cycle.total_work
    assert work is not None and work.value == pytest.approx(total, rel=1e-4)
    assert cycle.unloading_work.value == pytest.approx(elastic, rel=1e-4)
    assert abs(work.value - total) <= 2 * work.error
    assert cycle.h_p == pytest.approx(exact.h_f)


def test_the_work_ends_where_the_force_vanishes() -> None:
    """Adhesion and the way out of contact are no work of unloading."""
    exact = loop(STEEL)
    h = np.append(exact.h, np.linspace(exact.h[-1], -50, 50)[1:])
    F = np.append(exact.F, np.linspace(0, -0.1, 50)[1:])
    cycle = indentation_cycle(h, F)
    without = indentation_cycle(exact.h, exact.F)
    assert cycle.unloading_work.value == pytest.approx(without.unloading_work.value, rel=1e-9)
    assert cycle.h_p == pytest.approx(without.h_p, rel=1e-9)


def test_unloading_alone_has_no_total_work() -> None:
    exact = loop(FUSED_SILICA)
    cycle = indentation_cycle(exact.h[300:], exact.F[300:])
    assert cycle.total_work is None and cycle.start == 0


def test_a_second_cycle_is_left_out() -> None:
    exact = loop(FUSED_SILICA)
    h = np.concatenate([exact.h, exact.h[200:]])
    F = np.concatenate([exact.F, 0.9 * exact.F[200:]])
    cycle = indentation_cycle(h, F)
    assert cycle.end == len(exact.h) and "the force rises again" in cycle.notes[0]


def relaxing(exact: Loop, fall: float) -> tuple[np.ndarray, np.ndarray]:
    """The depth is held instead of the force, which falls by a fraction."""
    h, F = exact.h.copy(), exact.F.copy()
    h[200:300] = h[199]
    h[300:] -= exact.h_max - h[199]
    F[200:300] = F[199] * (1 - fall * np.linspace(0, 1, 100))
    F[300:] *= 1 - fall
    return h, F


REFUSED = {
    "no unloading": (lambda x: (x.h[:300], x.F[:300]), "has no unloading"),
    "pulls": (lambda x: (x.h, -x.F), "largest force is -?0"),
    "goes out": (lambda x: (-x.h, x.F), "largest depth is -"),
    "no force": (lambda x: (x.h, 0 * x.F), "largest force is 0"),
    "force is noise": (
        lambda x: (x.h, np.random.default_rng(0).standard_normal(len(x.h))),
        "force .* is not above its noise",
    ),
    "depth is noise": (
        lambda x: (x.h + 60 * np.random.default_rng(0).standard_normal(len(x.h)), x.F),
        "depth .* is not above its noise",
    ),
    "relaxes": (lambda x: relaxing(x, 0.1), "force falls by 1.* while the depth"),
    "nose": (
        lambda x: (x.h + np.where(x.t > 15, 30 * np.exp(-((x.t - 16.5) ** 2)), 0), x.F),
        "force falls by .* while the depth",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_curve_without_an_unloading_is_refused(name: str) -> None:
    change, problem = REFUSED[name]
    with pytest.raises(UsageError, match=problem):
        indentation_cycle(*change(loop(FUSED_SILICA)))


def test_a_small_relaxation_is_accepted() -> None:
    """One per cent of the force is less than the stiffness of the fitted part can feel."""
    indentation_cycle(*relaxing(loop(FUSED_SILICA), 0.01))


def test_a_peak_before_the_deepest_row_is_no_relaxation() -> None:
    """Noise of 0.5 % makes an earlier row the largest; a metal recovers by 2 % of the depth."""
    h = np.concatenate([np.linspace(0.0, 1.0, 300), 1.0 - 0.02 * np.linspace(0.0, 1.0, 200)])
    F = np.concatenate([h[:300] ** 2, np.linspace(1.0, 0.0, 200) ** 1.3])
    F[296] = 1.001
    noise = 2e-3 * np.random.default_rng(0).standard_normal(len(F))
    noise[296] = 0.0
    cycle = indentation_cycle(h, np.minimum(F + noise, 1.001))
    assert cycle.start == 296 and cycle.end == 500


def test_unloading_must_reach_the_fitted_part() -> None:
    cycle = indentation_cycle(*noisy(loop(FUSED_SILICA, last=0.6), 0.0))
    assert len(cycle.h[cycle.upper_part(0.7, 0.98)]) > 50
    with pytest.raises(
        UsageError, match="ends at 60% of the largest force, but it is to be fitted down to 40%"
    ):
        cycle.upper_part(0.4, 0.98)
