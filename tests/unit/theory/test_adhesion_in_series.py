"""Two adhesive contacts in series, against the closed forms of Johnson, Kendall and Roberts."""

from __future__ import annotations

from math import inf, pi, sqrt

import numpy as np
import pytest

from indent_sim.theory.adhesion import Jkr
from indent_sim.theory.adhesion_in_series import JkrInSeries
from indent_sim.theory.layer import Layer
from indent_sim.theory.profiles import paraboloid
from indent_sim.theory.punches import LayerPunches
from indent_sim.theory.stack import Stack

E_STAR = 1.0
WORK = 1e-3
TIP_RADIUS, BASE_RADIUS = 0.25, 1.0
# Relative accuracy of the layer theory of a half-space.
EXACT = 1e-7


def half_space_jkr(radius: float, work: float) -> Jkr:
    contact = Layer.from_stack(paraboloid(radius), Stack.half_space(E_STAR, 1.0))
    return Jkr(LayerPunches(contact), work)


def in_series(work: float, base_work: float, shared_compliance: float = 0.0) -> JkrInSeries:
    upper = half_space_jkr(TIP_RADIUS, work)
    lower = half_space_jkr(BASE_RADIUS, base_work)
    return JkrInSeries(upper, lower, shared_compliance)


def closed_form(force: float, R: float, work: float, *, is_stable: bool = True) -> np.ndarray:
    """Return radius and approach of one contact: Johnson (1985), eq. 5.47 to 5.49."""
    root = sqrt(max(6 * pi * work * R * force + (3 * pi * work * R) ** 2, 0.0))
    cube = 0.75 * R / E_STAR * (force + 3 * pi * work * R + (root if is_stable else -root))
    a = cube ** (1 / 3)
    return np.array([a, a * a / R - sqrt(2 * pi * work * a / E_STAR)])


@pytest.mark.parametrize(("base_work", "is_base_weaker"), [(WORK, False), (0.2 * WORK, True)])
def test_the_contact_with_the_smaller_radius_times_work_is_lost(
    base_work: float, is_base_weaker: bool
) -> None:
    """The pull-off force is -3/2 pi R w of this contact, whatever the other one is."""
    jkr = in_series(WORK, base_work)
    assert jkr.is_base_weaker == is_base_weaker
    weaker = min(TIP_RADIUS * WORK, BASE_RADIUS * base_work)
    assert jkr.pull_off(inf).force == pytest.approx(-1.5 * pi * weaker, rel=EXACT)


@pytest.mark.parametrize("base_work", [WORK, 0.2 * WORK])
@pytest.mark.parametrize("fraction", [3.0, 0.0, -0.5, -0.9])
def test_approaches_add_up_at_one_force(base_work: float, fraction: float) -> None:
    """Both closed forms at one force, a fraction of the pull-off force."""
    jkr = in_series(WORK, base_work)
    force = -fraction * jkr.pull_off(inf).force
    contact = jkr.stable_equilibrium(force, inf)
    assert contact is not None
    upper = closed_form(force, TIP_RADIUS, WORK)
    lower = closed_form(force, BASE_RADIUS, base_work)
    assert contact.delta == pytest.approx(upper[1] + lower[1], rel=1e-6, abs=1e-9)
    assert jkr.radii(contact) == pytest.approx((upper[0], lower[0]), rel=1e-6)


@pytest.mark.parametrize("base_work", [WORK, 0.2 * WORK])
def test_pull_off_under_depth_control_is_the_smallest_depth(base_work: float) -> None:
    """The smallest sum on the branch on which the weaker contact is unstable under force control.

    The depth is sampled at 4000 forces; at its minimum the force is known to a few of them.
    """
    jkr = in_series(WORK, base_work)
    is_base_weaker = BASE_RADIUS * base_work < TIP_RADIUS * WORK
    forces = np.linspace(jkr.pull_off(inf).force * (1 - 1e-9), 0.0, 4000)
    depths = [
        closed_form(force, TIP_RADIUS, WORK, is_stable=is_base_weaker)[1]
        + closed_form(force, BASE_RADIUS, base_work, is_stable=not is_base_weaker)[1]
        for force in forces
    ]
    lowest = int(np.argmin(depths))
    pull_off = jkr.pull_off()
    assert pull_off.delta == pytest.approx(depths[lowest], rel=1e-5)
    assert pull_off.force == pytest.approx(forces[lowest], rel=0.01)


def test_a_shared_compliance_is_counted_once() -> None:
    """It shortens the depth by itself times the force, and leaves forces and radii alone."""
    plain, shared = (in_series(WORK, WORK, compliance) for compliance in (0.0, 0.1))
    force = 2e-3
    one, other = (jkr.stable_equilibrium(force, inf) for jkr in (plain, shared))
    assert one is not None
    assert other is not None
    assert one.delta - other.delta == pytest.approx(0.1 * force, rel=1e-6)
    assert other.a == pytest.approx(one.a, rel=1e-9)


def test_equal_contacts_are_lost_at_their_common_pull_off_force() -> None:
    jkr = in_series(WORK, WORK * TIP_RADIUS / BASE_RADIUS)
    assert jkr.pull_off(inf).force == pytest.approx(-1.5 * pi * TIP_RADIUS * WORK, rel=EXACT)
