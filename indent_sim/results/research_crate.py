"""RO-Crate: metadata of a result, a study or a fit for archives of research data."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from indent_sim.process.errors import UsageError
from indent_sim.process.limits import write_error
from indent_sim.process.version import VERSION
from indent_sim.results.atomic_files import write_atomically
from indent_sim.results.json_text import to_json
from indent_sim.results.result_files import (
    CONFIG,
    CRATE,
    CRATE_SIGNATURE,
    FIT,
    PROGRAM,
    STUDY,
    is_own_file,
    read_report,
)

CrateEntity = dict[str, Any]  # JSON-LD object of a file, folder, program or action.
MEDIA_TYPES = {
    ".csv": "text/csv",
    ".json": "application/json",
    ".yaml": "application/yaml",
    ".png": "image/png",
    ".html": "text/html",
    ".xdmf": "application/xml",
    ".h5": "application/x-hdf5",
    ".msh": "model/mesh",
    ".tif": "image/tiff",
}


def refuse_foreign_crate(folder: Path) -> None:
    """Raise UsageError if the folder has metadata that this program did not write."""
    if os.path.lexists(folder / CRATE) and not is_own_file(folder / CRATE):
        raise UsageError(f"{folder / CRATE} was not made by {PROGRAM}", "move it to another folder")


def write_crate(folder: Path, parts: Sequence[str]) -> None:
    """Write RO-Crate 1.1 metadata of a result, a study or a fit as JSON-LD.

    Parameters
    ----------
    folder
        The folder.
    parts
        Names of files and folders of this program in the folder; existing ones are listed.

    Raises
    ------
    UsageError
        If the folder has metadata that this program did not write, or cannot be written.

    References
    ----------
    https://www.researchobject.org/ro-crate/specification/1.1
    """
    refuse_foreign_crate(folder)
    report = read_report(folder) or read_report(folder, STUDY) or read_report(folder, FIT)
    existing = [name for name in sorted(parts) if (folder / name).exists() and name != CRATE]
    part_entities = [_crate_entity(folder / name) for name in existing]
    program = {
        "@id": "#program",
        "@type": "SoftwareApplication",
        "name": PROGRAM,
        "version": report.get("version", VERSION),
    }
    action: CrateEntity = {
        "@id": "#run",
        "@type": "CreateAction",
        "name": "simulation",
        "instrument": {"@id": "#program"},
    }
    action |= {"result": [{"@id": part["@id"]} for part in part_entities if part["@id"] != CONFIG]}
    action |= {"object": [{"@id": CONFIG}]} if CONFIG in existing else {}
    times = {"startTime": report.get("started"), "endTime": report.get("finished")}
    action |= {name: value for name, value in times.items() if value}
    root: CrateEntity = {
        "@id": "./",
        "@type": "Dataset",
        "name": str(report.get("title") or folder.resolve().name),
    }
    root |= {
        "description": f"Simulated indentation by {PROGRAM}",
        "hasPart": [{"@id": part["@id"]} for part in part_entities],
    }
    root |= {"datePublished": report["finished"]} if report.get("finished") else {}
    profile = "https://w3id.org/ro/crate/1.1"
    descriptor: CrateEntity = {
        "@id": CRATE,
        "@type": "CreativeWork",
        "name": CRATE_SIGNATURE,
        "about": {"@id": "./"},
        "conformsTo": {"@id": profile},
    }
    graph = [descriptor, root | {"mentions": {"@id": "#run"}}, *part_entities, action, program]
    try:
        write_atomically(
            folder / CRATE,
            to_json({"@context": f"{profile}/context", "@graph": graph}) + "\n",
        )
    except OSError as error:
        raise write_error(folder / CRATE, error) from error


def _crate_entity(path: Path) -> CrateEntity:
    """Return the JSON-LD entity of a file or a folder."""
    if path.is_dir():
        return {"@id": f"{path.name}/", "@type": "Dataset", "name": path.name}
    kind = MEDIA_TYPES.get(path.suffix, "application/octet-stream")
    size = str(path.stat().st_size)
    return {
        "@id": path.name,
        "@type": "File",
        "name": path.name,
        "encodingFormat": kind,
        "contentSize": size,
    }
