"""Report of a study: its table, its pictures and what it compares, as the page of a result."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from indent_sim.process.errors import UsageError
from indent_sim.results.folder import RUNS, Report, read_regular_file, read_report
from indent_sim.results.html_report import Picture, render_page, thinned_table
from indent_sim.results.pictures import figures
from indent_sim.studies import curve_table, picture, study_table
from indent_sim.studies.reference import scoreboard
from indent_sim.studies.study_folder import RECORD, SCOREBOARD, STUDY_TABLE
from indent_sim.studies.study_table import Row

NEEDED_COLUMNS = ("index", "run", "status", "method", "force_error_vs", "cpu_s")
BOARD = ("case", "quantity", "published", "exact", "ours", "our_error", "difference", "source")
NUMBER_COLUMNS = ("force_error_vs", "cpu_s")


def of_study(folder: Path) -> str:
    """The page of a study's folder; UsageError when it holds none that can be read."""
    record, rows = read_study(folder)
    title = str(record.get("title") or folder.resolve().name)
    names = [
        name
        for name in (rows[0] if rows else {})
        if not name.startswith(("cpu_", "peak_", "memory_", "wall_s"))
    ]
    shown = [
        name for name in names if name != "warnings" and any(row[name] is not None for row in rows)
    ]
    ended = sum(row["status"] == "done" for row in rows)
    warned = {line for row in rows for line in (row.get("warnings") or "").split(" | ") if line}
    compared = any(row["force_error_vs"] is not None for row in rows)
    against = f"; forces compared with {record.get('compare_to')}" if compared else ""
    subtitle = f"Study of {', '.join(record['keys'])}: {ended} of {len(rows)} runs done{against}"
    tables = [thinned_table("Runs", shown, [[row[name] for name in shown] for row in rows])]
    board = _scoreboard(folder)
    families = curve_table.of_runs(
        folder / RUNS, [] if board else rows, record["keys"]
    )  # as in the study's folder
    pictures = _pictures(families, record, rows, title)
    if board:
        said = [[row[name] for name in BOARD] + [scoreboard.in_words(row)] for row in board]
        tables.insert(0, thinned_table("Published values", [*BOARD, "who is wrong"], said))
        words = "Published values and ours, as they differ from the exact ones"
        pictures.insert(
            0,
            Picture(
                figures.svg_element(partial(picture.draw_scoreboard, board, title)),
                words,
                broad=True,
            ),
        )
    seen = {"pictures": pictures, "warnings": sorted(warned), "tables": tables}
    failure = "" if ended else "no run gave a result"
    return render_page(title=title, subtitle=subtitle, failure=failure, **seen)


def read_study(folder: Path) -> tuple[Report, list[Row]]:
    """study.json and the rows of study.csv; UsageError when they are missing or damaged."""
    try:
        record = read_report(folder, RECORD)
        found = list(
            csv.DictReader(
                io.StringIO(read_regular_file(folder / STUDY_TABLE).decode("utf-8")), restval=""
            )
        )
        if not record or any(None in row for row in found):
            raise ValueError("not what this program writes")
        keys = record.get("keys")
        if not isinstance(keys, list) or not all(
            name in row for row in found for name in (*NEEDED_COLUMNS, *keys)
        ):
            raise ValueError("it lacks what a study has")
        rows = [{name: _value(name, text, keys) for name, text in row.items()} for row in found]
    except (OSError, ValueError, RecursionError) as error:
        raise UsageError(f"{folder} holds no study that can be read: {error}") from None
    return record, rows


def _scoreboard(folder: Path) -> list[Row]:
    """The rows of verification.csv; none where there is no such file, UsageError where it is
    damaged.
    """
    path = folder / SCOREBOARD
    if not path.exists():
        return []
    try:
        return scoreboard.read(read_regular_file(path).decode("utf-8"))
    except (OSError, ValueError, KeyError) as error:
        raise UsageError(
            f"{path} is no scoreboard that can be read: {error}", file=str(path)
        ) from None


def _value(name: str, text: str, keys: Sequence[str]) -> str | float | None:
    """A cell of study.csv as it was written: None, a word, or a number; ValueError where it must be
    one.
    """
    if not text or name not in (*NUMBER_COLUMNS, *keys):
        return text or None
    try:
        return float(text)
    except ValueError:
        if name in NUMBER_COLUMNS:
            raise
        return text


def _pictures(
    families: curve_table.Families, record: Report, rows: Sequence[Row], title: str
) -> list[Picture]:
    """The curves of all runs that are there, and what accuracy costs where forces are compared."""
    found = []
    if families.curves:
        words = (
            "Force over depth, and the last force, of histories the largest, over each "
            "varied number"
        )
        found.append(
            Picture(
                figures.svg_element(partial(picture.draw_curves, families, title)),
                words,
                broad=True,
            )
        )
    if study_table.measured(rows):
        cost = partial(picture.draw, rows, record["keys"], title, str(record.get("compare_to")))
        found.append(Picture(figures.svg_element(cost), "What accuracy costs", broad=True))
    return found
