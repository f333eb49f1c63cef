"""The architecture of the package, read off its syntax trees: imports, libraries and names."""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

from indent_sim.config.scene_file import load
from indent_sim.scene.scene import resolve

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "indent_sim"
FILES = sorted(PACKAGE.rglob("*.py"))

# What each room may import of the others; a room imports only rooms written above it.
ROOMS: dict[str, set[str]] = {
    "process": set(),
    "model": set(),
    "theory": set(),
    "config": {"model", "process"},
    "results": {"config", "model", "process"},
    "mesh": {"model", "process"},
    "scene": {"config", "mesh", "model", "theory", "process"},
    "fe": {"scene", "mesh", "model", "process"},
    "run": {"fe", "scene", "config", "results", "theory", "model", "process"},
    "studies": {"run", "config", "results", "model", "process"},
    "fitting": {"run", "config", "results", "process"},
    "cli": {"studies", "fitting", "run", "config", "results", "process"},
}

# The same inside fe; `dolfinx_loading` and `kernel_cache` are the process's side of dolfinx.
FE: dict[str, set[str]] = {
    "compat": set(),
    "dolfinx_loading": {"compat"},
    "kernel_cache": {"compat"},
    "measured_constants": set(),
    "nodal_assembly": set(),
    "symbolic_constants": set(),
    "shape_functions": set(),
    "quadrature": {"compat", "shape_functions"},
    "facet_values": {"compat", "kernel_cache", "shape_functions"},
    "surface": {"quadrature", "shape_functions"},
    "mesh": {"compat"},
    "unknowns": {"compat", "kernel_cache"},
    "constraints": {"compat", "mesh"},
    "postprocessing": {"compat", "kernel_cache", "measured_constants", "quadrature", "surface"},
    "discrete_body": {
        "constraints",
        "facet_values",
        "measured_constants",
        "mesh",
        "quadrature",
        "surface",
        "unknowns",
    },
    "terms": {
        "compat",
        "discrete_body",
        "facet_values",
        "kernel_cache",
        "measured_constants",
        "nodal_assembly",
        "quadrature",
        "shape_functions",
        "symbolic_constants",
        "unknowns",
    },
    "problem": {"compat", "discrete_body", "kernel_cache", "terms", "unknowns"},
    "path": {"measured_constants", "postprocessing", "terms"},
    "solve": {
        "compat",
        "constraints",
        "discrete_body",
        "kernel_cache",
        "measured_constants",
        "postprocessing",
        "terms",
        "problem",
        "path",
    },
    "condensed": {
        "discrete_body",
        "kernel_cache",
        "measured_constants",
        "postprocessing",
        "quadrature",
        "shape_functions",
        "surface",
        "terms",
        "path",
        "solve",
    },
}
FE["solver"] = set(FE)  # the door

# Libraries that only these rooms and files may import
LIBRARIES: dict[str, tuple[str, ...]] = {
    "dolfinx": ("fe/",),
    "basix": ("fe/",),
    "ffcx": ("fe/",),
    "petsc4py": ("fe/",),
    "ufl": ("fe/", "model/"),
    "mpi4py": ("fe/",),
    "gmsh": ("mesh/display_libraries.py",),
    "dolfinx_solver": ("fe/dolfinx_loading.py",),
    "meshio": ("mesh/mesh_file.py",),
    "afmformats": ("results/measured/afm_file.py",),
    "pyfmreader": ("results/measured/peakforce_file.py",),
    "h5py": (
        "results/",
        "mesh/mesh_file.py",
        "studies/row_file.py",
        "studies/curve_file.py",
    ),
    "matplotlib": (
        "results/pictures/",
        "fitting/map_picture.py",
        "studies/study_picture.py",
        "studies/small_multiples.py",
        "studies/many_runs_picture.py",
        "fitting/fit_picture.py",
    ),
    "PIL": ("results/map_images.py",),
    "scipy": (
        "theory/",
        "fe/",
        "fitting/",
        "model/",
        "scene/",
        "results/pictures/curves.py",
        "studies/sample.py",
        "studies/polynomial_fit.py",
        "studies/held_out_error.py",
        "studies/term_search.py",
    ),
    "yaml": ("config/strict_yaml.py",),
    "pint": ("config/quantities.py",),
    "jinja2": ("results/html_report.py",),
    "click": ("cli/",),
    "rich": ("cli/",),
}
# Modules and attributes that Windows lacks, and the files that may name them. fe and the tests of
# its cache run where the solver is; the other files have an answer for every system.
POSIX_MODULES = {"fcntl", "grp", "pwd", "resource", "termios", "tty", "pty", "syslog"}
POSIX_NAMES = re.compile(
    r"os\.(O_NOFOLLOW|O_NONBLOCK|O_DIRECTORY|O_CLOEXEC|fchdir|fork|getuid|geteuid|getpgid|killpg|mkfifo"
    r"|pread|pwrite|setsid|statvfs|sysconf|uname|RTLD_\w+)"
    r"|signal\.(SIGHUP|SIGBUS|SIGKILL|SIGPIPE|SIGXCPU|SIGALRM|pthread_sigmask|alarm)"
)
FILES_WITH_POSIX = {
    "process/child_process.py",
    "process/file_locks.py",
    "process/signals.py",
    "process/operating_system.py",
    "mesh/display_libraries.py",
    "fe/dolfinx_loading.py",
}
EMPTY_NAMES = {"utils", "util", "helpers", "helper", "common", "manager", "misc"}
IMPORT_OF_A_TEST = re.compile(r"^ *(?:from|import) .*\btest_\w+", re.MULTILINE)
ENDS = {
    "sys.exit",
    "os._exit",
    "os.abort",
    "SystemExit",
    "quit",
    "exit",
    "MPI.COMM_WORLD",
    "COMM_WORLD",
}


