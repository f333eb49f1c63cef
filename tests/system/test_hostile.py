"""Hostile scenes, studies and result folders run no command and touch nothing outside.

Every refusal is a sentence with its exit code. Each example stands in a folder of its own among
decoys, all of which are compared before and after. An audit hook sees every process that Python
starts and every file that it opens for writing; what PETSc starts from C leaves PWNED.
"""

from __future__ import annotations

import copy
import hashlib
import json
import os
import random
import shutil
import stat
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
from arbitrary_scenes import within
from click.testing import CliRunner, Result

from indent_sim.cli import commands
from indent_sim.config.scene_file import config_from_mapping, to_yaml
from indent_sim.config.strict_yaml import dump
from indent_sim.process.errors import ConfigError, UsageError, printable
from indent_sim.run.explicit_config import explicit_config
from indent_sim.scene.scene import resolve
from indent_sim.studies import study_file as study_file
from indent_sim.studies.study_folder import StudyFolder

EXAMPLES = 300  # in `make system`; 1500 others in `make stress`
RUNS = 4  # real runs in `make system`; 16 others in `make stress`
WAIT = 60.0  # s for one example on a busy machine; most take 20 ms
SCENE: dict[str, Any] = {
    "title": "plain",
    "body": {"shape": "cylinder", "radius": 1.0, "height": 1.0},
    "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.3},
    "indenter": {"shape": "paraboloid", "R": 1.0},
    "contact": {"method": "penalty"},
    "loading": {"delta": 0.01, "steps": 2},
    "mesh": {"h_contact": 0.06, "h_far": 0.5},
    "solver": {"method": "newton"},
    "output": {"plot": False, "fields": "none", "surface": "all"},
}
WORDS = [
    "ascii:x;touch PWNED;.gz",
    "ascii:victim",
    "binary:/tmp/PWNED",
    "draw::PWNED.ps",
    "$(touch PWNED)",
    "`touch PWNED`",
    "|touch PWNED",
    "; touch PWNED",
    "python",
    "shell",
    "os.system",
    "-ksp_view ascii:victim",
    "../victim",
    "/etc/passwd",
    "~/.bashrc",
    "victim",
    "",
    " ",
    "cg",
    "mumps",
    "gamg",
    "1",
    "0,0.1,0,1.1",
    "auto",
    "[/x]",
    "[kPa]",
    "[link=file:///etc]",
    ":smile:",
    "$",
    "$x$",
    r"$\frac{$",
    r"\$",
    r"$\input{/etc/passwd}$",
    "{0.__class__}",
    "%n%s%n",
    "\x1b]0;x\x07",
    "\x1b[2J",
    "\r\n",
    "a\nb",
    "\u202eevil",
    "\ud800",
    "\0",
    "_x",
    "#",
    "a" * 5000,
    "ä漢🙂",
    "null",
    "true",
    "'\"",
    "<b>&amp;",
    "../" * 30,
    "CON",
    "run.json",
]
OPTIONS = [
    "ksp_monitor",
    "ksp_view",
    "ksp_view_mat",
    "snes_monitor",
    "snes_view",
    "pc_type",
    "ksp_type",
    "mat_type",
    "ksp_converged_reason",
    "ksp_view_eigenvalues",
    "snes_type",
    "pc_python_type",
    "mat_mumps_icntl_1",
    "mat_mumps_icntl_22",
    "mat_mumps_ooc_tmpdir",
    "options_file",
    "log_view",
    "info",
    "malloc_dump",
    "help",
    "on_error_attach_debugger",
    "start_in_debugger",
    "prefix_push",
    "skip_petscrc",
    "viewer_hdf5_filename",
    "pc_hypre_type",
    "pc_hypre_boomeramg_print_statistics",
    "snes_convergence_test",
    "snes_rtol",
    "history",
    "ksp_rtol -ksp_view",
    "ksp_view\n",
    "-ksp_view",
    "",
    "a.b",
    "display",
]
CELLS = [
    "nan",
    "inf",
    "-inf",
    "1e999",
    "",
    "x",
    "1_0",
    "-1",
    "1e200",
    "0x10",
    "1,1",
    "\0",
    "nan\n",
    "9" * 400,
    "٣",
    "0",
]
JSONS: list[Any] = [
    None,
    True,
    0,
    -1,
    1.5,
    1e308,
    10**400,
    "",
    "x",
    [],
    {},
    [[]],
    [1, "x"],
    {"a": 1},
    "\ud800",
    "$",
]
KINDS = 3 * ["json", "cell", "lines"]  # of damage, more often than others
FILES = ("run.json", "force_indentation.csv", "surface.csv", "config.yaml")

