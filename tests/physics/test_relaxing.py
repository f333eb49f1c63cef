"""Bodies whose shear stress relaxes, step by step in time.

References are bars in closed form and integrated point by point, other theories, and the symmetry
of what the material remembers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache
from math import isnan, log, pi
from typing import Any

import numpy as np
import pytest
from exact_time import held_incompressible, relaxing_bar
from scenes import PARABOLOID, meshed, scene
from scipy.optimize import brentq

from indent_sim.fe import solver
from indent_sim.fe.discrete_body import Body
from indent_sim.fe.postprocessing.fields import Fields
from indent_sim.fe.problem import Problem
from indent_sim.fe.solve.newton import Newton
from indent_sim.fe.terms.scene_terms import additional_fields, bulk_terms, contact_terms
from indent_sim.fe.terms.term import Term
from indent_sim.fe.unknowns import TimeLevel
from indent_sim.model.relaxation import PowerLaw, PronySeries, Relaxation
from indent_sim.model.state import State
from indent_sim.run import pipeline
from indent_sim.scene.prescribed_history import prony_series
from indent_sim.scene.scene import Scene
from indent_sim.theory.elastic_curve import ElasticCurve
from indent_sim.theory.lee_radok_ting import LeeRadokTing
from indent_sim.theory.relaxation_function import ShearRelaxation

TWO_TIMES = PronySeries(0.3, (0.4, 0.3), (0.1, 1.0))
ONE_TIME = PronySeries(0.4, (0.6,), (2.0,))
HOOKE = {"model": "linear_elastic", "E": 1.0, "nu": 0.3}
C10, C01, NU = 0.15, 0.1, 0.3
MOONEY = {"model": "mooney_rivlin", "C10": C10, "C01": C01, "nu": NU}
BAR = {"shape": "cylinder", "radius": 1.0, "height": 1.0, "base": "roller", "sides": "free"}
AS_WIDE = {"shape": "flat_punch", "radius": 1.0}
TWO_ELEMENTS = {"h_contact": 0.5, "h_far": 0.5}  # the strain of a bar is in the space
LAYER = {"shape": "cylinder", "radius": 1.5, "height": 1.0, "base": "fixed", "sides": "roller"}
HALVES = LAYER | {"layers": [{"thickness": 0.5}, {"thickness": 0.5}]}
COARSE = {"h_contact": 0.05, "h_far": 0.4}


def relaxing(base: Scene, law: PronySeries) -> Scene:
    """The same scene, of a material whose shear stress relaxes by a Prony series."""
    part = base.physics.domain
    return base.replace_physics(
        domain=replace(
            part, regions=tuple(replace(one, relaxation_series=law) for one in part.regions)
        )
    )


@cache
def in_time(name: str, law: PronySeries) -> tuple[Scene, Any]:
    """The scene of SCENES of a name with a relaxing material, and its mesh."""
    body, material, tip, mesh = SCENES[name]
    contact = {"gap": "reference"} if body is BAR else {}
    base = scene(
        body,
        material=material,
        indenter=tip,
        mesh=mesh,
        contact=contact,
        solver={"method": "newton"},
        loading={"delta": 0.01},
    )
    return relaxing(base, law), meshed(base)


SCENES: dict[str, tuple[dict[str, Any], dict[str, Any], dict[str, Any], dict[str, Any]]] = {
    "bar": (BAR, HOOKE, AS_WIDE, TWO_ELEMENTS),
    "mixed bar": (BAR, HOOKE | {"formulation": "mixed"}, AS_WIDE, TWO_ELEMENTS),
    "incompressible bar": (BAR, HOOKE | {"nu": 0.5}, AS_WIDE, TWO_ELEMENTS),
    "softer bar": (BAR, {"model": "linear_elastic", "E": 10.0, "nu": 0.1}, AS_WIDE, TWO_ELEMENTS),
    "rubber bar": (BAR, MOONEY, AS_WIDE, TWO_ELEMENTS),
    "layer": (LAYER, HOOKE, PARABOLOID, COARSE),
    "incompressible layer": (LAYER, HOOKE | {"nu": 0.5}, PARABOLOID, COARSE),
    "rubber": (LAYER, MOONEY | {"nu": 0.5}, PARABOLOID, COARSE),
    "ogden": (
        LAYER,
        {"model": "ogden", "mu": [0.6, -0.2], "alpha": [1.7, -2.3], "nu": 0.5},
        PARABOLOID,
        COARSE,
    ),
    "box": (
        {"shape": "box", "size": [2.0, 2.0, 1.0], "base": "fixed", "sides": "free"},
        HOOKE | {"nu": 0.5},
        PARABOLOID,
        {"h_contact": 0.05, "h_far": 0.4},
    ),
}


def ladder(first: float, end: float, per_doubling: int) -> list[float]:
    """Lengths of steps up to a time: so many of each length before the length doubles."""
    steps, now, dt = [], 0.0, first
    while now < end * (1 - 1e-12):
        for _ in range(per_doubling):
            steps.append(min(dt, end - now))
            now += steps[-1]
            if now >= end * (1 - 1e-12):
                break
        dt *= 2
    return steps


def along(body: Any, history: Sequence[tuple[float, float]]) -> Iterator[float]:
    """The force after every (depth, length of step) of a history."""
    for depth, dt in history:
        assert body.solve(depth, dt), body.failure
        yield body.force
        body.accept()


def held(
    name: str, law: PronySeries, delta: float, end: float, per_doubling: int
) -> tuple[np.ndarray, np.ndarray]:
    """Times from 0 on and forces of a tip that is pressed in at once and then held.

    The jump to the depth is made in parts of 0.05.
    """
    steps, parts = ladder(min(law.times) / 20, end, per_doubling), round(delta / 0.05) or 1
    jump = [(delta * k / parts, 0.0) for k in range(1, parts + 1)]
    forces = list(
        along(
            solver.create_equilibrium(*in_time(name, law)), [*jump, *((delta, dt) for dt in steps)]
        )
    )
    return np.cumsum([0.0, *steps]), np.array(forces[parts - 1 :])


# ---- bars


def bar_error(
    name: str, law: PronySeries, E: float, nu: float, end: float, per_doubling: int
) -> float:
    """Largest error of E(t)/E of a bar in a hold; E is the scene's unit of pressure."""
    t, force = held(name, law, 0.01, end, per_doubling)
    exact = [relaxing_bar(E, nu, law.fractions, law.times, s) / E for s in t]
    return float(np.max(np.abs(force / (pi * 0.01) - exact)))


