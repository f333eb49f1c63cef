"""Several ranks give the forces of one, write files once, and end badly with one message."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterable
from functools import cache
from os import environ
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import MPI_ENVIRONMENT, ROOT, Mpirun
from mesh_files import block, write
from scenes import BOX, CYLINDER, ELASTIC, PARABOLOID, STRIP

from indent_sim.config.scene_file import config_from_mapping, to_yaml
from indent_sim.results.field_reader import read_fields

# Round-off: sums in another order and another elimination order, seen through a matrix whose
# condition is below 1e6
SAME = 1e-9
NUMBERS = ("delta", "force", "a", "p_max", "penetration", "energy", "reaction")

SCENES: dict[str, dict[str, Any]] = {
    "axisymmetric": {
        "body": CYLINDER,
        "mesh": {"h_contact": 0.02},
        "loading": {"deltas": [0.005, 0.01, 0.003, -0.01]},
    },
    "plane_strain": {
        "body": STRIP | {"base": "roller", "sides": "free"},  # held by a pin that only one rank has
        "mesh": {"h_contact": 0.03, "symmetry": "full"},
        "loading": {"delta": 0.01, "steps": 2},
    },
    "current_gap": {
        "body": CYLINDER,
        "contact": {"method": "auto", "gap": "current"},
        "mesh": {"h_contact": 0.03},
        "loading": {"delta": 0.01, "steps": 2},
    },
    "newton": {
        "body": BOX,
        "mesh": {"h_contact": 0.2},
        "loading": {"delta": 0.06, "steps": 1},
        "solver": {"method": "newton"},
    },
    "iterative": {
        "body": BOX,
        "material": ELASTIC | {"nu": 0.4999},
        "mesh": {"h_contact": 0.2},
        "loading": {"delta": 0.06, "steps": 1},
        "solver": {"linear": "iterative", "rtol": 1e-11},
    },
    "penalty": {
        "body": CYLINDER,
        "contact": {"method": "penalty"},
        "mesh": {"h_contact": 0.05},
        "loading": {"delta": 0.01},
    },
    "box": {"body": BOX, "mesh": {"h_contact": 0.15}, "loading": {"delta": 0.04, "steps": 2}},
    "rough": {
        "body": CYLINDER,
        "contact": {"method": "auto", "gap": "current", "friction": 0.5},
        "mesh": {"h_contact": 0.03},
        "loading": {"deltas": [0.005, 0.01, 0.005]},
    },
    "rough_box": {
        "body": BOX,
        "contact": {"method": "auto", "friction": 0.3},
        "mesh": {"h_contact": 0.2},
        "loading": {"delta": 0.04, "steps": 2},
    },
    **{
        f"finite_strain_{method}": {
            "body": CYLINDER,
            "material": {"model": "neo_hookean", "E": 1.0, "nu": 0.49},
            "indenter": {"shape": "sphere", "R": 1.0},
            "contact": {"method": method},
            "mesh": {"h_contact": 0.04},
            "loading": {"delta": 0.3, "steps": 3},
        }
        for method in ("auto", "active_set")
    },
    "sticky": {
        "body": CYLINDER,
        "material": {"model": "neo_hookean", "E": 1.0, "nu": 0.3},
        "contact": {"method": "auto", "adhesion": {"work": 1e-2, "range": 2.5e-2}},
        "mesh": {"h_contact": 0.05},
        "loading": {"deltas": [-0.15, 0.03, -0.05, -0.2]},  # snaps in, and lets go
    },
    "ball": {
        "body": {"shape": "ball", "radius": 1.0},
        "indenter": {"shape": "plate"},
        "contact": {"method": "auto", "gap": "current"},
        "mesh": {"h_contact": 0.03},
        "loading": {"delta": 0.02, "steps": 2},
    },
    "forces": {"body": BOX, "mesh": {"h_contact": 0.15}, "loading": {"forces": [0.005, 0.01, 0.0]}},
    "forces_newton": {
        "body": CYLINDER,
        "material": {"model": "neo_hookean", "E": 1.0, "nu": 0.3},
        "mesh": {"h_contact": 0.05},
        "loading": {"forces": [0.002, 0.0, 0.001]},
    },
}

METHODS = ("augmented_lagrangian", "uzawa", "active_set", "nitsche", "penalty")
EVERY_METHOD = {
    f"{method}_{solver}": {
        "body": CYLINDER,
        "contact": {"method": method},
        "solver": {"method": solver},
        "mesh": {"h_contact": 0.03},
        "loading": {"delta": 0.01, "steps": 2},
    }
    for method in METHODS
    for solver in ("condensed", "newton")
    if (method, solver) != ("nitsche", "condensed")
}
ELSEWHERE = {"strip": (STRIP, 0.03, 0.01), "box": (BOX, 0.2, 0.06)}
EVERYWHERE = {
    f"{name}_{place}": data
    | {"body": body, "mesh": {"h_contact": h}, "loading": {"delta": delta, "steps": 2}}
    for place, (body, h, delta) in ELSEWHERE.items()
    for name, data in EVERY_METHOD.items()
}
SCENES |= EVERY_METHOD

# Walks every scene on all ranks and prints, on rank 0, its states and how many of them the ranks
# disagree about
PROGRAM = f"""
import json, sys
from mpi4py import MPI
from indent_sim.config.scene_file import config_from_mapping
from indent_sim.run.pipeline import states
from indent_sim.scene.scene import resolve

