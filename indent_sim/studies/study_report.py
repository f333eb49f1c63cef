"""HTML report of a study with table, pictures and comparison with a reference."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from indent_sim.process.errors import UsageError
from indent_sim.results.atomic_files import read_regular_file
from indent_sim.results.html_report import Picture, render_page, thinned_table
from indent_sim.results.pictures import figures
from indent_sim.results.result_files import RUNS, STUDY, Report, read_report
from indent_sim.studies import curve_table, many_runs_picture, study_picture, study_table
from indent_sim.studies.many_runs import is_row_study, read_many_runs
from indent_sim.studies.reference import scoreboard
from indent_sim.studies.study_folder import SCOREBOARD, STUDY_TABLE
from indent_sim.studies.study_table import Row


def study_page(folder: Path) -> str:
    """Return the HTML page of a study's folder; raise UsageError without a readable study."""
    if is_row_study(folder):
        return _row_study_page(folder)
    record, rows = read_study_folder(folder)
    title = str(record.get("title") or folder.resolve().name)
    names = [
        name
        for name in (rows[0] if rows else {})
        if not name.startswith(("cpu_", "peak_", "memory_", "wall_s"))
    ]
    shown_columns = [
        name for name in names if name != "warnings" and any(row[name] is not None for row in rows)
    ]
    done_count = sum(row["status"] == "done" for row in rows)
    warnings = {line for row in rows for line in (row.get("warnings") or "").split(" | ") if line}
    is_compared = any(row["force_error_vs"] is not None for row in rows)
    reference_text = f"; forces compared with {record.get('compare_to')}" if is_compared else ""
    keys_text = ", ".join(record["keys"])
    subtitle = f"Study of {keys_text}: {done_count} of {len(rows)} runs done{reference_text}"
    tables = [
        thinned_table(
            "Runs", shown_columns, [[row[name] for name in shown_columns] for row in rows]
        )
    ]
    board_rows = _read_scoreboard(folder)
    # The scenes of a study with published values have nothing in common, so that their curves have
    # no common axes.
    curve_groups = curve_table.group_folder_curves(
        folder / RUNS, [] if board_rows else rows, record["keys"]
    )
    pictures = _pictures(curve_groups, record, rows, title)
    if board_rows:
        board_columns = (
            "case",
            "quantity",
            "published",
            "exact",
            "ours",
            "our_error",
            "difference",
            "source",
        )
        scoreboard_rows = [
            [row[name] for name in board_columns] + [scoreboard.verdict_text(row)]
            for row in board_rows
        ]
        tables.insert(
            0,
            thinned_table("Published values", [*board_columns, "wrong value"], scoreboard_rows),
        )
        caption = "Differences of published and computed values from the exact values"
        pictures.insert(
            0,
            Picture(
                figures.svg_element(partial(study_picture.draw_scoreboard, board_rows, title)),
                caption,
                broad=True,
            ),
        )
    page_parts = {"pictures": pictures, "warnings": sorted(warnings), "tables": tables}
    failure = "" if done_count else "no run has a result"
    return render_page(title=title, subtitle=subtitle, failure=failure, **page_parts)


