"""A function called in a forked process: an abort of its libraries ends that process and is an
exception here.
"""

from __future__ import annotations

import atexit
import gc
import os
import resource
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, Pipe
from typing import Any, TypeVar

from indent_sim.process import parcel, usage
from indent_sim.process.signals import die_with

MOST_WORDS = (
    4096  # bytes at the end of what the process printed in which its last error is looked for
)
SIGNAL_NAMES = {int(known): known.name for known in signal.Signals}
T = TypeVar("T")


class Crash(Exception):
    """The forked process ended before its answer; the message says how, and what its last error
    message was.

    exit_code: as a shell says it, 128 + n for signal n.
    """

    def __init__(self, words: str, exit_code: int = 1):
        super().__init__(words)
        self.exit_code = exit_code


class Forked:
    """Calls `function` in a forked process, which runs `prepare` first and then serves one call
    after another.

    Argument, answer and exception travel as a `parcel`; what the process prints is kept for
    `Crash`. The process leaves SIGINT, SIGTERM and SIGHUP to this one, is killed with it, and is
    forked anew where it has ended. It keeps the open files of this one only where it uses MPI,
    which waits for ever on those that it had here.
    """

    def __init__(
        self,
        function: Callable[[Any], Any],
        prepare: Callable[[], object],
        *,
        uses_mpi: bool = False,
    ):
        self._function = function
        self._prepare = prepare
        self._uses_mpi = uses_mpi
        self._child: _Child | None = None

    @property
    def is_up(self) -> bool:
        """Whether there is a process to ask.

        One that was itself forked from its owner has none of its own.
        """
        return self._child is not None and self._child.is_ours and self._child.status is None

    def start(self) -> None:
        """Fork the process, unless it is there and idle. OSError when the system has no room for
        it.
        """
        if self.is_up and self._child is not None and not self._child.is_asked:
            return
        self.stop()
        (here, there) = Pipe()
        parent = os.getpid()
        printed = os.memfd_create("printed")
        try:
            pid = os.fork()
        except OSError:
            os.close(printed)
            raise
        if pid == 0:
            self._serve(there, printed, parent)
        there.close()
        self._child = _Child(parent, pid, here, printed)
        atexit.unregister(self.stop)
        atexit.register(
            self.stop
        )  # waits for the process: its CPU time is counted with that of this one

    def ask(self, argument: Any, mapped: bool = False) -> Callable[[], Any]:
        """Begin a call; what is returned gives its answer once: returns or raises what the function
        did, or Crash.

        With `mapped` the arrays of argument and answer lie in temporary files; OSError where these
        have no room.
        """
        self.start()
        assert self._child is not None
        child = self._child
        self._child.is_asked = True
        with suppress(ConnectionError):  # it has just crashed: the answer will say so
            parcel.send(child.pipe, (argument, mapped), mapped)
        return lambda: self._answer(child)

    def fileno(self) -> int:
        """What can be read once a call that was begun has its answer."""
        assert self._child is not None
        return self._child.pipe.fileno()

    def stop(self) -> None:
        """End the process."""
        if self._child is not None and self._child.is_ours:
            self._child.end()
        self._child = None

    def _answer(self, child: _Child) -> Any:
        if child is not self._child:
            raise Crash("another call took its place")
        try:
            answer, failure, cpu, memory = parcel.receive(child.pipe)
        except (EOFError, ConnectionError):
            crash = child.crash()
            self.stop()
            raise crash from None
        except BaseException:  # a signal, or no memory to map it: nobody will wait for this answer
            self.stop()
            raise
        child.is_asked = False
        usage.ELSEWHERE.add(cpu, memory)
        if failure is not None:
            raise failure
        return answer

    def _serve(self, pipe: Connection, printed: int, parent: int) -> None:
        """The life of the forked process: calls until the pipe ends.

        It never returns into what was forked.
        """
        # the owner's garbage is not ours: to destroy its meshes and matrices would be a call of its
        # MPI
        gc.freeze()
        try:
            shared = usage.memory()
            _detach(printed, parent)
            if not self._uses_mpi:  # the lock of a result folder must not live on in here
                os.closerange(3, pipe.fileno())  # all but stdin, stdout, stderr
                os.closerange(pipe.fileno() + 1, os.sysconf("SC_OPEN_MAX"))
            with suppress(Exception):  # the first call will say what is wrong
                self._prepare()
            _let_crash()
            while True:
                usage.forget_peak_memory()
                self._serve_one(pipe, shared)
        finally:
            os.kill(os.getpid(), signal.SIGKILL)

    def _serve_one(self, pipe: Connection, shared: float) -> None:
        """Send the answer or exception of one call, its CPU time [s], and its memory beyond what is
        shared [MB].
        """
        argument, mapped = parcel.receive(pipe)
        began = time.process_time()
        answer = None
        failure = None
        try:
            answer = self._function(argument)
        except Exception as error:
            failure = error
        cost = time.process_time() - began, max(0.0, usage.peak_memory() - shared)
        try:
            parcel.send(pipe, (answer, failure, *cost), mapped)
        except ConnectionError:
            raise
        except OSError as error:  # no room for the arrays
            parcel.send(pipe, (None, error, *cost))


