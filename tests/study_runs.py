"""Runs of a study that end in another way than by a result; worker processes import this file."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable

from indent_sim.process.errors import NotConverged
from indent_sim.run import pipeline
from indent_sim.studies import worker
from indent_sim.studies.worker import ExitStatus, Job

simulate = pipeline.simulate
run_job = worker.run_job


def _run_with(action: Callable[[], object], job: Job) -> ExitStatus:
    """Do a run after an action in the place of `simulate`."""

    def simulate_after_action(*arguments, **options):
        action()
        return simulate(*arguments, **options)

    pipeline.simulate = simulate_after_action
    try:
        return run_job(job)
    finally:
        pipeline.simulate = simulate


def _refuse() -> None:
    raise NotConverged("never")


def _divide_by_zero() -> None:
    raise ZeroDivisionError("x")


def fail(job: Job) -> ExitStatus:
    """No run has a result."""
    return _run_with(_refuse, job)


def stop_worker(job: Job) -> ExitStatus:
    """Every run sends SIGTERM to its process."""
    return _run_with(lambda: os.kill(os.getpid(), signal.SIGTERM), job)


def divide_by_zero(job: Job) -> ExitStatus:
    """The run with h_contact = 0.05 raises an exception that nobody expects."""
    return _run_with(_divide_by_zero, job) if job.config.mesh.h_contact == 0.05 else run_job(job)


def not_converge(job: Job) -> ExitStatus:
    """The run with h_contact = 0.05 does not converge."""
    return _run_with(_refuse, job) if job.config.mesh.h_contact == 0.05 else run_job(job)


def crash(job: Job) -> ExitStatus:
    """The process of the run with h_contact = 0.05 crashes."""
    if job.config.mesh.h_contact == 0.05:
        os.kill(os.getpid(), signal.SIGSEGV)
    return run_job(job)


def leave(job: Job) -> ExitStatus:
    """The process of the run with h_contact = 0.05 ends."""
    if job.config.mesh.h_contact == 0.05:
        os._exit(3)
    return run_job(job)
