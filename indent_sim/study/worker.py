"""One process that does the runs of a study, one after another; when it dies, only the run it was at is lost.

It is forked before any MPI is up, so a run there is a run of its own; where it died another is forked for the next.
"""

from __future__ import annotations

import gc
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from multiprocessing import connection
from pathlib import Path
from typing import Any, TypeVar

from indent_sim.config.schema import Config
from indent_sim.process.errors import BackendError, ConfigError, IndentSimError, UsageError
from indent_sim.process.forked import Crash, Forked
from indent_sim.run import chain

LIFETIME = 100  # runs of one worker: PETSc and the compiled forms keep half a MB of each
# What mpirun and srun tell their processes: a worker is none of theirs, and they need not know when it is ended
LAUNCHERS = (
    "SLURM_",
    "PMI_",
    "PMIX_",
    "OMPI_COMM_",
    "OMPI_UNIVERSE_",
    "OMPI_MCA_orte_",
    "OMPI_MCA_ess",
    "PRTE_MCA_ess",
)
ABORTING = (UsageError, BackendError)  # no fault of the run: the next one would end the same way

Ending = tuple[int, str]  # exit code and reason
Named = TypeVar("Named")


class Worker:
    """Does runs in a process of its own, which has loaded what solves a mesh where `meshes`; a context manager."""

    def __init__(self, meshes: bool = True) -> None:
        self._process = Forked(_ending, partial(_prepare, meshes), uses_mpi=True)
        self._answer: Callable[[], Ending] = lambda: (0, "")
        self._done = 0

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, *error: Any) -> None:
        self._process.stop()

    def __call__(self, config: Config, directory: Path) -> Ending:
        """Run a config into a folder; exit code and reason. UsageError and BackendError are raised."""
        self.begin(config, directory)
        return self.end()

    def begin(self, config: Config, directory: Path) -> None:
        """Begin a run; `end` waits for it."""
        if self._done % LIFETIME == 0:
            self._process.stop()
        self._done += 1
        self._answer = self._process.ask((config, directory))

    def end(self) -> Ending:
        """How the run that was begun ended; errors as of a call."""
        try:
            return self._answer()
        except Crash as crash:
            return crash.exit_code, f"the process of the run {crash}"

    def fileno(self) -> int:
        """What `first_ready` waits for."""
        return self._process.fileno()


def _prepare(meshes: bool) -> None:
    """Forget the launcher, and load the libraries where a mesh is solved."""
    for name in [name for name in os.environ if name.startswith(LAUNCHERS)]:
        del os.environ[name]
    if meshes:
        chain.warm_up()
    gc.freeze()  # libraries stay: every run ends with a search for what it left behind


def _ending(job: tuple[Config, Path]) -> Ending:
    """Do a run; how it ended."""
    try:
        _run(*job)
    except ABORTING:
        raise
    except IndentSimError as error:
        return error.exit_code, str(error)
    except Exception as error:
        return 1, f"{type(error).__name__}: {error}"
    return 0, ""


def _run(config: Config, directory: Path) -> None:
    """Do a run, or what an earlier call left of it to do; what cannot be gone on with is begun anew."""
    if directory.exists():
        with suppress(ConfigError, UsageError):
            chain.simulate(config, directory=directory, resume=True)
            return
    chain.simulate(config, directory=directory)


Job = tuple[Named, Config, Path]  # a name, a config, and the folder it runs into


class Workers:
    """Several workers, each doing one run after another; a context manager."""

    def __init__(self, count: int, meshes: bool):
        self._workers = [Worker(meshes) for _ in range(count)]

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *error: Any) -> None:
        for worker in self._workers:
            worker.__exit__(*error)

    def done(self, jobs: Iterable[Job[Named]]) -> Iterator[tuple[Named, Ending]]:
        """Do the jobs, as many at a time as there are workers; each with its ending as soon as that is known."""
        waiting, busy = iter(jobs), {}
        idle = list(self._workers)
        while True:
            for worker, (name, config, directory) in zip(list(idle), waiting, strict=False):
                idle.remove(worker)
                worker.begin(config, directory)
                busy[worker] = name
            if not busy:
                return
            ready = first_ready(list(busy))
            idle.append(ready)
            yield busy.pop(ready), ready.end()


def first_ready(workers: Sequence[Worker]) -> Worker:
    """Wait until one of them has ended its run."""
    return connection.wait(workers)[0]  # type: ignore[return-value, arg-type]
