"""Worker processes that perform the runs of a study.

If a process crashes, only its current run is lost, and a new process is started for the next run.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from indent_sim.config.schema import Config
from indent_sim.process.child_process import ChildProcess, ProcessCrash, wait_for_answers
from indent_sim.process.errors import BackendError, ConfigError, IndentSimError, UsageError
from indent_sim.run import pipeline

# Exit code and reason.
ExitStatus = tuple[int, str]
JobName = TypeVar("JobName", bound=Hashable)


@dataclass(frozen=True)
class Job:
    """Run to be performed, with its result folder; `resume` continues an interrupted run."""

    config: Config
    is_meshed: bool
    directory: Path
    resume: bool = True


class Worker:
    """Process that performs jobs one after another.

    Parameters
    ----------
    lock
        Descriptor of the lock file of the study. The process keeps it open, so that the study is
        locked until the process has ended.
    """

    def __init__(self, lock: int):
        self._process = ChildProcess(__name__, inherited_files=(lock,))
        self._job_count = 0
        self._wait_for_answer: Callable[[], ExitStatus] = lambda: (0, "")

    def begin_job(self, job: Job) -> None:
        """Begin a job; `wait_for_job` returns its exit status."""
        # After this number of jobs a new process is started. This bounds the memory that PETSc and
        # compiled forms keep, about half a MB for each run.
        max_jobs_of_a_process = 100
        if self._job_count % max_jobs_of_a_process == 0:
            self.stop()
        self._job_count += 1
        self._wait_for_answer = self._process.begin_call(run_job, job)

    def wait_for_job(self) -> ExitStatus:
        """Wait for the job that was begun, and return its exit code and reason.

        Raises
        ------
        UsageError, BackendError
            If the environment caused the failure, so that the next job would fail in the same way.
        """
        try:
            return self._wait_for_answer()
        except ProcessCrash as crash:
            return crash.exit_code, f"the process of the run {crash}"

    def fileno(self) -> int:
        """Return a file descriptor that becomes readable when the job has ended."""
        return self._process.fileno()

    def stop(self) -> None:
        """End the worker process."""
        self._process.stop()


def run_job(job: Job) -> ExitStatus:
    """Perform a run, or the rest of an interrupted run if it can be resumed.

    The folder's name contains the hash of the physics, so that a finished run in it solves the same
    scene. If it was written with another config text or other output, it is replaced.
    """
    if job.is_meshed:
        # The time of a run does not include that of loading the libraries.
        pipeline.warm_up()
    try:
        if job.directory.exists():
            with suppress(ConfigError, UsageError):
                pipeline.simulate(job.config, directory=job.directory, resume=job.resume)
                return 0, ""
        pipeline.simulate(job.config, directory=job.directory, overwrite=True)
    except (UsageError, BackendError):
        # The environment caused the failure, so that the next run would end in the same way.
        raise
    except IndentSimError as error:
        return error.exit_code, str(error)
    except Exception as error:
        return 1, f"{type(error).__name__}: {error}"
    return 0, ""


def run_jobs(
    jobs: Mapping[JobName, Job], worker_count: int, lock: int
) -> Iterator[tuple[JobName, ExitStatus]]:
    """Perform jobs in parallel, and yield the name and exit status of each when it ends.

    Parameters
    ----------
    jobs
        Jobs by their names.
    worker_count
        Number of worker processes.
    lock
        Descriptor of the lock file of the study.
    """
    with ExitStack() as stack:
        idle = [Worker(lock) for _ in range(worker_count)]
        for worker in idle:
            stack.callback(worker.stop)
        busy: dict[Worker, JobName] = {}
        pending = iter(jobs.items())
        while True:
            for worker, (name, job) in zip(list(idle), pending, strict=False):
                idle.remove(worker)
                worker.begin_job(job)
                busy[worker] = name
            if not busy:
                return
            ready = wait_for_answers(busy)[0]
            idle.append(ready)
            yield busy.pop(ready), ready.wait_for_job()
