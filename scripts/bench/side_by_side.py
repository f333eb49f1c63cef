"""This program and others on the same problems: one table a problem, and one picture."""

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
OURS = "indent-sim"
RUBBER = (
    "body.radius=2",
    "body.sides=roller",
    "indenter={shape: sphere, R: 1.0}",
    "loading={delta: 0.3, steps: 10}",
)

# Forces of the last step, by converged computations with independent programs, to 1e-6
RUBBERS = {"0.3": 0.455870, "0.49": 0.619888}
TITLES = {
    "axi": "HERTZ, axisymmetric",
    "cube": "HERTZ, three-dimensional",
    "rubber 0.3": "Sphere on neo-Hookean rubber, nu = 0.3",
    "rubber 0.49": "Sphere on neo-Hookean rubber, nu = 0.49",
}

Row = dict[str, Any]


def ours(repeat: int) -> list[Row]:
    """This program's own rows, like those of `peers`."""
    rows = []
    for h in (0.04, 0.02, 0.01, 0.005, 0.0025):
        done = measure("configs/hertz.yaml", f"mesh.h_contact={h}", repeat=repeat)
        worst = max(abs(f / exact - 1) for f, exact in zip(done.force, CYLINDER_STEPS, strict=True))
        rows.append(own_row("axi", h, done, done.force[-1] / CYLINDER_STEPS[-1] - 1, worst))
    for h in (0.04, 0.03, 0.02, 0.016, 0.0125):
        done = measure("configs/hertz_cube.yaml", f"mesh.h_contact={h}", repeat=repeat)
        rows.append(own_row("cube", h, done, done.force[-1] / CUBE - 1))
    for nu, force in RUBBERS.items():
        material = f"material={{model: neo_hookean, E: 1.0, nu: {nu}}}"
        for h in (0.08, 0.04, 0.02):
            done = measure(
                "configs/hertz.yaml", *RUBBER, material, f"mesh.h_contact={h}", repeat=repeat
            )
            rows.append(own_row(f"rubber {nu}", h, done, done.force[-1] / force - 1))
    return rows


def own_row(case: str, h: float, done: Measured, last: float, worst: float | None = None) -> Row:
    """A row of this program."""
    report = done.report
    said = {
        "case": case,
        "program": OURS,
        "method": report["method"].replace("_", " "),
        "element": "P2",
        "h": h,
    }
    found = {"error_last": last, "error_worst": worst, "cpu_s": done.cpu, "memory_MB": done.memory}
    effort = {"dofs": report["dofs"], "iterations": report["audit"]["newton_iterations"]}
    return said | found | effort | {"gap": report["gap"], "stages": report["cpu_timings"]}


def peers() -> list[Row]:
    """The rows of peers.csv."""
    with open(PEERS, newline="", encoding="utf-8") as stream:
        rows: list[Row] = list(csv.DictReader(line for line in stream if not line.startswith("#")))
    for row in rows:
        row |= {
            k: float(row[k]) if row[k] else None
            for k in ("h", "error_last", "error_worst", "cpu_s", "memory_MB")
        }
    return rows


def tables(rows: Sequence[Row]) -> str:
    """A table for each problem, the quickest first."""
    names = [
        "program",
        "contact",
        "element",
        "h",
        "dofs",
        "error, last",
        "worst of ten",
        "iterations",
        "CPU s",
        "MB",
        "gap",
    ]
    parts = []
    for case, title in TITLES.items():
        mine = sorted((row for row in rows if row["case"] == case), key=lambda row: row["cpu_s"])
        parts.append(f"### {title}\n\n{table(names, [line(row) for row in mine])}")
    return "\n".join(parts)


def line(row: Row) -> list[str]:
    """A row as cells; this program's name is bold."""
    name = f"**{OURS}**" if row["program"] == OURS else row["program"]
    errors = percent(row["error_last"]), size(row["error_worst"])
    costs = str(row["iterations"]), number(row["cpu_s"]), number(row["memory_MB"])
    return [
        name,
        row["method"],
        row["element"],
        number(row["h"]),
        str(row["dofs"]),
        *errors,
        *costs,
        row["gap"],
    ]


