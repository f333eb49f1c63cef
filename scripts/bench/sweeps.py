"""The studies of configs/studies/accuracy: carried out, their pictures kept, their rows as tables."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from typing import Any

from markdown import number, percent, size, table
from processes import ROOT

from indent_sim import studies
from indent_sim.results.reader import read
from indent_sim.studies.run_study import Study

STUDIES = ROOT / "configs" / "studies" / "accuracy"
RESULTS = ROOT / "results" / "studies" / "accuracy"
IMAGES = ROOT / "docs" / "images"

Row = dict[str, Any]


def carry_out(name: str, resume: bool) -> Study:
    """The study of a name."""
    return studies.execute_study(
        STUDIES / f"{name}.yaml", output=RESULTS / name, resume=resume, tell=print
    )


def section(done: Study, down: Sequence[str], error: str) -> str:
    """Table, picture and advice of a study that varies the mesh; the picture goes to docs/images."""
    image = IMAGES / f"accuracy-{done.directory.name.replace('_', '-')}.png"
    shutil.copy(done.directory / "study.png", image)
    advice = "".join(f"* {line}\n" for line in done.recommendations)
    return f"{matrix(done.rows, down, error)}\n![{done.title}](images/{image.name})\n\n{advice}"


def matrix(rows: Sequence[Row], down: Sequence[str], error: str) -> str:
    """A line for each value of `down`, a column for each mesh: error, CPU seconds; memory of the finest last."""
    meshes = sorted({row["mesh.h_contact"] for row in rows}, reverse=True)
    head = [
        *(key.split(".")[-1] for key in down),
        *(f"h = {h:g}" for h in meshes),
        "dofs, finest",
        "MB, finest",
    ]
    lines = []
    for values in dict.fromkeys(tuple(row[key] for key in down) for row in rows):
        mine = {
            row["mesh.h_contact"]: row for row in rows if tuple(row[key] for key in down) == values
        }
        cells = [cell(mine[h], error) if h in mine else "" for h in meshes]
        finest = mine[min(mine)]
        lines.append([*map(str, values), *cells, str(finest["dofs"]), number(finest["memory_MB"])])
    return table(head, lines)


def cell(row: Row, error: str) -> str:
    """Error and CPU seconds of a run."""
    return (
        f"{size(row[error])}, {number(row['cpu_s'], 2)} s" if row["status"] == "done" else "failed"
    )


def asked(done: Study) -> str:
    """The accuracy asked for, the error bar that was given with the force, and the error there was."""
    lines = []
    for row in done.rows:
        found = read(done.directory / "runs" / row["run"])
        bar = (found["force_error"] / found["force"]).max()
        worst = (
            row["force_error_vs"] if row["force_error_worst"] is None else row["force_error_worst"]
        )
        lines.append(
            [
                size(row["accuracy"]),
                size(bar),
                size(worst),
                str(row["dofs"]),
                number(row["cpu_s"], 2),
                number(row["memory_MB"]),
            ]
        )
    return table(["asked for", "largest error bar", "worst error", "dofs", "CPU s", "MB"], lines)


def reductions(rows: Sequence[Row]) -> str:
    """The same scene as a plane, a quarter, a half and whole, condensed and not."""
    cheapest = min(row["cpu_s"] for row in rows)
    head = [
        "modelled",
        "solver",
        "dofs",
        "error of the last step",
        "iterations",
        "CPU s",
        "times the cheapest",
        "MB",
    ]
    return table(
        head,
        [
            [
                row["mesh.symmetry"],
                row["solver.method"],
                str(row["dofs"]),
                percent(row["force_error_vs"]),
                str(row["newton_iterations"]),
                number(row["cpu_s"], 2),
                number(row["cpu_s"] / cheapest, 2),
                number(row["memory_MB"]),
            ]
            for row in rows
        ],
    )


def growth(rows: Sequence[Row]) -> str:
    """Cost against unknowns, and how much both grow from the first to the last mesh of each kind."""
    lines = []
    for kind in dict.fromkeys((row["mesh.symmetry"], row["solver.method"]) for row in rows):
        mine = [row for row in rows if (row["mesh.symmetry"], row["solver.method"]) == kind]
        ends = mine[0], mine[-1]
        grown = [ends[1][name] / ends[0][name] for name in ("dofs", "cpu_s", "memory_MB")]
        told = "; ".join(
            f"{row['dofs']}: {number(row['cpu_s'], 2)} s, {number(row['memory_MB'])} MB"
            for row in mine
        )
        lines.append([*kind, told, *(f"x {number(value, 2)}" for value in grown)])
    return table(["modelled", "solver", "dofs: CPU s, MB", "dofs", "CPU s", "MB"], lines)
