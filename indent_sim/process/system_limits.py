"""Limits that the operating system sets to a process; Windows has none of them."""

from __future__ import annotations

from math import inf
from typing import Any


def soft_limit(name: str) -> float:
    """Return a limit, such as that of RLIMIT_NOFILE for "NOFILE"; infinite if there is none."""
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
    resource.setrlimit(
        number, (value if hard == resource.RLIM_INFINITY else min(value, hard), hard)
    )


def peak_resident_size() -> float | None:
    """Return the largest memory that this process has used [unit of ru_maxrss], if it is known."""
    resource = _resource_module()
    return None if resource is None else resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def _resource_module() -> Any:
    """Return the module resource; None on a system without it."""
    try:
        import resource
    except ImportError:
        return None
    return resource
