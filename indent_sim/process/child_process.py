"""Calls in a child process; if a library crashes there, the caller gets an exception.

A child process is a new Python interpreter that runs this module. It reads pickled calls from its
standard input and writes pickled answers to its standard output.
"""

from __future__ import annotations

import atexit
import ctypes
import os
import pickle
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from importlib import import_module
from tempfile import TemporaryFile
from typing import Any, Protocol, TypeVar

from indent_sim.process import usage
from indent_sim.process.operating_system import lower_limit
from indent_sim.process.ranks import environment_without_launcher
from indent_sim.process.signals import ignore_stop_signals


class ProcessCrash(Exception):
    """The child process ended before it returned an answer.

    The message is the predicate of a sentence about the process, such as "ended with exit code 1",
    with the last error message of the process. `exit_code` is 128 + n for signal n, as in a shell.
    """

    def __init__(self, message: str, exit_code: int = 1):
        super().__init__(message)
        self.exit_code = exit_code


class ChildProcess:
    """Python process that executes calls one after another.

    The process ignores the signals that stop a run, which its parent handles, and ends with the
    parent. If it has ended, the next call starts a new process. Printed output is not shown, except
    that ProcessCrash quotes the last error message.

    Parameters
    ----------
    *modules
        Names of modules that the process imports when it starts.
    inherited_files
        Descriptors of files that stay open until the process ends; ignored on Windows.
    """

    def __init__(self, *modules: str, inherited_files: tuple[int, ...] = ()):
        self._modules = modules
        self._inherited_files = inherited_files
        self._process: subprocess.Popen[bytes] | None = None
        self._output: Any = None
        self._is_busy = False

    def start(self) -> None:
        """Start the process, unless it exists and is idle.

        Raises OSError if the system cannot start a process.
        """
        if self._process is not None and self._process.poll() is None and not self._is_busy:
            return
        self.stop()
        search_path = os.pathsep.join(map(os.path.abspath, sys.path))
        self._output = TemporaryFile()  # noqa: SIM115
        self._process = subprocess.Popen(
            # Option -P: no file in the working directory is imported in place of a library.
            [sys.executable, "-P", "-m", __name__, *self._modules],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._output,
            env=environment_without_launcher() | {"PYTHONPATH": search_path},
            pass_fds=self._inherited_files if os.name == "posix" else (),
        )
        # Stopping waits for the process, so that its CPU time is counted with that of the parent.
        atexit.register(self.stop)

    def begin_call(self, function: Callable[..., Any], *arguments: Any) -> Callable[[], Any]:
        """Begin a call in the child process.

        Parameters
        ----------
        function, arguments
            Function and arguments of the call; both are pickled.

        Returns
        -------
        callable
            Function, to be called once, that waits for the answer. It returns the result or raises
            the exception of the call; it raises ProcessCrash if the process ended before the
            answer.

        Raises
        ------
        OSError
            If the system cannot start a process.
        """
        self.start()
        self._is_busy = True
        process = self._process
        assert process is not None and process.stdin is not None
        # A crash of the process at this time is reported when its answer is received.
        with suppress(BrokenPipeError):
            pickle.dump((function, arguments), process.stdin, pickle.HIGHEST_PROTOCOL)
            process.stdin.flush()
        return lambda: self._receive_answer(process)

    def fileno(self) -> int:
        """File descriptor that becomes readable when the answer of a call has arrived."""
        assert self._process is not None and self._process.stdout is not None
        return self._process.stdout.fileno()

    def stop(self) -> None:
        """Terminate the child process."""
        process = self._process
        self._process = None
        self._is_busy = False
        if process is None:
            return
        atexit.unregister(self.stop)
        process.kill()
        assert process.stdin is not None and process.stdout is not None
        # A call that the process has not read yet is lost.
        with suppress(BrokenPipeError):
            process.stdin.close()
        process.stdout.close()
        process.wait()
        self._output.close()

    def _receive_answer(self, process: subprocess.Popen[bytes]) -> Any:
        """Wait for the answer of a call and return the result; see `begin_call`."""
        if process is not self._process:
            raise ProcessCrash("was stopped before its answer arrived")
        assert process.stdout is not None
        try:
            answer, failure, cpu, memory = pickle.load(process.stdout)
        except (EOFError, pickle.UnpicklingError):
            crash = self._crash_error(process.wait())
            self.stop()
            raise crash from None
        except BaseException:
            # After a signal, or if there is no memory for the answer, the parent no longer waits
            # for it.
            self.stop()
            raise
        self._is_busy = False
        usage.CHILD_USAGE.add_call(cpu, memory)
        if failure is not None:
            raise failure
        return answer

    def _crash_error(self, code: int) -> ProcessCrash:
        """Return the exception for a process that ended with a return code of `subprocess`."""
        ending = f"ended with exit code {code}"
        if code < 0:
            ending = f"was ended by the signal {signal.Signals(-code).name}"
        length = self._output.seek(0, os.SEEK_END)
        # Number of bytes at the end of the printed output in which the last error message is
        # searched.
        max_bytes = 4096
        self._output.seek(max(0, length - max_bytes))
        lines = self._output.read().decode("utf-8", "replace").splitlines()
        errors = [line for line in lines if line.startswith("Error")]
        if errors:
            ending += f" ({errors[-1].partition(':')[2].strip()})"
        return ProcessCrash(ending, 128 - code if code < 0 else code or 1)


