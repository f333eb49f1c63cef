"""Time and memory used by this process and its child processes, and memory of the machine."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from indent_sim.process import operating_system


@dataclass
class ChildUsage:
    """CPU time and memory used by child processes for calls of this process.

    Attributes
    ----------
    cpu
        Total CPU time [s].
    memory
        Largest memory of a call minus the memory of the idle process [MB].
    """

    cpu: float = 0.0
    memory: float = 0.0

    def add_call(self, cpu: float, memory: float) -> None:
        """Add the CPU time [s] and memory [MB] of one call."""
        self.cpu += cpu
        self.memory = max(self.memory, memory)


# This variable belongs to the whole process, like the CPU time that the operating system counts.
CHILD_USAGE = ChildUsage()


def cpu_time() -> float:
    """Return the CPU time of this process so far [s], including its calls in child processes."""
    return time.process_time() + CHILD_USAGE.cpu


def current_memory() -> float:
    """Return the current memory of this process [MB]; the peak memory if not on Linux."""
    return _proc_status("VmRSS:") or _own_peak_memory()


def address_space() -> float:
    """Return the address space of this process [bytes] with shared memory; 0 if not on Linux."""
    return (_proc_status("VmSize:") or 0.0) * 1024**2


def peak_memory() -> float:
    """Return the peak memory [MB] of this process plus that of the largest child process call."""
    return _own_peak_memory() + CHILD_USAGE.memory


def reset_peak_memory() -> None:
    """Reset the peak memory to the current memory (on Linux only)."""
    CHILD_USAGE.memory = 0.0
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def _own_peak_memory() -> float:
    """Return the peak memory of this process without its child processes [MB].

    The value is read from /proc if possible, because Linux includes the memory of the process that
    started this one.
    """
    return _proc_status("VmHWM:") or operating_system.peak_memory() / 1024**2


def _proc_status(name: str) -> float | None:
    """Return the size [MB] in the line of /proc/self/status that begins with `name`.

    The result is None if not on Linux.
    """
    with suppress(OSError, ValueError):
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith(name):
                return int(line.split()[1]) / 1024
    return None


def machine_memory() -> float:
    """Return the physical memory of the machine [bytes], or this process's limit if smaller."""
    return min(operating_system.physical_memory(), operating_system.soft_limit("AS"))


def duration_text(seconds: float) -> str:
    """Return a duration [s] as text in seconds, minutes or hours."""
    minutes = seconds / 60
    hours = seconds / 3600
    if minutes < 2:
        return f"{seconds:.0f} s"
    if hours < 2:
        return f"{minutes:.0f} min"
    return f"{hours:.1f} h"


@dataclass
class ProgressEstimate:
    """Measures the duration of steps and estimates the time of the remaining steps.

    The mean duration does not include the first step, in which kernels are compiled.

    Attributes
    ----------
    completed_steps
        Number of completed steps.
    first_step_end, last_step_end
        Monotonic time at the end of the first and of the last step [s]; initially 0 and the time of
        creation.
    """

    completed_steps: int = 0
    first_step_end: float = 0.0
    last_step_end: float = field(default_factory=time.monotonic)

    def record_step(self, remaining_steps: int) -> tuple[float, str]:
        """Record the end of a step and estimate the remaining time.

        Parameters
        ----------
        remaining_steps
            Number of steps that follow.

        Returns
        -------
        step_seconds
            Duration of the step that has ended [s].
        remaining_text
            Estimate of the remaining time, such as "12 s left"; empty after the first and the last
            step.
        """
        now = time.monotonic()
        step_seconds = now - self.last_step_end
        self.last_step_end = now
        self.completed_steps += 1
        self.first_step_end = self.first_step_end or now
        if self.completed_steps == 1:
            return step_seconds, ""
        mean_seconds = (now - self.first_step_end) / (self.completed_steps - 1)
        if not (remaining_steps and mean_seconds):
            return step_seconds, ""
        return step_seconds, f"{duration_text(mean_seconds * remaining_steps)} left"


@dataclass
class Clock:
    """Time spent in each stage of a run.

    Attributes
    ----------
    started
        Value of time.perf_counter at the start of the run [s].
    stages
        Wall time of each stage [s], by name.
    cpu
        CPU time of each stage [s], including the process that meshes.
    """

    started: float = field(default_factory=time.perf_counter)
    stages: dict[str, float] = field(default_factory=dict)
    cpu: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Context manager that adds the time spent inside it to a stage."""
        start = time.perf_counter()
        cpu_start = cpu_time()
        try:
            yield
        finally:
            self.stages[name] = self.stages.get(name, 0.0) + time.perf_counter() - start
            self.cpu[name] = self.cpu.get(name, 0.0) + cpu_time() - cpu_start
