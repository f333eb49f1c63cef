"""The plan of the house, kept true by reading the syntax trees: who may import whom, and who may do what."""

from __future__ import annotations

import ast
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "indent_sim"
FILES = sorted(PACKAGE.rglob("*.py"))

# A room is a module of the package or one of its folders. What each may import of the others; `errors` is everybody's
# but model's and theory's. A new module needs its line here, below those that will use it.
ROOMS: dict[str, set[str]] = {
    "": set(),
    "errors": set(),
    "parallel": set(),
    "stopping": set(),
    "usage": set(),
    "forked": {"stopping", "usage"},
    "symbols": set(),
    "state": set(),
    "model": set(),
    "theory": set(),
    "oracle": {"model", "theory"},
    "blunting": {"model", "oracle"},
    "confinement": {"model"},
    "truncation": {"model", "oracle", "theory"},
    "sizing": set(),
    "costing": {"sizing"},
    "accuracy": {"sizing"},
    "reduction": {"model"},
    "corners": {"reduction", "sizing"},
    # the scene file
    "yaml_strict": set(),
    "hints": set(),
    "magnitudes": {"model"},
    "schema": {"hints", "magnitudes", "model", "yaml_strict"},
    "config_errors": {"hints", "schema", "yaml_strict"},
    "config": {"config_errors", "hints", "model", "schema", "yaml_strict"},
    # the chain
    "expectation": {"model", "oracle", "sizing", "state"},
    "premises": {
        *("confinement", "config", "expectation", "model", "oracle", "reduction", "sizing", "state"),
        *("theory", "truncation"),
    },
    "elements": {"accuracy", "config", "confinement", "corners", "model", "premises", "sizing", "state"},
    "choices": {"accuracy", "config", "costing", "expectation", "model", "premises", "sizing", "state"},
    "scene": {
        *("accuracy", "blunting", "choices", "config", "costing", "elements", "expectation", "model", "oracle"),
        *("premises", "reduction", "sizing", "state"),
    },
    "resolved": {"config", "scene", "sizing"},
    "error_bars": {"accuracy", "corners", "model", "scene", "sizing", "state"},
    "refinement": {"accuracy", "config", "error_bars", "scene", "state"},
    "geometry": {"forked", "model", "parallel", "scene", "sizing"},
    "fe": {"costing", "geometry", "model", "scene", "state"},
    "comparison": {"oracle", "scene", "state", "theory", "usage"},
    "folder": set(),
    "xdmf": {"folder"},
    "checkpoint": {"folder"},
    "tables": {"folder", "state"},
    "earlier": {"folder", "state", "tables"},
    "results": {"", "checkpoint", "earlier", "folder", "state", "tables", "xdmf"},
    "record": {"earlier", "parallel", "results", "usage"},
    "plots": {"folder", "results", "yaml_strict"},
    "simulation": {
        *("checkpoint", "comparison", "config", "error_bars", "fe", "folder", "geometry", "parallel", "record"),
        *("scene", "state"),
    },
    "run": {
        *("comparison", "config", "earlier", "error_bars", "folder", "geometry", "model", "simulation"),
        *("parallel", "plots", "record", "refinement", "resolved", "scene", "state", "stopping"),
        "usage",
    },
    "study": {
        *("", "config", "config_errors", "folder", "plots", "results", "run", "scene", "schema", "stopping", "usage"),
        "yaml_strict",
    },
    # what people see
    "reference": {"hints", "model", "schema", "symbols"},
    "terminal": {"hints", "results", "run", "scene", "schema", "state", "symbols"},
    "doctor": set(),
}
ROOMS["cli"] = set(ROOMS)  # above all the others

# Libraries that only these modules may import
LIBRARIES: dict[str, tuple[str, ...]] = {
    "dolfinx": ("fe/",),
    "basix": ("fe/",),
    "ffcx": ("fe/",),
    "petsc4py": ("fe/",),
    "ufl": ("fe/", "model/"),
    "mpi4py": ("fe/", "run.py", "cli.py"),
    "gmsh": ("geometry.py",),
    "h5py": ("checkpoint.py", "xdmf.py"),
    "matplotlib": ("plots.py", "study/picture.py"),
    "scipy": ("theory/", "fe/"),
    "yaml": ("yaml_strict.py",),
    "click": ("cli.py",),
    "rich": ("terminal.py", "cli.py"),
}
HEAVY = ("dolfinx", "basix", "petsc4py", "mpi4py", "gmsh", "h5py", "matplotlib")
EMPTY_NAMES = {"utils", "util", "helpers", "helper", "common", "manager", "misc"}


def name_of(path: Path) -> str:
    """Path inside the package."""
    return path.relative_to(PACKAGE).as_posix()


def room_of(module: str) -> str:
    """The room of a dotted module of the package, "" for the package itself."""
    return module.split(".")[1] if "." in module else ""


def tree_of(path: Path) -> ast.Module:
    """The syntax tree of a file."""
    return ast.parse(path.read_text(encoding="utf-8"), str(path))


