"""PETSc's solvers of a run: their choice, the options of PETSC_OPTIONS, and reported failures."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc
from scenes import CYLINDER, meshed, scene

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.fe.condensed.compliance import Condenser
from indent_sim.fe.condensed.contact import CondensedContact
from indent_sim.fe.path import step_size_control
from indent_sim.fe.problem import Problem
from indent_sim.fe.solve import newton, uzawa
from indent_sim.fe.solve.newton import Newton
from indent_sim.fe.solver import create_equilibrium
from indent_sim.process.errors import NotConverged
from indent_sim.run.pipeline import Outcome, simulate

SCENE: dict[str, Any] = {
    "body": {"shape": "cylinder", "radius": 1.0, "height": 1.0},
    "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.3},
    "indenter": {"shape": "paraboloid", "R": 1.0},
    "contact": {"method": "penalty"},
    "loading": {"delta": 0.01, "steps": 1},
    "mesh": {"h_contact": 0.05, "h_far": 0.5},
    "solver": {"method": "newton"},
    "output": {"plot": False, "fields": "none"},
}
FORCE = 1.6e-3
CUBE: dict[str, Any] = {
    "body": {"shape": "box", "size": [1.0, 1.0, 1.0]},
    "mesh": {"h_contact": 0.15, "h_far": 0.5},
    "solver": {"linear": "iterative"},
}
SAME = 1e-8  # of the force, whoever solves the systems: Newton's residual is 1e-9 of the reactions


def solved(folder: Path, **sections: Any) -> Outcome:
    """Outcome of the scene with other sections."""
    return simulate(
        config_from_mapping(SCENE | sections),
        MPI.COMM_SELF,
        directory=folder / "out",
        overwrite=True,
    )


@contextmanager
def tuned(**options: Any) -> Iterator[None]:
    """PETSc as after reading these PETSC_OPTIONS, which it does once per process."""
    database = PETSc.Options()
    for name, value in options.items():
        database.setValue(name, value)
    try:
        yield
    finally:
        for name in options:
            database.delValue(name)


@pytest.mark.parametrize(
    "options",
    [
        {"ksp_type": "gmres", "pc_type": "jacobi"},
        {"ksp_type": "cg", "pc_type": "gamg", "ksp_rtol": 1e-8},
        {"ksp_type": "cg", "pc_type": "ilu"},  # MUMPS has none: its name must not stand beside it
        {"pc_type": "lu", "pc_factor_mat_solver_type": "petsc"},
    ],
    ids=str,
)
def test_the_environment_stands_over_the_programs_choice(tmp_path, options, monkeypatch):
    found = []
    solve = Newton.solve

    def recorded(self, *given, **named):
        found.append(self.snes.ksp.pc.getType())
        return solve(self, *given, **named)

    monkeypatch.setattr(Newton, "solve", recorded)
    usual = solved(tmp_path).states[-1].force
    with tuned(**options):
        assert solved(tmp_path).states[-1].force == pytest.approx(usual, rel=SAME)
    assert usual == pytest.approx(FORCE, rel=0.02) and set(found) == {
        "cholesky",
        options["pc_type"],
    }


def test_what_the_scene_says_and_when_it_has_converged_is_not_the_environments(tmp_path):
    """PETSC_OPTIONS do not change the convergence test and the limits of the scene.

    `-snes_convergence_test skip` would accept any residual.
    """
    usual = solved(tmp_path).states[-1]
    with tuned(snes_convergence_test="skip", snes_rtol=0.99, snes_max_it=1):
        assert solved(tmp_path).states[-1].force == usual.force
        hasty = solved(tmp_path, solver={"method": "newton", "max_iterations": 1}).states[
            -1
        ]  # in ever shorter steps
    assert hasty.substeps > 10 * usual.substeps and hasty.force == pytest.approx(
        usual.force, rel=SAME
    )


@pytest.mark.parametrize("scene", [{}, CUBE], ids=["direct", "iterative"])
def test_a_monitor_sees_every_linear_system(tmp_path, scene):
    with tuned(ksp_monitor=f"ascii:{tmp_path / 'residuals'}"):
        state = solved(tmp_path, **scene).states[-1]
    seen = (tmp_path / "residuals").read_text().splitlines()
    systems = [line for line in seen if line.split()[0] == "0"]
    assert len(seen) - len(systems) >= (state.krylov_iterations or state.newton_iterations) > 0


def test_the_levels_of_the_multigrid_have_a_prefix_of_their_own(tmp_path):
    # With PETSc 3.25 a worse smoother needs more iterations from this size of the mesh on only.
    finer = CUBE | {"mesh": {"h_contact": 0.08, "h_far": 0.2}}
    usual = solved(tmp_path, **finer).states[-1]
    with tuned(pmultigrid_mg_levels_ksp_max_it=1):  # of 3
        rough = solved(tmp_path, **finer).states[-1]
    assert rough.force == pytest.approx(usual.force, rel=SAME)
    assert rough.krylov_iterations > usual.krylov_iterations
    assert not [
        name for name in PETSc.Options().getAll() if "pmultigrid" in name or "linesearch" in name
    ]


def newtons_of(monkeypatch: pytest.MonkeyPatch) -> list[Newton]:
    """Newton solvers of all runs from now on."""
    made: list[Newton] = []
    begin = Newton.__init__

    def recorded(self: Newton, problem: Problem) -> None:
        begin(self, problem)
        made.append(self)

    monkeypatch.setattr(Newton, "__init__", recorded)
    return made


@pytest.mark.parametrize(
    ("method", "factors"),
    [
        ("penalty", "cholesky"),
        ("augmented_lagrangian", "cholesky"),
        ("uzawa", "cholesky"),
        ("nitsche", "lu"),  # theta = 0: not the derivative of a potential
        ("active_set", "lu"),  # the rows of its nodes depend on the set
    ],
)
def test_a_symmetric_tangent_is_factored_as_such(tmp_path, monkeypatch, method, factors):
    """The tangent is factorized by LDL^T exactly where it is symmetric."""
    found = []
    assemble = Problem.assemble_tangent

    def watched(problem, A):
        assemble(problem, A)
        found.append((problem.has_symmetric_tangent, A.isSymmetric(1e-14 * A.norm())))

    monkeypatch.setattr(Problem, "assemble_tangent", watched)
    made = newtons_of(monkeypatch)
    coarse = {"h_contact": 0.1, "h_far": 0.5}  # symmetric or not on any mesh
    solved(
        tmp_path,
        contact={"method": method},
        material=SCENE["material"] | {"model": "neo_hookean"},
        mesh=coarse,
    )
    assert {newton.snes.ksp.pc.getType() for newton in made} == {factors}
    assert all(is_so == said for said, is_so in found)


def test_where_symmetric_factors_fail_others_take_their_place(tmp_path, monkeypatch):
    """Where a symmetric factorization fails, LU is used.

    MUMPS is given a hundredth of the memory that it requests.
    """
    choose, tried = newton.use_direct_solver, []

    def starved(ksp, factors):
        tried.append(factors)
        PETSc.Options().setValue("mat_mumps_icntl_14", -99 if factors == "cholesky" else 60)
        choose(ksp, factors)

    monkeypatch.setattr(newton, "use_direct_solver", starved)
    with tuned(mat_mumps_icntl_14=60):
        assert solved(tmp_path).states[-1].force == pytest.approx(FORCE, rel=0.02)
    assert tried == ["cholesky", "lu"]


def test_only_what_mumps_could_not_do_is_a_failed_step():
    """Only PETSc's error 76, of a library, is a failed increment; other errors are raised."""

    base = scene(CYLINDER, "mesh.h_contact=0.1", solver={"method": "newton"})
    solver = create_equilibrium(base, meshed(base)).newton

    def failing(code):
        def solve(*_):
            raise PETSc.Error(code)

        return SimpleNamespace(solve=solve, setTolerances=lambda **_: None)

    solver.problem.delta.value = 0.01
    solver.snes = failing(76)
    assert not solver.solve() and solver.failure == newton.LINEAR_SOLVER_FAILED
    assert isinstance(solver.snes, PETSc.SNES) and solver.solve()
    solver.snes = failing(55)
    with pytest.raises(PETSc.Error):
        solver.solve()


