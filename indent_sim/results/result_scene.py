"""Scene of a result folder, from its config.yaml."""

from __future__ import annotations

import os
from contextlib import suppress
from functools import lru_cache
from pathlib import Path

from indent_sim.config.scene_file import load_result_config
from indent_sim.config.schema import Config
from indent_sim.model.body import AnyBody
from indent_sim.model.spherical_bodies import CurvedBody
from indent_sim.process.errors import IndentSimError
from indent_sim.results.atomic_files import read_regular_file
from indent_sim.results.result_files import CONFIG


def scene_of(folder: Path) -> Config | None:
    """Return the scene of a result folder, in the user's units; None if it cannot be read."""
    with suppress(OSError):
        file_status = os.stat(folder / CONFIG)
        return _cached_scene(folder / CONFIG, file_status.st_mtime_ns, file_status.st_ino)
    return None


def has_adhesion(folder: Path) -> bool | None:
    """Return whether the contact of a result has adhesion; None if its scene cannot be read."""
    with suppress(OSError):
        # Most scenes do not contain the word, and need not be parsed.
        if b"adhesion" not in read_regular_file(folder / CONFIG):
            return False
    scene = scene_of(folder)
    return getattr(scene.contact, "adhesion", None) is not None if scene else None


@lru_cache(16)  # Every panel of a picture needs the scene.
def _cached_scene(file: Path, modified_ns: int, inode: int) -> Config | None:
    """Read a scene file; results are cached by file, modification time and inode."""
    with suppress(IndentSimError, OSError, ValueError):
        return load_result_config(file)
    return None


def contacts_per_body(body: AnyBody) -> int:
    """Return the number of equal contacts of a body; it is 2 for a ball between two tips."""
    return body.spherical_body.contacts_per_body if isinstance(body, CurvedBody) else 1
