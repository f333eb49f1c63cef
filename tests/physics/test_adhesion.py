"""Adhesion with a range: an independent solution, energy, loading and unloading, 3D."""

from __future__ import annotations

import random
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import E_STAR, WALLED, meshed, scene, solve
from scipy.special import ellipe, ellipk

from indent_sim.config.scene_file import load
from indent_sim.fe import solver
from indent_sim.model.adhesion import Adhesion
from indent_sim.model.state import State
from indent_sim.run.error_estimation.coarser_run import CoarserRun, coarser_scene
from indent_sim.run.error_estimation.error_bars import ErrorBars
from indent_sim.run.pipeline import states
from indent_sim.scene.scene import resolve
from indent_sim.studies.study_file import read as read_study
from indent_sim.theory.maugis import LAMBDA_PER_TABOR, maugis_pull_off

# 2000 contact radii thick and wide: a half-space to a few hundredths of a per cent
THICK = {"shape": "cylinder", "radius": 200.0, "height": 200.0, "base": "fixed", "sides": "roller"}
WORK = 1e-4
DEPTH = (pi * WORK / E_STAR) ** (2 / 3)  # of JKR's equations, at R = 1
LOOSE = {"adhesion": {"work": 1e-2, "range": 5e-2}}  # Maugis' lambda 1 at R = E = 1


def reach(parameter: float) -> float:
    """Range of an adhesion with the work WORK and a Maugis lambda, under a paraboloid of R = 1."""
    return float((WORK**2 / (E_STAR**2 * (parameter / LAMBDA_PER_TABOR) ** 3)) ** (1 / 3))


def attracted(parameter: float, *depths: float) -> Any:
    adhesion = {"work": WORK, "range": reach(parameter)}
    return solve(
        scene(
            THICK, contact={"adhesion": adhesion}, loading={"deltas": [d * DEPTH for d in depths]}
        )
    )


