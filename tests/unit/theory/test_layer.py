"""Axisymmetric layers against converged reference numbers, limits and conservation laws."""

import math
import time
from itertools import pairwise

import numpy as np
import pytest
from theory_bodies import indent, one_layer

from indent_sim.theory import half_space as hs
from indent_sim.theory import profiles
from indent_sim.theory.layer import Layer
from indent_sim.theory.quadrature import bessel_j1_zeros
from indent_sim.theory.stack import Stack, StackLayer

UNIT = {"E": 1.0, "h": 1.0}
PARABOLOID = profiles.paraboloid(1.0)
CONE, SPHERE, PUNCH = profiles.cone(70.0), profiles.sphere(1.0), profiles.flat_punch(0.5)

# E = 1, h = 1, R = 1: tip, delta, nu, base, wall, force, a, r/a, p(r); all digits are converged
REFERENCE = [
    (
        PARABOLOID,
        0.01,
        0.3,
        "fixed",
        None,
        1.60760232814e-03,
        1.03120191607e-01,
        0.0,
        7.218274346e-02,
    ),
    (
        PARABOLOID,
        0.01,
        0.3,
        "fixed",
        2.0,
        1.60793650804e-03,
        1.03127364087e-01,
        0.0,
        7.218770639e-02,
    ),
    (
        PARABOLOID,
        0.01,
        0.3,
        "fixed",
        4.0,
        1.60760947594e-03,
        1.03120344763e-01,
        0.0,
        7.218284999e-02,
    ),
    (
        PARABOLOID,
        0.01,
        0.4999,
        "fixed",
        2.0,
        2.01567242556e-03,
        1.04248508099e-01,
        0.0,
        8.855702682e-02,
    ),
    (
        PARABOLOID,
        0.01,
        0.3,
        "roller",
        2.0,
        1.58932137668e-03,
        1.02735304299e-01,
        0.0,
        7.189754636e-02,
    ),
    (SPHERE, 0.01, 0.3, "fixed", 2.0, 1.60605906926e-03, 1.02941079205e-01, 0.0, 7.222782689e-02),
    (CONE, 0.1, 0.3, "fixed", 2.0, 2.28262460711e-02, 1.90275390655e-01, 0.5, 2.642874524e-01),
    (PUNCH, 0.01, 0.3, "fixed", 2.0, 1.78766841375e-02, 0.5, 0.0, 1.248784742e-02),
]
# F/F_Hertz = 1 + c1 x + ... + O(x^5), x = sqrt(R delta)/h
SERIES = [
    (0.0, "fixed", (0.77098584, 0.69348902, 0.35999441, -0.03596131)),
    (0.3, "fixed", (0.87653259, 0.89636094, 0.57155512, 0.05180764)),
    (0.5, "fixed", (1.12695500, 1.48169883, 1.47000713, 1.00467768)),
    (0.1, "roller", (0.74330250, 0.64458172, 0.33991721, 0.00756611)),
    (0.5, "roller", (0.74330250, 0.64458172, 0.33991721, 0.00756611)),
]
KAPPA = [
    (1.0, 0.3, 2.48352),
    (1.0, 0.45, 3.09141),
    (1.0, 0.5, 3.61874),
    (4.0, 0.3, 8.17889),
    (4.0, 0.45, 14.66383),
    (4.0, 0.5, 31.52501),
]


def disc_integral(solution, breaks=()):
    """2 pi int p r dr, with nodes crowded towards the ends of every panel."""
    u, w = np.polynomial.legendre.leggauss(60)
    u, w = 0.5 * (1.0 + u), 0.5 * w
    t, dt = u**2 * (3.0 - 2.0 * u), 6.0 * u * (1.0 - u)
    total = 0.0
    for lo, hi in pairwise([0.0, *breaks, solution.a]):
        r = lo + (hi - lo) * t
        total += np.sum(w * dt * (hi - lo) * solution.pressure(r) * r)
    return 2.0 * math.pi * total