def stages(rows: Sequence[Row]) -> str:
    """Where the time of this program goes."""
    mine = [row for row in rows if row["program"] == OURS]
    names = list(dict.fromkeys(name for row in mine for name in row["stages"]))
    lines = [
        [
            TITLES[row["case"]],
            f"{row['h']:g}",
            *(number(row["stages"].get(name), 2) for name in names),
        ]
        for row in mine
    ]
    return table(["problem", "h", *names], lines)


def draw(rows: Sequence[Row]) -> None:
    """Error against CPU seconds of the whole process, a panel for each problem, this program's points joined."""
    programs = list(dict.fromkeys([OURS, *(row["program"] for row in rows)]))
    shown = "first panel: largest error of ten steps, hollow where only the last is known; others: last step"
    with figures.new_figure((12.4, 7.6)) as figure:
        figures.draw_title(
            figure, "Error of the force against the time of the whole process", shown
        )
        for axes, (case, title) in zip(figure.subplots(2, 2).ravel(), TITLES.items(), strict=True):
            mine = [row for row in rows if row["case"] == case]
            for row in mine:
                draw_point(axes, row, programs.index(row["program"]))
            joined = sorted(
                (row for row in mine if row["program"] == OURS), key=lambda row: row["h"]
            )
            x, y = [row["cpu_s"] for row in joined], [error(row) for row in joined]
            axes.plot(x, y, color=figures.INK, lw=1.2, zorder=2)
            front(axes, mine)
            finish(axes, title)
        handles, names = legend(programs)
        figure.get_layout_engine().set(
            rect=(0, 0.09, 1, 0.82)
        )  # the programs stand below the panels
        figure.legend(handles, names, loc="lower center", ncol=5, fontsize=9)
        figures.save(figure, PICTURE)


def error(row: Row) -> float:
    """The largest error known of a row."""
    return abs(row["error_last"] if row["error_worst"] is None else row["error_worst"])


def style(i: int) -> dict[str, Any]:
    """How the points of the i-th program look: this one black, the others coloured."""
    colours = (figures.INK, *figures.COLOURS[:6], figures.GREY, figures.INK)
    return {
        "color": colours[i % len(colours)],
        "marker": ("*", *figures.MARKERS, "<", ">")[i % 10],
        "ls": "",
    }


def draw_point(axes: Any, row: Row, i: int) -> None:
    """One row; hollow when it is compared by its last step although others of its problem have all ten."""
    look = style(i) | ({} if comparable(row) else {"mfc": "none"})
    axes.plot(row["cpu_s"], error(row), ms=11 if i == 0 else 7, zorder=4 if i == 0 else 3, **look)


def comparable(row: Row) -> bool:
    """Whether the error known of a row is that of the others of its problem."""
    return row["error_worst"] is not None or row["case"] != "axi"


def front(axes: Any, rows: Sequence[Row]) -> None:
    """The Pareto front of a panel: the rows that none beats in both error and time."""
    best: list[Row] = []
    for row in sorted(filter(comparable, rows), key=lambda row: row["cpu_s"]):
        if not best or error(row) < error(best[-1]):
            best.append(row)
    x, y = [row["cpu_s"] for row in best], [error(row) for row in best]
    axes.step(x, y, where="post", color=figures.GREY, lw=1.2, ls=":", zorder=1)


def finish(axes: Any, title: str) -> None:
    """Logarithmic axes, named."""
    from matplotlib.ticker import LogLocator

    axes.set(
        xscale="log",
        yscale="log",
        xlabel="CPU seconds of the process",
        ylabel="|relative error of the force|",
    )
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter("")
    axes.set_title(title, loc="left")
    axes.grid(True, which="major", color="#e4e4e4", lw=0.6, zorder=0)
    axes.margins(0.1)


def legend(programs: Sequence[str]) -> tuple[list[Any], list[str]]:
    """Handles and names: the programs, the joined points, the front."""
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], ms=8, **style(i)) for i in range(len(programs))]
    handles += [Line2D([], [], color=figures.GREY, lw=1.0, ls=":")]
    return handles, [*programs, "Pareto front"]