def on_rings(
    law: Adhesion, depths: list[float], rings: int = 100, inside: float = 0.08, ranges: float = 10
) -> list[float]:
    """Forces over pi work R of a paraboloid on a half-space, by rings of constant pressure.

    Newton's method; the rings end where the gap is so many ranges. A disc of unit pressure and
    radius b displaces by (4/(pi E*)) b E(r/b) inside and by (4/(pi E*)) r (E(b/r) - (1 - b^2/r^2)
    K(b/r)) outside (Johnson, Contact Mechanics, 3.4).
    """
    assert law.range
    far = max((2 * ranges * law.range) ** 0.5, 2 * inside)
    outside = inside * (far / inside) ** np.linspace(0, 1, rings // 2 + 1)[1:]
    edges = np.concatenate([np.linspace(0, inside, rings + 1), outside])
    r, area = 0.5 * (edges[1:] + edges[:-1]), pi * np.diff(edges**2)
    discs = np.array([_disc(r, b) for b in edges[1:]]).T
    C = discs - np.column_stack([np.zeros_like(r), discs[:, :-1]])
    n, one, stiff = len(r), np.eye(len(r)), E_STAR / edges[1]
    x, found = np.zeros(2 * n), []
    for depth in depths:
        for _ in range(100):
            q, lam = x[:n], x[n:]
            g = r**2 / 2 - depth + C @ q
            p, pull = lam - stiff * g, law.attraction(g)
            on, slope = (p > 0)[:, None], np.where(g > 0, -pull / law.range, 0.0)[:, None]
            residual = np.concatenate([q - np.maximum(p, 0.0) + pull, lam - np.maximum(p, 0.0)])
            if np.abs(residual).max() < 1e-12:
                break
            tangent = np.block(
                [[one + (on * stiff + slope) * C, -one * on], [on * stiff * C, one * ~on]]
            )
            x = x - np.linalg.solve(tangent, residual)
        found.append(float(x[:n] @ area) / (pi * law.work))
    return found


def _disc(r: np.ndarray, b: float) -> np.ndarray:
    k2 = np.where(r < b, r / b, b / r) ** 2
    outside = r * (ellipe(k2) - (1 - k2) * ellipk(k2))
    return 4 / (pi * E_STAR) * np.where(r < b, b * ellipe(k2), outside)


def test_the_force_is_that_of_rings_on_a_half_space() -> None:
    """The adhesive force is that of rings on a half-space, to 0.2 %.

    Depths lie near the largest pull and beyond first contact. The finite body contributes 0.05 %, a
    hundred rings 0.1 %.
    """
    depths = [0.3, 0.0, -0.4]
    expected = on_rings(Adhesion(WORK, reach(1.0)), [d * DEPTH for d in depths])
    found = [state.force / (pi * WORK) for state in attracted(1.0, *depths)]
    assert found == pytest.approx(expected, rel=2e-3)


def test_the_error_bar_holds_where_the_force_passes_zero() -> None:
    """The force is a compressive part less the adhesive force, and its error is that of both.

    Where they cancel, the error bar still contains the independent solution by rings, and is below
    0.2 % of pi work R, a third of the adhesive force. 200 and 400 rings differ by 1e-4 of it, a
    seventh of the bar.
    """
    depth = 0.957 * DEPTH
    adhesion = {"work": WORK, "range": reach(1.0)}
    base = scene(THICK, contact={"adhesion": adhesion}, loading={"deltas": [depth]})
    ratio, coarse_scene = coarser_scene(base)
    coarse = CoarserRun(ratio, solve(coarse_scene), coarse_scene)
    row = ErrorBars(base, coarse, None, None).add_error_estimate(solve(base)[0])
    (exact,) = on_rings(Adhesion(WORK, reach(1.0)), [depth], rings=400)
    unit = pi * WORK
    assert row.force_error is not None
    assert abs(row.force / unit) < 0.02
    assert abs(row.force / unit - exact) < row.force_error / unit < 2e-3


def largest_pull(depths: list[float], forces: list[float]) -> float:
    """Minimum of a parabola through three rows."""
    least = np.polynomial.Polynomial.fit(depths, forces, 2)
    return float(least(least.deriv().roots()[0]))


@pytest.mark.parametrize(
    ("parameter", "about", "pull"),
    [
        pytest.param(
            0.5, -0.43, -1.7974, marks=pytest.mark.verify
        ),  # the force near it is that of rings above
        pytest.param(1.0, -0.42, -1.6829, marks=pytest.mark.verify),
        pytest.param(2.0, -0.39, -1.5872, marks=pytest.mark.verify),
    ],
)
def test_pull_off_of_an_exponential_attraction(parameter: float, about: float, pull: float) -> None:
    """The pull-off of an exponential attraction is that of rings, and beyond a constant one's.

    The largest pull of a parabola through three rows is compared with 400 rings out to a gap of ten
    ranges, to 0.3 %; fewer rings or a wider surface change them by 1e-4.
    """
    depths = [about + 0.1, about, about - 0.1]
    rows = attracted(parameter, *depths)
    deepest = largest_pull(depths, [row.force / (pi * WORK) for row in rows])
    assert deepest == pytest.approx(pull, rel=3e-3)
    assert -2.0 < deepest < maugis_pull_off(parameter)


@pytest.mark.verify
def test_the_exact_pull_off_of_the_scoreboard_is_that_of_rings() -> None:
    """The exact pull-off of the scoreboard is that of rings, to 1e-5.

    200 and 400 rings differ by 7e-6. The published value there is Maugis'.
    """
    path = (
        Path(__file__).resolve().parents[2]
        / "configs"
        / "studies"
        / "verification"
        / "published.yaml"
    )
    case = next(one for one in read_study(path).named_cases if one.name == "Maugis, lambda 1")
    assert case.exact and case.exact.value and case.published
    depths = [-0.40, -0.42, -0.44]
    rings = largest_pull(
        depths, on_rings(Adhesion(WORK, reach(1.0)), [d * DEPTH for d in depths], rings=400)
    )
    assert case.exact.value / (pi * WORK) == pytest.approx(rings, rel=1e-5)
    assert case.published.value / (pi * WORK) == pytest.approx(maugis_pull_off(1.0), rel=1e-6)


@pytest.mark.parametrize(
    ("parameter", "about", "pull"),
    [(0.5, -0.43, -1.785), (1.0, -0.42, -1.676), (2.0, -0.39, -1.583)],
)
def test_a_surface_that_ends_at_five_ranges_pulls_less(
    parameter: float, about: float, pull: float
) -> None:
    """Rings up to five ranges give another program's pull-off, to 0.5 %.

    Its elements of half a cohesive zone contribute 0.35 %. The cut-off costs 0.6 % at lambda 0.5
    and nothing at lambda 2.
    """
    law, depths = Adhesion(WORK, reach(parameter)), [about + 0.1, about, about - 0.1]
    cut, whole = (
        largest_pull(depths, on_rings(law, [d * DEPTH for d in depths], ranges=ranges))
        for ranges in (5, 10)
    )
    assert cut == pytest.approx(pull, rel=5e-3)
    assert (cut / whole - 1 < -4e-3) == (parameter == 0.5)


@pytest.mark.verify
def test_a_contact_holds_on_however_long_the_step() -> None:
    """At a depth with two stable states the contact is found during unloading, for any increment.

    Lambda is 2.5 and the depth -0.06. Newton's method alone would take an increment of five ranges
    to the open state, which is found during loading.
    """
    adhesion = {"work": 1e-2, "range": 2e-2}

    def last(*depths: float) -> State:
        return solve(
            scene(
                WALLED,
                contact={"adhesion": adhesion},
                loading={"deltas": list(depths)},
                mesh={"h_contact": 0.05},
            )
        )[-1]

    held, slowly = last(0.04, -0.06), last(0.04, 0.0, -0.03, -0.045, -0.06)
    assert held.a > 0 and held.force == pytest.approx(slowly.force, rel=1e-7)
    assert last(-0.06).a == last(0.04, -0.08).a == 0.0


def test_a_path_may_begin_where_the_tip_touches() -> None:
    """A path at finite strain may begin at first contact, far from the state after the snap-in."""
    material = {"model": "neo_hookean", "E": 1.0, "nu": 0.3}
    near, far = (
        solve(
            scene(
                WALLED,
                material=material,
                contact=LOOSE,
                mesh={"h_contact": 0.08},
                loading={"deltas": [*before, 0.0]},
            )
        )[-1]
        for before in ([], [-0.2])
    )
    assert near.a > 0 and near.force == pytest.approx(far.force, rel=1e-7)


def test_a_prescribed_pull_is_found_down_to_that_of_first_touch() -> None:
    pulls = [1e-3, -1e-2, -0.1]
    rows = list(
        states(scene(WALLED, contact=LOOSE, loading={"forces": pulls}, mesh={"h_contact": 0.08}))
    )
    assert [row.force for row in rows[:2]] == pytest.approx(pulls[:2], rel=1e-8)
    assert 0 < rows[1].delta < rows[0].delta
    assert not rows[2].converged and "the tensile force exceeds the attraction" in rows[2].reason


def test_without_work_the_force_is_the_same_as_without_adhesion() -> None:
    """A work of adhesion of 1e-12 changes the force by less than 1e-6, on the same elements."""
    mesh, sticky = {"h_contact": 0.01}, {"adhesion": {"work": 1e-12, "range": 1e-3}}
    (clean,), (held,) = (
        solve(scene(THICK, contact=contact, mesh=mesh)) for contact in ({}, sticky)
    )
    assert held.force == pytest.approx(clean.force, rel=1e-6)


@pytest.mark.verify
def test_in_and_out_is_one_curve_where_nothing_jumps_and_its_energy_the_work() -> None:
    """Without jumps unloading repeats loading, and the energy is the work of the force.

    Lambda is 0.5. Simpson's rule on 8 intervals gives the work to 1e-4.
    """
    way = [2.0, 1.75, 1.5, 1.25, 1.0, 0.75, 0.5, 0.25, 0.0]
    rows = attracted(0.5, *way, 1.0, 2.0)
    for going, coming in ((rows[4], rows[9]), (rows[0], rows[10])):
        assert going.force == pytest.approx(coming.force, rel=1e-7, abs=1e-9 * WORK)
    simpson = np.array([1, 4, 2, 4, 2, 4, 2, 4, 1]) * 0.25 * DEPTH / 3
    work = float(simpson @ [row.force for row in rows[:9]])
    assert rows[0].energy - rows[8].energy == pytest.approx(
        work, rel=1e-3, abs=1e-3 * abs(rows[8].energy)
    )
    assert rows[0].stiffness is None or rows[0].force > 0 > rows[8].force


@pytest.mark.verify
def test_snap_in_and_pull_off_at_finite_strain() -> None:
    """The branch found at a depth with two stable states depends on where the tip comes from.

    The tip approaches out of contact, is pressed in, and holds on at the same depth on its way out.
    """
    material = {"model": "neo_hookean", "E": 1.0, "nu": 0.3}
    body = {"shape": "cylinder", "radius": 4.0, "height": 2.0, "base": "fixed", "sides": "roller"}
    adhesion = {"work": 0.02, "range": 0.03}  # Maugis' lambda 2.8
    rows = solve(
        scene(
            body,
            material=material,
            indenter={"shape": "sphere", "R": 1.0},
            contact={"adhesion": adhesion},
            loading={"deltas": [-0.2, -0.1, 0.05, -0.1, -0.3]},
            mesh={"h_contact": 0.04},
        )
    )
    far, near, pressed, held, off = rows
    assert far.a == near.a == off.a == 0.0 and held.a > 0.1 and pressed.a > held.a
    assert held.force < 3 * near.force < 0 and abs(off.force) < 1e-2 * abs(held.force)


@pytest.mark.verify
def test_a_tip_snaps_in_where_newton_finds_no_way() -> None:
    """After the end of the open state the snapped contact is the one that unloading finds.

    `configs/sticky_sphere.yaml` with half its range, lambda 2.8, on elements of 1.2 cohesive zones;
    the open state ends at -0.2425.
    """
    changes = [
        "contact.adhesion.range=0.08",
        "loading.deltas=[-0.24, -0.2, -0.24]",
        "mesh.h_contact=0.15",
    ]
    base = resolve(load(Path(__file__).parents[2] / "configs" / "sticky_sphere.yaml", changes))
    fallen, pressed, held = solve(base)
    assert pressed.a > fallen.a > 0
    assert fallen.force == pytest.approx(held.force, rel=1e-7)


@pytest.mark.verify
def test_the_state_after_a_snap_is_that_of_rings() -> None:
    """The state after a snap-in is that of rings, which find the contact from inside, to 0.5 %."""
    parameter = 3.0
    (expected,) = on_rings(Adhesion(WORK, reach(parameter)), [0.0], rings=300)
    (found,) = attracted(parameter, 0.0)
    assert found.a > 0 and found.force / (pi * WORK) == pytest.approx(expected, rel=5e-3)


@pytest.mark.stress
@pytest.mark.parametrize("number", range(12))
def test_a_row_does_not_depend_on_its_steps(number: int) -> None:
    """The force of a row is the same with 1, 4 and 16 increments, and is a minimum of energy.

    Random scenes in and out, with lambda 0.1 to 5, linear and neo-Hookean, on half-spaces, layers
    and caps; the tolerance is a hundred times Newton's residual.
    """
    sections, end, back = drawn(number)
    forces = []
    for steps in (1, 4, 16):
        way = np.linspace(0, 1, steps + 1)[1:]
        deltas = (
            [*(back * way), *(back + (end - back) * way)]
            if back
            else list(FAR_OFF + (end - FAR_OFF) * way)
        )
        base = scene(**sections, loading={"deltas": [float(delta) for delta in deltas]})
        walk = solver.create_load_stepper(base, meshed(base))
        rows = list(walk.states(base.physics.path, lambda step: False))
        assert rows[-1].converged, rows[-1].reason
        assert walk.equilibrium.newton.is_stable  # type: ignore[attr-defined]
        forces.append(rows[-1].force)
    work = sections["contact"]["adhesion"]["work"]
    assert forces == pytest.approx([forces[0]] * 3, rel=1e-6, abs=1e-8 * work)


FAR_OFF = -0.5  # twelve ranges and more above most of these bodies


def drawn(number: int) -> tuple[dict[str, Any], float, float]:
    """Random scene, the depth of its row, and the depth from which the tip comes back, or 0."""
    pick = random.Random(1000 + number)
    nu, work, parameter = (
        pick.choice([0.3, 0.48]),
        10 ** pick.uniform(-3.3, -2),
        10 ** pick.uniform(-1, 0.7),
    )
    E_star = 1 / (1 - nu**2)
    adhesion = {
        "work": work,
        "range": (work**2 / (E_star**2 * (parameter / LAMBDA_PER_TABOR) ** 3)) ** (1 / 3),
    }
    depth, zone = (pi * work / E_star) ** (2 / 3), Adhesion(**adhesion).cohesive_zone(E_star)
    layer = {
        "shape": "cylinder",
        "radius": 2.0,
        "height": pick.uniform(0.2, 0.6),
        "base": "fixed",
        "sides": "free",
    }
    thick = {"shape": "cylinder", "radius": 2.5, "height": 2.0, "base": "fixed", "sides": "roller"}
    sections = {
        "body": pick.choice([thick, layer, {"shape": "cap", "base_radius": 2.0, "height": 1.0}]),
        "material": {"model": pick.choice(["linear_elastic", "neo_hookean"]), "E": 1.0, "nu": nu},
        "indenter": {"shape": pick.choice(["paraboloid", "sphere"]), "R": 1.0},
        "contact": {"adhesion": adhesion},
        "mesh": {"h_contact": min(pick.uniform(0.6, 1.2) * zone, 0.4 * (work / E_star) ** (1 / 3))},
    }
    return sections, depth * pick.uniform(-2, 0.3), pick.choice([0.0, depth, depth])


@pytest.mark.parametrize(
    ("body", "adhesion", "mesh", "push"),
    [
        (WALLED, LOOSE["adhesion"], {"h_contact": 0.06}, 0.03),
        pytest.param(
            THICK, {"work": WORK, "range": reach(0.5)}, {}, 1e-3, marks=pytest.mark.verify
        ),
    ],
    ids=["layer", "half-space"],
)
def test_a_force_of_zero_is_a_depth_where_push_and_pull_are_equal(
    body: dict[str, Any], adhesion: dict[str, float], mesh: dict[str, float], push: float
) -> None:
    rows = solve(
        scene(body, contact={"adhesion": adhesion}, mesh=mesh, loading={"forces": [0.0, push, 0.0]})
    )
    assert [row.force for row in rows] == pytest.approx([0.0, push, 0.0], abs=1e-9 * push)
    assert 0 < rows[0].delta < rows[1].delta
    assert rows[2].delta == pytest.approx(rows[0].delta, rel=1e-8)


@pytest.mark.parametrize(
    ("wide", "coarse", "rel"),
    [(2.4, 0.18, 0.03), pytest.param(4.0, 0.12, 0.01, marks=pytest.mark.verify)],
)
def test_three_dimensions_give_the_force_of_the_body_of_revolution(
    wide: float, coarse: float, rel: float
) -> None:
    """An adhesive tip on a box gives the force on a cylinder of the same section.

    Coarse elements contribute 1 %. Two per cent more are allowed where the tip feels the corners
    and elements are four fifths of the cohesive zone of 0.22.
    """
    loading = {"deltas": [-0.05, 0.02]}
    box = {"shape": "box", "size": [wide, wide, 1.0], "base": "fixed", "sides": "free"}
    disc = {
        "shape": "cylinder",
        "radius": wide / pi**0.5,
        "height": 1.0,
        "base": "fixed",
        "sides": "free",
    }
    solid, turned = (
        solve(scene(body, contact=LOOSE, loading=loading, mesh={"h_contact": h}))
        for body, h in ((box, coarse), (disc, coarse / 4))
    )
    for one, other in zip(solid, turned, strict=True):
        assert one.force == pytest.approx(other.force, rel=rel)
