"""Report of a study: its table, its pictures and what it compares, as the page of a result."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from indent_sim.process.errors import UsageError
from indent_sim.results.folder import PROGRAM, content
from indent_sim.results.pictures import canvas
from indent_sim.results.report import Picture, Table, page, short, thinned, told
from indent_sim.study import curves, picture, table
from indent_sim.study.folder import RECORD, RUNS, TABLE
from indent_sim.study.table import Row

OF_CURVES = "Force over depth, and the last force over each varied number"
OF_COST = "What accuracy costs"
NEEDED = ("index", "run", "status", "method", "force_error_vs", "cpu_s")
NUMBERS = ("force_error_vs", "cpu_s")
SILENT = ("cpu_", "peak_", "memory_", "wall_s")  # columns that say nothing of the physics


def of_study(folder: Path) -> str:
    """The page of a study's folder; UsageError when it holds none that can be read."""
    record, rows = _read(folder)
    names = [name for name in (rows[0] if rows else {}) if not name.startswith(SILENT)]
    shown = [name for name in names if name != "warnings" and any(row[name] is not None for row in rows)]
    kept = thinned(rows)
    ended = sum(row["status"] == "done" for row in rows)
    warned = {line for row in rows for line in (row.get("warnings") or "").split(" | ") if line}
    compared = any(row["force_error_vs"] is not None for row in rows)
    against = f"; forces compared with {record.get('compare_to')}" if compared else ""
    return page(
        title=_title(folder, record),
        subtitle=f"Study of {', '.join(record['keys'])}: {ended} of {len(rows)} runs done{against}",
        failure="" if ended else "no run gave a result",
        numbers=[],
        said=[],
        pictures=_pictures(folder, record, rows),
        warnings=sorted(warned),
        tables=[Table("Runs", shown, [[short(row[name]) for name in shown] for row in kept], told(rows, kept), True)],
        scene="",
        chosen="",
    )


def _title(folder: Path, record: dict[str, Any]) -> str:
    return str(record.get("title") or folder.resolve().name)


def _read(folder: Path) -> tuple[dict[str, Any], list[Row]]:
    """study.json and the rows of study.csv; UsageError when they are missing or damaged."""
    try:
        record = json.loads(content(folder / RECORD))
        found = list(csv.DictReader(io.StringIO(content(folder / TABLE).decode("utf-8")), restval=""))
        if not isinstance(record, dict) or record.get("program") != PROGRAM or any(None in row for row in found):
            raise ValueError("not what this program writes")
        keys = record.get("keys")
        if not isinstance(keys, list) or not all(name in row for row in found for name in (*NEEDED, *keys)):
            raise ValueError("it lacks what a study has")
        rows = [{name: _value(name, text, keys) for name, text in row.items()} for row in found]
    except (OSError, ValueError, RecursionError) as error:
        raise UsageError(f"{folder} holds no study that can be read: {error}") from None
    return record, rows


def _value(name: str, text: str, keys: Sequence[str]) -> Any:
    """A cell of study.csv as it was written: None, a word, or a number; ValueError where it must be one."""
    if not text or name not in (*NUMBERS, *keys):
        return text or None
    try:
        return float(text)
    except ValueError:
        if name in NUMBERS:
            raise
        return text


def _pictures(folder: Path, record: dict[str, Any], rows: Sequence[Row]) -> list[Picture]:
    """The curves of all runs that are there, and what accuracy costs where forces are compared."""
    found, title = [], _title(folder, record)
    families = curves.of_runs(folder / RUNS, rows, record["keys"])
    if families.curves:
        found.append(Picture(canvas.element(partial(picture.draw_curves, families, title)), OF_CURVES, broad=True))
    if table.measured(rows):
        cost = partial(picture.draw, rows, record["keys"], title, str(record.get("compare_to")))
        found.append(Picture(canvas.element(cost), OF_COST, broad=True))
    return found
