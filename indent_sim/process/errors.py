"""The ways a run can end badly; each knows its exit code."""

from __future__ import annotations

import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any


def printable(text: str, line_breaks: bool = False) -> str:
    """Text of a stranger as a terminal or a picture may show it, on one line unless line breaks are
    kept.

    Characters that control a terminal or turn the direction of text become their escapes, as \\x1b.
    """
    if not line_breaks and any(sign in text for sign in "\n\r\t\v\f\x85\u2028\u2029"):
        text = " ".join(text.split())
    unsafe = {
        sign
        for sign in set(text) - set("\n\t\u200c\u200d")
        if unicodedata.category(sign) in ("Cc", "Cf", "Cs")
    }
    return "".join(
        sign.encode("unicode_escape").decode() if sign in unsafe else sign for sign in text
    )


class IndentSimError(Exception):
    """Base of all expected failures; `exit_code` is what the shell sees."""

    exit_code = 1
    partial_result: Mapping[str, Any] = MappingProxyType(
        {}
    )  # what the command found all the same, for its JSON object


class UsageError(IndentSimError):
    """CONFIG missing or unreadable, output folder unwritable, foreign or in use.

    problem: what is wrong; `remedy` and `file` where they are known, for scripts too.
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
    """A scene that is wrong or cannot exist: which key, what is wrong, what would be right.

    `key` is the dotted path (`indenter.R`); `file` and `line` are filled in by whoever knows them.
    meant: the word that was probably meant, in place of the last one of the key, or of its value.
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
        """The errors that are told, a line each."""
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
    """Several config errors of one file, reported together, a line each."""

    def __init__(self, errors: list[ConfigError]):
        first = errors[0]
        super().__init__(first.key, first.problem, first.remedy, first.file, first.line)
        self._errors = errors

    @property
    def errors(self) -> list[ConfigError]:
        """Each of them."""
        return self._errors

    @staticmethod
    def combine(errors: Sequence[ConfigError]) -> ConfigError:
        """One error as it is, several together, each once."""
        unique = list({str(error): error for error in errors}.values())
        return ConfigErrors(unique) if len(unique) > 1 else unique[0]

    def __str__(self) -> str:
        return "\n".join(str(error) for error in self.errors)

    def __reduce__(self):
        return ConfigErrors, (self.errors,)


class MeshFileError(ConfigError):
    """A mesh file that is no body, or that cannot be read."""

    exit_code = 4


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
