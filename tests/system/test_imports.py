"""What is imported when, each in a process of its own.

Reading and planning wait for no heavy library.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
HEAVY = ("dolfinx", "basix", "petsc4py", "mpi4py", "gmsh", "h5py", "matplotlib")


def ran(program: str, *words: str | Path) -> None:
    command = [sys.executable, "-c", program, *map(str, words)]
    finished = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert finished.returncode == 0, finished.stderr


def test_a_scene_is_resolved_without_any_heavy_library() -> None:
    """A scene is planned where the solver's libraries cannot be imported."""
    program = f"""
import sys
sys.modules.update(dict.fromkeys({HEAVY!r}))  # importing any of these fails now
import indent_sim, indent_sim.theory.strip, indent_sim.fe.path.step_size_control
assert indent_sim.resolve(indent_sim.load(sys.argv[1])).plan.prediction["force"] > 0
"""
    ran(program, ROOT / "configs" / "hertz.yaml")


def test_reading_a_config_stays_cheap() -> None:
    ran(
        f"import sys, indent_sim.config.scene_file; assert not {{*{HEAVY}, 'ufl', "
        f"'scipy', 'rich'}} & {{*sys.modules}}"
    )


def test_matplotlib_waits_until_it_is_needed() -> None:
    ran("import sys, indent_sim.results.pictures.forces; assert 'matplotlib' not in sys.modules")


def test_the_solver_loads_no_more_than_it_needs() -> None:
    """The solver loads no library that few runs need, each of which takes a tenth of a second.

    UFL only reads its own version from pkg_resources, and few contacts need scipy's searches.
    """
    ran("""
import sys
from indent_sim.run.single_run import backend
backend()
assert not {"scipy.optimize", "scipy.integrate", "matplotlib"} & {*sys.modules}
""")
