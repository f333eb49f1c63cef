"""Stacks of layers against values of other solutions, limits and conservation laws."""

import math
from itertools import pairwise

import numpy as np
import pytest
from theory_bodies import stack_of

from indent_sim.theory import half_space as hs
from indent_sim.theory import hankel, profiles, quadrature, strip
from indent_sim.theory import layer as theory_layer
from indent_sim.theory.layer import Layer
from indent_sim.theory.stack import Stack, StackLayer
from indent_sim.theory.strip import Strip

INF = math.inf
HARD = [
    stack_of([(1, 1, 0.5), (1, 1e3, 0.3), (3, 1e-3, 0.499)]),
    stack_of([(1, 1, 0.3), (0.2, 1e3, 0.5), (3, 1, 0.5)], "roller"),
    stack_of([(1, 1e3, 0.5), (INF, 1, 0)], None),
    stack_of([(0.02, 1e-3, 0.5), (1, 1, 0.3), (INF, 1e-3, 0.45)], None),
]
# L of HARD at k = 1e-4, 1e-2, 0.3, 2: Love's function in every layer, one dense system solved with
# 120 digits
WAVENUMBERS = np.array([1e-4, 1e-2, 0.3, 2.0])
L_120_DIGITS = [
    (0.00119690686054737863, 0.124207586211014312, 0.245526630521339133, 0.642037182407001487),
    (0.0000434783255688266877, 0.00436228960491931183, 0.347480103484382179, 0.780902590440231321),
    (1263.03933642269386, 1006.52367021886829, 178.955338435080563, 1.70599446177379469),
    (1.06201395262141354, 1.05389035645940087, 0.215304203113867762, 0.00204235019267652053),
]
# film (thickness 1, nu 0.3) on a half-space (E 1, nu 0.3), flat punch: E_f, a, F/(2 a E*_f delta)
# to eight decimals
FILM = [
    (0.1, 0.1, 1.08354347),
    (0.1, 1.0, 2.13517569),
    (0.1, 5.0, 5.11384660),
    (0.5, 1.0, 1.39853545),
    (2.0, 1.0, 0.65688323),
    (10.0, 0.1, 0.68072162),
    (10.0, 1.0, 0.20879868),
    (10.0, 5.0, 0.12655336),
]
TIPS = {
    "paraboloid": profiles.paraboloid(1.0),
    "sphere": profiles.sphere(1.0),
    "cone": profiles.cone(65.0),
    "punch": profiles.flat_punch(0.4),
    "rounded cone": profiles.cone(60.0, 0.1),
    "points": profiles.piecewise_linear([[0, 0], [0.1, 0.01], [0.3, 0.1], [1, 1]]),
}


def film(E, base_E=1.0, nu=0.3):
    return stack_of([(1, E, nu), (INF, base_E, 0.3)], None)


def integral(f, edges, count=80):
    """int f dr over panels, with nodes crowded towards the ends of every one."""
    u, w = np.polynomial.legendre.leggauss(count)
    u, w = 0.5 * (1.0 + u), 0.5 * w
    t, dt = u**2 * (3.0 - 2.0 * u), 6.0 * u * (1.0 - u)
    return sum(
        float(np.sum(w * dt * (hi - lo) * f(lo + (hi - lo) * t))) for lo, hi in pairwise(edges)
    )


def clear_caches():
    """Forget all kernels and modes that were computed before."""
    for module in (hankel, strip):
        for value in vars(module).values():
            if hasattr(value, "cache_clear"):
                value.cache_clear()


@pytest.fixture
def refined(monkeypatch):
    """Double the nodes of every quadrature, and extend it to smaller and larger wavenumbers."""

    def refine():
        finest = Stack.min_wavenumber.fget
        rule = quadrature.gauss_legendre
        nodes = Strip._node_count
        for name, value in {
            "POINTS_PER_PANEL": 36,
            "POINTS_PER_PHASE": 1.2,
            "MAX_WAVENUMBER": 33.0,
            "SINGLE_MODES": 64,
        }.items():
            monkeypatch.setattr(quadrature, name, value)
        monkeypatch.setattr(Stack, "min_wavenumber", property(lambda self: 0.1 * finest(self)))
        monkeypatch.setattr(theory_layer, "gauss_legendre", lambda lo, hi, n: rule(lo, hi, 2 * n))
        monkeypatch.setattr(Strip, "_node_count", lambda self, a: 2 * nodes(self, a))
        clear_caches()

    yield refine
    monkeypatch.undo()
    clear_caches()