comm = MPI.COMM_WORLD
result = {{}}
for name, data in json.loads(sys.argv[1]).items():
    walked = list(states(resolve(config_from_mapping(data)), comm))
    compared = [*{NUMBERS!r}, "newton_iterations", "converged"]
    rows = [[getattr(state, name) for name in compared] for state in walked]
    everywhere = comm.gather(rows)
    if comm.rank == 0:
        reactions = [state.reactions for state in walked]
        agreed = all(other == rows for other in everywhere)
        result[name] = {{"rows": rows, "reactions": reactions, "agreed": agreed}}
if comm.rank == 0:
    print("RESULT" + json.dumps(result))
"""


def mapping(name: str) -> dict[str, Any]:
    """The config of a scene."""
    return {"material": ELASTIC, "indenter": PARABOLOID} | (SCENES | EVERYWHERE)[name]


def mappings(names: Iterable[str]) -> str:
    """The configs of scenes, as PROGRAM reads them."""
    return json.dumps({name: mapping(name) for name in names})


def parsed(finished: subprocess.CompletedProcess[str]) -> dict[str, Any]:
    """The result that PROGRAM printed."""
    assert finished.returncode == 0, finished.stdout + finished.stderr
    (line,) = [line for line in finished.stdout.splitlines() if line.startswith("RESULT")]
    return json.loads(line.removeprefix("RESULT"))


@cache
def alone(*names: str) -> dict[str, Any]:
    """Results of scenes on one rank, in a process of its own like the others."""
    command = [sys.executable, "-c", PROGRAM, mappings(names)]
    return parsed(
        subprocess.run(
            command, env=environ | MPI_ENVIRONMENT, cwd=ROOT, capture_output=True, text=True
        )
    )


def assert_same_curves(
    here: dict[str, Any], there: dict[str, Any], name: str, steps_apart: int = 0
) -> None:
    """Assert that every number of every step is the same to 1e-9 of the largest of its kind.

    Zero out of contact is zero then. Newton may take `steps_apart` iterations more or less.
    """
    assert there["agreed"], f"the ranks differ among themselves about {name}"
    assert len(there["rows"]) == len(here["rows"])
    one, several = (np.array(result["rows"], dtype=float) for result in (here, there))
    for column, what in enumerate([*NUMBERS, "newton_iterations", "converged"]):
        scale = np.abs(one[:, column]).max()
        # what a multiplier leaves of a gap is round-off of the depth
        floor = SAME * (one[:, 0].max() if what == "penetration" else scale)
        floor = max(floor, steps_apart) if what == "newton_iterations" else floor
        assert several[:, column] == pytest.approx(one[:, column], rel=SAME, abs=floor), (
            f"{what} of {name}"
        )
    largest = np.abs(one[:, NUMBERS.index("force")]).max()
    for mine, theirs in zip(here["reactions"], there["reactions"], strict=True):
        assert theirs == pytest.approx(mine, rel=SAME, abs=SAME * largest), f"reactions of {name}"


def assert_same_on(
    ranks: int, names: Iterable[str], mpirun: Mpirun, program: str = PROGRAM
) -> None:
    """Assert that every curve of these scenes is the same on so many ranks as on one."""
    together = parsed(mpirun(ranks, "-c", program, mappings(names)))
    for name in names:
        assert_same_curves(alone(*names)[name], together[name], name)


FEW = ("axisymmetric", "newton", "iterative", "rough_box", "sticky", "box")  # one of a kind
OTHERS = tuple(name for name in SCENES if name not in FEW)


@pytest.mark.parametrize("names", [FEW, pytest.param(OTHERS, marks=pytest.mark.verify)], ids=len)
def test_same_curves_on_two_ranks(names: tuple[str, ...], mpirun: Mpirun) -> None:
    """Two ranks give the curves of one, for each kind of body, solver and law.

    Every contact method and path is tried with the proofs.
    """
    assert_same_on(2, names, mpirun)


RAMP = {
    "history": [[0, 0], [0.01, 0.02], [0.1, 0.02]],
    "times": [0.005, 0.01, 0.02, 0.1],
    "per_doubling": 2,
}
WET = ELASTIC | {"flow": {"diffusivity": 1.0}}
IN_TIME: dict[str, dict[str, Any]] = {
    "draining": {"body": CYLINDER, "material": WET, "loading": RAMP, "mesh": {"h_contact": 0.03}},
    "box": {
        "body": BOX,
        "material": WET,
        "loading": RAMP | {"times": [0.01, 0.1]},
        "mesh": {"h_contact": 0.2},
    },
    "rough": {
        "body": CYLINDER,
        "material": {
            "model": "mooney_rivlin",
            "C10": 0.15,
            "C01": 0.05,
            "nu": 0.45,
            "relaxation": {"prony": [[0.4, 0.05]], "of": "shear"},
        },
        "contact": {"friction": 0.3},
        "loading": RAMP,
        "mesh": {"h_contact": 0.05},
    },
    "lifted": {
        "body": CYLINDER | {"base": "roller", "sides": "free"},
        "material": {
            "model": "gel",
            "G": 1.0,
            "n_omega": 1e-3,
            "chi": 0.6,
            "stretch": 1.4,
            "flow": WET["flow"],
        },
        "loading": {
            "force_history": [[0, 0], [3, 0], [3, 0.1], [6, 0.1]],
            "times": [1.0, 3.0, 6.0],
        },
        "mesh": {"h_contact": 0.1},
    },
}
OF_TIME = ("t", "delta", "force", "a", "outflow", "pore_pressure_max", "converged")


@pytest.mark.parametrize(
    "names",
    [("draining",), pytest.param(("box", "rough", "lifted"), marks=pytest.mark.verify)],
    ids=len,
)
def test_same_histories_on_two_ranks(names: tuple[str, ...], mpirun: Mpirun) -> None:
    """Two ranks give the histories of one to 1e-9 of the largest number.

    Bodies drain, relax with friction, and swell under a tip that is lifted and under a weight. What
    is found by a search is good to its own tolerance.
    """
    program = PROGRAM.replace(repr(NUMBERS), repr(OF_TIME)).replace(
        ', "newton_iterations", "converged"]', "]"
    )
    scenes = json.dumps(
        {
            name: {"indenter": PARABOLOID, "material": ELASTIC} | data
            for name, data in IN_TIME.items()
            if name in names
        }
    )
    two, one = (parsed(mpirun(ranks, "-c", program, scenes)) for ranks in (2, 1))
    for name in names:
        assert two[name]["agreed"], f"the ranks differ among themselves about {name}"
        here, there = (np.array(result[name]["rows"], dtype=float) for result in (one, two))
        assert here[:, -1].all() and there[:, -1].all()
        for column, what in enumerate(OF_TIME[:-1]):
            slack = (1e-7 if name == "lifted" else SAME) * np.nanmax(
                np.abs(here[:, column]), initial=1e-12
            )
            assert there[:, column] == pytest.approx(
                here[:, column], rel=SAME, abs=slack, nan_ok=True
            ), f"{what} of {name}"


SLIDES: dict[str, dict[str, Any]] = {
    "slide": {
        "body": STRIP,
        "contact": {"friction": 0.3},
        "mesh": {"h_contact": 0.05},
        "loading": {"delta": 0.01, "steps": 1, "slide": {"to": [0.004, -0.004], "steps": 2}},
    },
    "slide_half": {
        "body": BOX,
        "contact": {"friction": 0.3},
        "mesh": {"h_contact": 0.2},
        "loading": {"delta": 0.04, "steps": 1, "slide": {"to": [0.004], "steps": 2}},
    },
}
OF_SLIDE = ("x", "force", "a", "side_force_x", "dissipation", "stick_radius", "moment", "converged")


@pytest.mark.parametrize("name", ["slide", pytest.param("slide_half", marks=pytest.mark.verify)])
def test_same_slides_on_two_ranks(name: str, mpirun: Mpirun) -> None:
    """Two ranks give the side forces and the dissipation of one to 1e-9 of the largest number."""
    program = PROGRAM.replace(repr(NUMBERS), repr(OF_SLIDE)).replace(
        ', "newton_iterations", "converged"]', "]"
    )
    scene = {"indenter": PARABOLOID, "material": ELASTIC} | SLIDES[name]
    two, one = (
        parsed(mpirun(ranks, "-c", program, json.dumps({name: scene})))[name] for ranks in (2, 1)
    )
    assert two["agreed"], f"the ranks differ among themselves about {name}"
    here, there = (np.array(result["rows"], dtype=float) for result in (one, two))
    assert here[:, -1].all() and there[:, -1].all()
    for column, what in enumerate(OF_SLIDE[:-1]):
        slack = SAME * np.abs(here[:, column]).max()
        assert there[:, column] == pytest.approx(here[:, column], rel=SAME, abs=slack), (
            f"{what} of {name}"
        )


TOGETHER = """
from indent_sim.fe.condensed import compliance
compliance.machine_memory = lambda: 0
"""


@pytest.mark.verify
@pytest.mark.parametrize("ranks", [3, 4])
def test_same_curves_on_ranks_that_share_little(ranks: int, mpirun: Mpirun) -> None:
    """Three and four ranks give the curves of one, where some have no facet of the contact."""
    assert_same_on(ranks, FEW, mpirun)


@pytest.mark.verify
def test_same_curves_where_ranks_factor_a_body_together(mpirun: Mpirun) -> None:
    """Ranks that factor a body together give the curves of one.

    They do so where memory is too small for the whole body on every rank.
    """
    program = f"from indent_sim.run.single_run import backend\nbackend()\n{TOGETHER}{PROGRAM}"
    assert_same_on(2, ("axisymmetric", "box", "rough"), mpirun, program)


@pytest.mark.verify
def test_every_method_everywhere_on_two_ranks(mpirun: Mpirun) -> None:
    """Every method gives the same on two ranks in plane strain and in three dimensions."""
    assert_same_on(2, EVERYWHERE, mpirun)


def test_same_curves_where_linear_elements_are_aggregated(mpirun: Mpirun) -> None:
    """Two ranks whose linear elements are aggregated give the curves of one.

    That is done where they are too many for a factorisation, and aggregates end where ranks do.
    Each preconditioner leaves another remainder below the tolerance of the linear solves, by which
    the last Newton iteration may be needed or not.
    """
    program = f"from indent_sim.run.single_run import backend\nbackend()\n{AGGREGATED}{PROGRAM}"
    together = parsed(mpirun(2, "-c", program, mappings(["iterative"])))
    assert_same_curves(
        alone(*SCENES)["iterative"], together["iterative"], "iterative", steps_apart=1
    )


AGGREGATED = """
from indent_sim.fe.solve import multigrid
multigrid.LARGEST_FACTORED = 0
"""
PACKED = """
import json, sys
from mpi4py import MPI
from indent_sim.config.scene_file import config_from_mapping
from indent_sim.fe import solver
from indent_sim.mesh import gmsh
from indent_sim.process.ranks import run_on_root
from indent_sim.scene.scene import resolve

