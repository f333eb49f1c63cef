"""One process that does the runs of a study, one after another; when it dies, only the run it was
at is lost.

It is forked before any MPI is up, so a run there is a run of its own; where it died another is
forked for the next.
"""

from __future__ import annotations

import gc
import os
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import partial
from multiprocessing import connection
from pathlib import Path
from typing import Generic, TypeVar

from indent_sim.process.errors import BackendError, ConfigError, IndentSimError, UsageError
from indent_sim.process.forked import Crash, Forked
from indent_sim.run import simulate
from indent_sim.run.planned_run import PlannedRun

# What mpirun and srun tell their processes: a worker is none of theirs, and they need not know when
# it is ended
OPEN_MPI = tuple(f"OMPI_{part}" for part in ("COMM_", "UNIVERSE_", "MCA_orte_", "MCA_ess"))
LAUNCHERS = ("SLURM_", "PMI_", "PMIX_", "PRTE_MCA_ess", *OPEN_MPI)

Ending = tuple[int, str]  # exit code and reason
Load = Callable[[], object]  # loads libraries
Named = TypeVar("Named", bound=Hashable)


@dataclass(frozen=True)
class Job:
    """A run to do: what is run, the folder that it runs into, and whether it goes on from what is
    there.
    """

    prospect: PlannedRun
    directory: Path
    resume: bool = True


Jobs = Mapping[Named, Job]  # by their names


class Worker(ExitStack, Generic[Named]):
    """Does jobs in a process of its own, which knows them from this one and calls `load` first, by
    default for what solves meshes; a context manager.
    """

    def __init__(self, jobs: Jobs[Named], load: Load = simulate.warm_up) -> None:
        super().__init__()
        self._process = Forked(
            lambda name: _ending(jobs[name]), partial(_prepare, load), uses_mpi=True
        )
        self.callback(self._process.stop)
        self._answer: Callable[[], Ending] = lambda: (0, "")
        self._done = 0

    def begin(self, name: Named) -> None:
        """Begin a job; `end` waits for it."""
        if self._done % 100 == 0:  # PETSc and the compiled forms keep half a MB of each run
            self._process.stop()
        self._done += 1
        self._answer = self._process.ask(name)

    def end(self) -> Ending:
        """How the job that was begun ended: exit code and reason.

        UsageError and BackendError are raised.
        """
        try:
            return self._answer()
        except Crash as crash:
            return crash.exit_code, f"the process of the run {crash}"

    def fileno(self) -> int:
        """What can be read once the run has ended."""
        return self._process.fileno()


def _prepare(load: Load) -> None:
    """Forget the launcher, and load the libraries."""
    for name in [name for name in os.environ if name.startswith(LAUNCHERS)]:
        del os.environ[name]
    load()
    gc.freeze()  # libraries stay: every run ends with a search for what it left behind


def _ending(job: Job) -> Ending:
    """Do a run, or what an earlier call left of it to do; what cannot be gone on with is begun
    anew.

    A finished run is of the same physics, as the name of its folder says; where it was written with
    other words, or with other output, it is replaced all the same.
    """
    config = job.prospect.config
    scene = job.prospect.scene
    directory = job.directory
    try:
        if directory.exists():
            with suppress(ConfigError, UsageError):
                simulate.simulate(config, scene=scene, directory=directory, resume=job.resume)
                return 0, ""
        simulate.simulate(config, scene=scene, directory=directory, overwrite=True)
    except (UsageError, BackendError):  # no fault of the run: the next one would end the same way
        raise
    except IndentSimError as error:
        return error.exit_code, str(error)
    except Exception as error:
        return 1, f"{type(error).__name__}: {error}"
    return 0, ""


class Workers(ExitStack, Generic[Named]):
    """Several workers, each doing one job after another; a context manager."""

    def __init__(self, count: int, jobs: Jobs[Named], load: Load):
        super().__init__()
        self._workers = [self.enter_context(Worker(jobs, load)) for _ in range(count)]

    def done(self, names: Iterable[Named]) -> Iterator[tuple[Named, Ending]]:
        """Do jobs, as many at a time as there are workers; each with its ending as soon as that is
        known.
        """
        waiting = iter(names)
        busy = dict[Worker[Named], Named]()
        idle = list(self._workers)
        while True:
            for worker, name in zip(list(idle), waiting, strict=False):
                idle.remove(worker)
                worker.begin(name)
                busy[worker] = name
            if not busy:
                return
            ready: Worker[Named] = connection.wait(list(busy))[0]  # type: ignore[assignment, arg-type]
            idle.append(ready)
            yield busy.pop(ready), ready.end()