# --- the compliance ---


@pytest.mark.parametrize(("stack", "exact"), list(zip(HARD, L_120_DIGITS, strict=True)))
def test_compliance_against_120_digits(stack, exact):
    # M = 1 - L is what is kept: L is off by the rounding of 1, or by that of its own size times the
    # stiffness ratio
    exact = np.array(exact)
    assert 1.0 - stack.compliance_complement(WAVENUMBERS) == pytest.approx(
        exact, rel=1e-12, abs=3e-16
    )


@pytest.mark.parametrize("base", ["fixed", "roller"])
@pytest.mark.parametrize("nu", [0.0, 0.3, 0.4999, 0.5])
def test_layers_of_one_material_are_one_layer(base, nu):
    k = np.geomspace(1e-8, 30.0, 150)
    one = stack_of([(1, 2, nu)], base)
    for parts in [(0.5, 0.5), (0.02, 0.98), (0.3, 0.3, 0.4)]:
        split = stack_of([(part, 2, nu) for part in parts], base)
        assert split.compliance_complement(k) == pytest.approx(
            one.compliance_complement(k), abs=1e-15
        )
        assert split.confined_compliance * split.h == pytest.approx(one.confined_compliance)
        for tip in TIPS.values():
            several, single = (
                Layer.from_stack(tip, stack).solutions_at_depths([0.03])[0]
                for stack in (split, one)
            )
            assert several.force == pytest.approx(single.force, rel=1e-12)
            assert several.a == pytest.approx(single.a, rel=1e-12)
            # where a tip has corners, the Abel integral of its pressure is good to 1e-7
            rel = 1e-7 if tip.slope_discontinuities else 1e-9
            assert several.pressure(0.05) == pytest.approx(single.pressure(0.05), rel=rel)


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.5])
def test_layer_on_its_own_half_space(nu):
    k = np.geomspace(1e-8, 30.0, 150)
    stack = stack_of([(1, 3, nu), (0.5, 3, nu), (INF, 3, nu)], None)
    assert np.max(np.abs(stack.compliance_complement(k))) < 1e-15
    s = Layer.from_stack(profiles.paraboloid(1.0), stack).solutions_at_depths([0.04])[0]
    assert s.force == pytest.approx(hs.paraboloid_force(0.04, 1.0, hs.E_star(3.0, nu)), rel=1e-14)
    assert s.a == pytest.approx(0.2, rel=1e-14)


def test_both_ways_through_a_layer_agree(monkeypatch):
    # where k h is 0.5 ... 2 exp(-A s) and the waves both cross a layer; one loses e^(2s), the other
    # s^-3
    k = np.linspace(0.5, 2.0, 40)
    for base in ("fixed", "roller"):
        stack = stack_of([(1, 1, 0.5), (1, 1e3, 0.3), (1, 1e-2, 0.499)], base)
        monkeypatch.setattr("indent_sim.theory.stack.WAVE_THICKNESS", 0.0)
        thick = stack.compliance_complement(k)
        monkeypatch.setattr("indent_sim.theory.stack.WAVE_THICKNESS", 9.0)
        assert stack.compliance_complement(k) == pytest.approx(thick, rel=1e-9)


def test_very_thin_and_very_thick_films():
    k = np.array([1e-3, 0.1, 1.0])
    # thinner by 1e-10 than the wavelength, a film does nothing; thicker by 1e3, it is all there is
    thin = stack_of([(1e-9, 1, 0.3), (INF, 2, 0.4)], None)
    assert 1.0 - thin.compliance_complement(k) == pytest.approx(
        hs.E_star(1, 0.3) / hs.E_star(2, 0.4), rel=1e-8
    )
    thick = stack_of([(1e3, 1, 0.3), (1e3, 5, 0.4)])
    assert thick.compliance_complement(k[1:]) == pytest.approx(0.0, abs=1e-80)


# --- contacts ---