@pytest.mark.parametrize(("tip", "delta", "nu", "base", "wall", "force", "a", "at", "p"), REFERENCE)
def test_reference_numbers(tip, delta, nu, base, wall, force, a, at, p):
    s = indent(Layer, tip, delta, nu=nu, base=base, wall=wall, **UNIT)
    assert s.force == pytest.approx(force, rel=5e-12)
    assert s.a == pytest.approx(a, rel=6e-12)
    assert s.pressure(at * s.a) == pytest.approx(p, rel=2e-10)


@pytest.mark.parametrize(("nu", "base", "expected"), SERIES)
def test_small_depth_series(nu, base, expected):
    x = np.sort(0.15 * (1.0 + np.cos((np.arange(18) + 0.5) * math.pi / 18)))
    # each depth by itself: what polynomials between many of them round, the fit of degree 14 would
    # magnify
    contact = one_layer(Layer, PARABOLOID, nu=nu, base=base, **UNIT)
    forces = [contact.solutions_at_depths([delta])[0].force for delta in x**2]
    ratio = np.array(forces) / (4.0 / 3.0 * hs.E_star(1.0, nu) * x**3)
    c = np.polynomial.Polynomial.fit(x, ratio, 14).convert().coef
    assert c[0] == pytest.approx(1.0, abs=1e-9)
    # the fit, not the solution, limits the higher coefficients
    assert np.all(np.abs(c[1:5] - expected) < [1e-8, 2e-8, 1e-7, 2e-6])


@pytest.mark.parametrize(("a", "nu", "kappa"), KAPPA)
def test_flat_punch_table(a, nu, kappa):
    s = indent(Layer, profiles.flat_punch(a), 1e-3, nu=nu, **UNIT)
    assert s.force / (2.0 * hs.E_star(1.0, nu) * a * 1e-3) == pytest.approx(kappa, abs=6e-6)


@pytest.mark.parametrize(("nu", "error2", "error4"), [(0.3, 2.1e-4, 4.5e-6), (0.5, 4.4e-3, 1.6e-4)])
def test_wall_error(nu, error2, error4):
    # published to two digits, at a/h of about 0.1
    infinite, near, far = (
        indent(Layer, PARABOLOID, 0.01, nu=nu, wall=wall, **UNIT).force for wall in (None, 2.0, 4.0)
    )
    assert near / infinite - 1 == pytest.approx(error2, rel=0.08)
    assert far / infinite - 1 == pytest.approx(error4, rel=0.08)


@pytest.mark.parametrize("base", ["fixed", "roller"])
def test_limits(base):
    thick = indent(Layer, PARABOLOID, 0.01, E=1.0, nu=0.3, h=1e7, base=base)
    assert thick.force == pytest.approx(
        hs.paraboloid_force(0.01, 1.0, hs.E_star(1.0, 0.3)), rel=1e-7
    )
    assert thick.a == pytest.approx(0.1, rel=1e-7)
    infinite = indent(Layer, SPHERE, 0.2, nu=0.3, base=base, **UNIT).force
    far = indent(Layer, SPHERE, 0.2, nu=0.3, base=base, wall=50.0, **UNIT).force
    assert far == pytest.approx(infinite, rel=1e-12 if base == "fixed" else 1e-3)
    assert indent(Layer, SPHERE, 0.2, nu=0.3, base=base, wall=math.inf, **UNIT).force == infinite


@pytest.mark.parametrize(
    ("tip", "a", "pressure"),
    [
        (PARABOLOID, 0.1, lambda r, a: 2.0 / math.pi * np.sqrt(a**2 - r**2)),
        (
            profiles.cone(60.0),
            2.0 / math.pi * 0.01 * 3.0**0.5,
            lambda r, a: np.arccosh(a / r) / 2.0 / 3.0**0.5,
        ),
        (profiles.flat_punch(0.1), 0.1, lambda r, a: 0.01 / math.pi / np.sqrt(a**2 - r**2)),
    ],
    ids=["paraboloid", "cone", "punch"],
)
def test_pressures_of_a_half_space(tip, a, pressure):
    # a depth of 0.01 into E* = 1: Hertz 1882, Sneddon 1965; a layer of 1e7 is off by about a/h =
    # 1e-8
    s = indent(Layer, tip, 0.01, E=1.0, nu=0.0, h=1e7)
    assert s.a == pytest.approx(a, rel=1e-7)
    r = np.array([0.1, 0.5, 0.99]) * a
    assert s.pressure(r) == pytest.approx(pressure(r, a), rel=1e-6)