comm, found = MPI.COMM_WORLD, {}
for name, mapping in json.loads(sys.argv[1]).items():
    scene = resolve(config_from_mapping(mapping))
    domain = scene.physics.domain
    grid = run_on_root(comm, gmsh.build_mesh, domain, scene.sizes)
    walk = solver.create_load_stepper(scene, solver.distribute(grid, domain, comm))
    for state in walk.states(scene.physics.path, lambda step: False):
        pass
    points = comm.bcast(walk.points)
    body = walk.equilibrium
    depth, _, arrays = points[-1]
    body.restore(body.unpack(0.0, points[0][2]))
    body.restore(body.unpack(depth, arrays))
    back = abs(body.force / state.force - 1)
    lists = [[values.tolist() for values in arrays] for _, _, arrays in points]
    found[name] = {"points": lists, "back": back}
if comm.rank == 0:
    print("RESULT" + json.dumps(found))
"""
PULLED_OFF = """
import json, sys
from mpi4py import MPI
from indent_sim.config.scene_file import config_from_mapping
from indent_sim.fe import solver
from indent_sim.mesh import gmsh
from indent_sim.process.ranks import run_on_root
from indent_sim.scene.scene import resolve

comm = MPI.COMM_WORLD
scene = resolve(config_from_mapping(json.loads(sys.argv[1])))
domain = scene.physics.domain
grid = run_on_root(comm, gmsh.build_mesh, domain, scene.sizes)
walk = solver.create_load_stepper(scene, solver.distribute(grid, domain, comm))
rows = [state.force for state in walk.states(scene.physics.path, lambda step: False)]
found = comm.allgather(walk.find_pull_off())
first = found[0]
same = [(one.state.force, one.equilibria) == (first.state.force, first.equilibria) for one in found]
assert all(same)
if comm.rank == 0:
    numbers = [min(rows), first.state.force, first.error, first.equilibria]
    print("RESULT" + json.dumps(numbers))
