"""One process that does the runs of a study, one after another; when it dies, only the run it was at is lost.

It is forked before any MPI is up, so a run there is a run of its own; the parent learns of every end through a
pipe and starts another worker when one died.
"""

from __future__ import annotations

import gc
import multiprocessing
import os
import signal
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from multiprocessing import connection
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, TypeVar

from indent_sim.config.schema import Config
from indent_sim.process.errors import BackendError, ConfigError, IndentSimError, UsageError
from indent_sim.process.signals import SIGNALS, die_with
from indent_sim.process.usage import forget_peak_memory
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
        self._meshes = meshes
        self._process: Any = None
        self._pipe: Any = None
        self._done = 0

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, *error: Any) -> None:
        self._stop()

    def __call__(self, config: Config, directory: Path) -> Ending:
        """Run a config into a folder; exit code and reason. UsageError and BackendError are raised."""
        self.begin(config, directory)
        return self.end()

    def begin(self, config: Config, directory: Path) -> None:
        """Begin a run; `end` waits for it."""
        if self._process is None or self._done >= LIFETIME:
            self._start()
        self._done += 1
        with suppress(OSError):  # a worker that has died says so at the end
            self._pipe.send((config, directory))

    def end(self) -> Ending:
        """How the run that was begun ended; errors as of a call."""
        try:
            ending = self._pipe.recv()
        except (EOFError, OSError):
            return self._death()
        if isinstance(ending, IndentSimError):
            raise ending
        return ending

    def fileno(self) -> int:
        """What `first_ready` waits for."""
        return int(self._pipe.fileno())

    def _start(self) -> None:
        self._stop()
        context = multiprocessing.get_context("fork")
        self._pipe, other = context.Pipe()
        args = (other, self._pipe, os.getpid(), self._meshes)
        self._process = context.Process(target=_serve, args=args, daemon=True)
        self._process.start()
        other.close()
        self._done = 0

    def _stop(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.join()
            self._pipe.close()
            self._process = None

    def _death(self) -> Ending:
        self._process.join()
        code = self._process.exitcode or 0
        self._process = None
        if code >= 0:
            return code or 1, f"the process of the run ended with exit code {code}"
        with suppress(ValueError):
            return 128 - code, f"the process of the run died of {signal.Signals(-code).name}"
        return 128 - code, f"the process of the run died of signal {-code}"


def _serve(pipe: Connection, parents: Connection, parent: int, meshes: bool) -> None:
    """Do the runs that arrive until the parent is gone."""
    gc.freeze()  # meshes and matrices that the parent has let go of are its own to destroy
    parents.close()
    for number in SIGNALS:  # batch systems and terminals send them to all processes of a job
        signal.signal(number, signal.SIG_IGN)  # the parent decides
    die_with(parent)
    for name in [name for name in os.environ if name.startswith(LAUNCHERS)]:
        del os.environ[name]
    if meshes:
        _warm_up()
    with suppress(EOFError, OSError):
        while True:
            pipe.send(_ending(*pipe.recv()))


def _ending(config: Config, directory: Path) -> Ending | IndentSimError:
    forget_peak_memory()  # of the runs before
    try:
        _run(config, directory)
    except ABORTING as error:
        return error
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


def _warm_up() -> None:
    """Load the libraries, and let a crash be one: PETSc would have MPI end it, which a forked process may wait for."""
    with suppress(Exception):  # the run will say what is wrong
        chain.warm_up()
    gc.freeze()  # libraries stay: every run ends with a search for what it left behind
    for crash in (signal.SIGSEGV, signal.SIGBUS, signal.SIGFPE, signal.SIGILL, signal.SIGABRT):
        signal.signal(crash, signal.SIG_DFL)


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
