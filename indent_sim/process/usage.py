"""Time and memory of this process, of those it forked, and of the machine."""

from __future__ import annotations

import ctypes
import os
import resource
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path


@dataclass
class ChildUsage:
    """What forked processes used for this one: CPU time [s], and their largest memory beyond what
    they share [MB].
    """

    cpu: float = 0.0
    memory: float = 0.0

    def add_call(self, cpu: float, memory: float) -> None:
        """Count one call that a forked process answered."""
        self.cpu += cpu
        self.memory = max(self.memory, memory)


CHILD_USAGE = ChildUsage()  # of this process, as its CPU time is


def cpu_time() -> float:
    """CPU time of this process so far [s], with that of the calls which forked processes answered."""
    return time.process_time() + CHILD_USAGE.cpu


def current_memory() -> float:
    """Memory of this process now [MB]; its peak where the system does not say."""
    return _proc_status("VmRSS:") or _own_peak_memory()


def address_space() -> float:
    """Addresses that this process uses now [bytes], what it shares with others among them."""
    return (_proc_status("VmSize:") or 0.0) * 1024**2


def peak_memory() -> float:
    """Largest memory of this process so far [MB], with the largest of its forked processes."""
    return _own_peak_memory() + CHILD_USAGE.memory


def reset_peak_memory() -> None:
    """Begin anew with the largest memory; what was freed goes back to the system."""
    CHILD_USAGE.memory = 0.0
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def _own_peak_memory() -> float:
    """The kernel's ru_maxrss would include the memory of whoever started this process."""
    return _proc_status("VmHWM:") or resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def _proc_status(name: str) -> float | None:
    with suppress(OSError, ValueError):
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith(name):
                return int(line.split()[1]) / 1024
    return None


def machine_memory() -> float:
    """Physical memory of this machine, or what this process may have of it [bytes]."""
    physical = float(os.sysconf("SC_PAGE_SIZE")) * os.sysconf("SC_PHYS_PAGES")
    allowed, _ = resource.getrlimit(resource.RLIMIT_AS)
    return physical if allowed == resource.RLIM_INFINITY else min(physical, float(allowed))


def duration_text(seconds: float) -> str:
    """A time in words, in the unit that fits."""
    minutes = seconds / 60
    hours = seconds / 3600
    return (
        f"{seconds:.0f} s"
        if minutes < 2
        else f"{minutes:.0f} min"
        if hours < 2
        else f"{hours:.1f} h"
    )


@dataclass
class ProgressEstimate:
    """How long each of several steps takes, and how long the others will; the first step seen
    begins the count.
    """

    completed_steps: int = 0
    first_step_end: float = 0.0
    last_step_end: float = field(default_factory=time.monotonic)

    def record_step(self, remaining_steps: int) -> tuple[float, str]:
        """Seconds of the step that has just ended, and in words how long so many more take; nothing
        after one step.
        """
        now = time.monotonic()
        step_seconds = now - self.last_step_end
        self.last_step_end = now
        self.completed_steps = self.completed_steps + 1
        self.first_step_end = self.first_step_end or now
        mean_seconds = (
            (now - self.first_step_end) / (self.completed_steps - 1)
            if self.completed_steps > 1
            else 0.0
        )
        return (
            step_seconds,
            f"{duration_text(mean_seconds * remaining_steps)} left"
            if remaining_steps and mean_seconds
            else "",
        )


@dataclass
class Clock:
    """Seconds spent in each stage of a run: of wall time, and of CPU time, with that of the process
    that meshes.
    """

    started: float = field(default_factory=time.perf_counter)
    stages: dict[str, float] = field(default_factory=dict)
    cpu: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the time of the block to a stage."""
        begin = time.perf_counter()
        cpu = cpu_time()
        try:
            yield
        finally:
            self.stages[name] = self.stages.get(name, 0.0) + time.perf_counter() - begin
            self.cpu[name] = self.cpu.get(name, 0.0) + cpu_time() - cpu