"""


def test_every_rank_searches_for_the_same_largest_pull(mpirun: Mpirun) -> None:
    """Two ranks find the largest pull of one rank to 1e-8, after the same equilibria."""
    loose = {"contact": {"adhesion": {"work": 1e-2, "range": 5e-2}}, "mesh": {"h_contact": 0.08}}
    scene = (
        mapping("sticky")
        | loose
        | {"material": ELASTIC, "loading": {"deltas": [0.03, -0.01, -0.1]}}
    )
    two, one = (parsed(mpirun(ranks, "-c", PULLED_OFF, json.dumps(scene))) for ranks in (2, 1))
    assert two[:2] == pytest.approx(one[:2], rel=1e-8) and two[3] == one[3]
    assert one[1] < one[0] < 0


KEPT = {
    "newton": {"solver": {"method": "newton", "linear": "iterative", "rtol": 1e-11}},
    "uzawa_newton": {},
}  # with a vector of its own beside the unknowns


def test_a_state_is_kept_in_an_order_that_does_not_know_the_ranks(mpirun: Mpirun) -> None:
    """A checkpoint of two ranks is that of one, so that any number of ranks may resume it.

    Displacements agree to 1e-9 of the largest, as the curves do.
    """
    scenes = json.dumps({name: mapping(name) | sections for name, sections in KEPT.items()})
    two, one = (parsed(mpirun(ranks, "-c", PACKED, scenes)) for ranks in (2, 1))
    for name in KEPT:
        assert two[name]["back"] < 1e-12
        for here, there in zip(one[name]["points"], two[name]["points"], strict=True):
            for ours, theirs in zip(map(np.array, here), map(np.array, there), strict=True):
                assert np.abs(ours - theirs).max() <= SAME * max(1e-3, np.abs(ours).max())


RELAXED = """
import json, sys
from dataclasses import replace
from mpi4py import MPI
from indent_sim.config.scene_file import config_from_mapping
from indent_sim.fe import solver
from indent_sim.mesh import gmsh
from indent_sim.model.relaxation import PronySeries
from indent_sim.process.ranks import run_on_root
from indent_sim.scene.scene import resolve

