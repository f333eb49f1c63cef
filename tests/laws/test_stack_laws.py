"""The laws of linear contact hold for random stacks, tips and depths."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from theory_bodies import stack_of

from indent_sim.theory import profiles
from indent_sim.theory.layer import Layer
from indent_sim.theory.strip import Strip

LAWS = settings(
    deadline=None,
    database=None,
    derandomize=True,
    max_examples=60,
    suppress_health_check=list(HealthCheck),
)
MODULI = st.floats(-1.5, 1.5).map(lambda x: 10.0**x)  # contrasts up to 1e3
RATIOS = st.sampled_from([0.0, 0.3, 0.45, 0.4999, 0.5]) | st.floats(0.0, 0.5)
PLIES = st.lists(
    st.tuples(st.floats(-1.7, 0.5).map(lambda x: 10.0**x), MODULI, RATIOS), min_size=1, max_size=5
)
SUBSTRATES = st.tuples(st.just(math.inf), MODULI, RATIOS)
FINITE = st.builds(stack_of, PLIES, st.sampled_from(["fixed", "roller"]))
STACKS = FINITE | st.builds(lambda plies, last: stack_of([*plies, last], None), PLIES, SUBSTRATES)
SIZES = st.floats(-1.3, 1.3).map(lambda x: 10.0**x)  # contact radius over the top layer's thickness
WALLS = st.none() | st.floats(1.2, 30.0)  # over the contact radius
SMOOTH = {
    "paraboloid": lambda a: profiles.paraboloid(10 * a),
    "cone": lambda a: profiles.cone(80.0),
    "sphere": lambda a: profiles.sphere(2 * a),
}
TIPS = st.sampled_from([*SMOOTH, "punch"])


def contact(kind, stack, name, size, wall):
    """A contact of random layers whose radius is near `size`, and three neighbouring depths."""
    a = size * stack.h
    wall = None if wall is None or stack.is_bottomless else wall * a
    assume(
        wall is None or wall > 0.2 * stack.height
    )  # in a deep narrow well the body's own spring is all there is
    tip = profiles.flat_punch(a) if name == "punch" else SMOOTH[name](a)
    theory = kind.from_stack(tip, stack, wall)
    delta = a if name == "punch" else theory.linear_solution(size).indentation_of_radius * stack.h
    return theory, [delta * (1 - 2e-5), delta, delta * (1 + 2e-5)]


@LAWS
@given(STACKS, TIPS, SIZES, WALLS)
def test_energy_force_and_stiffness_are_derivatives(stack, name, size, wall):
    theory, depths = contact(Layer, stack, name, size, wall)
    less, s, more = theory.solutions_at_depths(depths)
    step = depths[2] - depths[0]
    # Central differences of the step 2e-5: 4e-10 times the third derivative, of which 200 were
    # seen, and a rounding of 1e-12 over the step.
    assert (more.energy - less.energy) / step == pytest.approx(s.force, rel=1e-6)
    assert (more.force - less.force) / step == pytest.approx(s.stiffness, rel=1e-6)
    assert s.a == pytest.approx(size * stack.h, rel=1e-8)
    assert less.a <= s.a <= more.a and less.force < s.force < more.force


@LAWS
@given(FINITE, TIPS, SIZES, WALLS)
def test_strips_have_the_same_laws(stack, name, size, wall):
    theory, depths = contact(Strip, stack, name, size, wall)
    less, s, more = theory.solutions_at_depths(depths)
    step = depths[2] - depths[0]
    assert (more.energy - less.energy) / step == pytest.approx(s.force, rel=1e-6)
    assert (more.force - less.force) / step == pytest.approx(s.stiffness, rel=1e-6)


@LAWS
@given(STACKS, st.sampled_from(list(SMOOTH)), SIZES, WALLS)
def test_pressure_pushes_and_carries_the_force(stack, name, size, wall):
    theory, depths = contact(Layer, stack, name, size, wall)
    s = theory.solutions_at_depths(depths[1:2])[0]
    u, w = np.polynomial.legendre.leggauss(100)
    u, w = 0.5 * (1.0 + u), 0.5 * w
    r, dr = s.a * u**2 * (3.0 - 2.0 * u), s.a * 6.0 * u * (1.0 - u)
    p = s.pressure(r)
    assert np.all(p >= -1e-9 * s.force / s.a**2)
    assert 2.0 * math.pi * np.sum(w * dr * r * p) == pytest.approx(s.force, rel=1e-7)
    # Clapeyron: the work of the pressure on the surface it pushes is twice the strain energy
    assert -math.pi * np.sum(w * dr * r * p * s.u_z(r)) == pytest.approx(s.energy, rel=1e-7)


@LAWS
@given(STACKS, st.floats(1.01, 10.0), st.integers(0, 4), SIZES)
def test_a_stiffer_layer_makes_a_stiffer_stack(stack, factor, which, size):
    # the strain energy at given displacements grows with every modulus
    plies = list(stack.layers)
    h, E, nu = plies[which % len(plies)]
    plies[which % len(plies)] = (h, factor * E, nu)
    tip = profiles.flat_punch(size * stack.h)
    soft, stiff = (
        Layer.from_stack(tip, stack_of(layers, stack.base)).solutions_at_depths([1.0])[0]
        for layers in (stack.layers, plies)
    )
    assert soft.force * (1 - 1e-9) <= stiff.force <= factor * soft.force * (1 + 1e-9)


@LAWS
@given(STACKS, st.floats(0.05, 0.95), st.integers(0, 4), SIZES)
def test_a_cut_inside_a_layer_changes_nothing(stack, share, which, size):
    plies = list(stack.layers)
    at = which % len(plies)
    h, E, nu = plies[at]
    assume(math.isfinite(h))
    plies[at : at + 1] = [(share * h, E, nu), ((1 - share) * h, E, nu)]
    k = np.geomspace(1e-4, 20.0, 30) / stack.h
    scale = 1.0 + np.abs(stack.compliance_complement(k))  # M rounds as 1 or as L does
    assert np.all(
        np.abs(
            stack_of(plies, stack.base).compliance_complement(k) - stack.compliance_complement(k)
        )
        < 3e-13 * scale
    )