def test_bar_of_a_bulk_modulus_that_stays() -> None:
    """A bar whose shear alone relaxes has the closed form's E(t) in a hold, and converges in time.

    Measured errors are 1.4e-4, 4.4e-5 and 1.3e-5 with 2, 4 and 8 steps of each length: between
    first and second order.
    """
    errors = [bar_error("bar", TWO_TIMES, 1.0, 0.3, 2.0, n) for n in (2, 4, 8)]
    assert errors[1] < 1.5e-4
    assert errors[0] / errors[1] > 2.5 and errors[1] / errors[2] > 2.5


@pytest.mark.parametrize(
    ("name", "law", "E", "nu"),
    [("mixed bar", TWO_TIMES, 1.0, 0.3), ("softer bar", ONE_TIME, 10.0, 0.1)],
)
def test_other_bars(name: str, law: PronySeries, E: float, nu: float) -> None:
    assert bar_error(name, law, E, nu, 3.0, 4) < 1.5e-4


@pytest.mark.parametrize("exponent", [0.1, 0.4])
def test_a_bar_of_a_power_law_in_a_ramp(exponent: float) -> None:
    """At a constant rate a power-law bar at nu = 0.5 has the closed form's stress for any steps.

    The stress is rate E time^b t^(1-b)/(1-b). The internal variable's source is straight in time,
    so a step of any length is exact. What is left is the fit by exponentials, 5e-6, and what they
    lack of the modulus before a hundredth of their shortest time, (1e-9/0.1)^0.6 = 2e-5 of the
    force at 0.1.
    """
    law = prony_series(Relaxation(power_law=PowerLaw(exponent, 2.0)), 1e-7, 1.0)
    steps = [0.1, 0.2, 0.7]
    t = np.cumsum(steps)
    history = list(zip(0.01 * t, steps, strict=True))
    forces = list(along(solver.create_equilibrium(*in_time("incompressible bar", law)), history))
    exact = pi * 0.01 * 2.0**exponent * t ** (1 - exponent) / (1 - exponent)
    assert forces == pytest.approx(exact, rel=4e-5)


class Trickle(Term):
    """A term that makes every step have two stages, as if fluid flowed."""

    flows = True

    def virtual_work(self, now: TimeLevel, before: TimeLevel, dt: Any) -> Any:
        return None