comm, found = MPI.COMM_WORLD, {}
for name, mapping in json.loads(sys.argv[1]).items():
    scene = resolve(config_from_mapping(mapping))
    series = PronySeries(0.3, (0.4, 0.3), (0.1, 1.0))
    domain = scene.physics.domain
    regions = tuple(replace(region, relaxation_series=series) for region in domain.regions)
    domain = replace(domain, regions=regions)
    scene = scene.replace_physics(domain=domain)
    mesh = solver.distribute(run_on_root(comm, gmsh.build_mesh, domain, scene.sizes), domain, comm)
    body = solver.create_equilibrium(scene, mesh)

    def step(depth, dt):
        assert body.solve(depth, dt), body.failure
        body.accept()
        return body.force

    forces = [step(0.02, 0.0), step(0.02, 0.1)]
    arrays = comm.bcast(body.pack(body.snapshot()))
    forces.append(step(0.02, 0.5))
    body.restore(body.unpack(0.02, arrays))
    lists = [values.tolist() for values in arrays]
    again = step(0.02, 0.5)
    found[name] = {"arrays": lists, "forces": forces, "again": again}
if comm.rank == 0:
    print("RESULT" + json.dumps(found))
"""
RELAXING = {  # stresses at points inside cells are kept beside the unknowns
    "bulging": {"body": CYLINDER, "mesh": {"h_contact": 0.05}, "solver": {"method": "newton"}},
    "box": {"body": BOX, "mesh": {"h_contact": 0.2}, "solver": {"method": "newton"}},
}


def test_what_relaxes_is_kept_in_an_order_that_does_not_know_the_ranks(mpirun: Mpirun) -> None:
    """Relaxing stresses in a checkpoint of two ranks are those of one, in two and three dimensions.

    Stresses are of the order of 0.01 E, as are their differences.
    """
    defaults = {"material": ELASTIC, "indenter": PARABOLOID, "loading": {"delta": 0.02}}
    scenes = json.dumps({name: defaults | sections for name, sections in RELAXING.items()})
    two, one = (parsed(mpirun(ranks, "-c", RELAXED, scenes)) for ranks in (2, 1))
    for name in RELAXING:
        assert two[name]["again"] == pytest.approx(two[name]["forces"][-1], rel=1e-9)
        assert two[name]["forces"] == pytest.approx(one[name]["forces"], rel=SAME)
        for ours, theirs in zip(
            *(map(np.array, ranks[name]["arrays"]) for ranks in (one, two)), strict=True
        ):
            assert np.abs(ours - theirs).max() <= SAME * max(1.0, np.abs(ours).max())


@pytest.fixture
def config(tmp_path: Path) -> Path:
    """A scene file, alone in its folder."""
    path = tmp_path / "scene.yaml"
    path.write_text(to_yaml(config_from_mapping(mapping("axisymmetric"))))
    return path


def test_files_are_written_once(config: Path, mpirun: Mpirun, tmp_path: Path) -> None:
    """Two ranks leave the folder that one leaves, with one row a step, and print once."""
    finished = mpirun(
        2, "-m", "indent_sim.cli.commands", "run", config, "--output", tmp_path / "two"
    )
    assert finished.returncode == 0, finished.stderr
    assert finished.stdout.split() == [str(tmp_path / "two")]
    rows = (tmp_path / "two" / "force_indentation.csv").read_text().splitlines()
    assert [row.split(",")[0] for row in rows] == ["step", "1", "2", "3", "4"]
    assert json.loads((tmp_path / "two" / "run.json").read_text())["ranks"] == 2
    present = {path.name for path in (tmp_path / "two").iterdir()}
    assert {
        "force_indentation.csv",
        "surface.csv",
        "fields.xdmf",
        "fields",
        "config.yaml",
        "run.json",
    } <= present
    assert sorted(path.name for path in tmp_path.iterdir()) == ["scene.yaml", "two"]


def test_fields_do_not_depend_on_the_ranks(mpirun: Mpirun, tmp_path: Path) -> None:
    """Fields of two ranks are those of one in the grid's own order, to rounding.

    That includes nodes where facets of two ranks meet.
    """
    config = tmp_path / "scene.yaml"
    config.write_text("""
