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

from indent_sim.process import ipc, usage
from indent_sim.process.signals import die_with_parent

CRASH_OUTPUT_BYTES = (
    4096  # bytes at the end of what the process printed in which its last error is looked for
)
SIGNAL_NAMES = {int(known): known.name for known in signal.Signals}
T = TypeVar("T")


class ProcessCrash(Exception):
    """The forked process ended before its answer; the message says how, and what its last error
    message was.

    exit_code: as a shell says it, 128 + n for signal n.
    """

    def __init__(self, message: str, exit_code: int = 1):
        super().__init__(message)
        self.exit_code = exit_code


class ForkedProcess:
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
    def is_running(self) -> bool:
        """Whether there is a process to ask.

        One that was itself forked from its owner has none of its own.
        """
        return self._child is not None and self._child.is_own_child and self._child.status is None

    def start(self) -> None:
        """Fork the process, unless it is there and idle. OSError when the system has no room for
        it.
        """
        if self.is_running and self._child is not None and not self._child.is_busy:
            return
        self.stop()
        (parent_pipe, child_pipe) = Pipe()
        parent = os.getpid()
        output_file = os.memfd_create("printed")
        try:
            pid = os.fork()
        except OSError:
            os.close(output_file)
            raise
        if pid == 0:
            self._serve_calls(child_pipe, output_file, parent)
        child_pipe.close()
        self._child = _Child(parent, pid, parent_pipe, output_file)
        atexit.unregister(self.stop)
        atexit.register(
            self.stop
        )  # waits for the process: its CPU time is counted with that of this one

    def begin_call(self, argument: Any, mapped: bool = False) -> Callable[[], Any]:
        """Begin a call; what is returned gives its answer once: returns or raises what the function
        did, or Crash.

        With `mapped` the arrays of argument and answer lie in temporary files; OSError where these
        have no room.
        """
        self.start()
        assert self._child is not None
        child = self._child
        self._child.is_busy = True
        with suppress(ConnectionError):  # it has just crashed: the answer will say so
            ipc.send(child.pipe, (argument, mapped), mapped)
        return lambda: self._receive_answer(child)

    def fileno(self) -> int:
        """What can be read once a call that was begun has its answer."""
        assert self._child is not None
        return self._child.pipe.fileno()

    def stop(self) -> None:
        """End the process."""
        if self._child is not None and self._child.is_own_child:
            self._child.end()
        self._child = None

    def _receive_answer(self, child: _Child) -> Any:
        if child is not self._child:
            raise ProcessCrash("another call took its place")
        try:
            answer, failure, cpu, memory = ipc.receive(child.pipe)
        except (EOFError, ConnectionError):
            crash = child.crash_error()
            self.stop()
            raise crash from None
        except BaseException:  # a signal, or no memory to map it: nobody will wait for this answer
            self.stop()
            raise
        child.is_busy = False
        usage.CHILD_USAGE.add_call(cpu, memory)
        if failure is not None:
            raise failure
        return answer

    def _serve_calls(self, pipe: Connection, output_file: int, parent: int) -> None:
        """The life of the forked process: calls until the pipe ends.

        It never returns into what was forked.
        """
        # the owner's garbage is not ours: to destroy its meshes and matrices would be a call of its
        # MPI
        gc.freeze()
        try:
            shared_memory = usage.current_memory()
            _detach(output_file, parent)
            if not self._uses_mpi:  # the lock of a result folder must not live on in here
                os.closerange(3, pipe.fileno())  # all but stdin, stdout, stderr
                os.closerange(pipe.fileno() + 1, os.sysconf("SC_OPEN_MAX"))
            with suppress(Exception):  # the first call will say what is wrong
                self._prepare()
            _restore_crash_signals()
            while True:
                usage.reset_peak_memory()
                self._serve_call(pipe, shared_memory)
        finally:
            os.kill(os.getpid(), signal.SIGKILL)

    def _serve_call(self, pipe: Connection, shared_memory: float) -> None:
        """Send the answer or exception of one call, its CPU time [s], and its memory beyond what is
        shared [MB].
        """
        argument, mapped = ipc.receive(pipe)
        began = time.process_time()
        answer = None
        failure = None
        try:
            answer = self._function(argument)
        except Exception as error:
            failure = error
        cost = time.process_time() - began, max(0.0, usage.peak_memory() - shared_memory)
        try:
            ipc.send(pipe, (answer, failure, *cost), mapped)
        except ConnectionError:
            raise
        except OSError as error:  # no room for the arrays
            ipc.send(pipe, (None, error, *cost))


def call_in_fork(call: Callable[[], T], prepare: Callable[[], object], mapped: bool = False) -> T:
    """What a call returns or raises in a process forked for it alone, or Crash; see `Forked` and
    its `ask`.
    """
    process = ForkedProcess(lambda call: call(), prepare)
    try:
        return process.begin_call(call, mapped)()
    finally:
        process.stop()


@dataclass
class _Child:
    """A forked process as its parent `owner` knows it; `printed` is an open file of what it
    printed.
    """

    parent_pid: int
    pid: int
    pipe: Connection
    output_file: int
    is_busy: bool = False
    wait_status: int | None = None

    @property
    def is_own_child(self) -> bool:
        return self.parent_pid == os.getpid()

    @property
    def status(self) -> int | None:
        """The wait status of a process that has ended; None while it lives."""
        self._wait_for_exit(os.WNOHANG)
        return self.wait_status

    def end(self) -> None:
        if self.status is None:
            os.kill(self.pid, signal.SIGKILL)
            self._wait_for_exit(0)
        self.pipe.close()
        os.close(self.output_file)

    def crash_error(self) -> ProcessCrash:
        """How a process ended whose pipe is closed, and the last error message it printed."""
        self._wait_for_exit(0)
        code = os.waitstatus_to_exitcode(self.wait_status or 0)
        name = SIGNAL_NAMES.get(-code, f"signal {-code}")
        ending = (
            f"died of {name}" if code < 0 else f"ended with exit code {code}" if code else "ended"
        )
        printed = os.pread(
            self.output_file,
            CRASH_OUTPUT_BYTES,
            max(0, os.fstat(self.output_file).st_size - CRASH_OUTPUT_BYTES),
        )
        errors = [
            line
            for line in printed.decode("utf-8", "replace").splitlines()
            if line.startswith("Error")
        ]
        message = f"{ending} ({errors[-1].partition(':')[2].strip()})" if errors else ending
        return ProcessCrash(message, 128 - code if code < 0 else code or 1)

    def _wait_for_exit(self, wait_options: int) -> None:
        if self.wait_status is None:
            try:
                pid, status = os.waitpid(self.pid, wait_options)
            except ChildProcessError:  # somebody else waited for it
                pid = self.pid
                status = 0
            self.wait_status = status if pid else None


def _detach(output_file: int, parent: int) -> None:
    """Leave signals and the terminal to the parent; no core file where this process crashes."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    _restore_crash_signals()
    die_with_parent(parent)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    for standard, file in enumerate((os.open(os.devnull, os.O_RDONLY), output_file, output_file)):
        os.dup2(file, standard)


def _restore_crash_signals() -> None:
    """A crash ends this process alone; PETSc, where it is loaded, would have MPI end all ranks."""
    for number in (signal.SIGSEGV, signal.SIGBUS, signal.SIGFPE, signal.SIGILL, signal.SIGABRT):
        signal.signal(number, signal.SIG_DFL)
