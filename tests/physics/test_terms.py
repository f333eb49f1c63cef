"""A term with a memory, as CONTRIBUTING describes one, and degrees of freedom held at a value."""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import ufl
from dolfinx import fem
from scenes import meshed, scene

from indent_sim.fe.discrete_body import Body
from indent_sim.fe.problem import Problem
from indent_sim.fe.solve.newton import Newton
from indent_sim.fe.terms.scene_terms import additional_fields, bulk_terms, contact_terms
from indent_sim.fe.terms.term import Term
from indent_sim.fe.unknowns import TimeLevel

DEPTH, COARSE = 0.05, {"h_contact": 0.05, "h_far": 0.2}
ON_ROLLERS = {"shape": "cylinder", "radius": 1.0, "height": 1.0, "base": "roller", "sides": "free"}


class Dashpots(Term):
    """Dashpots that drag on the base: the traction -c du/dt [pressure], by backward Euler."""

    has_memory = True

    def __init__(self, body: Body, c: float):
        """Dashpots of the constant c [pressure time/length]."""
        self._body, self._c = body, fem.Constant(body.mesh, c)
        now, before = body.now.fields["u"], body.before.fields["u"]
        self._rate = (now - before) / body.dt
        self._lost = fem.form(
            body.surface_integral("base", self._c * body.dt * ufl.dot(self._rate, self._rate))
        )

    def virtual_work(self, now: TimeLevel, before: TimeLevel, dt: fem.Constant) -> Any:
        """int c du/dt . v over the base."""
        way = self._body.unknowns.split_fields(now.test)["u"]
        return self._body.surface_integral("base", self._c * ufl.dot(self._rate, way))

    def dissipation(self) -> float:
        """int c |du/dt|^2 dt over the base [energy]."""
        return float(fem.assemble_scalar(self._lost))


@cache
def on_dashpots(c: float, h: float = 0.05) -> tuple[Problem, Newton]:
    """The problem of a body on rollers and dashpots under the tip, and its Newton solver."""
    base = scene(
        ON_ROLLERS,
        mesh=COARSE | {"h_contact": h},
        loading={"delta": DEPTH},
        solver={"method": "newton"},
    )
    body = Body(base, meshed(base), additional_fields(base))
    matter = bulk_terms(body)
    problem = Problem(
        body, [*matter, *contact_terms(body, matter.strain_energies[0]), Dashpots(body, c)]
    )
    return problem, Newton(problem)


def press(
    steps: int, time: float, hold: float = 0.0, c: float = 1.0
) -> list[tuple[float, float, float, float]]:
    """Depth, force, energy and dissipation after every step of a press from rest and a hold.

    The tip is pressed in within `time`.
    """
    problem, newton = on_dashpots(c)
    problem.x.set(0.0)
    problem.delta.value = 0.0
    problem.accept()
    rows = [(0.0, 0.0, 0.0, 0.0)]
    for t in np.linspace(0.0, time + hold, steps + 1)[1:]:
        (stage,) = problem.stages((time + hold) / steps)
        problem.begin_stage(stage)
        problem.delta.value = DEPTH * min(t / time, 1.0)
        assert newton.solve(), newton.failure
        problem.end_stage(stage)
        rows.append((problem.depth, problem.force(), problem.energy(), problem.dissipation()))
        problem.accept()
    return rows


def force_on(base: str) -> float:
    """The force of the same mesh on rollers or a fixed base."""
    problem, newton = on_dashpots(1e-12 if base == "roller" else 1e12)
    problem.x.set(0.0)
    problem.accept()
    problem.begin_stage(problem.stages(1.0)[0])
    problem.delta.value = DEPTH
    assert newton.solve()
    return problem.force()


def test_dashpots_hold_a_sudden_base_and_let_a_slow_one_slide() -> None:
    """Dashpots under the base act as a fixed base in a fast press and as rollers in a slow one.

    References are elastic bodies on the same mesh; 1e-5 allows for the finite times of 1e-6 and
    1e6.
    """
    assert press(1, 1e-6)[-1][1] == pytest.approx(force_on("fixed"), rel=1e-5)
    assert press(1, 1e6)[-1][1] == pytest.approx(force_on("roller"), rel=1e-5)
    assert force_on("fixed") > 1.005 * force_on("roller")


def test_dashpots_converge_with_the_steps_of_time() -> None:
    """Backward Euler is of first order: half the time step halves the error of the force."""
    exact = press(80, 0.2, hold=0.2)[-1][1]
    errors = [abs(press(n, 0.2, hold=0.2)[-1][1] - exact) for n in (5, 10)]
    assert 1.6 < errors[0] / errors[1] < 2.6


def test_what_the_tip_does_is_stored_or_lost() -> None:
    """The tip's work is what the body stores and the dashpots lose, as steps go to zero.

    The work by the trapezoidal rule is off by 1/n^2, the losses of backward Euler by 1/n.
    """
    off = []
    for n in (10, 20):
        rows = press(n, 0.5)
        work = sum((b[0] - a[0]) * (a[1] + b[1]) / 2 for a, b in pairwise(rows))
        lost = sum(row[3] for row in rows)
        assert lost > 0
        off.append(abs(work - rows[-1][2] - lost) / work)
    assert off[0] < 1e-2
    assert off[1] < 0.6 * off[0]


def test_a_base_held_at_another_place_stretches_the_body() -> None:
    """A top held 0.01 higher without contact is in uniaxial stress.

    Its sides are free, so its energy is E strain^2/2 per volume.
    """
    problem, newton = on_dashpots(1e-9)
    body = problem.body
    top = body.unknowns.dofs_on("u", 1, body.body_mesh.dim - 1, body.body_mesh.surfaces["top"])
    body.constrain_dofs("u", 1, top, value=0.01)
    problem.x.set(0.0)
    problem.delta.value = -1.0
    problem.accept()
    problem.begin_stage(problem.stages(1e9)[0])
    assert newton.solve(), newton.failure
    E = 1.0  # material.E in units of itself
    assert problem.energy() == pytest.approx(
        0.5 * E * 0.01**2 * np.pi, rel=1e-9
    )  # uniaxial stress is in the space
    on_dashpots.cache_clear()  # what is held here is held nowhere else