def test_bar_in_stages_of_a_body_in_which_fluid_flows() -> None:
    """Stepped by the two stages of SDIRK2 a relaxing bar converges to the closed form.

    Measured 2.8e-4 with four steps of each length; twice the steps leave a quarter of the error.
    """
    base, grid = in_time("bar", TWO_TIMES)
    errors = []
    for per_doubling in (4, 8):
        body = Body(base, grid, additional_fields(base))
        matter = bulk_terms(body)
        problem = Problem(
            body, [*matter, *contact_terms(body, matter.strain_energies[0]), Trickle()]
        )
        newton, t, off = Newton(problem), 0.0, [0.0]
        for dt in (0.0, *ladder(0.005, 2.0, per_doubling)):
            for stage in problem.stages(dt):
                problem.begin_stage(stage)
                problem.delta.value = 0.01
                assert newton.solve(), newton.failure
                problem.end_stage(stage)
            t += dt
            off.append(
                abs(problem.force() / (pi * 0.01) - relaxing_bar(1.0, 0.3, *TWO_TIMES[1:], t))
            )
            problem.accept()
        errors.append(max(off))
    assert errors[0] < 8e-4
    assert errors[0] / errors[1] > 3


def rubber_bar(strain: Callable[[float], float], law: PronySeries, end: float, steps: int) -> float:
    """Nominal stress over E of a Mooney-Rivlin bar after strain(t), integrated point by point.

    Simo's law in principal stretches, its internal stresses by the trapezoidal rule, the lateral
    stretch from a lateral stress of 0.
    """
    E, nu = 4 * (C10 + C01) * (1 + NU), NU
    kappa, rest = E / (3 * (1 - 2 * nu)), law.long_term
    A = [np.zeros(3) for _ in law.times]
    S, dt, side, P = np.zeros(3), end / steps, 1.0, 0.0

    def deviator(v: np.ndarray) -> np.ndarray:
        return v - v.mean()

    def state(
        side: float, long: float, old: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
        l = np.array([long, side, side])
        J, b = float(np.prod(l)), l**2 * float(np.prod(l)) ** (-2 / 3)
        elastic = deviator(2 * C10 * b - 2 * C01 / b)  # Kirchhoff
        S_new = elastic / b
        x = [dt / tau for tau in law.times]
        new = [
            (a * (1 - y / 2) + y / 2 * (old + S_new)) / (1 + y / 2)
            for a, y in zip(A, x, strict=True)
        ]
        lost = sum(g * deviator(b * a) for g, a in zip(law.fractions, new, strict=True))
        return (rest + sum(law.fractions)) * elastic - lost + kappa * log(J), S_new, new

    for k in range(1, steps + 1):
        long = 1 - strain(k * dt)
        side = brentq(
            lambda s, long=long, S=S: state(s, long, S)[0][1], 0.8 * side, 1.25 * side, xtol=1e-14
        )
        tau, S, A = state(side, long, S)
        P = tau[0] / long
    return P / E


def test_bar_at_finite_strain() -> None:
    """A relaxing Mooney-Rivlin bar at finite strain converges to the point-by-point integration.

    It is shortened by 0.3 within a time of 0.5 and held to 1. The error of 20 and 40 steps beside
    2000 steps of the other rule falls with the square of the step.
    """

    def strain(t: float) -> float:
        return 0.3 * min(t / 0.5, 1.0)

    exact = -pi * rubber_bar(strain, TWO_TIMES, 1.0, 2000)
    errors = []
    for n in (20, 40):
        body = solver.create_equilibrium(*in_time("rubber bar", TWO_TIMES))
        *_, force = along(body, [(strain(k / n), 1 / n) for k in range(1, n + 1)])
        errors.append(abs(force / exact - 1))
    assert errors[0] < 2e-3
    assert errors[0] / errors[1] > 3


# ---- indentation


@pytest.mark.parametrize("name", ["rubber", pytest.param("ogden", marks=pytest.mark.verify)])
def test_a_sudden_deep_step_into_rubber_is_held(name: str) -> None:
    """At nu = 0.5 the force of a hold after a sudden deep step falls as one stress does.

    Nothing moves in the hold, whatever the law, so F(t)/F(0) is the closed form of one stress.
    Measured 3e-5: elements at the edge of contact open a little.
    """
    t, force = held(name, TWO_TIMES, 0.3, 2.0, 4)
    exact = [held_incompressible(TWO_TIMES.fractions, TWO_TIMES.times, s) for s in t]
    assert force / force[0] == pytest.approx(exact, abs=3e-4)


def test_incompressible_layers_relax_as_one_modulus() -> None:
    """At nu = 0.5 ramp, hold and way out are those of Ting's theory on the elastic curve.

    The curve is that of the same mesh. All that deforms is shear. Twice the steps bring the forces
    nearer.
    """
    base, grid = in_time("incompressible layer", TWO_TIMES)
    plain = relaxing(base, PronySeries(1.0, (), ()))
    depths = 0.03 * np.geomspace(0.02, 1.0, 24)
    elastic = solver.create_equilibrium(plain, grid)
    curve = ElasticCurve(
        depths, np.array(list(along(elastic, [(d, 0.0) for d in depths]))), np.sqrt(depths)
    )
    cycle = LeeRadokTing(
        ShearRelaxation(*TWO_TIMES[1:]), [0.0, 0.5, 1.0, 2.0], [0.0, 0.03, 0.03, 0.0], curve
    )
    asked = np.array([0.5, 1.0, 1.25, 1.4])
    exact = np.array([cycle.response_at(float(t)).force for t in asked])
    errors = []
    for n in (20, 40):
        t = np.arange(1, round(1.4 * n) + 1) / n
        history = [
            (float(np.interp(s, [0.0, 0.5, 1.0, 2.0], [0.0, 0.03, 0.03, 0.0])), 1 / n) for s in t
        ]
        forces = np.array(list(along(solver.create_equilibrium(base, grid), history)))
        errors.append(np.max(np.abs(np.interp(asked, t, forces) - exact)) / exact[0])
    assert errors[0] < 1e-2
    assert errors[1] < 0.7 * errors[0]


def test_layers_that_are_alike_are_one_body() -> None:
    """Two relaxing layers of one material have the forces of one body.

    Each layer has internal stresses of its own. The mesh has a face between them, which is worth at
    most 1e-3 of the force.
    """
    base = scene(HALVES, mesh=COARSE, solver={"method": "newton"}, loading={"delta": 0.02})
    assert len(base.physics.domain.regions) == 2
    (*_, layers), (*_, one) = (
        along(solver.create_equilibrium(*body), IN_AND_OUT)
        for body in ((relaxing(base, TWO_TIMES), meshed(base)), in_time("layer", TWO_TIMES))
    )
    assert layers == pytest.approx(one, rel=1e-3)


def test_a_layer_relaxes_alone() -> None:
    """A relaxing layer over an elastic one ends at the force of the relaxed shear modulus.

    The reference is the elastic scene whose upper layer has the long-term shear modulus and the
    same bulk modulus.
    """
    kappa, G = 1 / (3 * 0.4), TWO_TIMES.long_term / 2.6
    soft = {"model": "linear_elastic", "mu": G, "kappa": kappa}
    base = scene(HALVES, mesh=COARSE, solver={"method": "newton"}, loading={"delta": 0.02})
    rested = scene(
        HALVES | {"layers": [{"thickness": 0.5, "material": soft}, {"thickness": 0.5}]},
        mesh=COARSE,
        solver={"method": "newton"},
        loading={"delta": 0.02},
    )
    part, grid = base.physics.domain, meshed(base)
    upper, lower = part.regions
    alone = base.replace_physics(
        domain=replace(part, regions=(replace(upper, relaxation_series=TWO_TIMES), lower))
    )
    *_, force = along(
        solver.create_equilibrium(alone, grid), [(0.02, 0.0), (0.02, 1.0), (0.02, 1e3), (0.02, 1e5)]
    )
    (exact,) = along(solver.create_equilibrium(rested, meshed(rested)), [(0.02, 0.0)])
    unit = rested.physics.scales.force / base.physics.scales.force
    assert force == pytest.approx(exact * unit, rel=1e-3)  # two meshes, if they differ


@pytest.mark.verify
def test_a_box_in_three_dimensions_relaxes_as_one_modulus() -> None:
    """At nu = 0.5 the force on a box in three dimensions falls in a hold as one stress does.

    Measured 5.6e-5, and 1.9e-4 with elements twice as large, which open at the contact's edge.
    """
    t, force = held("box", TWO_TIMES, 0.05, 2.0, 4)
    exact = [held_incompressible(TWO_TIMES.fractions, TWO_TIMES.times, s) for s in t]
    assert force / force[0] == pytest.approx(exact, abs=1.5e-4)


# ---- what is remembered

IN_AND_OUT = [(0.01, 0.05), (0.02, 0.05), (0.02, 0.1), (0.02, 0.4), (0.01, 0.2), (0.012, 0.3)]
STOPPED = 3


@pytest.mark.parametrize("name", ["layer", "rubber"])
def test_a_body_put_back_in_mid_hold_goes_on_as_before(name: str) -> None:
    """Forces after a return to mid-hold are those of the uninterrupted history.

    The state comes from the arrays of a checkpoint, in another body, or from the snapshot after a
    step that is given up. Newton begins at the same numbers, so the forces agree to round-off.
    """
    first = solver.create_equilibrium(*in_time(name, TWO_TIMES))
    forces = list(along(first, IN_AND_OUT[:STOPPED]))
    kept = first.snapshot()
    arrays = first.pack(kept)
    assert first.solve(0.03, 1.0)  # never accepted
    first.restore(kept)
    assert first.force == pytest.approx(forces[-1], rel=1e-12)
    rest = list(along(first, IN_AND_OUT[STOPPED:]))
    other = solver.create_equilibrium(*in_time(name, TWO_TIMES))
    state = other.unpack(kept.depth, arrays)
    assert state
    other.restore(state)
    assert list(along(other, IN_AND_OUT[STOPPED:])) == pytest.approx(rest, rel=1e-12)
    unhindered = list(along(solver.create_equilibrium(*in_time(name, TWO_TIMES)), IN_AND_OUT))
    assert [*forces, *rest] == pytest.approx(unhindered, rel=1e-9)  # Newton's tolerance


def test_arrays_of_another_body_are_refused() -> None:
    one, other = (
        solver.create_equilibrium(*in_time("layer", law)) for law in (TWO_TIMES, ONE_TIME)
    )
    assert other.unpack(0.0, one.pack(one.snapshot())) is None


@pytest.mark.parametrize("name", ["bar", "mixed bar", "rubber bar"])
def test_stress_fields_are_those_of_the_force_also_after_a_restore(name: str) -> None:
    """A bar's axial stress is its force over its area, and all other stresses are 0.

    This holds before and after a step is accepted and after a restore. At finite strain the area is
    that of the deformed bar.
    """
    body = solver.create_equilibrium(*in_time(name, TWO_TIMES))
    body.solve(0.05, 0.0)
    body.accept()
    before = body.snapshot()
    assert body.solve(0.05, 0.3)
    later = Fields(body.observed_body).gather()
    force = body.force
    body.accept()
    accepted = Fields(body.observed_body).gather()
    body.restore(body.snapshot())
    restored = Fields(body.observed_body).gather()
    assert later and accepted and restored
    for fields in (later, accepted, restored):
        area = pi * np.max(1 + fields["displacement"][:, 0]) ** 2 if name == "rubber bar" else pi
        expected = np.zeros((3, 3))
        expected[2, 2] = -force / area
        assert fields["stress"] == pytest.approx(
            np.broadcast_to(expected, fields["stress"].shape), abs=1e-9
        )
    body.restore(before)
    at_once = Fields(body.observed_body).gather()
    assert (
        at_once and at_once["stress"][0, 2, 2] < 1.1 * later["stress"][0, 2, 2]
    )  # it pushed harder


def test_supports_take_what_the_tip_gives_after_a_restore() -> None:
    body = solver.create_equilibrium(*in_time("layer", TWO_TIMES))
    *_, force = along(body, IN_AND_OUT[:STOPPED])
    state = body.snapshot()
    assert body.solve(0.02, 1.0)
    body.restore(state)
    assert body.state_values()["reaction"] == pytest.approx(force, rel=1e-8)


def test_finite_strain_is_small_strain_where_it_is_small() -> None:
    """At a strain of 1e-3 a rubber bar relaxes as the small-strain bar of the same moduli.

    Forces over the one at once differ by a tenth of the order of the strain.
    """
    E, nu, delta = 4 * (C10 + C01) * (1 + NU), NU, 1e-3
    t, force = held("rubber bar", TWO_TIMES, delta, 1.0, 2)
    exact = np.array([relaxing_bar(E, nu, TWO_TIMES.fractions, TWO_TIMES.times, s) / E for s in t])
    linear = held("bar", TWO_TIMES, delta, 1.0, 2)[1]
    assert force / force[0] == pytest.approx(linear / linear[0], abs=1e-3)
    assert force / (pi * delta) == pytest.approx(exact, abs=2e-3)


def test_a_hold_lets_go_of_shear_alone() -> None:
    """In a hold the force of a layer never rises, and falls less than the shear modulus.

    The layer lies between fixed faces, so part of the force is borne by the bulk modulus, which
    stays.
    """
    _, force = held("layer", TWO_TIMES, 0.02, 5.0, 4)
    assert np.all(np.diff(force) < 1e-9 * force[0])
    assert force[-1] / force[0] > TWO_TIMES.long_term * 1.05


# ---- scenes

PRONY = {"prony": [[0.4, 0.1], [0.3, 1.0]]}
POWER = {"power_law": {"exponent": 0.2, "time": 1.0}}
CYCLE = {
    "history": [[0, 0], [0.5, 0.02], [2, 0.02], [2.2, 0.015]],
    "times": [0.1, 0.5, 0.505, 0.7, 2.0, 2.1],
}


def of_scene(law: dict[str, Any], of: str, **sections: Any) -> list[State]:
    """The rows of an incompressible layer whose moduli or whose shear alone relax."""
    material = HOOKE | {"nu": 0.5, "relaxation": law | {"of": of}}
    given = {
        "material": material,
        "indenter": PARABOLOID,
        "mesh": COARSE | {"h_contact": 0.02},
        "loading": CYCLE,
    }
    return list(pipeline.states(scene(LAYER, **given | sections), with_surface=False))


@pytest.mark.parametrize(
    "law",
    [
        pytest.param(PRONY, id="prony"),
        pytest.param(POWER, id="power law", marks=pytest.mark.verify),
    ],
)
def test_an_incompressible_scene_is_that_of_its_elastic_curve(law: dict[str, Any]) -> None:
    """At nu = 0.5 steps in time give the forces of the elastic curve, by Lee & Radok and Ting.

    There is no bulk modulus that could stay. The mesh's contact grows by elements, ten of them,
    where the curve is smooth: measured 7e-4 of the largest force.
    """
    by_steps, by_curve = of_scene(law, "shear"), of_scene(law, "all")
    assert [row.t for row in by_steps] == [row.t for row in by_curve] == CYCLE["times"]
    largest = max(row.force for row in by_curve)
    found, expected = [row.force for row in by_steps], [row.force for row in by_curve]
    assert found == pytest.approx(expected, abs=1.5e-3 * largest)
    assert all(isnan(row.energy) for row in by_steps)


def test_a_body_that_shrinks_in_bulk_keeps_more_of_its_force() -> None:
    """At nu = 0.2 relaxation of shear alone leaves more force than relaxation of all moduli.

    The bulk modulus bears what the shear lets go, but the force is less than before the hold.
    """
    rows = {
        of: of_scene(PRONY, of, material=HOOKE | {"nu": 0.2, "relaxation": PRONY | {"of": of}})
        for of in ("all", "shear")
    }
    last = {of: found[4].force for of, found in rows.items()}
    first = rows["shear"][1].force
    assert 1.1 * last["all"] < last["shear"] < first


@pytest.mark.parametrize(
    "control", ["history", pytest.param("force_history", marks=pytest.mark.verify)]
)
def test_a_stopped_history_of_rubber_goes_on(control: str) -> None:
    """A history of layered rubber with friction, resumed in mid-hold, repeats its rows."""
    rubber = {
        "model": "mooney_rivlin",
        "C10": 0.15,
        "C01": 0.05,
        "nu": 0.45,
        "relaxation": PRONY | {"of": "shear"},
    }
    points = {
        "history": [[0, 0], [0.5, 0.03], [2, 0.03]],
        "force_history": [[0, 0], [0.5, 0.01], [2, 0.01]],
    }
    base = scene(
        LAYER
        | {
            "layers": [
                {"thickness": 0.4, "material": MOONEY},
                {"thickness": 0.6, "material": rubber},
            ]
        },
        indenter=PARABOLOID,
        mesh=COARSE,
        loading={control: points[control], "per_doubling": 2, "times": "auto"},
        contact={"friction": 0.3},
    )
    mesh = meshed(base)
    whole = solver.create_load_stepper(base, mesh)
    rows, points_then, done = [], None, len(base.physics.deltas) - 6
    for row in whole.states(base.physics.path, lambda step: False):
        rows.append(row)
        assert row.converged, row.reason
        if row.step == done:
            points_then = whole.points
    goes_on = solver.create_load_stepper(base, mesh)
    assert points_then and goes_on.resume(points_then, [])
    for row, state in zip(
        rows[done:], goes_on.states(base.physics.path, lambda step: False, done), strict=True
    ):
        assert state.force == pytest.approx(row.force, rel=1e-7)
        assert state.delta == pytest.approx(row.delta, rel=1e-7)
