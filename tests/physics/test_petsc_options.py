"""`solver.petsc`: what PETSc takes works, what it does not take is a config error in PETSc's own words."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from mpi4py import MPI
from petsc4py import PETSc

from indent_sim.config.file import from_mapping
from indent_sim.fe.path import steps
from indent_sim.fe.problem import Problem
from indent_sim.fe.solve import linear, uzawa
from indent_sim.fe.solve.newton import Newton
from indent_sim.process.errors import ConfigError, NotConverged
from indent_sim.run.chain import Outcome, simulate

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


def solved(folder: Path, petsc: dict[str, Any], **sections: Any) -> Outcome:
    """A run with these PETSc options."""
    config = from_mapping(SCENE | sections | {"solver": {"method": "newton", "petsc": petsc}})
    return simulate(config, MPI.COMM_SELF, directory=folder / "out")


@pytest.mark.parametrize(
    "petsc",
    [
        {"mat_mumps_icntl_14": 60},  # asked for at the factorisation only
        {"ksp_type": "gmres"},  # with the direct factorisation, which stays
        {"ksp_type": "gmres", "pc_type": "jacobi"},
        {"ksp_type": "cg", "pc_type": "gamg", "ksp_rtol": 1e-8},
        {"pc_type": "ilu"},  # MUMPS has none: its defaults must not stand beside it
        {"pc_type": "cholesky"},
        {"pc_factor_mat_solver_type": "petsc"},
    ],
    ids=str,
)
def test_what_petsc_takes_works(tmp_path, petsc):
    assert solved(tmp_path, petsc).states[-1].force == pytest.approx(FORCE, rel=0.02)


@pytest.mark.parametrize("name", ["pc_gamg_threshold", "mg_levels_ksp_max_it"])
def test_an_option_that_petsc_did_not_use_is_named(tmp_path, name):
    with pytest.raises(ConfigError, match="PETSc did not use this option") as caught:
        solved(tmp_path, {"mat_mumps_icntl_14": 60, name: 1})
    assert caught.value.key == f"solver.petsc.{name}" and list(tmp_path.iterdir()) == []


def test_options_of_the_run_before_are_gone(tmp_path):
    solved(tmp_path, {"pc_type": "jacobi", "ksp_type": "cg"})
    with pytest.raises(ConfigError, match="did not use"):
        solved(tmp_path, {"pc_jacobi_type": "diagonal"})


def test_a_step_out_of_contact_asks_for_no_option(tmp_path):
    outcome = solved(tmp_path, {"mat_mumps_icntl_14": 60}, loading={"deltas": [-0.01, 0.01]})
    assert outcome.states[-1].force == pytest.approx(FORCE, rel=0.02)


@pytest.mark.parametrize(
    ("petsc", "said"),
    [
        ({"pc_type": "ilu", "pc_factor_mat_solver_type": "mumps"}, "mumps does not support"),
        ({"pc_factor_mat_solver_type": "pastix"}, "pastix"),
    ],
    ids=["combination", "package"],
)
def test_what_petsc_refuses_is_a_config_error_in_its_words(tmp_path, petsc, said):
    with pytest.raises(ConfigError, match=said) as caught:
        solved(tmp_path, petsc)
    assert caught.value.key == "solver.petsc" and str(caught.value).count("\n") == 0
    assert list(tmp_path.iterdir()) == []


def test_without_options_of_the_user_petsc_keeps_its_error(tmp_path, monkeypatch):
    monkeypatch.setitem(linear.FACTORISATION, "ksp_type", "gmrs")
    with pytest.raises(PETSc.Error):
        solved(tmp_path, {})


@pytest.mark.parametrize(
    ("method", "petsc", "factors"),
    [
        ("penalty", {}, "cholesky"),
        ("augmented_lagrangian", {}, "cholesky"),
        ("uzawa", {}, "cholesky"),
        ("nitsche", {}, "lu"),  # theta = 0: not the derivative of a potential
        ("active_set", {}, "lu"),  # the rows of its nodes depend on the set
        ("penalty", {"pc_type": "lu"}, "lu"),
        ("penalty", {"pc_factor_mat_solver_type": "petsc"}, "lu"),
    ],
    ids=str,
)
def test_a_symmetric_tangent_is_factored_as_such(tmp_path, monkeypatch, method, petsc, factors):
    """L D L^T exactly where the tangent is its own transpose, and where the user chose nothing else."""
    found = []
    assemble = Problem.assemble_tangent

    def watched(problem, A):
        assemble(problem, A)
        found.append((problem.has_symmetric_tangent, A.isSymmetric(1e-14 * A.norm())))

    made: list[Newton] = []
    create = Newton._create
    monkeypatch.setattr(Problem, "assemble_tangent", watched)
    monkeypatch.setattr(Newton, "_create", lambda self, **said: made.append(self) or create(self, **said))
    solved(tmp_path, petsc, contact={"method": method}, material=SCENE["material"] | {"model": "neo_hookean"})
    assert {newton.snes.ksp.pc.getType() for newton in made} == {factors}
    assert all(is_so == said for said, is_so in found)


def test_where_symmetric_factors_fail_others_take_their_place(tmp_path, monkeypatch):
    """Here because MUMPS is given a hundredth of the memory that it wants."""
    install, tried = linear.install, []

    def starved(user, *, symmetric, line_search):
        install(user, symmetric=symmetric, line_search=line_search)
        tried.append(symmetric)
        if symmetric:
            PETSc.Options(linear.PREFIX).setValue("mat_mumps_icntl_14", -99)

    monkeypatch.setattr(linear, "install", starved)
    assert solved(tmp_path, {}).states[-1].force == pytest.approx(FORCE, rel=0.02)
    assert tried == [True, False]


@pytest.mark.parametrize("method", ["newton", "condensed"])
def test_a_failed_uzawa_says_so(tmp_path, monkeypatch, method):
    monkeypatch.setattr(uzawa, "LOOPS", 3)
    monkeypatch.setattr(steps, "SMALLEST_CUT", 0.5)
    contact = {"method": "uzawa", "epsilon_n": 0.01}
    config = from_mapping(SCENE | {"contact": contact, "solver": {"method": method}})
    with pytest.raises(NotConverged, match=r"contact method uzawa.*multiplier does not settle.*delta = 0") as caught:
        simulate(config, MPI.COMM_SELF, directory=tmp_path / "out")
    assert "Newton" not in str(caught.value)


def test_a_failed_linear_solver_is_named_at_a_depth_in_the_users_lengths(tmp_path):
    sections = {
        "body": {"shape": "cylinder", "radius": 1e3, "height": 1e3},
        "indenter": {"shape": "paraboloid", "R": 1e3},
        "loading": {"deltas": [10.0]},
        "mesh": {"h_contact": 50.0, "h_far": 500.0},
    }
    with pytest.raises(NotConverged, match="delta = 10: the linear solver failed"):
        solved(tmp_path, {"ksp_type": "cg", "pc_type": "jacobi", "ksp_max_it": 1}, **sections)
