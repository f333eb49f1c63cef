"""Runs every config with this installation, or compares the forces of two installations.

usage: PYTHON scripts/compare_installations.py run FOLDER [NAME...]
       PYTHON scripts/compare_installations.py compare REFERENCE FOLDER

`run` writes a result folder for each config of configs/, or for those named. `compare` prints, for
each of them, the largest difference of forces and depths relative to the largest of each. It must
be at most 1e-9 where both have the same mesh or none, 1e-4 where meshes have as many cells, whose
points differ by the version of gmsh, and 3e-3, the error for which element sizes are
chosen, where they have not. The exit code is 1 if a run failed or a difference is larger.
"""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
import time
from math import isfinite
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
# A process that is alone must not yield its core: on a busy machine it would hardly get it back.
SINGLE_PROCESS = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "OMPI_MCA_mpi_yield_when_idle": "0",
}
# Largest difference by how meshes differ.
LIMITS = {"none": 1e-9, "the same": 1e-9, "as many cells": 1e-4, "another": 3e-3}


def main() -> None:
    """Run the configs or compare two folders of results."""
    match sys.argv[1:]:
        case ["run", folder, *names]:
            is_good = run_configs(Path(folder), names)
        case ["compare", reference, folder]:
            is_good = compare(Path(reference), Path(folder))
        case _:
            sys.exit(__doc__)
    sys.exit(0 if is_good else 1)


def run_configs(folder: Path, names: list[str]) -> bool:
    """Run configs one after the other, and return whether all of them ended well."""
    folder = folder.resolve()
    configs = sorted((ROOT / "configs").glob("*.yaml"))
    failed = []
    for config in configs:
        if names and config.stem not in names:
            continue
        command = [sys.executable, "-m", "indent_sim.cli.start", "run", str(config), "--quiet"]
        options = ["--set", "output.plot=false", "--overwrite"]
        start = time.monotonic()
        done = subprocess.run(
            [*command, "--output", str(folder / config.stem), *options],
            cwd=ROOT,
            env=os.environ | SINGLE_PROCESS,
            capture_output=True,
            text=True,
        )
        print(f"{config.stem}: {time.monotonic() - start:.1f} s", flush=True)
        if done.returncode:
            failed.append(config.stem)
            print(f"exit code {done.returncode}: {done.stderr.strip()}", flush=True)
    return not failed


def compare(reference: Path, folder: Path) -> bool:
    """Print a table of the differences, and return whether all of them are small enough."""
    print("| scene | mesh | largest difference |\n|---|---|---|")
    is_good = True
    for expected in sorted(path for path in reference.iterdir() if path.is_dir()):
        found = folder / expected.name
        kind = difference_of_meshes(mesh_of(expected), mesh_of(found))
        difference = largest_difference(expected, found)
        is_good = is_good and difference <= LIMITS[kind]
        verdict = "" if difference <= LIMITS[kind] else f", more than {LIMITS[kind]:g}"
        print(f"| {expected.name} | {kind} | {difference:.1e}{verdict} |")
    return is_good


def mesh_of(folder: Path) -> dict[str, Any]:
    """Return hash and size of the mesh of a result; empty if theory has solved the scene."""
    report = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    return report.get("mesh") or {}


def difference_of_meshes(first: dict[str, Any], second: dict[str, Any]) -> str:
    """Return the key of LIMITS for two meshes."""
    if not first and not second:
        return "none"
    if first.get("hash") == second.get("hash"):
        return "the same"
    return "as many cells" if first.get("cells") == second.get("cells") else "another"


def largest_difference(expected: Path, found: Path) -> float:
    """Return the largest difference of forces and depths, relative to the largest of each."""
    differences = []
    tables = table(expected), table(found)
    for column in ("delta", "force"):
        values, others = ([float(row[column]) for row in rows] for rows in tables)
        scale = max(map(abs, values)) or 1.0
        differences += [abs(a - b) / scale for a, b in zip(values, others, strict=True)]
    return max(differences) if all(map(isfinite, differences)) else float("inf")


def table(folder: Path) -> list[dict[str, str]]:
    """Return the rows of a force table."""
    with open(folder / "force_indentation.csv", newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


if __name__ == "__main__":
    main()