body: {shape: box, size: [1.0, 1.0, 0.5]}
material: {model: neo_hookean, E: 1.0, nu: 0.3}
indenter: {shape: sphere, R: 0.5}
loading: {delta: 0.05, steps: 1}
mesh: {h_contact: 0.08, h_far: 0.2}
""")
    for ranks in (1, 2):
        words = (
            "-m",
            "indent_sim.cli.commands",
            "run",
            config,
            "--quiet",
            "--output",
            tmp_path / str(ranks),
        )
        assert mpirun(ranks, *words).returncode == 0
    alone_, together = (read_fields(tmp_path / str(ranks), 1) for ranks in (1, 2))
    assert alone_["pressure"].max() > 0
    for name, values in alone_.items():
        assert np.abs(together[name] - values).max() <= 1e-11 * np.abs(values).max(), name


def test_config_error_ends_every_rank_with_one_message(
    config: Path, mpirun: Mpirun, tmp_path: Path
) -> None:
    """A config error ends mpirun with exit code 3 and one message, and leaves nothing."""
    config.write_text(config.read_text().replace("R: 1.0", "r: 1.0"))
    finished = mpirun(
        3, "-m", "indent_sim.cli.commands", "run", config, "--output", tmp_path / "three"
    )
    assert finished.returncode == 3, finished.stderr
    assert finished.stderr.count("did you mean 'R'") == 1
    assert "Traceback" not in finished.stderr
    assert finished.stdout.strip() == ""
    assert [path.name for path in tmp_path.iterdir()] == ["scene.yaml"]


def test_scene_that_cannot_exist_ends_every_rank(
    config: Path, mpirun: Mpirun, tmp_path: Path
) -> None:
    """An error found when the scene is resolved ends all ranks with one message."""
    config.write_text(
        to_yaml(config_from_mapping(mapping("axisymmetric") | {"loading": {"delta": 2.0}}))
    )
    finished = mpirun(
        2, "-m", "indent_sim.cli.commands", "run", config, "--output", tmp_path / "two"
    )
    assert finished.returncode == 3, finished.stderr
    assert finished.stderr.count("beyond the body's thickness") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["scene.yaml"]


# Every rank of a set fails at the second row, which the others then wait for; argv: the ranks, and
# how
FAILING = """
import os, signal, sys
from mpi4py import MPI
from indent_sim.cli import commands
from indent_sim.process import ranks as process
from indent_sim.process.errors import NotConverged
from indent_sim.run.derived_quantities import DerivedQuantities
complete, ranks, how = DerivedQuantities.complete_state, sys.argv.pop(1), sys.argv.pop(1)
def fail(quantities, state):
    if state.step == 2 and str(MPI.COMM_WORLD.rank) in ranks:
        if how == "killed":
            os.kill(os.getpid(), signal.SIGKILL)
        raise {"expected": NotConverged, "bug": RuntimeError}[how]("injected")
    return complete(quantities, state)