Key = TypeVar("Key")


def run_calls(
    processes: Sequence[ChildProcess],
    calls: Iterable[tuple[Key, Callable[..., Any], tuple[Any, ...]]],
) -> Iterator[tuple[Key, Callable[[], Any]]]:
    """Execute calls in several processes, each of which takes the next call when it is idle.

    Parameters
    ----------
    processes
        The processes.
    calls
        A key, the function and its arguments for each call.

    Yields
    ------
    key, answer
        Key of a call that has ended, and the function that returns its answer; see
        `ChildProcess.begin_call`.
    """
    idle = list(processes)
    busy: dict[ChildProcess, tuple[Key, Callable[[], Any]]] = {}
    for key, function, arguments in calls:
        while not idle:
            for process in wait_for_answers(busy):
                idle.append(process)
                yield busy.pop(process)
        process = idle.pop()
        busy[process] = key, process.begin_call(function, *arguments)
    while busy:
        for process in wait_for_answers(busy):
            yield busy.pop(process)


def call_in_child(function: Callable[..., Any], *arguments: Any) -> Any:
    """Call a function in a new child process; see `ChildProcess.begin_call`."""
    process = ChildProcess()
    try:
        return process.begin_call(function, *arguments)()
    finally:
        process.stop()


class Answering(Protocol):
    """Process whose descriptor becomes readable when the answer of a call has arrived."""

    def fileno(self) -> int:
        """Return the descriptor."""


P = TypeVar("P", bound=Answering)


def wait_for_answers(processes: Iterable[P]) -> list[P]:
    """Wait until a call in one of the processes has ended; return the processes with answers."""
    waiting = list(processes)
    answered = list(map(id, _wait_for_descriptors(waiting)))
    return [process for process in waiting if id(process) in answered]


if sys.platform == "win32":

    def _wait_for_descriptors(processes: list[Any]) -> list[Any]:
        """Return the objects whose pipe has data or is closed, as soon as there is such a pipe."""
        # The system can wait for several pipes only if they were made for that purpose.
        seconds_between_looks = 0.02
        while not (ready := [process for process in processes if _has_data(process.fileno())]):
            time.sleep(seconds_between_looks)
        return ready

    def _has_data(descriptor: int) -> bool:
        """Return whether a pipe has data, or was closed at its other end."""
        import msvcrt

        count = ctypes.c_uint32()
        handle = ctypes.c_void_p(msvcrt.get_osfhandle(descriptor))
        is_open = ctypes.windll.kernel32.PeekNamedPipe(
            handle, None, 0, None, ctypes.byref(count), None
        )
        return not is_open or count.value > 0

else:

    def _wait_for_descriptors(processes: list[Any]) -> list[Any]:
        """Return the objects whose descriptor is readable, as soon as at least one is."""
        from multiprocessing import connection

        return connection.wait(processes)


def _serve_calls() -> None:
    """Execute calls (main function of the child process) until the parent closes the pipe."""
    ignore_stop_signals()
    _end_with_parent()
    # A crash writes no core file.
    lower_limit("CORE", 0)
    # Libraries print to the file of stderr; their output would damage the answers.
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    for module in sys.argv[1:]:
        # If a module is missing, the first call reports it.
        with suppress(ImportError, OSError):
            import_module(module)
    idle_memory = usage.current_memory()
    while True:
        try:
            function, arguments = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        usage.reset_peak_memory()
        start = time.process_time()
        answer = None
        failure = None
        try:
            answer = function(*arguments)
        except Exception as error:
            failure = error
        cpu = time.process_time() - start
        memory = max(0.0, usage.peak_memory() - idle_memory)
        pickle.dump((answer, failure, cpu, memory), answers, pickle.HIGHEST_PROTOCOL)
        answers.flush()


def _end_with_parent() -> None:
    """Make Linux kill this process when its parent ends, even during a call of a library.

    On other systems it ends after the call, when it finds the pipe of the calls closed.
    """
    pr_set_pdeathsig = 1  # PR_SET_PDEATHSIG of linux/prctl.h
    if sys.platform == "linux":
        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGKILL)


if __name__ == "__main__":
    _serve_calls()
