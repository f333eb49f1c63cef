"""Checks of paths in scene files, which may be untrusted."""

from __future__ import annotations

import os
from collections.abc import Iterator

from indent_sim.config.scene_sections import SceneSections
from indent_sim.process.errors import ConfigError, printable


def directory_errors(config: SceneSections) -> Iterator[ConfigError]:
    """Yield an error if the result folder is not allowed."""
    if config.output.directory and (problem := directory_problem(config.output.directory)):
        yield ConfigError("output.directory", problem, "choose any other folder with --output")


def directory_problem(directory: str) -> str:
    """Return a message if a result folder named in a file is not allowed, otherwise "".

    The folder must be below the working directory, because scene and study files may be untrusted.
    The command line may name any other folder.
    """
    if problem := path_problem(directory, "the working directory"):
        return problem
    try:
        working_directory = os.path.realpath(".")
        paths = [working_directory, os.path.realpath(directory)]
        leads_out = os.path.commonpath(paths) != working_directory
    except OSError:
        # If the working directory was deleted, the check passes; writing a result will fail.
        return ""
    except ValueError:
        leads_out = True  # The path leads to another drive of Windows.
    return "leads out of the working directory through a link" if leads_out else ""


def path_problem(path: str, root_name: str) -> str:
    """Return a message if a path is not below the folder `root_name`, otherwise ""."""
    parts = path.split("/")
    if path.startswith("/") or ".." in parts:
        return f"must be below {root_name}, not absolute and without .."
    if any(part.startswith((".", "~")) and part != "." for part in parts):
        return "must not begin with . or ~, nor may any folder in it"
    if printable(path) != path or "\\" in path:
        return "contains a character that is not allowed in the name of a folder"
    # Largest length of a name of a folder [bytes]. File systems allow 255; the program
    # appends suffixes to the names of temporary folders.
    max_name_bytes = 200
    # Largest length of a path [characters].
    max_path_length = 1000
    if (
        any(len(os.fsencode(part)) > max_name_bytes for part in parts)
        or len(path) > max_path_length
    ):
        return "is too long"
    return ""