def test_confined_layer_tends_to_uniaxial_compression():
    # a flat punch that nearly fills its roller cylinder: F = M_c pi W^2 delta/h
    nu, W = 0.3, 1.0
    modulus = (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu))
    s = indent(Layer, profiles.flat_punch(0.9999 * W), 0.01, nu=nu, wall=W, **UNIT)
    assert s.force == pytest.approx(modulus * math.pi * W**2 * 0.01, rel=1e-3)


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.5])
@pytest.mark.parametrize("ratio", [1e-4, 1e-2, 1.0, 10.0])
@pytest.mark.parametrize("walled", [False, True])
def test_conservation_from_thick_to_very_thin(nu, ratio, walled):
    R = 100.0
    delta = ratio**2 / R
    body = {"nu": nu, "wall": 3.0 * ratio + 1.0 if walled else None, **UNIT}
    depths = [delta * (1 - 1e-4), delta, delta * (1 + 1e-4)]
    less, s, more = one_layer(Layer, profiles.paraboloid(R), **body).solutions_at_depths(depths)
    assert ratio <= s.a < 2.0 * ratio
    assert disc_integral(s) == pytest.approx(s.force, rel=1e-8)
    assert np.all(s.pressure(np.linspace(0.0, 1.2 * s.a, 25)) >= 0.0)
    assert (more.energy - less.energy) / (2e-4 * delta) == pytest.approx(s.force, rel=1e-6)
    assert (more.force - less.force) / (2e-4 * delta) == pytest.approx(s.stiffness, rel=1e-6)


def test_very_thin_incompressible_layer_follows_lubrication_theory():
    # flux -p' h^3/(3 mu) through a layer that slips at the top carries away delta - r^2/2R; p(a) =
    # p'(a) = 0: p = E (a^2 - r^2)^2/(32 R h^3), a^2 = 4 R delta, F = 2 pi/3 E R^2 (delta/h)^3
    R, delta = 1e4, 0.2
    s = indent(Layer, profiles.paraboloid(R), delta, nu=0.5, **UNIT)
    assert s.a == pytest.approx(math.sqrt(4.0 * R * delta), rel=0.02)
    assert s.force == pytest.approx(2.0 * math.pi / 3.0 * R**2 * delta**3, rel=0.01)
    assert s.pressure(0.0) == pytest.approx((4.0 * R * delta) ** 2 / (32.0 * R), rel=0.01)


def test_units_only_scale():
    s = indent(Layer, SPHERE, 0.1, nu=0.4, wall=2.0, **UNIT)
    nano = indent(Layer, profiles.sphere(1e-9), 1e-10, E=1e12, nu=0.4, h=1e-9, wall=2e-9)
    assert nano.force == pytest.approx(s.force * 1e12 * 1e-18, rel=1e-12)
    assert nano.a == pytest.approx(s.a * 1e-9, rel=1e-12)
    assert nano.pressure(0.0) == pytest.approx(s.pressure(0.0) * 1e12, rel=1e-11)
    assert nano.energy == pytest.approx(s.energy * 1e12 * 1e-27, rel=1e-12)


@pytest.mark.parametrize("wall", [None, 2.0])
def test_numerical_profiles_agree_with_closed_ones(wall):
    pairs = [
        (PARABOLOID, profiles.tip_from_slope(lambda r: r)),
        (SPHERE, profiles.tip_from_slope(lambda r: r / np.sqrt(1.0 - r * r), max_radius=1.0)),
        (
            CONE,
            profiles.piecewise_linear(
                [
                    [0, 0],
                    [0.05, 0.05 / math.tan(math.radians(70))],
                    [2.0, 2.0 / math.tan(math.radians(70))],
                ]
            ),
        ),
    ]
    for closed, numerical in pairs:
        a = indent(Layer, closed, 0.1, nu=0.3, wall=wall, **UNIT)
        b = indent(Layer, numerical, 0.1, nu=0.3, wall=wall, **UNIT)
        assert b.force == pytest.approx(a.force, rel=1e-12)
        assert b.pressure(0.1) == pytest.approx(a.pressure(0.1), rel=1e-10)


