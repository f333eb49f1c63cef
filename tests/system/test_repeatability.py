"""The same scene gives the same bits, whatever a process has done before."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]

# Runs the scene again and again in a fresh process, with a constant of somebody else made in
# between: a run makes two, so that those of the fourth are numbers 9 and 10 of UFL, which orders
# them by their text. Prints the states.
PROGRAM = """
from dolfinx import fem, mesh
from mpi4py import MPI
from indent_sim.config.scene_file import config_from_mapping
from indent_sim.run.pipeline import states
from indent_sim.scene.scene import resolve

scene = resolve(config_from_mapping({
    "body": {"shape": "cylinder", "radius": 1.0, "height": 1.0},
    "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.3},
    "indenter": {"shape": "paraboloid", "R": 1.0},
    "loading": {"delta": 0.01, "steps": 1},
    "mesh": {"h_contact": 0.06, "h_far": 0.5},
}))
line = mesh.create_unit_interval(MPI.COMM_SELF, 1)
for _ in range(5):
    (state,) = states(scene)
    numbers = (state.force, state.a, state.p_max, state.penetration, state.energy)
    print(*numbers, state.surface.u.tobytes().hex())
    fem.Constant(line, 1.0)
"""


def test_no_bit_depends_on_earlier_runs_of_the_process() -> None:
    """A scene gives the same bits first, last and between other runs of a process.

    Rounding is deterministic as long as the operations and their order are the same.
    """
    search = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env=os.environ | {"PYTHONPATH": search},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert len(lines) == 5
    assert set(lines) == {lines[0]}