def name_of(path: Path) -> str:
    """Path of a file inside the package."""
    return path.relative_to(PACKAGE).as_posix()


@cache
def tree_of(path: Path) -> ast.Module:
    """Syntax tree of a file."""
    return ast.parse(path.read_text(encoding="utf-8"), str(path))


@cache
def nodes_of(path: Path) -> list[ast.AST]:
    """All nodes of a file's syntax tree."""
    return list(ast.walk(tree_of(path)))


@cache
def imports(path: Path) -> list[str]:
    """Dotted name of every module that a file imports, anywhere in the file."""
    return list(_imports(path))


def _imports(path: Path) -> Iterator[str]:
    package = path.relative_to(ROOT).parts[:-1]
    for node in nodes_of(path):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) + 1 - node.level] if node.level else []
            base = ".".join([*above, *filter(None, [node.module])])
            yield from (_module(base, alias.name) for alias in node.names)


def _module(base: str, name: str) -> str:
    """Module that `from base import name` imports: base.name if there is one, else base."""
    inside = PACKAGE.parent.joinpath(*base.split("."), name)
    return f"{base}.{name}" if inside.with_suffix(".py").exists() or inside.is_dir() else base


def place(module: str, depth: int) -> str:
    """Room (depth 1) or part of fe (depth 2) of a dotted module; "" for what is above."""
    parts = module.split(".")
    return parts[depth] if len(parts) > depth else ""


def module_of(path: Path) -> str:
    """Dotted name of a file."""
    return ".".join(["indent_sim", *path.relative_to(PACKAGE).with_suffix("").parts]).removesuffix(
        ".__init__"
    )


def forbidden(files: list[Path], table: dict[str, set[str]], depth: int, within: str) -> list[str]:
    """Imports that a table does not allow, as 'importer -> imported'."""
    found = []
    for path in files:
        here = place(module_of(path), depth)
        for module in imports(path):
            there = place(module, depth) if module.startswith(within) else ""
            if there and there != here and there not in table.get(here, set()):
                found.append(f"{name_of(path)} -> {module}")
    return found


def test_rooms_import_as_the_table_says() -> None:
    assert not forbidden(
        [path for path in FILES if path.parent != PACKAGE], ROOMS, 1, "indent_sim."
    )


def test_the_solver_imports_as_its_table_says() -> None:
    assert not forbidden(sorted((PACKAGE / "fe").rglob("*.py")), FE, 2, "indent_sim.fe.")


def test_the_tables_have_no_circle() -> None:
    """Each room imports only rooms written above it."""
    for table in (ROOMS, FE):
        order = list(table)
        assert not {
            (a, b) for a, below in table.items() for b in below if order.index(b) >= order.index(a)
        }


def test_no_module_imports_itself_in_a_circle() -> None:
    """The graph of all imports, also in functions and for type checking, has no cycle."""
    graph = {
        module_of(path): {m for m in imports(path) if m.startswith("indent_sim.")} for path in FILES
    }
    state: dict[str, int] = {}

    def visit(module: str, chain: tuple[str, ...]) -> None:
        assert state.get(module) != 1, " -> ".join((*chain, module))
        if state.get(module) == 2:
            return
        state[module] = 1
        for other in graph.get(module, set()) - {module}:
            visit(other, (*chain, module))
        state[module] = 2

    for module in graph:
        visit(module, ())


def test_the_longest_chain_of_rooms_is_seven() -> None:
    """The longest chain of rooms, from the command line down, has at most seven."""
    used: dict[str, set[str]] = {}
    for path in FILES:
        here = place(module_of(path), 1)
        there = {place(module, 1) for module in imports(path) if module.startswith("indent_sim.")}
        used.setdefault(here, set()).update(there - {here, ""})

    def length(room: str) -> int:
        return 1 + max((length(other) for other in used.get(room, ())), default=0)

    assert length("cli") <= 7


def test_every_room_is_in_the_table() -> None:
    rooms = {
        path.name for path in PACKAGE.iterdir() if path.is_dir() and path.name != "__pycache__"
    }
    assert rooms == set(ROOMS)
    assert {path.name for path in PACKAGE.iterdir() if path.is_file()} == {
        "__init__.py",
        "__main__.py",
        "py.typed",
    }