def test_tips_with_corners():
    r = np.linspace(0.0, 1.0, 11)
    s = indent(
        Layer, profiles.piecewise_linear(np.column_stack([r, r * r / 2])), 0.02, nu=0.3, **UNIT
    )
    assert disc_integral(s, [b for b in r[1:] if b < s.a]) == pytest.approx(s.force, rel=2e-6)
    rounded = indent(Layer, profiles.cone(70.0, 1e-4), 0.1, nu=0.3, **UNIT)
    assert rounded.force == pytest.approx(indent(Layer, CONE, 0.1, nu=0.3, **UNIT).force, rel=2e-4)
    assert math.isfinite(rounded.pressure(0.0))
    assert indent(Layer, CONE, 0.1, nu=0.3, **UNIT).pressure(0.0) == math.inf
    blunt = indent(Layer, profiles.flat_punch(0.5, 1e-3), 0.01, nu=0.3, **UNIT)
    sharp = indent(Layer, PUNCH, 0.01, nu=0.3, **UNIT)
    assert 0.499 < blunt.a < 0.5 and 0.997 < blunt.force / sharp.force < 1.0
    assert sharp.pressure(0.5) == math.inf


def test_many_points_converge_to_the_smooth_tip():
    exact = indent(Layer, PARABOLOID, 0.02, nu=0.3, **UNIT).force
    errors = []
    for count in (20, 80):
        r = np.linspace(0.0, 1.0, count + 1)
        chords = profiles.piecewise_linear(np.column_stack([r, r * r / 2]))
        errors.append(abs(indent(Layer, chords, 0.02, nu=0.3, **UNIT).force / exact - 1.0))
    assert errors[1] < errors[0] / 8.0


def test_curve_equals_single_depths_and_is_quick():
    depths = np.linspace(-0.001, 0.01, 12)
    one_layer(Layer, PARABOLOID, nu=0.3, wall=2.0, **UNIT).solutions_at_depths(
        depths
    )  # kernels cached, scipy imported
    start = time.perf_counter()
    curve = one_layer(Layer, PARABOLOID, nu=0.3, wall=2.0, **UNIT).solutions_at_depths(depths)
    assert time.perf_counter() - start < 0.5  # a few ms on an idle core
    for depth, s in zip(depths, curve, strict=True):
        assert s.delta == depth
        single = indent(Layer, PARABOLOID, depth, nu=0.3, wall=2.0, **UNIT)
        assert s.force == pytest.approx(single.force, rel=1e-12)
    assert (
        curve[0].force == 0.0 and curve[0].a == 0.0 and curve[0].pressure(np.zeros(3)).shape == (3,)
    )


def test_symbols():
    s = np.array([1e-9, 1e-3, 0.3, 2.0, 9.0])
    K = 3.0 - 4.0 * 0.3
    bonded = (2 * K * np.sinh(2 * s) - 4 * s) / (2 * K * np.cosh(2 * s) + 1 + K**2 + 4 * s**2)
    free = (np.cosh(2 * s) - 1) / (np.sinh(2 * s) + 2 * s)
    assert Stack((StackLayer(1.0, 1.0, 0.3),)).compliance_complement(s) == pytest.approx(
        1 - bonded, abs=1e-15
    )
    assert Stack((StackLayer(1.0, 1.0, 0.3),), "roller").compliance_complement(
        s[1:]
    ) == pytest.approx(1 - free[1:], abs=1e-12)
    from scipy.special import jn_zeros

    # The program takes the first 32 from scipy and the others from McMahon's expansion.
    assert bessel_j1_zeros(np.arange(1.0, 41.0)) == pytest.approx(jn_zeros(1, 40), rel=1e-14)


