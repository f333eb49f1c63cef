"""Exceptions for expected failures, each with an exit code of the command line."""

from __future__ import annotations

import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any


def printable(text: str, line_breaks: bool = False) -> str:
    """Return text from outside the program, made safe for a terminal or a picture.

    Characters that control a terminal or change the text direction become escapes such as \\x1b.

    Parameters
    ----------
    text
        Text of a config, a file name or a library's message.
    line_breaks
        Keep line breaks; otherwise the text becomes a single line.
    """
    if not line_breaks and any(character in text for character in "\n\r\t\v\f\x85\u2028\u2029"):
        text = " ".join(text.split())
    unsafe = {
        character
        for character in set(text) - set("\n\t\u200c\u200d")
        if unicodedata.category(character) in ("Cc", "Cf", "Cs")
    }
    return "".join(
        character.encode("unicode_escape").decode() if character in unsafe else character
        for character in text
    )


class IndentSimError(Exception):
    """Base class of all expected failures.

    Attributes
    ----------
    exit_code
        Exit code of the command.
    partial_result
        Results obtained before the failure, which are written to the JSON object of the command.
    """

    exit_code = 1
    partial_result: Mapping[str, Any] = MappingProxyType({})


class UsageError(IndentSimError):
    """The command cannot start: the config is not readable or the output folder not writable.

    Attributes
    ----------
    problem
        Description of the error.
    remedy
        Advice on how to avoid the error; may be empty.
    file
        Path of the file or folder concerned; may be empty.
    """

    exit_code = 2

    def __init__(self, problem: str, remedy: str = "", file: str = ""):
        super().__init__(problem, remedy, file)
        self.problem = problem
        self.remedy = remedy
        self.file = file

    def __str__(self) -> str:
        return f"{self.problem}; {self.remedy}" if self.remedy else self.problem


@dataclass
class ConfigError(IndentSimError):
    """A scene is invalid or physically impossible.

    Attributes
    ----------
    key
        Dotted path of the key, such as `indenter.R`; empty for the whole file.
    problem
        Description of the error, the predicate of a sentence whose subject is the key.
    remedy
        Advice on how to correct the error; may be empty.
    file, line
        File and line of the key, which the reader of the file sets.
    suggestion
        The word that was probably intended instead of the key's last part or its value.
    """

    key: str
    problem: str
    remedy: str = ""
    file: str = ""
    line: int | None = None
    suggestion: str = ""

    exit_code = 3

    @property
    def errors(self) -> list[ConfigError]:
        """The individual errors, which are reported one per line."""
        return [self]

    def __str__(self) -> str:
        place = ":".join(str(part) for part in (self.file, self.line) if part)
        message = f"{self.key}: {self.problem}" if self.key else self.problem
        if self.remedy:
            message += f"; {self.remedy}"
        return printable(f"{place}: {message}" if place else message)

    def __reduce__(self):
        return type(self), (
            self.key,
            self.problem,
            self.remedy,
            self.file,
            self.line,
            self.suggestion,
        )


class ConfigErrors(ConfigError):
    """Several config errors of one file, reported together, one per line."""

    def __init__(self, errors: list[ConfigError]):
        first = errors[0]
        super().__init__(first.key, first.problem, first.remedy, first.file, first.line)
        self._errors = errors

    @property
    def errors(self) -> list[ConfigError]:
        """The individual errors."""
        return self._errors

    @staticmethod
    def combine(errors: Sequence[ConfigError]) -> ConfigError:
        """Combine errors into one without duplicates; a single error is returned unchanged."""
        unique = list({str(error): error for error in errors}.values())
        return ConfigErrors(unique) if len(unique) > 1 else unique[0]

    def __str__(self) -> str:
        return "\n".join(str(error) for error in self.errors)

    def __reduce__(self):
        return ConfigErrors, (self.errors,)


class MeshFileError(ConfigError):
    """A mesh file cannot be read, or its mesh is not suitable as a body."""

    exit_code = 4


class MeshError(IndentSimError):
    """Gmsh could not build the geometry or the mesh, or crashed."""

    exit_code = 4


class NotConverged(IndentSimError):
    """A load step has no converged solution, or the disk is full; earlier results are kept."""

    exit_code = 5


class VerificationError(IndentSimError):
    """A result failed its verification, or two results differ."""

    exit_code = 6


class BackendError(IndentSimError):
    """A library is missing or does not work: dolfinx, PETSc, gmsh or MPI."""

    exit_code = 7


class SolverMissing(BackendError):
    """A scene needs a mesh, and the solver is not installed."""
