"""Checksum of the settings of a run, by which its row is found without resolving its scene."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path
from typing import Any

from indent_sim.process.version import VERSION
from indent_sim.studies.study_file import RunRequest, StudyFile


class SettingsChecksum:
    """Checksum of the scene's document and of the settings that change it.

    Equal settings give equal physics; different settings may give equal physics, too. Titles and
    outputs do not affect it. A file that the scene names counts with its size and the time of its
    last change.
    """

    def __init__(self, study: StudyFile):
        document = {
            key: value for key, value in study.base.items() if key not in ("title", "output")
        }
        settings = [
            (key, value) for key, value, _ in study.common_settings if not key.startswith("output.")
        ]
        self._folder = Path(study.source.name).parent
        self._prefix = hashlib.sha256(_text([VERSION, document, settings]).encode())
        body = document.get("body")
        base_file = body.get("file") if isinstance(body, dict) else None
        self._base_file = self._file_state(base_file)

    def __call__(self, request: RunRequest) -> int:
        """Return the checksum of a requested run, a number of 64 bits."""
        checksum = self._prefix.copy()
        files = [self._file_state(_body_file(key, value)) for key, value, _ in request.point]
        values = [(key, value) for key, value, _ in request.point]
        known_files = [state for state in (self._base_file, *files) if state]
        checksum.update(_text([values, known_files]).encode())
        return int.from_bytes(checksum.digest()[:8], "little")

    def _file_state(self, name: Any) -> list[int]:
        """Return size and time of the last change of a file; an empty list if it does not exist."""
        if not isinstance(name, str):
            return []
        try:
            state = os.stat(self._folder / name)
        except (OSError, ValueError):
            return []
        return [state.st_size, state.st_mtime_ns]


def _body_file(key: str, value: Any) -> Any:
    """Return the name of the mesh file in a setting; None if the setting names no mesh file."""
    if key == "body" and isinstance(value, dict):
        return value.get("file")
    return value if key == "body.file" else None


def _text(value: Any) -> str:
    """Return a value as text that is different for different values."""
    return json.dumps(value, default=repr)
