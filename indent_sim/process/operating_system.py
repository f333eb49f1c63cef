"""Limits and memory of this process and of the machine, as the operating system reports them.

Windows has no limits of a process. Memory is in bytes on all systems.
"""

from __future__ import annotations

import ctypes
import os
import sys
from math import inf
from typing import Any


def soft_limit(name: str) -> float:
    """Return a limit by its name, e.g. "NOFILE" for RLIMIT_NOFILE; infinite without a limit."""
    resource = _resource_module()
    number = getattr(resource, f"RLIMIT_{name}", None)
    if number is None:
        return inf
    allowed, _ = resource.getrlimit(number)
    return inf if allowed == resource.RLIM_INFINITY else float(allowed)


def lower_limit(name: str, value: int) -> None:
    """Lower a limit of this process; where the system does not have it, do nothing."""
    resource = _resource_module()
    number = getattr(resource, f"RLIMIT_{name}", None)
    if number is None:
        return
    _, hard = resource.getrlimit(number)
    lowered = value if hard == resource.RLIM_INFINITY else min(value, hard)
    resource.setrlimit(number, (lowered, hard))


def _resource_module() -> Any:
    """Return the Python module `resource`; None on a system without this module."""
    try:
        import resource
    except ImportError:
        return None
    return resource


if sys.platform == "win32":

    class _MachineMemory(ctypes.Structure):
        """MEMORYSTATUSEX of the Windows API."""

        _fields_ = (
            ("dwLength", ctypes.c_uint32),
            ("dwMemoryLoad", ctypes.c_uint32),
            ("ullTotalPhys", ctypes.c_uint64),
            ("others", ctypes.c_uint64 * 6),
        )

    class _ProcessMemory(ctypes.Structure):
        """PROCESS_MEMORY_COUNTERS of the Windows API."""

        _fields_ = (
            ("cb", ctypes.c_uint32),
            ("PageFaultCount", ctypes.c_uint32),
            ("PeakWorkingSetSize", ctypes.c_size_t),
            ("others", ctypes.c_size_t * 7),
        )

    def physical_memory() -> float:
        """Return the physical memory of the machine."""
        memory = _MachineMemory(dwLength=ctypes.sizeof(_MachineMemory))
        if not ctypes.windll.kernel32.GlobalMemoryStatusEx(ctypes.byref(memory)):
            raise ctypes.WinError()
        return float(memory.ullTotalPhys)

    def peak_memory() -> float:
        """Return the largest memory that this process has used."""
        memory = _ProcessMemory(cb=ctypes.sizeof(_ProcessMemory))
        kernel = ctypes.windll.kernel32
        this_process = ctypes.c_void_p(-1)
        if not kernel.K32GetProcessMemoryInfo(this_process, ctypes.byref(memory), memory.cb):
            raise ctypes.WinError()
        return float(memory.PeakWorkingSetSize)

else:

    def physical_memory() -> float:
        """Return the physical memory of the machine."""
        return float(os.sysconf("SC_PAGE_SIZE")) * os.sysconf("SC_PHYS_PAGES")

    def peak_memory() -> float:
        """Return the largest memory that this process has used; 0 if it is not known."""
        resource = _resource_module()
        if resource is None:
            return 0.0
        # macOS counts in bytes, other systems in kB.
        unit = 1 if sys.platform == "darwin" else 1024
        return float(unit * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