@pytest.mark.parametrize(("E", "a", "stiffness"), FILM)
def test_film_under_a_flat_punch(E, a, stiffness):
    s = Layer.from_stack(profiles.flat_punch(a), film(E)).solutions_at_depths([1e-3])[0]
    # half a unit of the last decimal
    assert s.force / (2 * a * hs.E_star(E, 0.3) * 1e-3) == pytest.approx(stiffness, abs=7e-9)
    assert s.stiffness == pytest.approx(s.force / 1e-3, rel=1e-14)


@pytest.mark.parametrize(
    ("E", "delta", "force"), [(0.1, 0.06934611, 0.17866338), (10.0, 0.23028302, 0.08706777)]
)
def test_film_under_a_paraboloid(E, delta, force):
    # R/t = 10, a/t = 1; delta was rounded to eight decimals
    s = Layer.from_stack(profiles.paraboloid(10.0), film(E)).solutions_at_depths([delta])[0]
    assert s.a == pytest.approx(1.0, abs=1e-7)
    assert s.force / E == pytest.approx(force, rel=2e-7)


@pytest.mark.parametrize(
    ("layers", "force", "a"),
    [
        ([(0.2, 1, 0.3), (0.8, 10, 0.4)], 8.1685143754e-03, 0.16902340),
        ([(0.2, 10, 0.3), (0.8, 1, 0.45)], 1.5984026851e-02, 0.10819224),
    ],
)
def test_stack_in_a_cylinder(layers, force, a):
    # bonded base, frictionless wall at 2, paraboloid R = 1, delta = 0.02: eleven and eight digits
    s = Layer.from_stack(profiles.paraboloid(1.0), stack_of(layers), wall=2.0).solutions_at_depths(
        [0.02]
    )[0]
    assert s.force == pytest.approx(force, rel=2e-11)
    assert s.a == pytest.approx(a, abs=6e-9)


BODIES = [
    (stack_of([(0.3, 1, 0.3), (0.7, 20, 0.45)]), None),
    (stack_of([(0.3, 20, 0.5), (0.7, 1, 0.2)], "roller"), None),
    (stack_of([(0.3, 1, 0.5), (0.7, 0.05, 0.5)]), 1.5),
    (stack_of([(0.3, 5, 0.0), (0.2, 1, 0.49), (INF, 0.5, 0.5)], None), None),
]


@pytest.mark.parametrize("name", TIPS)
@pytest.mark.parametrize(("stack", "wall"), BODIES)
def test_conservation(name, stack, wall):
    tip, delta, step = TIPS[name], 0.2, 1e-4
    less, s, more = Layer.from_stack(tip, stack, wall).solutions_at_depths(
        [delta * (1 - step), delta, delta * (1 + step)]
    )
    edges = [0.0, *(b for b in tip.slope_discontinuities if b < s.a), s.a]
    # the test's quadrature meets roots at the breaks, or a pressure that is infinite at the apex
    rel = 1e-4 if tip.slope_discontinuities else 1e-9
    assert 2 * math.pi * integral(lambda r: r * s.pressure(r), edges) == pytest.approx(
        s.force, rel=rel
    )
    work = -math.pi * integral(lambda r: r * s.pressure(r) * s.u_z(r), edges)
    assert work == pytest.approx(s.energy, rel=rel)
    assert Layer.from_stack(tip, stack, wall).depth_of_force(s.force) == pytest.approx(
        delta, rel=1e-9
    )
    # dPi/d delta = F and dF/d delta = K, by central differences
    assert (more.energy - less.energy) / (2 * step * delta) == pytest.approx(s.force, rel=1e-6)
    assert (more.force - less.force) / (2 * step * delta) == pytest.approx(s.stiffness, rel=1e-6)


def test_surface_outside_the_contact():
    # closed forms of the half-space: punch 2/pi delta arcsin(a/r), paraboloid (Johnson 1985, 3.42a)
    half_space = stack_of([(1, 1, 0.3), (INF, 1, 0.3)], None)
    r = np.array([0.5, 0.6, 1.0, 3.0, 50.0])
    punch = Layer.from_stack(profiles.flat_punch(0.5), half_space).solutions_at_depths([0.01])[0]
    assert punch.u_z(r) == pytest.approx(-0.02 / math.pi * np.arcsin(0.5 / r), rel=1e-12)
    assert punch.u_z(0.3) == pytest.approx(-0.01, rel=1e-14)
    ball = Layer.from_stack(profiles.paraboloid(1.0), half_space).solutions_at_depths([0.01])[0]
    exact = -((0.02 - r**2) * np.arcsin(0.1 / r) + 0.1 * np.sqrt(r**2 - 0.01)) / math.pi
    assert ball.u_z(r) == pytest.approx(exact, rel=1e-9)  # far away the closed form cancels