def _row_study_page(folder: Path) -> str:
    """Return the HTML page of a study without result folders: pictures and some rows."""
    record = read_report(folder, STUDY)
    runs = read_many_runs(folder)
    draw = many_runs_picture
    drawn: list[tuple[Callable[[Path], object], str]] = []
    if draw.has_curves(runs):
        caption = "Force over depth: median, and bands of the runs"
        drawn.append((partial(draw.draw_bands, runs), caption))
    if len(runs.varying_keys) > 1:
        caption = "Runs as dots over pairs of keys, coloured by the force"
        drawn.append((partial(draw.draw_samples, runs), caption))
        caption = "Force over the two most influential keys, in panels for two other keys"
        drawn.append((partial(draw.draw_maps, runs), caption))
    if sobol := record.get("sobol"):
        draw_indices = partial(draw.draw_sobol_indices, sobol, runs.column, runs.title)
        drawn.append((draw_indices, "Sobol indices of the force over the ranges of the study"))
    pictures = [
        Picture(figures.svg_element(function), caption, broad=True) for function, caption in drawn
    ]
    hidden = ("cpu_", "peak_", "memory_", "wall_s")
    names = [
        name
        for name in runs.rows[0]
        if not name.startswith(hidden)
        and name != "warnings"
        and any(row[name] for row in runs.rows)
    ]
    cells = [[row[name] for name in names] for row in runs.rows]
    statuses = ", ".join(f"{count} {status}" for status, count in runs.statuses.items())
    left_out = record["counts"].get("left_out", 0)
    left_out_text = f"; {left_out} points left out by where" if left_out else ""
    subtitle = f"Study of {', '.join(record['keys'])}: {statuses}{left_out_text}"
    return render_page(
        title=runs.title,
        subtitle=subtitle,
        failure="",
        pictures=pictures,
        warnings=sorted(runs.warnings),
        tables=[thinned_table("Some of the runs", names, cells)],
    )


def read_study_folder(folder: Path) -> tuple[Report, list[Row]]:
    """Return study.json and the rows of study.csv; raise UsageError if one is not readable."""
    try:
        record = read_report(folder, STUDY)
        table_rows = list(
            csv.DictReader(
                io.StringIO(read_regular_file(folder / STUDY_TABLE).decode("utf-8")), restval=""
            )
        )
        if not record or any(None in row for row in table_rows):
            raise ValueError("its files were not written by this program")
        keys = record.get("keys")
        required_columns = ("index", "run", "status", "method", "force_error_vs", "cpu_s")
        if not isinstance(keys, list) or not all(
            name in row for row in table_rows for name in (*required_columns, *keys)
        ):
            raise ValueError("its table lacks columns of varied keys or of results")
        rows = [
            {name: _parse_cell(name, text, keys) for name, text in row.items()}
            for row in table_rows
        ]
    except (OSError, ValueError, RecursionError) as error:
        raise UsageError(f"{folder} has no readable study: {error}") from None
    return record, rows


def _read_scoreboard(folder: Path) -> list[Row]:
    """Return the rows of verification.csv; an empty list if there is no such file.

    Raises UsageError if the file is damaged.
    """
    path = folder / SCOREBOARD
    if not path.exists():
        return []
    try:
        return scoreboard.read(read_regular_file(path).decode("utf-8"))
    except (OSError, ValueError, KeyError) as error:
        raise UsageError(f"{path} is not a readable scoreboard: {error}", file=str(path)) from None


def _parse_cell(name: str, text: str, keys: Sequence[str]) -> str | float | None:
    """Return a cell of study.csv as None, text or number; raise ValueError if invalid."""
    number_columns = ("force_error_vs", "cpu_s")
    if not text or name not in (*number_columns, *keys):
        return text or None
    try:
        return float(text)
    except ValueError:
        if name in number_columns:
            raise
        return text


def _pictures(
    curve_groups: curve_table.CurveGroups, record: Report, rows: Sequence[Row], title: str
) -> list[Picture]:
    """Return the pictures of the curves, and of error over cost if forces are compared."""
    pictures = []
    if curve_groups.curves:
        caption = (
            "Force over depth, and the last force (largest force of a time history) over each "
            "varied number"
        )
        pictures.append(
            Picture(
                figures.svg_element(partial(study_picture.draw_curves, curve_groups, title)),
                caption,
                broad=True,
            )
        )
    if study_table.rows_with_error(rows):
        draw_cost = partial(
            study_picture.draw_cost, rows, record["keys"], title, str(record.get("compare_to"))
        )
        pictures.append(
            Picture(figures.svg_element(draw_cost), "Force error over CPU time", broad=True)
        )
    return pictures