@pytest.mark.parametrize("method", ["newton", "condensed"])
def test_a_failed_uzawa_says_so(tmp_path, monkeypatch, method):
    monkeypatch.setattr(uzawa, "MAX_ITERATIONS", 3)
    monkeypatch.setattr(step_size_control, "SMALLEST_STEP_FRACTION", 0.5)
    contact = {"method": "uzawa", "epsilon_n": 0.01}
    with pytest.raises(
        NotConverged, match=r"contact method uzawa.*multiplier does not converge.*delta = 0"
    ) as caught:
        solved(tmp_path, contact=contact, solver={"method": method})
    assert "Newton" not in str(caught.value)


def test_a_failed_linear_solver_is_named_at_a_depth_in_the_users_lengths(tmp_path):
    sections = {
        "body": {"shape": "cylinder", "radius": 1e3, "height": 1e3},
        "indenter": {"shape": "paraboloid", "R": 1e3},
        "loading": {"deltas": [10.0]},
        "mesh": {"h_contact": 50.0, "h_far": 500.0},
    }
    options = {"ksp_type": "cg", "pc_type": "jacobi", "ksp_max_it": 1}
    with (
        tuned(**options),
        pytest.raises(NotConverged, match="delta = 10: the linear solver failed"),
    ):
        solved(tmp_path, **sections)