DerivedQuantities.complete_state, process.RANK_TIMEOUT = fail, 2.0
commands.main()
"""


@pytest.mark.parametrize(
    ("ranks", "how", "code", "said"),
    [
        ("1", "expected", 5, "error: injected"),
        ("1", "bug", 1, "RuntimeError: injected"),
        ("0", "bug", 1, "RuntimeError: injected"),
        ("012", "bug", 1, "RuntimeError: injected"),
        ("012", "expected", 5, "error: injected"),
        ("1", "killed", 137, "signal 9"),
    ],
)
def test_an_error_on_any_rank_ends_all(
    ranks: str, how: str, code: int, said: str, config: Path, mpirun: Mpirun, tmp_path: Path
) -> None:
    """An error on one rank or on all ends all with its exit code and one message.

    A rank that hangs would take minutes.
    """
    finished = mpirun(3, "-c", FAILING, ranks, how, "run", config, "--output", tmp_path / "out")
    assert finished.returncode == code, finished.stderr
    assert finished.stderr.count(said) == 1, finished.stderr
    rows = (tmp_path / "out" / "force_indentation.csv").read_text().splitlines()
    assert [row.split(",")[0] for row in rows] == ["step", "1"]  # what was there stays


# A reading fails on one rank alone, which the others do not wait for; argv: the rank
MISSING = """
import sys
from mpi4py import MPI
from indent_sim.cli import commands
from indent_sim.model.kinematics import Axisymmetric
area, rank = Axisymmetric.contact_area, int(sys.argv.pop(1))
def fail(kinematics, a):
    if MPI.COMM_WORLD.rank == rank:
        raise KeyError("injected")
    return area(kinematics, a)
Axisymmetric.contact_area = fail
commands.main()
"""


@pytest.mark.parametrize("rank", ["0", "1"])
def test_what_fails_beside_the_rows_on_one_rank_is_missing_on_all(
    rank: str, config: Path, mpirun: Mpirun, tmp_path: Path
) -> None:
    """An optional result that fails on one rank is missing on all, and the rows stay.

    Nobody waits, and one rank says what is missing.
    """
    finished = mpirun(2, "-c", MISSING, rank, "run", config, "--output", tmp_path / "out")
    assert finished.returncode == 0, finished.stderr
    assert finished.stderr.count("area is missing: KeyError") == 1, finished.stderr
    table = [
        row.split(",")
        for row in (tmp_path / "out" / "force_indentation.csv").read_text().splitlines()
    ]
    assert len(table) > 2 and all(row[table[0].index("area")] == "" for row in table[1:])


# Rank 0 is stopped while it writes the second row: the others wait for it there
STOPPED_IN_A_ROW = """
import os, signal, sys
from indent_sim.results.writer import ResultFolder
write_row = ResultFolder.append
def append(folder, state):
    write_row(folder, state)
    if state.step == 2:
        os.kill(os.getpid(), signal.SIGTERM)
ResultFolder.append = append
from indent_sim.cli.commands import main
main()
"""


def test_a_signal_while_a_row_is_written_is_everybodys(
    config: Path, mpirun: Mpirun, tmp_path: Path
) -> None:
    """A signal to one rank while a row is written ends all, and rank 0 closes its files.

    The others learn of it by a message.
    """
    finished = mpirun(2, "-c", STOPPED_IN_A_ROW, "run", config, "--output", tmp_path / "two")
    assert finished.returncode == 143 and "Traceback" not in finished.stderr, finished.stderr
    assert finished.stderr.count("stopped by SIGTERM") == 1
    report = json.loads((tmp_path / "two" / "run.json").read_text())
    assert (report["status"], report["exit_code"], report["rows"]) == ("interrupted", 143, 2)


# What every rank gives dolfinx of a mesh (rows of points and cells), what it holds of it, and the
# last force; argv: the scene.
HELD = """
import json, sys
from indent_sim.mesh import gmsh
from pathlib import Path
from mpi4py import MPI
from indent_sim.config.scene_file import load
from indent_sim.fe import compat
from indent_sim.run import pipeline, single_run

single_run.backend()
comm, given, seen, domains = MPI.COMM_WORLD, [], [], []
create, start = compat.create_mesh, gmsh.start_meshing
def create_mesh(comm, cells, points, dim):
    given.append((len(points), len(cells)))
    return create(comm, cells, points, dim)
def start_meshing(domain, sizes):
    answer = start(domain, sizes)
    def grid():
        seen.append(answer())
        return seen[0]
    return grid
compat.create_mesh, gmsh.start_meshing = create_mesh, start_meshing
run = pipeline.SingleRun.__init__
def init(self, config, scene, *rest):
    domains.append(scene.physics.domain)
    run(self, config, scene, *rest)
pipeline.SingleRun.__init__ = init
outcome = pipeline.simulate(load(Path(sys.argv[1])), comm, directory=Path(f"out{comm.size}"))
mesh = getattr(domains[0], "mesh", None)
mine = {
    "given": given[0],
    "skin": len(mesh.grid.cells) if mesh else 0,
    "whole": mesh.statistics.cells if mesh else 0,
    "held": len(seen),
}
everybody = comm.gather(mine)
if comm.rank == 0:
    whole = seen[0]
    result = {
        "ranks": everybody,
        "force": [state.force for state in outcome.states],
        "points": len(whole.points),
        "cells": len(whole.cells),
        "hash": whole.hash,
    }
    print("RESULT" + json.dumps(result))
