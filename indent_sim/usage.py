"""CPU time and memory of this process and of the forked processes that work for it."""

from __future__ import annotations

import contextlib
import ctypes
import resource
import time
from dataclasses import dataclass
from pathlib import Path


@dataclass
class Elsewhere:
    """What forked processes used for this one: CPU time [s], and their largest memory beyond what they share [MB]."""

    cpu: float = 0.0
    memory: float = 0.0

    def add(self, cpu: float, memory: float) -> None:
        """Count one call that a forked process answered."""
        self.cpu += cpu
        self.memory = max(self.memory, memory)


ELSEWHERE = Elsewhere()  # of this process, as its CPU time is


def cpu_time() -> float:
    """CPU time of this process so far [s], with that of the calls which forked processes answered."""
    return time.process_time() + ELSEWHERE.cpu


def memory() -> float:
    """Memory of this process now [MB]; its peak where the system does not say."""
    return _status("VmRSS:") or _peak()


def peak_memory() -> float:
    """Largest memory of this process so far [MB], with the largest of its forked processes."""
    return _peak() + ELSEWHERE.memory


def forget_peak_memory() -> None:
    """Begin anew with the largest memory; what was freed goes back to the system."""
    ELSEWHERE.memory = 0.0
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def _peak() -> float:
    """The kernel's ru_maxrss would include the memory of whoever started this process."""
    return _status("VmHWM:") or resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def _status(name: str) -> float | None:
    with contextlib.suppress(OSError, ValueError):
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith(name):
                return int(line.split()[1]) / 1024
    return None
