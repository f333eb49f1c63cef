"""Worker processes that do the runs of a study.

A process is forked before MPI is initialised, so that each run is independent of this process. If
it crashes, only its current run is lost and a new process is forked for the next run.
"""

from __future__ import annotations

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

# Environment variables by which mpirun and srun address their processes. A worker must not register
# with the launcher, which would abort the whole job when the worker is stopped.
OPEN_MPI_VARIABLES = tuple(
    f"OMPI_{part}" for part in ("COMM_", "UNIVERSE_", "MCA_orte_", "MCA_ess")
)
LAUNCHER_VARIABLES = ("SLURM_", "PMI_", "PMIX_", "PRTE_MCA_ess", *OPEN_MPI_VARIABLES)

# Exit code and reason.
ExitStatus = tuple[int, str]
LoadLibraries = Callable[[], object]
JobName = TypeVar("JobName", bound=Hashable)


@dataclass(frozen=True)
class Job:
    """Run to do, with its result folder; `resume` continues an interrupted run."""

    planned_run: PlannedRun
    directory: Path
    resume: bool = True


# Jobs by their names.
Jobs = Mapping[JobName, Job]


class Worker(ExitStack, Generic[JobName]):
    """Process that does jobs one after another; a context manager.

    It inherits `jobs` by forking, and first calls `load` to import the solver's libraries.
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
        """Begin a job; `wait_for_job` returns its exit status."""
        # A new process for every 100 jobs bounds the memory that PETSc and compiled forms keep:
        # about half a MB of each run.
        if self._job_count % 100 == 0:
            self._process.stop()
        self._job_count += 1
        self._wait_for_answer = self._process.begin_call(name)

    def wait_for_job(self) -> ExitStatus:
        """Wait for the job that was begun, and return its exit code and reason.

        Raises
        ------
        UsageError, BackendError
            The environment is at fault, so that the next job would fail in the same way.
        """
        try:
            return self._wait_for_answer()
        except ProcessCrash as crash:
            return crash.exit_code, f"the process of the run {crash}"

    def fileno(self) -> int:
        """Return a file descriptor that becomes readable when the job has ended."""
        return self._process.fileno()


def _prepare_process(load: LoadLibraries) -> None:
    """Remove the launcher's environment variables, and load the libraries."""
    for name in [name for name in os.environ if name.startswith(LAUNCHER_VARIABLES)]:
        del os.environ[name]
    load()


def _run_job(job: Job) -> ExitStatus:
    """Do a run, or the rest of an interrupted one; what cannot be resumed is started again.

    The folder's name contains the hash of the physics, so that a finished run in it solves the same
    scene. If it was written with another config text or other output, it is replaced.
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
    except (UsageError, BackendError):
        # The environment is at fault, not this run: the next run would end in the same way.
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
        """Do jobs in parallel, one per worker, and yield the exit status of each when it ends."""
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