@pytest.mark.parametrize("name", TIPS)
@pytest.mark.parametrize(("stack", "wall"), BODIES)
def test_surface_inside_the_contact_is_the_tip(name, stack, wall):
    tip = TIPS[name]
    s = Layer.from_stack(tip, stack, wall).solutions_at_depths([0.2])[0]
    r = np.array([0.01, 0.3, 0.7, 0.999]) * s.a
    tangent, cot = 0.1 * math.cos(math.radians(60)), 1 / math.tan(math.radians(60))
    shapes = {
        "rounded cone": lambda r: np.where(
            r < tangent,
            0.1 - np.sqrt(np.maximum(0.01 - r**2, 0)),
            0.1 - tangent / cot + (r - tangent) * cot,
        ),
        "points": lambda r: np.interp(r, [0, 0.1, 0.3, 1], [0, 0.01, 0.1, 1]),
    }
    f = tip.f or shapes[name]
    assert s.u_z(r) == pytest.approx(f(r) - 0.2, abs=1e-14)


@pytest.mark.parametrize("nu", [0.3, 0.5])
def test_volume_between_walls_is_that_of_uniform_compression(nu):
    # only the mean pressure squeezes volume out: ∫ -u_z dA = F sum h_i/M_i, whatever the tip; none
    # at nu = 0.5
    stack, wall = stack_of([(0.3, 1, nu), (0.7, 5, nu)]), 2.0
    compliance = sum(h * (1 + n) * (1 - 2 * n) / (1 - n) / E for h, E, n in stack.layers)
    tip = profiles.paraboloid(1.0)
    s = Layer.from_stack(tip, stack, wall).solutions_at_depths([0.1])[0]
    volume = -2 * math.pi * integral(lambda r: r * s.u_z(r), [0, s.a, wall])
    assert volume == pytest.approx(s.force * compliance, rel=1e-10, abs=1e-11)
    line = Strip.from_stack(tip, stack, wall).solutions_at_depths([0.1])[0]
    assert -2 * integral(line.u_z, [0, line.a, wall]) == pytest.approx(
        line.force * compliance, rel=1e-10, abs=1e-11
    )
    assert np.isnan(s.u_z(2.1)) and np.isnan(line.u_z(2.1)) and math.isfinite(s.u_z(wall))


@pytest.mark.parametrize("Theory", [Layer, Strip])
@pytest.mark.parametrize("name", ["paraboloid", "cone", "punch", "sphere"])
@pytest.mark.parametrize("wall", [None, 2.0])
def test_surface_is_continuous_and_below_the_tip(Theory, name, wall):
    tip, delta = TIPS[name], 0.1
    s = Theory.from_stack(
        tip, stack_of([(0.3, 1, 0.3), (0.7, 20, 0.45)]), wall
    ).solutions_at_depths([delta])[0]
    inside, outside = s.a * (1 - 1e-9), s.a * (1 + 1e-9)
    assert s.u_z(inside) == pytest.approx(s.u_z(outside), rel=1e-4 if tip.punch_radius else 1e-7)
    r = np.linspace(s.a, min(tip.max_radius, 1.9), 40)[1:]
    assert tip.punch_radius or np.all(tip.f(r) - delta - s.u_z(r) > 0)  # the gap is open
    assert s.u_z(-r) == pytest.approx(s.u_z(r), rel=1e-15)


def test_far_walls_and_sums_over_many_modes(monkeypatch):
    stack, tip = stack_of([(0.02, 30, 0.3), (1, 1, 0.45)]), profiles.paraboloid(1.0)
    for Theory in (Layer, Strip):
        infinite, far = (
            Theory.from_stack(tip, stack, wall).solutions_at_depths([0.05])[0]
            for wall in (None, 50.0)
        )
        # bonded to a rigid base, what the wall returns has decayed by exp(-pi W/H) and better
        assert far.force == pytest.approx(infinite.force, rel=1e-11)
        assert far.u_z(np.array([0.1, 3.0])) == pytest.approx(
            infinite.u_z(np.array([0.1, 3.0])), abs=1e-12
        )
        assert (
            Theory.from_stack(tip, stack, 1e9).solutions_at_depths([0.05])[0].force
            == infinite.force
        )
    with monkeypatch.context() as every_mode:  # 17 500 of them, one by one
        every_mode.setattr(quadrature, "SINGLE_MODES", 10**9)
        clear_caches()
        direct = Layer.from_stack(tip, stack, 50.0).solutions_at_depths([0.05])[0].force
    clear_caches()
    assert Layer.from_stack(tip, stack, 50.0).solutions_at_depths([0.05])[0].force == pytest.approx(
        direct, rel=1e-12
    )


