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
from indent_sim.process.forked_process import ForkedProcess, ProcessCrash
from indent_sim.run import pipeline
from indent_sim.run.planned_run import PlannedRun

# What mpirun and srun tell their processes: a worker is none of theirs, and they need not know when
# it is ended
OPEN_MPI_VARIABLES = tuple(
    f"OMPI_{part}" for part in ("COMM_", "UNIVERSE_", "MCA_orte_", "MCA_ess")
)
LAUNCHER_VARIABLES = ("SLURM_", "PMI_", "PMIX_", "PRTE_MCA_ess", *OPEN_MPI_VARIABLES)

ExitStatus = tuple[int, str]  # exit code and reason
LoadLibraries = Callable[[], object]  # loads libraries
JobName = TypeVar("JobName", bound=Hashable)


@dataclass(frozen=True)
class Job:
    """A run to do: what is run, the folder that it runs into, and whether it goes on from what is
    there.
    """

    planned_run: PlannedRun
    directory: Path
    resume: bool = True


Jobs = Mapping[JobName, Job]  # by their names


class Worker(ExitStack, Generic[JobName]):
    """Does jobs in a process of its own, which knows them from this one and calls `load` first, by
    default for what solves meshes; a context manager.
    """

    def __init__(self, jobs: Jobs[JobName], load: LoadLibraries = pipeline.warm_up) -> None:
        super().__init__()
        self._process = ForkedProcess(
            lambda name: _run_job(jobs[name]), partial(_prepare_process, load), uses_mpi=True
        )
        self.callback(self._process.stop)
        self._wait_for_answer: Callable[[], ExitStatus] = lambda: (0, "")
        self._job_count = 0

    def begin_job(self, name: JobName) -> None:
        """Begin a job; `end` waits for it."""
        if self._job_count % 100 == 0:  # PETSc and the compiled forms keep half a MB of each run
            self._process.stop()
        self._job_count += 1
        self._wait_for_answer = self._process.begin_call(name)

    def wait_for_job(self) -> ExitStatus:
        """How the job that was begun ended: exit code and reason.

        UsageError and BackendError are raised.
        """
        try:
            return self._wait_for_answer()
        except ProcessCrash as crash:
            return crash.exit_code, f"the process of the run {crash}"

    def fileno(self) -> int:
        """What can be read once the run has ended."""
        return self._process.fileno()


def _prepare_process(load: LoadLibraries) -> None:
    """Forget the launcher, and load the libraries."""
    for name in [name for name in os.environ if name.startswith(LAUNCHER_VARIABLES)]:
        del os.environ[name]
    load()
    gc.freeze()  # libraries stay: every run ends with a search for what it left behind


def _run_job(job: Job) -> ExitStatus:
    """Do a run, or what an earlier call left of it to do; what cannot be gone on with is begun
    anew.

    A finished run is of the same physics, as the name of its folder says; where it was written with
    other words, or with other output, it is replaced all the same.
    """
    config = job.planned_run.config
    scene = job.planned_run.scene
    directory = job.directory
    try:
        if directory.exists():
            with suppress(ConfigError, UsageError):
                pipeline.simulate(config, scene=scene, directory=directory, resume=job.resume)
                return 0, ""
        pipeline.simulate(config, scene=scene, directory=directory, overwrite=True)
    except (UsageError, BackendError):  # no fault of the run: the next one would end the same way
        raise
    except IndentSimError as error:
        return error.exit_code, str(error)
    except Exception as error:
        return 1, f"{type(error).__name__}: {error}"
    return 0, ""


class Workers(ExitStack, Generic[JobName]):
    """Several workers, each doing one job after another; a context manager."""

    def __init__(self, count: int, jobs: Jobs[JobName], load: LoadLibraries):
        super().__init__()
        self._workers = [self.enter_context(Worker(jobs, load)) for _ in range(count)]

    def run_jobs(self, names: Iterable[JobName]) -> Iterator[tuple[JobName, ExitStatus]]:
        """Do jobs, as many at a time as there are workers; each with its ending as soon as that is
        known.
        """
        pending = iter(names)
        busy = dict[Worker[JobName], JobName]()
        idle = list(self._workers)
        while True:
            for worker, name in zip(list(idle), pending, strict=False):
                idle.remove(worker)
                worker.begin_job(name)
                busy[worker] = name
            if not busy:
                return
            ready: Worker[JobName] = connection.wait(list(busy))[0]  # type: ignore[assignment, arg-type]
            idle.append(ready)
            yield busy.pop(ready), ready.wait_for_job()
