"""Calls in a forked process: if a library aborts there, the caller gets an exception."""

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

# The last error message is searched in so many bytes at the end of the printed output.
CRASH_OUTPUT_BYTES = 4096
SIGNAL_NAMES = {int(number): number.name for number in signal.Signals}
T = TypeVar("T")


class ProcessCrash(Exception):
    """The forked process ended before its answer.

    The message continues a sentence whose subject is the process, such as "died of SIGSEGV"; it
    quotes the last error message of the process. `exit_code` is that of a shell, 128 + n for
    signal n.
    """

    def __init__(self, message: str, exit_code: int = 1):
        super().__init__(message)
        self.exit_code = exit_code


class ForkedProcess:
    """A function that is called in a forked process.

    The process ignores SIGINT, SIGTERM and SIGHUP, which its parent handles, and is killed together
    with its parent. If it has ended, the next call forks another one. Its printed output is not
    shown; ProcessCrash quotes an error message from it.

    Parameters
    ----------
    function
        Called in the forked process with the argument of `begin_call`, one call after another.
    prepare
        Called once in the forked process, before the first call.
    uses_mpi
        Keep the open files of the parent. An MPI that is already initialized needs them, and
        otherwise waits for ever.
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
        """True if the process exists; False in other processes than its parent."""
        return self._child is not None and self._child.is_own_child and self._child.status is None

    def start(self) -> None:
        """Fork the process, unless it exists and is idle.

        Raises OSError if the system cannot fork.
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
        # Stopping waits for the process, so that its CPU time is counted with that of the parent.
        atexit.unregister(self.stop)
        atexit.register(self.stop)

    def begin_call(self, argument: Any, mapped: bool = False) -> Callable[[], Any]:
        """Begin a call in the forked process.

        Parameters
        ----------
        argument
            Argument of the function.
        mapped
            Send the arrays of the argument and the answer through temporary files.

        Returns
        -------
        callable
            Waits for the answer; to be called once. It returns or raises what the function
            returned or raised. It raises ProcessCrash if the process ended before.

        Raises
        ------
        OSError
            If the system cannot fork, or has no space for the temporary files. The answer raises
            it, too, if its arrays have no space.
        """
        self.start()
        assert self._child is not None
        child = self._child
        self._child.is_busy = True
        # A process that has just crashed is reported when its answer is received.
        with suppress(ConnectionError):
            ipc.send(child.pipe, (argument, mapped), mapped)
        return lambda: self._receive_answer(child)

    def fileno(self) -> int:
        """File descriptor that becomes readable when the answer of a call has arrived."""
        assert self._child is not None
        return self._child.pipe.fileno()

    def stop(self) -> None:
        """End the process, if this process is its parent."""
        if self._child is not None and self._child.is_own_child:
            self._child.end()
        self._child = None

    def _receive_answer(self, child: _Child) -> Any:
        """Wait for the answer of a call; see `begin_call`."""
        if child is not self._child:
            raise ProcessCrash("was stopped before its answer arrived")
        try:
            answer, failure, cpu, memory = ipc.receive(child.pipe)
        except (EOFError, ConnectionError):
            crash = child.crash_error()
            self.stop()
            raise crash from None
        except BaseException:
            # After a signal, or without memory for the answer, nobody waits for it any more.
            self.stop()
            raise
        child.is_busy = False
        usage.CHILD_USAGE.add_call(cpu, memory)
        if failure is not None:
            raise failure
        return answer

    def _serve_calls(self, pipe: Connection, output_file: int, parent: int) -> None:
        """Serve calls in the forked process until the pipe ends; never returns to the caller."""
        # Collecting the parent's garbage here would destroy its meshes and matrices, which calls
        # its MPI.
        gc.freeze()
        try:
            shared_memory = usage.current_memory()
            _detach(output_file, parent)
            if not self._uses_mpi:
                # Inherited files include the lock of a result folder, which would last as long as
                # this process. All but stdin, stdout, stderr and the pipe are closed.
                os.closerange(3, pipe.fileno())
                os.closerange(pipe.fileno() + 1, os.sysconf("SC_OPEN_MAX"))
            # If the preparation fails, the first call reports what is missing.
            with suppress(Exception):
                self._prepare()
            _restore_crash_signals()
            while True:
                usage.reset_peak_memory()
                self._serve_call(pipe, shared_memory)
        finally:
            os.kill(os.getpid(), signal.SIGKILL)

    def _serve_call(self, pipe: Connection, shared_memory: float) -> None:
        """Serve one call.

        The answer or exception is sent together with the CPU time of the call [s] and its peak
        memory [MB] beyond the memory that is shared with the parent.
        """
        argument, mapped = ipc.receive(pipe)
        start = time.process_time()
        answer = None
        failure = None
        try:
            answer = self._function(argument)
        except Exception as error:
            failure = error
        cost = time.process_time() - start, max(0.0, usage.peak_memory() - shared_memory)
        try:
            ipc.send(pipe, (answer, failure, *cost), mapped)
        except ConnectionError:
            raise
        except OSError as error:
            # The temporary file of the arrays has no space.
            ipc.send(pipe, (None, error, *cost))


