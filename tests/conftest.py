"""Fixtures and options of all tests.

They load dolfinx, share grids and runs, and start several MPI ranks.
"""

from __future__ import annotations

import argparse
import gc
import os
import pickle
import resource
import shutil
import signal
import subprocess
import sys
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

# A shell that starts the tests in the background has SIGINT ignored, nohup SIGHUP, and children
# inherit that
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)

# One BLAS thread, as the program gives itself, before anything loads numpy: two add in another
# order
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# How fast inputs are drawn, and how long one takes, is the machine's affair
settings.register_profile(
    "any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("any machine")

TESTS = Path(__file__).resolve().parent
ROOT = TESTS.parent
FOLDERS_THAT_SOLVE = {"physics", "regression", "system"}
MPI_ENVIRONMENT = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "OMPI_ALLOW_RUN_AS_ROOT": "1",  # containers test as root
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_rmaps_base_oversubscribe": "1",  # more ranks than cores, Open MPI 4
    "OMPI_MCA_mpi_yield_when_idle": "1",  # a waiting rank leaves its core to the others
    # two ranks bound to two busy cores wait for each other by turns
    "OMPI_MCA_hwloc_base_binding_policy": "none",
    "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",  # Open MPI 5
    "PRTE_MCA_hwloc_default_binding_policy": "none",
}
GRIDS_KEPT = 40
CPU_PROPERTY = "cpu_seconds"
CPU_BEFORE = pytest.StashKey[float]()
PATIENCE = 600  # s; a run that takes longer than this hangs, also on a busy machine

Mpirun = Callable[..., "subprocess.CompletedProcess[str]"]


def pytest_addoption(parser: pytest.Parser) -> None:
    """Options of the proofs, see `make proofs`."""
    parser.addoption(
        "--cpu-times",
        metavar="FILE",
        help="append to FILE a line for each test: CPU seconds of it and its child processes, "
        "a tab, its name",
    )
    parser.addoption(
        "--slice",
        metavar="K/N",
        type=slice_of_tests,
        help="run the K-th of N slices of the tests that are selected, K = 1 to N",
    )


def slice_of_tests(text: str) -> tuple[int, int]:
    """K and N of "K/N"."""
    words = text.split("/")
    if len(words) == 2 and all(word.isdecimal() for word in words):
        slice_, slices = map(int, words)
        if 1 <= slice_ <= slices:
            return slice_, slices
    raise argparse.ArgumentTypeError(f"{text!r} is no slice K/N with K from 1 to N, as 3/12")


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Keep a slice of the tests.

    The slice of a test comes from its name alone, so it does not move when others come and go, and
    a new test needs no place in a list. Slices cost nearly the same as long as no test is
    expensive.
    """
    wanted = config.getoption("--slice")
    if wanted is None:
        return
    slice_, slices = wanted
    mine = [zlib.crc32(item.nodeid.encode()) % slices == slice_ - 1 for item in items]
    config.hook.pytest_deselected(
        items=[item for item, is_mine in zip(items, mine, strict=True) if not is_mine]
    )
    items[:] = [item for item, is_mine in zip(items, mine, strict=True) if is_mine]


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Note the CPU time before a test.

    It counts the test with its fixtures and the child processes that it waits for.
    """
    item.stash[CPU_BEFORE] = cpu_seconds()
    return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> Iterator[None]:
    """Put the CPU time into the test's last report.

    Reports are all that comes back from a worker of pytest-xdist.
    """
    report: Any = yield
    if call.when == "teardown":
        report.user_properties.append((CPU_PROPERTY, cpu_seconds() - item.stash[CPU_BEFORE]))
    return report


@pytest.hookimpl(trylast=True)
def pytest_configure(config: pytest.Config) -> None:
    """Write the CPU times in the process that distributes the tests, or in the only one."""
    file = config.getoption("--cpu-times")
    if file and not hasattr(config, "workerinput"):
        config.pluginmanager.register(CpuTimes(Path(file)))


class CpuTimes:
    """Appends the CPU time of each test to a file as soon as the test is over."""

    def __init__(self, file: Path):
        self._file = file

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Write a line for a test when it is torn down."""
        seconds = dict(report.user_properties).get(CPU_PROPERTY)
        if seconds is None:
            return
        with self._file.open("a") as lines:
            lines.write(f"{seconds:.2f}\t{report.nodeid}\n")


def cpu_seconds() -> float:
    """User and system time of this process and of all child processes that have ended [s]."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


def pytest_collect_file(file_path: Path) -> None:
    """Load dolfinx as the program does, before the first file that solves is imported.

    dolfinx reads the command line, which is pytest's here. It is never loaded in the process that
    only distributes tests to others: MPI would leave its variables to them, and every mpirun they
    start would take itself for a rank.
    """
    if file_path.relative_to(TESTS).parts[0] in FOLDERS_THAT_SOLVE:
        from indent_sim.fe.dolfinx_loading import load_dolfinx

        load_dolfinx()


@pytest.fixture(scope="module", autouse=True)
def nothing_old_is_searched() -> None:
    """Exclude objects that exist before a file of tests from garbage collection.

    Every solve ends with a garbage collection, which among the libraries and what earlier files
    keep takes as long as a small solve.
    """
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session")
def grids() -> dict[bytes, Any]:
    """The grids made last, by the modelled part and its element sizes."""
    return {}


@pytest.fixture(scope="module", autouse=True)
def grids_are_made_once(request: pytest.FixtureRequest, grids: dict[bytes, Any]) -> Iterator[None]:
    """Share grids among tests of physics.

    More than half of the grids are asked for again, and no test changes them. Mesh generation is
    tested elsewhere.
    """
    if request.path.relative_to(TESTS).parts[0] != "physics":
        yield
        return
    from indent_sim.mesh import gmsh

    build = gmsh.build_mesh

    def build_once(part: Any, sizes: Any) -> Any:
        identity = pickle.dumps((part, sizes))
        if identity not in grids:
            while len(grids) >= GRIDS_KEPT:
                grids.pop(next(iter(grids)))
            grids[identity] = build(part, sizes)
        return grids[identity]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gmsh, "build_mesh", build_once)
        yield


@pytest.fixture(scope="session")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """The folder of an undisturbed run of a scene; each scene is run once."""
    from mpi4py import MPI  # only the tests that run something load it

    from indent_sim.config.scene_file import load
    from indent_sim.run.pipeline import simulate

    done: dict[str, Path] = {}

    def of(scene: str) -> Path:
        if scene not in done:
            place = tmp_path_factory.mktemp("undisturbed")
            (place / "scene.yaml").write_text(scene)
            simulate(load(place / "scene.yaml"), MPI.COMM_SELF, directory=place / "out")
            done[scene] = place / "out"
        return done[scene]

    return of


@pytest.fixture
def mpirun(tmp_path: Path) -> Mpirun:
    """Run this Python on n ranks with the given arguments, in an empty directory."""
    if shutil.which("mpirun") is None:
        pytest.fail("mpirun is missing; it comes with the packages of packages-debian.txt")

    def start(ranks: int, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
        search = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
        command = ["mpirun", "-n", str(ranks), sys.executable, *map(str, arguments)]
        return subprocess.run(
            command,
            cwd=tmp_path,
            env=os.environ | MPI_ENVIRONMENT | {"PYTHONPATH": search},
            capture_output=True,
            text=True,
            timeout=PATIENCE,
            stdin=subprocess.DEVNULL,
        )

    return start
