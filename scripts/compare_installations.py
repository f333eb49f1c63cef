"""Runs every config with this installation, or compares the forces of two installations.

usage: PYTHON scripts/compare_installations.py run FOLDER [NAME...]
       PYTHON scripts/compare_installations.py compare REFERENCE FOLDER

`run` writes a result folder for each config of configs/, or for those named. `compare` prints, for
each of them, the largest difference of the forces relative to the largest force. It must be at most
1e-9 where both have the same mesh or none. Versions of gmsh mesh differently; there it must be at
most 3e-4, a tenth of the error for which element sizes are chosen. Depths are compared where forces
are prescribed. The exit code is 1 if a run failed or a difference is larger.
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

ROOT = Path(__file__).resolve().parents[1]
# A process that is alone must not yield its core: on a busy machine it would hardly get it back.
SINGLE_PROCESS = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "OMPI_MCA_mpi_yield_when_idle": "0",
}
SAME_MESH = 1e-9
OTHER_MESH = 3e-4


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
        meshes = mesh_hash(expected), mesh_hash(found)
        difference = largest_difference(expected, found)
        limit = SAME_MESH if meshes[0] == meshes[1] else OTHER_MESH
        is_good = is_good and difference <= limit
        kind = "none" if not meshes[0] else "the same" if limit == SAME_MESH else "another"
        verdict = "" if difference <= limit else f", more than {limit:g}"
        print(f"| {expected.name} | {kind} | {difference:.1e}{verdict} |")
    return is_good


def mesh_hash(folder: Path) -> str:
    """Return the hash of the mesh of a result; empty if theory has solved the scene."""
    report = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    return str((report.get("mesh") or {}).get("hash", ""))


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