@pytest.mark.parametrize("wall", [1.0, 60.0, 2000.0])
def test_rule_for_sums_is_exact_for_polynomials(wall):
    n, w = quadrature.wall_mode_nodes(1.0, wall)
    every = np.arange(1, round(np.sum(w)) + 1)
    assert len(n) < len(every) or wall == 1.0
    for power in (0, 1, 7, 35):
        expected = np.sum((every / every[-1]) ** power)
        assert w @ (n / every[-1]) ** power == pytest.approx(expected, rel=1e-12)


def test_thin_compressible_stacks_are_springs_in_series():
    # punch of radius a >> H: F = pi a^2 delta/sum(h_i/M_i) inside, and an edge of width ~ H that
    # adds H/a
    layers = [(1.0, 1, 0.3), (1.0, 4, 0.1)]
    compliance = sum(h * (1 + n) * (1 - 2 * n) / (1 - n) / E for h, E, n in layers)
    excess = []
    for a in (25.0, 50.0, 100.0):
        force = (
            Layer.from_stack(profiles.flat_punch(a), stack_of(layers))
            .solutions_at_depths([1.0])[0]
            .force
        )
        excess.append(force * compliance / (math.pi * a**2) - 1.0)
    assert 0.0 < excess[2] < 0.03
    assert excess[0] / excess[1] == pytest.approx(2.0, rel=0.02)
    assert excess[1] / excess[2] == pytest.approx(2.0, rel=0.01)


def test_units_only_scale():
    layers = [(0.3, 1.0, 0.3), (0.7, 20.0, 0.45)]
    s = Layer.from_stack(profiles.sphere(1.0), stack_of(layers), 2.0).solutions_at_depths([0.1])[0]
    small = stack_of([(h * 1e-9, E * 1e12, nu) for h, E, nu in layers])
    nano = Layer.from_stack(profiles.sphere(1e-9), small, 2e-9).solutions_at_depths([1e-10])[0]
    assert nano.force == pytest.approx(s.force * 1e-6, rel=1e-12)
    assert nano.u_z(5e-10) == pytest.approx(s.u_z(0.5) * 1e-9, rel=1e-12)


# --- plane strain ---


@pytest.mark.parametrize("wall", [None, 2.0])
@pytest.mark.parametrize("base", ["fixed", "roller"])
def test_strips_of_one_material_are_one_strip(wall, base):
    for name in ("paraboloid", "cone", "punch"):
        stacks = stack_of([(0.2, 1, 0.4), (0.8, 1, 0.4)], base), stack_of([(1, 1, 0.4)], base)
        two, one = (
            Strip.from_stack(TIPS[name], stack, wall).solutions_at_depths([0.05])[0]
            for stack in stacks
        )
        # a wedge between walls leaves |q|^3 behind, which two units of length cut off differently
        rel = 1e-8 if name == "cone" else 1e-12
        assert two.force == pytest.approx(one.force, rel=rel)
        assert two.u_z(0.9) == pytest.approx(one.u_z(0.9), rel=10 * rel)


def test_stacked_strip_conserves():
    stack, delta, step = stack_of([(0.3, 1, 0.3), (0.7, 0.05, 0.5)]), 0.1, 1e-4
    for wall in (None, 2.0):
        less, s, more = Strip.from_stack(TIPS["paraboloid"], stack, wall).solutions_at_depths(
            [delta * (1 + i * step) for i in (-1, 0, 1)]
        )
        assert 2 * integral(s.pressure, [0, s.a]) == pytest.approx(s.force, rel=1e-9)
        assert (more.energy - less.energy) / (2 * step * delta) == pytest.approx(s.force, rel=1e-7)
        assert (more.force - less.force) / (2 * step * delta) == pytest.approx(
            s.stiffness, rel=1e-7
        )