def once(call: Callable[[], T], prepare: Callable[[], object], mapped: bool = False) -> T:
    """What a call returns or raises in a process forked for it alone, or Crash; see `Forked` and
    its `ask`.
    """
    process = Forked(lambda call: call(), prepare)
    try:
        return process.ask(call, mapped)()
    finally:
        process.stop()


@dataclass
class _Child:
    """A forked process as its parent `owner` knows it; `printed` is an open file of what it
    printed.
    """

    owner: int
    pid: int
    pipe: Connection
    printed: int
    is_asked: bool = False
    ended: int | None = None

    @property
    def is_ours(self) -> bool:
        return self.owner == os.getpid()

    @property
    def status(self) -> int | None:
        """The wait status of a process that has ended; None while it lives."""
        self._wait(os.WNOHANG)
        return self.ended

    def end(self) -> None:
        if self.status is None:
            os.kill(self.pid, signal.SIGKILL)
            self._wait(0)
        self.pipe.close()
        os.close(self.printed)

    def crash(self) -> Crash:
        """How a process ended whose pipe is closed, and the last error message it printed."""
        self._wait(0)
        code = os.waitstatus_to_exitcode(self.ended or 0)
        name = SIGNAL_NAMES.get(-code, f"signal {-code}")
        how = f"died of {name}" if code < 0 else f"ended with exit code {code}" if code else "ended"
        printed = os.pread(
            self.printed, MOST_WORDS, max(0, os.fstat(self.printed).st_size - MOST_WORDS)
        )
        errors = [
            line
            for line in printed.decode("utf-8", "replace").splitlines()
            if line.startswith("Error")
        ]
        words = f"{how} ({errors[-1].partition(':')[2].strip()})" if errors else how
        return Crash(words, 128 - code if code < 0 else code or 1)

    def _wait(self, how: int) -> None:
        if self.ended is None:
            try:
                pid, status = os.waitpid(self.pid, how)
            except ChildProcessError:  # somebody else waited for it
                pid = self.pid
                status = 0
            self.ended = status if pid else None


def _detach(printed: int, parent: int) -> None:
    """Leave signals and the terminal to the parent; no core file where this process crashes."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    _let_crash()
    die_with(parent)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    for standard, file in enumerate((os.open(os.devnull, os.O_RDONLY), printed, printed)):
        os.dup2(file, standard)


def _let_crash() -> None:
    """A crash ends this process alone; PETSc, where it is loaded, would have MPI end all ranks."""
    for number in (signal.SIGSEGV, signal.SIGBUS, signal.SIGFPE, signal.SIGILL, signal.SIGABRT):
        signal.signal(number, signal.SIG_DFL)
