"""`solver.petsc` in the scene file: numerics alone get through; viewers, monitors, files and code never do."""

from __future__ import annotations

import re

import pytest

from indent_sim.config.file import loads
from indent_sim.config.petsc_options import INNER, LISTS, NUMBERS, SWITCHES, WHOLE, WORDS
from indent_sim.process.errors import ConfigError

SCENE = """\
body: {shape: cylinder, radius: 1, height: 1}
material: {model: linear_elastic, E: 1, nu: 0.3}
indenter: {shape: paraboloid, R: 1}
loading: {delta: 0.01}
solver:
  petsc:
    ksp_rtol: 1e-9
"""

HOSTILE = [
    'ksp_monitor: "ascii:x;touch PWNED;.gz"',  # PETSc pipes *.gz through a shell
    "ksp_view: ascii:/etc/passwd",
    "mg_levels_ksp_view: true",
    "fieldsplit_0_pc_view: ascii:x",
    "ksp_converged_reason: ascii:x",
    "ksp_view_eigenvalues: binary:x",
    "ksp_compute_eigenvalues: ascii:x",
    "pc_type: python",
    "ksp_type: python",
    "snes_type: python",
    "mat_type: python",
    "pc_python_type: os.system",
    "pc_type: shell",
    "snes_linesearch_type: shell",
    "snes_linesearch_monitor: ascii:x",
    "snes_convergence_test: skip",  # would take any residual for converged
    "snes_rtol: 1",  # has no effect: the program judges convergence itself
    "options_file: x",
    "log_view: ascii:x",
    "info: x",
    "malloc_dump: x",
    "on_error_attach_debugger: xterm",
    "prefix_push: x",
    "mat_mumps_ooc_tmpdir: /tmp",
    "mat_mumps_icntl_22: 1",  # out of core: files
    "mat_mumps_icntl_1: 7",  # messages to the Fortran unit 7: a file fort.7
    "mat_mumps_icntl_14: 60; touch x",
    "mat_mumps_icntl_14: 1e300",
    "ksp_rtol: 1e-8 -ksp_view ascii:x",
    "ksp_rtol: true",
    "ksp_max_it: 1.5",
    "ksp_max_it: -99999999999999999999999",
    "ksp_knoll: 1",
    "ksp_chebyshev_esteig: 0,0.1,0,x",
    "pc_hypre_type: euclid",  # reads ./database
    "pc_hypre_boomeramg_print_statistics: 1",
    'ksp_type: "cg "',
    '"ksp_type ": cg',
    '"-ksp_view": true',
    '"ksp_rtol -ksp_view": 1e-8',
    '"x\\n": 1',
    "indent_sim_ksp_rtol: 1e-8",
]  # fmt: skip


@pytest.mark.parametrize("option", HOSTILE)
def test_anything_else_is_refused_at_its_line(option):
    with pytest.raises(ConfigError) as caught:
        loads(SCENE + f"    {option}\n", "scene.yaml")
    error = caught.value
    assert (error.exit_code, error.file, error.line) == (3, "scene.yaml", 8)
    assert error.key.startswith("solver.petsc") and "\n" not in str(error)


@pytest.mark.parametrize("option", ["ksp_view", "mg_levels_ksp_monitor", "pc_type", "options_file", "log_view"])
def test_set_is_held_to_the_list_too(option):
    with pytest.raises(ConfigError) as caught:
        loads(SCENE, "scene.yaml", [f"solver.petsc.{option}=ascii:x"])
    assert caught.value.file.startswith("--set")


def test_inner_solvers_have_the_same_options():
    options = "".join(f"    {prefix.replace('N', '1')}ksp_max_it: 3\n" for prefix in INNER)
    options += "    fieldsplit_0_mg_levels_2_pc_type: sor\n    mg_levels_ksp_chebyshev_esteig: 0,0.1,0,1.1\n"
    assert len(loads(SCENE + options).solver.petsc) == len(INNER) + 3


def test_a_near_miss_is_guessed():
    with pytest.raises(ConfigError, match=r"did you mean 'mg_levels_ksp_type'\?"):
        loads(SCENE + "    mg_levels_ksp_tipe: cg\n")


def test_the_list_names_nothing_that_looks_outside():
    """No option that PETSc's manual calls a viewer, monitor, file, type of code or debugger."""
    outside = re.compile("view|monitor|reason|file|python|shell|ooc|load|dump|debug|print|log|display|info|saws|path")
    names = WHOLE | NUMBERS | LISTS | SWITCHES | WORDS.keys()
    harmless = {"pc_hypre_parasails_loadbal", "pc_hypre_boomeramg_agg_num_paths"}
    assert not {name for name in names if outside.search(name)} - harmless
    words = {word for words in WORDS.values() for word in words}
    assert not words & {"python", "shell", "composite", "telescope", "patch", "matlab", "binary", "ascii"}
    assert "mat" not in WORDS["pc_type"]
    assert not any(re.search(r"[^\w/+,-]", word) or word.startswith(("/", ".")) for word in words)
