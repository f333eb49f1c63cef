"""Comparison with other programs on the same problems: a table for each problem, and a picture."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmark_forces import CUBE, CYLINDER_STEPS
from markdown import number, percent, size, table
from processes import Measured, measure
from sweeps import IMAGES

from indent_sim.results.pictures import figures

PEERS = Path(__file__).with_name("peers.csv")
PICTURE = IMAGES / "accuracy-programs.png"
OWN_NAME = "indent-sim"
RUBBER = (
    "body.radius=2",
    "body.sides=roller",
    "indenter={shape: sphere, R: 1.0}",
    "loading={delta: 0.3, steps: 10}",
)
# Forces of the last step by Poisson's ratio, from converged computations with independent programs,
# to 1e-6.
RUBBER_FORCES = {"0.3": 0.455870, "0.49": 0.619888}
TITLES = {
    "axi": "HERTZ, axisymmetric",
    "cube": "HERTZ, three-dimensional",
    "rubber 0.3": "Sphere on neo-Hookean rubber, nu = 0.3",
    "rubber 0.49": "Sphere on neo-Hookean rubber, nu = 0.49",
}
NUMBER_COLUMNS = ("h", "error_last", "error_worst", "cpu_s", "memory_MB")

Row = dict[str, Any]


# ---- rows ------------------------------------------------------------------------------------


def own_rows(repeat: int) -> list[Row]:
    """Measure this program; return rows like those of `peers`."""
    rows = []
    for h in (0.04, 0.02, 0.01, 0.005, 0.0025):
        done = measure("configs/hertz.yaml", f"mesh.h_contact={h}", repeat=repeat)
        errors = [
            force / exact - 1 for force, exact in zip(done.force, CYLINDER_STEPS, strict=True)
        ]
        rows.append(own_row("axi", h, done, errors[-1], max(map(abs, errors))))
    for h in (0.04, 0.03, 0.02, 0.016, 0.0125):
        done = measure("configs/hertz_cube.yaml", f"mesh.h_contact={h}", repeat=repeat)
        rows.append(own_row("cube", h, done, done.force[-1] / CUBE - 1))
    for nu, exact in RUBBER_FORCES.items():
        material = f"material={{model: neo_hookean, E: 1.0, nu: {nu}}}"
        for h in (0.08, 0.04, 0.02):
            settings = (*RUBBER, material, f"mesh.h_contact={h}")
            done = measure("configs/hertz.yaml", *settings, repeat=repeat)
            rows.append(own_row(f"rubber {nu}", h, done, done.force[-1] / exact - 1))
    return rows


def own_row(
    case: str, h: float, done: Measured, error_last: float, error_worst: float | None = None
) -> Row:
    """Return a row of this program.

    Parameters
    ----------
    case
        One of TITLES.
    h
        Element size.
    done
        The measurement.
    error_last, error_worst
        Relative error of the force at the last step, and the largest one at any step if known.
    """
    report = done.report
    return {
        "case": case,
        "program": OWN_NAME,
        "method": report["method"].replace("_", " "),
        "element": "P2",
        "h": h,
        "error_last": error_last,
        "error_worst": error_worst,
        "cpu_s": done.cpu,
        "memory_MB": done.memory,
        "dofs": report["dofs"],
        "iterations": report["audit"]["newton_iterations"],
        "gap": report["gap"],
        "stages": report["cpu_timings"],
    }


def peers() -> list[Row]:
    """Return the rows of peers.csv."""
    with open(PEERS, newline="", encoding="utf-8") as file:
        rows: list[Row] = list(csv.DictReader(line for line in file if not line.startswith("#")))
    for row in rows:
        for name in NUMBER_COLUMNS:
            row[name] = float(row[name]) if row[name] else None
    return rows


# ---- tables ----------------------------------------------------------------------------------


def tables(rows: Sequence[Row]) -> str:
    """Return a table for each problem, with the fastest run first."""
    head = [
        "program",
        "contact",
        "element",
        "h",
        "dofs",
        "error of the last step",
        "worst error of ten steps",
        "iterations",
        "CPU s",
        "MB",
        "gap",
    ]
    parts = []
    for case, title in TITLES.items():
        case_rows = [row for row in rows if row["case"] == case]
        case_rows.sort(key=lambda row: row["cpu_s"])
        parts.append(f"### {title}\n\n{table(head, [row_cells(row) for row in case_rows])}")
    return "\n".join(parts)


def row_cells(row: Row) -> list[str]:
    """Return the cells of a row; the name of this program is bold."""
    return [
        f"**{OWN_NAME}**" if row["program"] == OWN_NAME else row["program"],
        row["method"],
        row["element"],
        number(row["h"]),
        str(row["dofs"]),
        percent(row["error_last"]),
        size(row["error_worst"]),
        str(row["iterations"]),
        number(row["cpu_s"]),
        number(row["memory_MB"]),
        row["gap"],
    ]


def stages_table(rows: Sequence[Row]) -> str:
    """Return the table of the CPU seconds of this program by stage."""
    own = [row for row in rows if row["program"] == OWN_NAME]
    stages = list(dict.fromkeys(stage for row in own for stage in row["stages"]))
    lines = []
    for row in own:
        cells = [number(row["stages"].get(stage), 2) for stage in stages]
        lines.append([TITLES[row["case"]], f"{row['h']:g}", *cells])
    return table(["problem", "h", *stages], lines)


# ---- picture ---------------------------------------------------------------------------------


def draw(rows: Sequence[Row]) -> None:
    """Draw the error against the CPU seconds of the process, with a panel for each problem."""
    programs = list(dict.fromkeys([OWN_NAME, *(row["program"] for row in rows)]))
    subtitle = (
        "first panel: largest error of ten steps, hollow where only the last is known; "
        "others: last step"
    )
    with figures.new_figure((12.4, 7.6)) as figure:
        figures.draw_title(
            figure, "Error of the force against the time of the whole process", subtitle
        )
        panels = figure.subplots(2, 2).ravel()
        for panel, (case, title) in zip(panels, TITLES.items(), strict=True):
            case_rows = [row for row in rows if row["case"] == case]
            draw_case(panel, case_rows, programs)
            format_panel(panel, title)
        handles, labels = legend_entries(programs)
        # The legend is below the panels.
        figure.get_layout_engine().set(rect=(0, 0.09, 1, 0.82))
        figure.legend(handles, labels, loc="lower center", ncol=5, fontsize=9)
        figures.save(figure, PICTURE)


def draw_case(panel: Any, rows: Sequence[Row], programs: Sequence[str]) -> None:
    """Draw the points of a problem, a line through those of this program, and the Pareto front."""
    for row in rows:
        draw_point(panel, row, programs.index(row["program"]))
    own = sorted((row for row in rows if row["program"] == OWN_NAME), key=lambda row: row["h"])
    panel.plot(
        [row["cpu_s"] for row in own],
        [known_error(row) for row in own],
        color=figures.INK,
        lw=1.2,
        zorder=2,
    )
    draw_front(panel, rows)


def known_error(row: Row) -> float:
    """Return the largest error of any step if known, else that of the last step."""
    return abs(row["error_last"] if row["error_worst"] is None else row["error_worst"])


def point_style(i: int) -> dict[str, Any]:
    """Return the style of the points of the i-th program, of which the first is this one."""
    colours = (figures.INK, *figures.COLOURS[:6], figures.GREY, figures.INK)
    markers = ("*", *figures.MARKERS, "<", ">")
    return {"color": colours[i % len(colours)], "marker": markers[i % 10], "ls": ""}


def draw_point(panel: Any, row: Row, i: int) -> None:
    """Draw a row of the i-th program, hollow if it is not comparable."""
    style = point_style(i)
    if not is_comparable(row):
        style["mfc"] = "none"
    is_own = i == 0
    panel.plot(
        row["cpu_s"],
        known_error(row),
        ms=11 if is_own else 7,
        zorder=4 if is_own else 3,
        **style,
    )


def is_comparable(row: Row) -> bool:
    """Return whether the known error of a row is the same quantity as that of the other rows."""
    return row["error_worst"] is not None or row["case"] != "axi"


def draw_front(panel: Any, rows: Sequence[Row]) -> None:
    """Draw the Pareto front: the rows that no other row beats in both error and time."""
    front: list[Row] = []
    for row in sorted(filter(is_comparable, rows), key=lambda row: row["cpu_s"]):
        if not front or known_error(row) < known_error(front[-1]):
            front.append(row)
    panel.step(
        [row["cpu_s"] for row in front],
        [known_error(row) for row in front],
        where="post",
        color=figures.GREY,
        lw=1.2,
        ls=":",
        zorder=1,
    )


def format_panel(panel: Any, title: str) -> None:
    """Give a panel logarithmic axes with labels, a title and a light grid."""
    from matplotlib.ticker import LogLocator

    panel.set(
        xscale="log",
        yscale="log",
        xlabel="CPU seconds of the process",
        ylabel="|relative error of the force|",
    )
    panel.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    panel.xaxis.set_major_formatter("{x:g}")
    panel.xaxis.set_minor_formatter("")
    panel.set_title(title, loc="left")
    panel.grid(True, which="major", color="#e4e4e4", lw=0.6, zorder=0)
    panel.margins(0.1)


def legend_entries(programs: Sequence[str]) -> tuple[list[Any], list[str]]:
    """Return handles and labels of the programs and of the Pareto front."""
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], ms=8, **point_style(i)) for i in range(len(programs))]
    handles.append(Line2D([], [], color=figures.GREY, lw=1.0, ls=":"))
    return handles, [*programs, "Pareto front"]