def imports(path: Path) -> Iterator[str]:
    """Every module that a file imports, wherever in the file, as a dotted name."""
    package = ["indent_sim", *path.relative_to(PACKAGE).parts[:-1]]
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) + 1 - node.level] if node.level else []
            base = ".".join([*above, *filter(None, [node.module])])
            yield from (_module(base, alias.name) for alias in node.names)


def _module(base: str, name: str) -> str:
    """`from base import name` imports the module base.name, if there is one, else base."""
    inside = PACKAGE.parent.joinpath(*base.split("."), name)
    return f"{base}.{name}" if inside.with_suffix(".py").exists() or inside.is_dir() else base


each_file = pytest.mark.parametrize("path", FILES, ids=name_of)


@each_file
def test_arrows_point_downward(path: Path) -> None:
    room = room_of(".".join(["indent_sim", *path.relative_to(PACKAGE).with_suffix("").parts]).removesuffix(".__init__"))
    assert room in ROOMS, f"{room} has no line in ROOMS: say what it may import"
    allowed = ROOMS[room] | {room} | (set() if room in ("model", "theory") else {"errors"})
    taken = {module: room_of(module) for module in imports(path) if module.split(".")[0] == "indent_sim"}
    assert not {module for module, taken_room in taken.items() if taken_room not in allowed}


def test_the_table_has_no_circle() -> None:
    """Each room imports only rooms written above it."""
    order = list(ROOMS)
    for room, below in ROOMS.items():
        assert all(order.index(other) <= order.index(room) for other in below), room


@each_file
def test_libraries_stay_in_their_rooms(path: Path) -> None:
    taken = {module.split(".")[0] for module in imports(path)}
    assert not {lib for lib in taken & LIBRARIES.keys() if not name_of(path).startswith(LIBRARIES[lib])}


@each_file
def test_only_compat_knows_a_version(path: Path) -> None:
    if name_of(path) == "fe/compat.py":
        return
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Attribute):
            asked = ast.unparse(node)
            assert asked.split(".")[0] not in LIBRARIES or node.attr != "__version__", asked
            assert asked != "compat.VERSION", "make it a function of compat"


@each_file
def test_only_cli_ends_the_process_or_names_the_world(path: Path) -> None:
    if name_of(path) == "cli.py":
        return
    forbidden = {"sys.exit", "os._exit", "os.abort", "SystemExit", "quit", "exit", "MPI.COMM_WORLD", "COMM_WORLD"}
    named = {ast.unparse(node) for node in ast.walk(tree_of(path)) if isinstance(node, ast.Attribute | ast.Name)}
    assert not named & forbidden


@each_file
def test_names_say_something(path: Path) -> None:
    assert not EMPTY_NAMES & set(path.with_suffix("").name.split("_"))


@each_file
def test_public_things_have_docstrings(path: Path) -> None:
    tree = tree_of(path)
    assert ast.get_docstring(tree) or not tree.body
    assert not [name for name, node in _public(tree) if not ast.get_docstring(node)]


def test_type_checkers_see_the_types() -> None:
    """PEP 561: the marker is a file of the package, and goes where the package goes."""
    assert (PACKAGE / "py.typed").is_file()
    declared = tomllib.loads((PACKAGE.parent / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"]
    assert "py.typed" in declared["*"]


def _public(
    body: ast.Module | ast.ClassDef, prefix: str = ""
) -> Iterator[tuple[str, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef]]:
    """Public classes and functions at the top of a module, and the public methods of those classes."""
    for node in body.body:
        if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) and not node.name.startswith("_"):
            yield prefix + node.name, node
            if isinstance(node, ast.ClassDef):
                yield from _public(node, f"{node.name}.")


def test_a_scene_is_resolved_without_any_heavy_library() -> None:
    """`plan` and a config error must not wait for, nor need, the solver's libraries."""
    program = f"""
import sys
sys.modules.update(dict.fromkeys({HEAVY!r}))  # importing any of these fails now
from indent_sim.config import load
from indent_sim.scene import resolve
import indent_sim.theory.layer, indent_sim.theory.plane_strain, indent_sim.theory.half_space
assert resolve(load(sys.argv[1])).prediction["force"] > 0
"""
    config = PACKAGE.parent / "configs" / "hertz.yaml"
    command = [sys.executable, "-c", program, str(config)]
    finished = subprocess.run(command, cwd=PACKAGE.parent, capture_output=True, text=True, timeout=120)
    assert finished.returncode == 0, finished.stderr


# ---- the tests above can fail ---------------------------------------------------------------------------------


def test_imports_are_found_wherever_they_stand() -> None:
    assert "indent_sim.fe.solver" in set(imports(PACKAGE / "simulation.py"))  # inside a function
    assert "mpi4py" in set(imports(PACKAGE / "run.py"))
    assert "indent_sim.theory.solution" in set(imports(PACKAGE / "theory" / "layer.py"))  # relative
    assert "indent_sim.scene.sizing" in set(imports(PACKAGE / "scene.py"))  # from indent_sim import sizing
