"""The ways a run can end badly; each knows its exit code."""

from __future__ import annotations

from dataclasses import dataclass


class IndentSimError(Exception):
    """Base of all expected failures; `exit_code` is what the shell sees."""

    exit_code = 1


class UsageError(IndentSimError):
    """CONFIG missing or unreadable, output folder unwritable, foreign or in use."""

    exit_code = 2


@dataclass
class ConfigError(IndentSimError):
    """A scene that is wrong or cannot exist: which key, what is wrong, what would be right.

    `key` is the dotted path (`indenter.R`); `file` and `line` are filled in by whoever knows them.
    """

    key: str
    problem: str
    remedy: str = ""
    file: str = ""
    line: int | None = None

    exit_code = 3

    def __str__(self) -> str:
        place = ":".join(str(part) for part in (self.file, self.line) if part)
        message = f"{self.key}: {self.problem}" if self.key else self.problem
        if self.remedy:
            message += f"; {self.remedy}"
        return f"{place}: {message}" if place else message

    def __reduce__(self):
        return ConfigError, (self.key, self.problem, self.remedy, self.file, self.line)


class ConfigErrors(ConfigError):
    """Several config errors of one file, reported together, a line each."""

    def __init__(self, errors: list[ConfigError]):
        first = errors[0]
        super().__init__(first.key, first.problem, first.remedy, first.file, first.line)
        self.errors = errors

    def __str__(self) -> str:
        return "\n".join(str(error) for error in self.errors)

    def __reduce__(self):
        return ConfigErrors, (self.errors,)


class MeshError(IndentSimError):
    """gmsh could not build the geometry or the mesh, or crashed."""

    exit_code = 4


class NotConverged(IndentSimError):
    """A load step has no converged solution, or the disk filled up; what came before is kept."""

    exit_code = 5


class VerificationError(IndentSimError):
    """A result failed its own audit, or two results differ."""

    exit_code = 6


class BackendError(IndentSimError):
    """dolfinx, PETSc, gmsh or MPI is missing or broken."""

    exit_code = 7