FRICTION = {"method": "penalty", "friction": 0.3}  # whose line search shortens steps


def named(contact: dict[str, Any]) -> str:
    """Name of a contact law by its values."""
    return "-".join(map(str, contact.values()))


@pytest.mark.parametrize(
    ("linear", "contact"),
    [
        ("direct", {"method": "penalty"}),
        ("direct", FRICTION),
        ("iterative", {"method": "penalty"}),
        ("iterative", {"method": "uzawa"}),
    ],
)
@pytest.mark.parametrize("after", [0, 1])  # residuals that are numbers
def test_a_residual_that_is_no_number_is_no_equilibrium(
    tmp_path, monkeypatch, contact, linear, after
):
    """A residual that is not a number ends the path with that reason, for every line search.

    The residual is NaN from the first or the second evaluation of every solve on.
    """
    assemble, begin = Problem.assemble_residual, Problem.begin_solve
    left = [after]

    def begun(self):
        left[0] = after
        begin(self)

    def not_a_number(self, b):
        assemble(self, b)
        if left[0] == 0:
            b.set(float("nan"))
        else:
            left[0] -= 1

    monkeypatch.setattr(Problem, "begin_solve", begun)
    monkeypatch.setattr(Problem, "assemble_residual", not_a_number)
    monkeypatch.setattr(step_size_control, "SMALLEST_STEP_FRACTION", 0.5)
    bodies = {"direct": {}, "iterative": CUBE | {"mesh": {"h_contact": 0.3, "h_far": 0.5}}}
    sections = bodies[linear] | {
        "contact": contact,
        "solver": {"method": "newton", "linear": linear},
    }
    with pytest.raises(NotConverged, match="the residual is not a number"):
        solved(tmp_path, **sections)


def test_only_the_reason_of_the_own_convergence_test_is_accepted(tmp_path, monkeypatch):
    """Only the program's own convergence test is accepted; other reasons end the run.

    PETSc 3.25 may report a short step for a residual that is not a number.
    """
    reasons = PETSc.SNES.ConvergedReason

    def says(reason):
        class Claiming(PETSc.SNES):
            """A SNES that gives a reason of its own."""

            def getConvergedReason(self):
                return reason

        return Claiming

    monkeypatch.setattr(step_size_control, "SMALLEST_STEP_FRACTION", 0.5)
    made = newtons_of(monkeypatch)
    for reason in (
        reasons.CONVERGED_SNORM_RELATIVE,
        reasons.CONVERGED_FNORM_ABS,
        reasons.CONVERGED_ITS,
    ):
        with monkeypatch.context() as patch:
            patch.setattr(newton.PETSc, "SNES", says(reason))
            with pytest.raises(NotConverged, match=f"SNES stopped with the reason code {reason}"):
                solved(tmp_path)
    assert solved(tmp_path).states[-1].force == pytest.approx(FORCE, rel=0.1)
    with tuned(snes_stol=1.0):  # nor does a short step end a solve, whatever the environment says
        solved(tmp_path / "tuned")
    assert {one.snes.getTolerances()[2] for one in made} == {0.0}


@pytest.mark.parametrize(
    "contact",
    [
        *(
            {"method": method}
            for method in ("penalty", "augmented_lagrangian", "uzawa", "active_set")
        ),
        {"method": "augmented_lagrangian", "friction": 0.3},
    ],
    ids=named,
)
def test_a_condensed_body_takes_no_number_that_is_none(tmp_path, monkeypatch, contact):
    """A compliance or an increment that is not a number fails on a condensed body.

    An increment of NaN has no point in contact and looked like a tip that does not touch.
    """
    sections = {"contact": contact, "solver": {"method": "condensed"}}
    column, step = Condenser._solve_block, CondensedContact.newton_step
    monkeypatch.setattr(step_size_control, "SMALLEST_STEP_FRACTION", 0.5)
    with monkeypatch.context() as patch:
        patch.setattr(
            Condenser,
            "_solve_block",
            lambda *given: tuple(np.nan * part for part in column(*given)),
        )
        with pytest.raises(NotConverged, match="response to forces on its surface is not a number"):
            solved(tmp_path, **sections)
    if contact["method"] == "active_set":  # has no such step
        return
    monkeypatch.setattr(CondensedContact, "newton_step", lambda *given: np.nan * step(*given))
    with pytest.raises(NotConverged):
        solved(tmp_path, **sections)


def test_a_multiplier_that_is_no_number_has_not_settled():
    solver, base = SimpleNamespace(failure=""), scene(CYLINDER, contact={"method": "uzawa"})
    assert not uzawa.iterate(
        solver, base, MPI.COMM_SELF, lambda rtol: True, lambda mixing: float("nan")
    )
    assert solver.failure == "the multiplier is not a number"
