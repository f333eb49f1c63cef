"""No slip on a half-space: limits of its formulas, and values of an independent solution."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad

from indent_sim.theory.measured_constants import LAYER_FORCE_RATIOS, MAPPED_POISSON_RATIOS
from indent_sim.theory.no_slip import force_ratio, layer_force_range, radius_ratio

# Force without slip over the frictionless one: flat punch, cone, paraboloid, by superposed bonded
# punches on rings
RATIOS = {
    0.0: (1.098612, 1.045248, 1.052891),
    0.1: (1.074950, 1.035121, 1.040961),
    0.2: (1.051276, 1.024531, 1.028544),
    0.3: (1.028627, 1.013967, 1.016213),
    0.4: (1.009417, 1.004671, 1.005411),
    0.45: (1.002769, 1.001381, 1.001599),
}


@pytest.mark.parametrize("nu", RATIOS)
def test_against_rings(nu: float) -> None:
    """Force ratios are those of superposed bonded punches, to their six digits."""
    found = [force_ratio(nu, power) for power in (math.inf, 1.0, 2.0)]
    assert found == pytest.approx(RATIOS[nu], abs=6e-7)


def test_nu_0_under_a_punch_is_ln_3() -> None:
    assert force_ratio(0.0) == pytest.approx(math.log(3.0), rel=1e-14)


@pytest.mark.parametrize("power", [1.0, 2.0, 3.5, math.inf])
def test_incompressible_bodies_do_not_slip_anyway(power: float) -> None:
    assert force_ratio(0.5, power) == pytest.approx(1.0, rel=1e-12)
    assert force_ratio(0.5 - 1e-9, power) == pytest.approx(1.0, rel=1e-8)


def displacement_beside_punch(q: float, nu: float) -> float:
    """Relative depth W(q) of the surface at q >= 1 radii from the axis of a bonded flat punch.

    Spence's solution, with quadrature by scipy.
    """
    theta = math.log(3.0 - 4.0 * nu) / (2.0 * math.pi)
    factor = 4.0 * (1.0 - nu) / (math.pi * math.sqrt(3.0 - 4.0 * nu))

    def slope(y: float) -> float:
        """Integrand in y = artanh t, which keeps the digits of q^2 - t^2."""
        root = math.sqrt((q * q - 1.0) * math.cosh(y) ** 2 + 1.0)
        return math.cos(2.0 * theta * y) / (math.cosh(y) * root)

    integral, _ = quad(slope, 0.0, 40.0, epsabs=1e-14, epsrel=1e-13)
    return factor * integral


@pytest.mark.parametrize("nu", [-0.5, 0.0, 0.3, 0.49, 0.5])
def test_the_surface_beside_a_punch_begins_at_its_depth(nu: float) -> None:
    """The force ratio of a bonded punch gives the far displacement of its surface.

    W(1) = 1 for every nu, and far away W is that of the point force, u_z = (1 - nu) F/(2 pi mu r);
    at 100 radii the difference is 1e-4.
    """
    assert displacement_beside_punch(1.0, nu) == pytest.approx(1.0, rel=1e-12)
    far = 100.0
    point_force = (1 - nu) / (2 * math.pi) * 4 / (1 - nu) * force_ratio(nu) / far
    assert displacement_beside_punch(far, nu) == pytest.approx(point_force, rel=1e-4)


def test_a_high_power_is_a_punch() -> None:
    """Tips f = B r^n with a high power n approach the flat punch."""
    gaps = [force_ratio(0.0) - force_ratio(0.0, power) for power in (50.0, 100.0, 200.0)]
    assert np.all(np.diff(gaps) < 0)
    assert 0 < gaps[-1] < 0.01
    assert radius_ratio(0.0, 200.0) == pytest.approx(1.0, abs=5e-3)


@pytest.mark.parametrize(("nu", "power"), [(0.6, 2.0), (-1.0, 2.0), (math.nan, 2.0), (0.3, 0.5)])
def test_no_such_body(nu: float, power: float) -> None:
    with pytest.raises(ValueError):
        force_ratio(nu, power)


# Force without slip over the frictionless one on bonded layers beside the map's lines, by finite
# elements: where the effect is largest over the contact radius, where it is nearly nothing, and in
# the middle of cells
BESIDE = [
    (2.0, 0.49, 5.26, 1.396),
    (2.0, 0.49, 4.5, 1.401),
    (math.inf, 0.49, 4.5, 1.437),
    (1.0, 0.4, 2.21, 1.0172),
    (2.0, 0.36, 1.0, 0.9997),
    (2.0, 0.43, 0.6, 0.9998),
    (1.0, 0.38, 0.8, 0.9994),
    (math.inf, 0.4, 0.7, 1.0018),
    (2.0, 0.498, 8.5, 1.900),
    (2.0, 0.0, 0.2, 1.0594),
]


@pytest.mark.parametrize(("power", "nu", "slenderness", "solved"), BESIDE)
def test_a_cell_holds_what_lies_inside(
    power: float, nu: float, slenderness: float, solved: float
) -> None:
    low, high = layer_force_range(nu, slenderness, power) or (math.inf, -math.inf)
    assert low <= solved <= high


def test_the_map_begins_as_a_half_space_and_grows_with_the_tips_edge() -> None:
    """The map of layers begins at the half-space and grows from cone to paraboloid to punch.

    At a tenth of the thickness the base changes at most 0.0074. A punch gains about 2.2 times as
    much as a cone, and at most 0.011 beyond that.
    """
    for power, rows in LAYER_FORCE_RATIOS.items():
        known = [force_ratio(nu, power) for nu in MAPPED_POISSON_RATIOS]
        assert [row[0] for row in rows] == pytest.approx(known, abs=0.008)
    cone, paraboloid, punch = (
        np.array(LAYER_FORCE_RATIOS[power]) for power in (1.0, 2.0, math.inf)
    )
    assert np.all((cone >= 1.0) & (paraboloid >= cone) & (punch >= paraboloid))
    assert np.all(punch - 1.0 <= 2.2 * (cone - 1.0) + 0.012)


def test_a_layer_on_a_line_of_the_map_is_of_no_other() -> None:
    """At a tabulated nu the range of the map is not widened by the neighbouring column.

    At nu = 0.3 a thick layer gains 1.6 %, as a half-space does, whatever it gains at nu = 0.
    """
    for nu in (0.3, 0.3 * (1 - 1e-12), 0.3 * (1 + 1e-12)):
        low, high = layer_force_range(nu, 0.08, 2.0) or (0.0, math.inf)
        assert 1.01 < low < 1.0162 < high < 1.02
    low, high = layer_force_range(0.49, 5.0, math.inf) or (0.0, math.inf)
    assert high - low < 0.03 and low < LAYER_FORCE_RATIOS[math.inf][4][5] < high


@pytest.mark.parametrize(
    ("nu", "slenderness", "power"), [(0.3, 10.1, 2.0), (-0.1, 1.0, 2.0), (0.3, 1.0, 3.0)]
)
def test_beyond_the_map(nu: float, slenderness: float, power: float) -> None:
    assert layer_force_range(nu, slenderness, power) is None