def test_libraries_stay_in_their_rooms() -> None:
    for path in FILES:
        taken = {module.split(".")[0] for module in imports(path)}
        assert not {
            lib for lib in taken & LIBRARIES.keys() if not name_of(path).startswith(LIBRARIES[lib])
        }, path


def test_what_windows_lacks_stands_behind_few_files() -> None:
    found = set()
    for path in FILES:
        named = {ast.unparse(node) for node in nodes_of(path) if isinstance(node, ast.Attribute)}
        if POSIX_MODULES & set(imports(path)) or any(map(POSIX_NAMES.fullmatch, named)):
            found.add(name_of(path))
    assert found == FILES_WITH_POSIX


def test_only_compat_knows_a_version() -> None:
    for path in FILES:
        for node in nodes_of(path) if name_of(path) != "fe/compat.py" else ():
            if isinstance(node, ast.Attribute):
                asked = ast.unparse(node)
                assert asked.split(".")[0] not in LIBRARIES or node.attr != "__version__", asked
                assert asked != "compat.DOLFINX_VERSION", "make it a function of compat"


def test_only_the_commands_end_the_process_or_name_the_world() -> None:
    for path in FILES:
        if name_of(path) != "cli/commands.py":
            nodes = [node for node in nodes_of(path) if isinstance(node, ast.Attribute | ast.Name)]
            named = {ast.unparse(node) for node in nodes}
            assert not named & ENDS, path


def test_names_say_something() -> None:
    assert not [path for path in FILES if EMPTY_NAMES & set(path.stem.split("_"))]


def test_public_things_have_docstrings() -> None:
    for path in FILES:
        tree = tree_of(path)
        assert ast.get_docstring(tree) or not tree.body, path
        assert not [name for name, node in _public(tree) if not ast.get_docstring(node)], path


def _public(
    body: ast.Module | ast.ClassDef, prefix: str = ""
) -> Iterator[tuple[str, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef]]:
    """Yield the public classes and functions of a module, and the public methods of the classes."""
    for node in body.body:
        is_definition = isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
        if is_definition and not node.name.startswith("_") and not _is_setter(node):
            yield prefix + node.name, node
            if isinstance(node, ast.ClassDef):
                yield from _public(node, f"{node.name}.")


def _is_setter(node: ast.AST) -> bool:
    """Whether a method only sets what a documented property gives."""
    marks = getattr(node, "decorator_list", ())
    return any(isinstance(mark, ast.Attribute) and mark.attr == "setter" for mark in marks)


@pytest.mark.parametrize(
    "path", sorted((ROOT / "configs").glob("*.yaml")), ids=lambda path: path.stem
)
def test_a_config_on_its_way_to_a_scene_visits_six_rooms(path: Path) -> None:
    visited: set[str] = set()

    def watch(frame: FrameType, event: str, _: Any) -> None:
        module = frame.f_globals.get("__name__", "")
        if (
            event == "call"
            and frame.f_code.co_name != "<module>"
            and module.startswith("indent_sim.")
        ):
            visited.add(place(module, 1))

    sys.setprofile(watch)
    try:
        resolve(load(path))
    finally:
        sys.setprofile(None)
    assert (
        {"config", "scene"} < visited <= {"config", "scene", "model", "theory", "mesh", "process"}
    )


def test_what_make_check_runs_starts_no_process_and_solves_nothing() -> None:
    running = {"subprocess", "multiprocessing", "dolfinx", "petsc4py", "mpi4py", "gmsh"}
    files = [path for kind in ("unit", "laws") for path in (ROOT / "tests" / kind).rglob("*.py")]
    found = {path.name: running & {name.split(".")[0] for name in imports(path)} for path in files}
    assert found and not [name for name, libraries in found.items() if libraries]


def test_no_test_module_imports_another() -> None:
    """Shared code of tests stands in helper modules; programs in strings count, too."""
    texts = {path: path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("*.py")}
    assert not [path.name for path, text in texts.items() if IMPORT_OF_A_TEST.search(text)]


# ---- the tests above can fail


def test_imports_are_found_wherever_they_stand() -> None:
    assert "indent_sim.fe.solver" in set(
        imports(PACKAGE / "run" / "single_run.py")
    )  # inside a function
    assert "mpi4py" in set(imports(PACKAGE / "fe" / "dolfinx_loading.py"))  # in a function, too
    assert "indent_sim.theory.solution" in set(imports(PACKAGE / "theory" / "layer.py"))  # relative


def test_an_arrow_that_the_table_lacks_is_found() -> None:
    without = ROOMS | {"run": ROOMS["run"] - {"fe"}}
    assert "run/single_run.py -> indent_sim.fe.solver" in forbidden(
        FILES, without, 1, "indent_sim."
    )


@pytest.mark.parametrize(
    "line",
    ["from test_cli import ROOT", "    import tests.unit.test_docs", "from tests import test_x"],
)
def test_an_import_of_a_test_module_is_found(line: str) -> None:
    assert IMPORT_OF_A_TEST.search(f"import os\n{line}\n")
    assert not IMPORT_OF_A_TEST.search("from scenes import scene\n")
