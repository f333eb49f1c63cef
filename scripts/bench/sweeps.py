"""Studies of configs/studies/accuracy: their execution, pictures and tables."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from typing import Any

from markdown import number, percent, size, table
from processes import ROOT

from indent_sim import studies
from indent_sim.results.reader import read
from indent_sim.studies.finished_study import Study

STUDIES = ROOT / "configs" / "studies" / "accuracy"
RESULTS = ROOT / "results" / "studies" / "accuracy"
IMAGES = ROOT / "docs" / "images"

Row = dict[str, Any]


def execute(name: str, resume: bool) -> Study:
    """Execute a study by its name."""
    return studies.execute_study(
        STUDIES / f"{name}.yaml", output=RESULTS / name, resume=resume, tell=print
    )


def section(study: Study, keys: Sequence[str], error: str) -> str:
    """Return table, picture and recommendations of a study that varies the mesh.

    The picture is copied to docs/images.

    Parameters
    ----------
    study
        The study.
    keys
        The other varied keys; each combination of their values has a line in the table.
    error
        Column of the error.
    """
    image = IMAGES / f"accuracy-{study.directory.name.replace('_', '-')}.png"
    shutil.copy(study.directory / "study.png", image)
    recommendations = "".join(f"* {text}\n" for text in study.recommendations)
    picture = f"![{study.title}](images/{image.name})"
    return f"{mesh_table(study.rows, keys, error)}\n{picture}\n\n{recommendations}"


def mesh_table(rows: Sequence[Row], keys: Sequence[str], error: str) -> str:
    """Return a table with a line for each combination of keys and a column for each mesh."""
    sizes = sorted({row["mesh.h_contact"] for row in rows}, reverse=True)
    head = [
        *(key.split(".")[-1] for key in keys),
        *(f"h = {h:g}" for h in sizes),
        "dofs, finest",
        "MB, finest",
    ]
    rows_by_values: dict[tuple[Any, ...], dict[float, Row]] = {}
    for row in rows:
        values = tuple(row[key] for key in keys)
        rows_by_values.setdefault(values, {})[row["mesh.h_contact"]] = row
    lines = []
    for values, rows_by_size in rows_by_values.items():
        cells = [run_cell(rows_by_size[h], error) if h in rows_by_size else "" for h in sizes]
        finest = rows_by_size[min(rows_by_size)]
        lines.append([*map(str, values), *cells, str(finest["dofs"]), number(finest["memory_MB"])])
    return table(head, lines)


def run_cell(row: Row, error: str) -> str:
    """Return error and CPU seconds of a run."""
    if row["status"] != "done":
        return "failed"
    return f"{size(row[error])}, {number(row['cpu_s'], 2)} s"


def accuracy_table(study: Study) -> str:
    """Return the table of requested accuracies, error bars and errors."""
    lines = []
    for row in study.rows:
        results = read(study.directory / "runs" / row["run"])
        bar = (results["force_error"] / results["force"]).max()
        worst = row["force_error_worst"]
        if worst is None:
            worst = row["force_error_vs"]
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
    return table(["requested accuracy", "largest error bar", "error", "dofs", "CPU s", "MB"], lines)


def reductions_table(rows: Sequence[Row]) -> str:
    """Return the table of one scene with different symmetries and solvers."""
    cheapest = min(row["cpu_s"] for row in rows)
    head = [
        "model domain",
        "solver",
        "dofs",
        "error of the last step",
        "iterations",
        "CPU s",
        "CPU s / smallest",
        "MB",
    ]
    lines = [
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
    ]
    return table(head, lines)


def growth_table(rows: Sequence[Row]) -> str:
    """Return the table of cost against unknowns.

    Its last columns are ratios of the last mesh of each symmetry and solver to the first.
    """
    rows_by_kind: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        rows_by_kind.setdefault((row["mesh.symmetry"], row["solver.method"]), []).append(row)
    lines = []
    for kind, kind_rows in rows_by_kind.items():
        costs = "; ".join(
            f"{row['dofs']}: {number(row['cpu_s'], 2)} s, {number(row['memory_MB'])} MB"
            for row in kind_rows
        )
        first = kind_rows[0]
        last = kind_rows[-1]
        ratios = [last[name] / first[name] for name in ("dofs", "cpu_s", "memory_MB")]
        lines.append([*kind, costs, *(f"x {number(ratio, 2)}" for ratio in ratios)])
    ratio_heads = [f"ratio of {quantity}" for quantity in ("dofs", "CPU s", "MB")]
    return table(["model domain", "solver", "dofs: CPU s, MB", *ratio_heads], lines)