# ---- what must not happen

_watching: list[Callable[[str, tuple[Any, ...]], None]] = []
PROCESSES = {
    "os.system",
    "os.exec",
    "os.posix_spawn",
    "os.spawn",
    "os.fork",
    "os.forkpty",
    "subprocess.Popen",
    "pty.spawn",
}


def _hook(event: str, arguments: tuple[Any, ...]) -> None:
    for watch in _watching:
        watch(event, arguments)


sys.addaudithook(_hook)


def is_compiler(event: str, arguments: tuple[Any, ...]) -> bool:
    """Whether a process is the C compiler at one of FFCx' own kernels.

    A machine that has compiled none yet starts it.
    """
    command = [str(word) for word in arguments[1]] if event == "subprocess.Popen" else []
    return any(word.endswith("gcc") for word in command[:1]) and any(
        "libffcx_forms_" in word for word in command
    )


def is_child(event: str, arguments: tuple[Any, ...]) -> bool:
    """Whether a process is one in which this program calls gmsh or a reader of mesh files."""
    return event == "subprocess.Popen" and "indent_sim.process.child_process" in arguments[1]


@contextmanager
def watched(place: Path) -> Iterator[list[str]]:
    """Processes started, and files opened for writing outside a folder, within a block."""
    seen: list[str] = []
    fine = (str(place), "/dev/", "/proc/")

    def watch(event: str, arguments: tuple[Any, ...]) -> None:
        if event in PROCESSES and not (is_compiler(event, arguments) or is_child(event, arguments)):
            seen.append(f"{event} {arguments}")
        elif event == "open" and isinstance(arguments[0], (str, bytes)):
            path = os.path.abspath(os.fsdecode(arguments[0]))
            is_writing = bool(
                (arguments[2] or 0) & (os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC)
            )
            is_writing &= (
                path != tempfile.gettempdir()
            )  # a file without a name, gone when it is closed
            if (
                is_writing
                and not path.startswith(fine)
                and "__pycache__" not in path
                and "/fenics" not in path
            ):
                seen.append(f"writes {path}")

    _watching.append(watch)
    try:
        yield seen
    finally:
        _watching.remove(watch)


def tree(place: Path) -> dict[str, tuple[Any, ...]]:
    """Kind, permissions, link target and content of everything below a folder."""
    found: dict[str, tuple[Any, ...]] = {}
    for folder, folders, files in os.walk(place):
        for name in (*folders, *files):
            path = Path(folder, name)
            state = path.lstat()
            said: Any = os.readlink(path) if stat.S_ISLNK(state.st_mode) else None
            if stat.S_ISREG(state.st_mode):
                said = hashlib.sha256(path.read_bytes()).hexdigest()
            found[str(path.relative_to(place))] = (stat.S_IFMT(state.st_mode), state.st_mode, said)
    return found


def decoys(place: Path) -> None:
    """Files that a user may have, with names that this program uses too."""
    (place / "home").mkdir()
    (place / "home" / "victim").write_text("PRECIOUS")
    here = place / "work"
    (here / "results").mkdir(parents=True)
    (here / "link").symlink_to(place / "home")
    (here / "victim").write_text("PRECIOUS")
    for folder in ("runs", ".precious.old", ".precious.staging", "precious"):
        (here / folder).mkdir()
        (here / folder / "force_indentation.csv").write_text("mine\n")
    (here / "force_indentation.png").write_bytes(b"my own picture")
    (here / "petscrc").write_text("-log_view ascii:x;touch PWNED;.gz\n")