# --- accuracy ---


CONTRASTS = (1e-3, 1e-2, 30.0, 1e3)
SIZES = [(size, contrast) for size in (0.05, 1.0, 10.0) for contrast in CONTRASTS] + [
    pytest.param(50.0, 1e-3, marks=pytest.mark.verify)
]


@pytest.mark.parametrize(("size", "contrast"), SIZES)
def test_twice_as_fine_is_the_same(refined, size, contrast):
    # a from 1/20 to 50 times the top layer's thickness, to 49 times the stack's; 1e-8 is claimed of
    # forces and depths
    tip = profiles.paraboloid(100.0)
    stacks = [
        stack_of([(1, contrast, 0.5), (0.3, 1, 0.3), (2, contrast, 0.0)]),
        stack_of([(1, contrast, 0.5), (0.02, 1, 0.5)]),
        stack_of([(1, contrast, 0.3), (20, 1, 0.5)], "roller"),
        stack_of([(1, contrast, 0.45), (INF, 1, 0.3)], None),
    ]

    def numbers():
        found = []
        for stack in stacks:
            for Theory in (Layer, Strip) if not stack.is_bottomless else (Layer,):
                for wall in (None, 3.0 * size) if not stack.is_bottomless else (None,):
                    contact = Theory.from_stack(tip, stack, wall)
                    s = contact.solution(contact.linear_solution(size).indentation_of_radius, size)
                    found += [s.delta, s.force, s.stiffness, s.energy]
        return np.array(found)

    coarse = numbers()
    refined()
    assert coarse == pytest.approx(numbers(), rel=1e-8)


# --- refusals ---


@pytest.mark.parametrize(
    ("plies", "base", "word"),
    [
        ([], "fixed", "at least one"),
        ([(1, 0, 0.3)], "fixed", "E must"),
        ([(0, 1, 0.3)], "fixed", "h must"),
        ([(1, 1, 0.6)], "fixed", "nu must"),
        ([(1, 1, 0.3)], None, "base must"),
        ([(1, 1, 0.3)], "glued", "base must"),
        ([(INF, 1, 0.3)], "fixed", "h must"),
        ([(1, 1, 0.3), (INF, 1, 0.3), (1, 1, 0.3)], "fixed", "h must"),
        ([(1, 1, 0.3), (INF, 1, 0.3)], "fixed", "below a half-space"),
        ([(1, math.nan, 0.3)], "fixed", "E must"),
    ],
)
def test_impossible_stacks_are_refused(plies, base, word):
    with pytest.raises(ValueError, match=word):
        stack_of(plies, base)


def test_half_space_has_no_walls_and_no_plane_depth():
    with pytest.raises(ValueError, match="no finite indentation depth"):
        Layer.from_stack(TIPS["paraboloid"], film(2.0), wall=5.0)
    with pytest.raises(ValueError, match="plane strain"):
        Strip.from_stack(TIPS["paraboloid"], film(2.0))


def test_ply_is_what_its_fields_say():
    assert stack_of([[1, 2, 0.3]]).layers == (StackLayer(thickness=1.0, E=2.0, nu=0.3),)


@pytest.mark.parametrize(
    "plies", [[(0.123, 3.68, 0.3), (0.877, 0.14, 0.2)], [(0.05, 100, 0.3), (INF, 1, 0.5)]]
)
def test_a_plate_bends_away_from_the_middle_of_a_punch(plies):
    # by the integral of the negative part of the pressure; none where the soft layer is the upper
    # one
    stack = stack_of(plies, None if plies[-1][0] == INF else "fixed")
    contact = Layer.from_stack(profiles.flat_punch(0.2), stack)
    found = contact.solutions_at_depths([0.05])[0]
    pulled = (
        -2
        * math.pi
        * integral(lambda r: r * np.minimum(found.pressure(r), 0), [0, 0.5 * found.a, found.a])
    )
    assert contact.tension_fraction(found) == pytest.approx(
        pulled / found.force, rel=0.02
    )  # 40 rings: 1 %
    soft = Layer.from_stack(
        profiles.flat_punch(0.2), stack_of([(h, 1 / E, nu) for h, E, nu in plies], stack.base)
    )
    assert soft.tension_fraction(soft.solutions_at_depths([0.05])[0]) == 0