"""
DRAWN = """
body: {shape: box, size: [2.0, 2.0, 1.0], base: fixed, layers: [
  {thickness: 0.3, material: {model: linear_elastic, E: 1.0, nu: 0.3}},
  {thickness: 0.7, material: {model: linear_elastic, E: 5.0, nu: 0.4}}]}
indenter: {shape: paraboloid, R: 1.0}
loading: {delta: 0.04, steps: 1}
mesh: {h_contact: 0.2}
"""
OF_FILE = """
body: {shape: mesh, file: part.msh, kinematics: 3d, surfaces: {contact: top, base: bottom},
  regions: {gel: {model: linear_elastic, E: 5.0, nu: 0.4}}}
material: {model: linear_elastic, E: 1.0, nu: 0.3}
indenter: {shape: paraboloid, R: 1.0}
loading: {delta: 0.04, steps: 1}
mesh: {refinements: 1}
"""


@pytest.mark.parametrize("text", [DRAWN, OF_FILE], ids=["of gmsh", "of a file"])
def test_rank_0_alone_holds_the_mesh(text: str, mpirun: Mpirun, tmp_path: Path) -> None:
    """Rank 0 alone holds the mesh; each rank has its slice of the rows.

    Of a mesh file the scene has no more than the outer cells. Cells stay with their regions, as the
    force would differ otherwise.
    """
    body = block(n=5, m=4)
    body["regions"] = {
        "gel": np.flatnonzero(body["points"][body["cells"]].mean(axis=1)[:, 2] < -0.4)
    }
    write(tmp_path / "part.msh", body | {"regions": {**body["regions"], "rest": np.arange(0)}})
    scene = tmp_path / "scene.yaml"
    scene.write_text(text)
    one, three = (parsed(mpirun(ranks, "-c", HELD, scene)) for ranks in (1, 3))
    assert three["hash"] == one["hash"] and three["force"] == pytest.approx(one["force"], rel=SAME)
    for column, name in enumerate(("points", "cells")):
        rows = [rank["given"][column] for rank in three["ranks"]]
        assert sum(rows) == three[name] == one[name] and max(rows) - min(rows) <= 1
    assert [rank["held"] for rank in three["ranks"]] == [1, 0, 0]
    if text is OF_FILE:
        assert all(
            0 < rank["skin"] < rank["whole"] == len(body["cells"]) for rank in three["ranks"]
        )


def test_a_mesh_file_that_is_no_body_ends_every_rank_with_one_message(
    mpirun: Mpirun, tmp_path: Path
) -> None:
    """A mesh file that is no body ends all ranks with one message, though rank 0 alone reads it."""
    body = block()
    body["cells"] = np.vstack([body["cells"], body["cells"][:1]])
    write(tmp_path / "part.msh", body)
    (tmp_path / "scene.yaml").write_text(OF_FILE)
    finished = mpirun(
        3,
        "-m",
        "indent_sim.cli.commands",
        "run",
        tmp_path / "scene.yaml",
        "--output",
        tmp_path / "out",
    )
    assert finished.returncode == 4, finished.stderr
    assert (
        finished.stderr.count("three cells share the facet") == 1
        and "scene.yaml:2: body.file" in finished.stderr
    )
    assert sorted(path.name for path in tmp_path.iterdir()) == ["part.msh", "scene.yaml"]


ROWS = """
import sys
import numpy as np
from mpi4py import MPI
from indent_sim.mesh.distributed_rows import fetch_rows, scatter_rows
comm, chance = MPI.COMM_WORLD, np.random.default_rng(MPI.COMM_WORLD.rank)
for count in (0, 1, 2, 7, 1000):
    whole = np.arange(3 * count, dtype=np.int32).reshape(count, 3)
    mine = scatter_rows(comm, whole if comm.rank == 0 else None)
    assert np.array_equal(np.concatenate(comm.allgather(mine)), whole)
    wanted = chance.integers(0, count, 50 * comm.rank) if count else np.empty(0, dtype=np.int64)
    assert np.array_equal(fetch_rows(comm, mine, wanted), whole[wanted])
"""


@pytest.mark.parametrize("ranks", [1, 3])
def test_rows_go_to_the_ranks_and_are_found_there(ranks: int, mpirun: Mpirun) -> None:
    """Rows are distributed to the ranks and found there.

    There may be fewer rows than ranks, and ranks that want none.
    """
    finished = mpirun(ranks, "-c", ROWS)
    assert finished.returncode == 0, finished.stderr
