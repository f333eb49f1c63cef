"""Limits of the system are expected failures with an exit code."""

from __future__ import annotations

import errno
import os
import resource
import signal

import pytest

from indent_sim.process import limits
from indent_sim.process.errors import BackendError, IndentSimError, NotConverged
from indent_sim.process.signals import Interrupted, raise_on_signals


@pytest.mark.parametrize(
    ("error", "kind", "said"),
    [
        (MemoryError("std::bad_alloc"), NotConverged, "memory"),
        (OSError(errno.ENOMEM, os.strerror(errno.ENOMEM)), NotConverged, "memory"),
        (
            RuntimeError("error code 76\n[0] Error reported by MUMPS: INFOG(1)=-13"),
            NotConverged,
            "memory",
        ),
        (RuntimeError("error code 55\n[0] Out of memory"), NotConverged, "memory"),
        (
            OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "a.csv"),
            NotConverged,
            "cannot write a.csv: No space left",
        ),
        (
            OSError(errno.EMFILE, os.strerror(errno.EMFILE), "a.csv"),
            BackendError,
            "too many open files a.csv",
        ),
    ],
)
def test_what_runs_out(error: Exception, kind: type[IndentSimError], said: str) -> None:
    with pytest.raises(kind, match=said), limits.translate_resource_errors():
        raise error


@pytest.mark.parametrize(
    "error", [RuntimeError("error code 62"), FileNotFoundError(errno.ENOENT, "no such file", "x")]
)
def test_other_failures_pass(error: Exception) -> None:
    with pytest.raises(type(error)) as found, limits.translate_resource_errors():
        raise error
    assert found.value is error


class Error(RuntimeError):
    """Error like petsc4py's."""

    __module__ = "petsc4py.PETSc"


@pytest.mark.parametrize(
    "error",
    [
        Error(
            "error code 86\n[0] SNESSetType() at snes.c:4792\n[0] Unable to find requested "
            "SNES type nosuch"
        ),
        RuntimeError(
            "Failed to successfully call PETSc function 'MatSetFromOptions': requested type nosuch"
        ),
    ],
)
def test_whose_an_option_is_that_petsc_refuses(
    error: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PETSC_OPTIONS", "-snes_type nosuch")
    with (
        pytest.raises(BackendError, match=r"PETSC_OPTIONS='-snes_type nosuch' .* type nosuch"),
        limits.translate_resource_errors(),
    ):
        raise error
    with pytest.raises(ValueError, match="no such key"), limits.translate_resource_errors():
        raise ValueError("no such key")
    monkeypatch.delenv("PETSC_OPTIONS")
    with pytest.raises(type(error)) as found, limits.translate_resource_errors():
        raise error
    assert found.value is error


@pytest.mark.parametrize(
    ("number", "said"), [(resource.RLIMIT_NOFILE, "16 open files"), (resource.RLIMIT_AS, "MB")]
)
def test_too_little_to_begin(number: int, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    unlimited = (resource.RLIM_INFINITY,) * 2
    monkeypatch.setattr(
        resource, "getrlimit", lambda asked: (16, 16) if asked == number else unlimited
    )
    with pytest.raises(BackendError, match=said):
        limits.require_resources()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signals_stop(number: signal.Signals) -> None:
    with pytest.raises(Interrupted) as stopped, raise_on_signals():
        signal.raise_signal(number)
    assert stopped.value.exit_code == 128 + number


def test_nohup_is_honoured() -> None:
    """An ignored SIGHUP stays ignored while the other signals are handled."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with raise_on_signals():
            signal.raise_signal(signal.SIGHUP)
            assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
            assert callable(signal.getsignal(signal.SIGTERM))
        assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)