# ---- hostile input


def text(rng: random.Random) -> str:
    """A hostile title, unit or word."""
    return "".join(rng.choices(WORDS, k=rng.choice([1, 1, 2, 3])))


def directory(rng: random.Random) -> str:
    """A path that leads somewhere else, or a plain one."""
    parts = [
        "..",
        ".",
        "~",
        "~root",
        "",
        "link",
        "results",
        "victim",
        "precious",
        ".git",
        "runs",
        "new",
        text(rng),
    ]
    return "/".join(rng.choices(parts, k=rng.choice([1, 2, 3])))


def scene(rng: random.Random) -> dict[str, Any]:
    """A scene in which a few values are hostile."""
    document = copy.deepcopy(SCENE)
    for what in rng.sample(["title", "units", "directory"], k=rng.choice([1, 2, 3])):
        if what == "title":
            document["title"] = text(rng)
        elif what == "units":
            document["units"] = {"length": text(rng), "force": text(rng)}
        else:
            document["output"]["directory"] = directory(rng)
    return document


def bomb(rng: random.Random) -> str:
    """Text that should cost time or memory."""
    n = rng.choice([10, 1000, 100_000])
    return rng.choice(
        [
            "a: &a [x, x]\nb: [*a, *a]\n",
            f"title: {'[' * n}",
            f"title: {'{a: ' * n}",
            f"R: {'9' * n}",
            "loading: {deltas: [" + "1, " * n + "1]}",
            "? " * n,
            f"!!python/object/apply:os.system ['{n}']",
            f"title: '{'x' * n}'",
            "<<: *a",
            "".join(f"k{i}: 1\n" for i in range(n // 10)),
        ]
    )


def damage(rng: random.Random, folder: Path, outside: Path) -> None:
    """Damage one file of a result folder, or put something else in its place."""
    path = folder / rng.choice(FILES)
    data = path.read_bytes() if path.is_file() and not path.is_symlink() else b"x"
    kind = rng.choice(
        [
            "gone",
            "cut",
            "bits",
            "junk",
            "folder",
            "link",
            "hard link",
            "pipe",
            *3 * ["json", "cell", "lines"],
        ]
    )
    if kind in ("json", "cell", "lines"):
        path = folder / (
            "run.json" if kind == "json" else rng.choice(["force_indentation.csv", "surface.csv"])
        )
        with suppress(OSError, ValueError):
            state = path.lstat()
            if (
                stat.S_ISREG(state.st_mode) and state.st_nlink == 1
            ):  # what the damage before left as it was
                path.write_text(rewritten(rng, kind, path.read_text()), errors="surrogatepass")
        return
    with suppress(OSError):
        shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink(
            missing_ok=True
        )
        if kind == "cut":
            path.write_bytes(data[: rng.randrange(len(data) + 1)])
        elif kind == "bits":
            path.write_bytes(bytes(b ^ (rng.random() < 0.01) * rng.randrange(256) for b in data))
        elif kind == "junk":
            path.write_bytes(rng.randbytes(rng.choice([0, 1, 100, 10_000])))
        elif kind == "folder":
            path.mkdir()
        elif kind == "link":
            path.symlink_to(outside / rng.choice(["victim", "nowhere"]))
        elif kind == "hard link":
            os.link(outside / "victim", path)
        elif kind == "pipe":
            os.mkfifo(path)


def rewritten(rng: random.Random, kind: str, text: str) -> str:
    """The text of run.json or of a table with one change."""
    if kind == "json":
        return json.dumps(mistyped(rng, json.loads(text)))
    lines = text.split("\n")
    return "\n".join(retyped(rng, lines) if kind == "cell" else rng.choices(lines, k=len(lines)))


def mistyped(rng: random.Random, value: Any) -> Any:
    """A JSON document with something else in one place."""
    if rng.random() < 0.02:
        return json.loads("[" * 500 + "]" * 500)
    if isinstance(value, dict) and value and rng.random() < 0.85:
        key = rng.choice(sorted(value))
        return (
            value | {key: mistyped(rng, value[key])}
            if rng.random() < 0.9
            else {k: value[k] for k in value if k != key}
        )
    if isinstance(value, list) and value and rng.random() < 0.7:
        at = rng.randrange(len(value))
        return [*value[:at], mistyped(rng, value[at]), *value[at + 1 :]]
    return rng.choice(JSONS)


def retyped(rng: random.Random, lines: list[str]) -> list[str]:
    """A table with something else in one cell, or without one column."""
    cells = [line.split(",") for line in lines]
    row, column = rng.randrange(len(cells)), rng.randrange(len(cells[0]))
    if rng.random() < 0.2:
        cells = [line[:column] + line[column + 1 :] for line in cells]
    elif column < len(cells[row]):
        cells[row][column] = rng.choice(CELLS)
    return [",".join(line) for line in cells]


# ---- examples


def said(*words: str | Path) -> Result:
    """Run a command in this process, and assert a known exit code, a message, and no traceback."""
    with within(WAIT):
        done = CliRunner().invoke(commands.program, [str(word) for word in words])
    assert done.exit_code in (0, 2, 3, 5, 6), (words, done.stderr)
    assert "Traceback" not in done.stderr and (done.exit_code == 0 or done.stderr), (
        words,
        done.stderr,
    )
    assert printable(done.stderr, line_breaks=True) == done.stderr
    return done


def planned(rng: random.Random, place: Path) -> None:
    """Run `plan` of a hostile scene, as text or as JSON."""
    document = scene(rng)
    path = place / "scene.yaml"
    path.write_text(
        bomb(rng) if rng.random() < 0.05 else dump(document), "utf-8", errors="surrogatepass"
    )
    if rng.random() < 0.5:
        found = said("plan", path.name)
        assert printable(found.stdout, line_breaks=True) == found.stdout
    else:
        object_ = json.loads(said("plan", path.name, "--json").stdout)
        assert ("error" in object_) == (object_["exit_code"] != 0) and object_["status"] in (
            "done",
            "failed",
        )


def set_(rng: random.Random, place: Path) -> None:
    """Give hostile values by --set."""
    (place / "scene.yaml").write_text(dump(SCENE))
    key = rng.choice(
        ["title", "units.length", "output.directory", *(f"solver.petsc.{name}" for name in OPTIONS)]
    )
    value = directory(rng) if key == "output.directory" else text(rng)
    said("plan", "scene.yaml", "--set", f"{key}={value}")


def studied(rng: random.Random, place: Path) -> None:
    """Read a study file that reads or writes somewhere else."""
    (place / "scene.yaml").write_text(dump(SCENE))
    document: dict[str, Any] = {
        "title": text(rng),
        "base": rng.choice(["scene.yaml", directory(rng), scene(rng)]),
        "vary": {f"solver.petsc.{rng.choice(OPTIONS)}": [text(rng)]},
        "output": {"directory": directory(rng)},
    }
    if rng.random() < 0.5:
        document["compare_to"] = rng.choice(
            ["victim", "../home/victim", "/etc/passwd", directory(rng)]
        )
    (place / "STUDY.yaml").write_text(dump(document), "utf-8", errors="surrogatepass")
    with within(WAIT):
        try:
            found = study_file.read("STUDY.yaml")
            assert os.path.realpath(found.directory).startswith(os.path.realpath("."))
        except (ConfigError, UsageError) as error:
            assert "PRECIOUS" not in str(error) and "root:" not in str(error)


def read_back(rng: random.Random, place: Path, good: Path) -> None:
    """Give a damaged result folder to everything that reads one."""
    shutil.copytree(good, place / "out")
    for _ in range(rng.choice([1, 1, 2, 3])):
        damage(rng, place / "out", place.parent / "home")
    what = rng.choices(["compare", "plot", "resume", "study"], weights=[65, 10, 3, 22])[0]
    if what == "compare":
        assert said("compare", *rng.choice([("out", good), (good, "out")])).exit_code != 5
    elif what == "plot":
        said("plot", "out", *rng.choice([(), (good,), (good, "--output", "out/x.svg")]))
    elif what == "resume":
        again = said("run", good / "config.yaml", "--output", "out", "--resume", "--json")
        if again.exit_code == 0:
            rows = json.loads(again.stdout)["rows"]
            assert len(rows) == 2 and all(
                row[name] == row[name] for row in rows for name in ("force", "a", "delta")
            )
    else:
        os.mkdir("study")
        os.mkdir("study/runs")
        with StudyFolder(place / "study", resume=True) as folder:
            os.rename(place / "out", folder.run_folder("x"))
            folder.is_finished("x")


def started(rng: random.Random, place: Path) -> None:
    """Run a hostile scene."""
    document = scene(rng)
    if rng.random() < 0.8:  # gets as far as PETSc
        document["output"].pop("directory", None)
    document["output"]["plot"] = True
    document["loading"]["steps"] = 1
    (place / "scene.yaml").write_text(dump(document), "utf-8", errors="surrogatepass")
    said("run", "scene.yaml", *rng.choice([(), (), ("--output", "out"), ("--output", "precious")]))


def example(seed: int, place: Path, good: Path, act: Callable[..., Any] | None = None) -> None:
    """Try one hostile input among decoys, and assert that none of them is changed."""
    rng = random.Random(seed)
    decoys(place)
    before = tree(place)
    here = os.getcwd()
    os.chdir(place / "work")
    try:
        with watched(place) as seen:
            if act is None:
                act = rng.choices([planned, set_, studied, read_back], weights=[30, 10, 20, 40])[0]
            act(rng, Path.cwd(), good) if act is read_back else act(rng, Path.cwd())
    finally:
        os.chdir(here)
    after = tree(place)
    made = {path.split("/")[1] for path in after.keys() - before.keys() if path.startswith("work/")}
    results = {"results", "new", "out", "study", "scene.yaml", "STUDY.yaml"}
    assert not seen, (seed, seen)
    assert {path: after.get(path) for path in before} == before, seed
    assert not any("PWNED" in path for path in after), seed
    if (
        act is not started
    ):  # a run makes the folder that its scene names, below the working directory
        assert made <= results, (seed, made)
    assert not {path for path in after.keys() - before.keys() if not path.startswith("work/")}, seed


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An intact result folder.

    Kernels and the list of fonts, which are made once on a machine, exist afterwards.
    """
    place = tmp_path_factory.mktemp("good")
    (place / "scene.yaml").write_text(dump(SCENE))
    command = ["run", str(place / "scene.yaml"), "--output", str(place / "out")]
    assert CliRunner().invoke(commands.program, command).exit_code == 0
    drawn = ["plot", str(place / "out"), "--output", str(place / "picture.png")]
    assert CliRunner().invoke(commands.program, drawn).exit_code == 0
    config = config_from_mapping(SCENE)
    assert (place / "out" / "config.yaml").read_text() == to_yaml(
        explicit_config(config, resolve(config))
    )
    return place / "out"


def examples(seeds: range, place: Path, good: Path, act: Callable[..., Any] | None = None) -> None:
    for seed in seeds:
        folder = place / str(seed)
        folder.mkdir()
        example(seed, folder, good, act)
        shutil.rmtree(folder)


def test_some_hundred(tmp_path, good):
    examples(range(EXAMPLES), tmp_path, good)


def test_some_runs(tmp_path, good):
    examples(range(RUNS), tmp_path, good, started)


@pytest.mark.stress
@pytest.mark.parametrize("part", range(6))
def test_hundreds(tmp_path, good, part):
    examples(range(1000 + 250 * part, 1250 + 250 * part), tmp_path, good)


@pytest.mark.stress
def test_more_runs(tmp_path, good):
    examples(range(1000, 1016), tmp_path, good, started)