def call_in_fork(call: Callable[[], T], prepare: Callable[[], object], mapped: bool = False) -> T:
    """Call a function in a process that is forked for this call only.

    Parameters
    ----------
    call
        Called in the forked process.
    prepare
        Called before in the forked process.
    mapped
        Send the arrays of the answer through temporary files.

    Returns
    -------
    object
        The answer of the call.

    Raises
    ------
    ProcessCrash
        If the process ended before its answer. Exceptions of the call are raised as they are.
    """
    process = ForkedProcess(lambda call: call(), prepare)
    try:
        return process.begin_call(call, mapped)()
    finally:
        process.stop()


@dataclass
class _Child:
    """A forked process as its parent knows it.

    Attributes
    ----------
    parent_pid, pid
        Process ids of the parent and of the forked process.
    pipe
        The parent's end of the pipe.
    output_file
        File descriptor of the printed output.
    is_busy
        A call has begun whose answer has not been received.
    wait_status
        Status of os.waitpid once the process has ended; None before.
    """

    parent_pid: int
    pid: int
    pipe: Connection
    output_file: int
    is_busy: bool = False
    wait_status: int | None = None

    @property
    def is_own_child(self) -> bool:
        """True if this process is the parent."""
        return self.parent_pid == os.getpid()

    @property
    def status(self) -> int | None:
        """Wait status of the process if it has ended; None while it is running."""
        self._wait_for_exit(os.WNOHANG)
        return self.wait_status

    def end(self) -> None:
        """Kill the process if it is running, and close its files."""
        if self.status is None:
            os.kill(self.pid, signal.SIGKILL)
            self._wait_for_exit(0)
        self.pipe.close()
        os.close(self.output_file)

    def crash_error(self) -> ProcessCrash:
        """The exception for a process whose pipe is closed, with its last error message."""
        self._wait_for_exit(0)
        code = os.waitstatus_to_exitcode(self.wait_status or 0)
        if code < 0:
            ending = f"died of {SIGNAL_NAMES.get(-code, f'signal {-code}')}"
        elif code > 0:
            ending = f"ended with exit code {code}"
        else:
            ending = "ended"
        output = os.pread(
            self.output_file,
            CRASH_OUTPUT_BYTES,
            max(0, os.fstat(self.output_file).st_size - CRASH_OUTPUT_BYTES),
        )
        errors = [
            line
            for line in output.decode("utf-8", "replace").splitlines()
            if line.startswith("Error")
        ]
        message = f"{ending} ({errors[-1].partition(':')[2].strip()})" if errors else ending
        return ProcessCrash(message, 128 - code if code < 0 else code or 1)

    def _wait_for_exit(self, wait_options: int) -> None:
        """Call os.waitpid, and keep the status if the process has ended."""
        if self.wait_status is None:
            try:
                pid, status = os.waitpid(self.pid, wait_options)
            except ChildProcessError:
                # Another part of the program has already waited for it, and has its status.
                pid = self.pid
                status = 0
            self.wait_status = status if pid else None


def _detach(output_file: int, parent: int) -> None:
    """Leave signals and the terminal to the parent, and write no core file after a crash."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    _restore_crash_signals()
    die_with_parent(parent)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    for standard, file in enumerate((os.open(os.devnull, os.O_RDONLY), output_file, output_file)):
        os.dup2(file, standard)


def _restore_crash_signals() -> None:
    """Let a crash end this process only; the handlers of PETSc would end all MPI ranks."""
    for number in (signal.SIGSEGV, signal.SIGBUS, signal.SIGFPE, signal.SIGILL, signal.SIGABRT):
        signal.signal(number, signal.SIG_DFL)