@pytest.mark.parametrize(
    "change",
    [
        {"E": 0.0},
        {"nu": 0.51},
        {"nu": -0.1},
        {"h": -1.0},
        {"base": "glued"},
        {"wall": 0.0},
        {"delta": math.nan},
        {"delta": 5.0, "wall": 1.0},
        {"tip": PUNCH, "wall": 0.5},
        {"tip": profiles.flat_punch(1e3)},
        {"tip": profiles.paraboloid(1e6), "delta": 1.0},
    ],
)
def test_nonsense_is_refused(change):
    arguments = {"tip": PARABOLOID, "delta": 0.01, "E": 1.0, "nu": 0.3, "h": 1.0, **change}
    with pytest.raises(ValueError):
        indent(Layer, **arguments)


@pytest.mark.parametrize(
    "make",
    [
        lambda: profiles.paraboloid(0.0),
        lambda: profiles.sphere(-1.0),
        lambda: profiles.cone(90.0),
        lambda: profiles.flat_punch(0.5, 0.6),
        lambda: profiles.piecewise_linear([[0, 0], [1, 1], [2, 1.5]]),
        lambda: profiles.piecewise_linear([[0.1, 0], [1, 1]]),
    ],
)
def test_impossible_tips_are_refused(make):
    with pytest.raises(ValueError):
        make()


def test_pressures_beside_several_kinks_make_the_force():
    """The pressure between several kinks of a tip integrates to the force.

    The quadrature here has 60 points per panel, which leaves 1e-7.
    """
    kinks = (0.03, 0.06, 0.09)
    tip = profiles.piecewise_linear(
        [[0.0, 0.0], [0.03, 0.001], [0.06, 0.005], [0.09, 0.012], [0.3, 0.3]]
    )
    found = Layer.from_stack(tip, Stack((StackLayer(1.0, 1.0, 0.3),), "fixed")).solutions_at_depths(
        [0.05]
    )[0]
    assert found.a > kinks[-1]
    assert disc_integral(found, kinks) == pytest.approx(found.force, rel=5e-7)


def test_curvatures_of_tip_and_body_add():
    """The curvatures of tip and spherical body add; a punch there is a plate up to its edge."""
    stack = Stack((StackLayer(1.0, 1.0, 0.3),), "fixed")
    known = Layer.from_stack(PARABOLOID, stack).solutions_at_depths([0.01])[0]
    for tip, dome in ((profiles.paraboloid(2.0), 2.0), (profiles.flat_plate(), 1.0), (PUNCH, 1.0)):
        found = Layer.from_stack(
            profiles.tip_over_spherical_body(tip, dome), stack
        ).solutions_at_depths([0.01])[0]
        assert (found.force, found.a) == pytest.approx((known.force, known.a), rel=1e-12)
        r = np.array([0.0, 0.5, 0.99, 1.5]) * known.a  # the surface, too, is pressed into one shape
        assert found.u_z(r) == pytest.approx(known.u_z(r), rel=1e-9)
    with pytest.raises(ValueError):
        Layer.from_stack(
            profiles.tip_over_spherical_body(profiles.flat_punch(0.05), 1.0), stack
        ).solutions_at_depths([0.01])


@pytest.mark.parametrize(
    "tip", [profiles.paraboloid(1.0), profiles.cone(70.0), profiles.flat_punch(0.2)]
)
def test_solutions_up_to_a_known_one_lie_on_the_curve(tip: profiles.Tip) -> None:
    """Contacts found by their size are those found by their depth, to the search's 1e-11."""
    contact = one_layer(Layer, tip, E=1.0, nu=0.3, h=0.5)
    (deepest,) = contact.solutions_at_depths([0.02])
    found = contact.solutions_up_to(deepest, 5)
    again = contact.solutions_at_depths([s.delta for s in found])
    assert found[-1].delta == pytest.approx(0.02, rel=1e-10)
    assert [s.force for s in found] == pytest.approx([s.force for s in again], rel=1e-10)
