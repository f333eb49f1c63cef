"""New users get from an empty folder to their goal in at most three commands.

The commands are those of docs/how_do_i.md.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable
from pathlib import Path

import html_page
import matplotlib.image
import numpy as np
import pytest
from documented_commands import BLOCK, ROOT, followed

import indent_sim
from indent_sim.results.reader import read_run

MOST = 3  # commands


def afm_biologist(folder: Path) -> None:
    """The curve in and out has error bars, and there is a picture.

    It has the curve above the stress in the deformed cell.
    """
    run = read_run(folder / "results" / "cell")
    assert run["force"] == pytest.approx([0.5, 1, 2, 3, 1, 0]) and run["delta"][1] == pytest.approx(
        run["delta"][4]
    )
    assert (run["force_error"][:-1] <= 0.02 * run["force"][:-1]).all()  # what the template asks for
    picture = matplotlib.image.imread(folder / "cell.png")
    top, bottom = np.array_split(picture[..., :3], 2)
    assert (
        len(np.unique(bottom.reshape(-1, 3), axis=0)) > 500 and (top.min(axis=(0, 2)) < 0.5).any()
    )  # graded, drawn


def film_engineer(folder: Path) -> None:
    """The report says how far the half-space's formula is off, and has the curve."""
    page = (folder / "results" / "film" / "report.html").read_text(encoding="utf-8")
    html_page.check(page)
    assert (
        re.search(r"of this curve gives E = [\d.]+ GPa \([+-][\d.]+ %", page)
        and ">force F [mN]<" in page
    )
    assert len(read_run(folder / "results" / "film")) == 20


def gel_researcher(folder: Path) -> None:
    """The stress at three depths is a PDF 170 mm wide."""
    pdf = (folder / "stress.pdf").read_bytes()
    width = float(re.search(rb"/MediaBox \[ 0 0 ([\d.]+)", pdf)[1])  # type: ignore[index]
    assert pdf.startswith(b"%PDF") and width / 72 * 25.4 == pytest.approx(170, abs=0.1)


def cluster_user(folder: Path) -> None:
    """There is a table of six runs, and a page with their curves."""
    with open(folder / "results" / "study" / "study.csv", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["status"] for row in rows] == ["done"] * 6
    assert {(row["body.height"], row["material.E"]) for row in rows} == {
        (height, E) for height in ("5.0", "10.0", "20.0") for E in ("1.0", "3.0")
    }
    page = (folder / "results" / "study" / "report.html").read_text(encoding="utf-8")
    html_page.check(page)
    assert ">height [µm]<" in page and ">E [nN/µm²]<" in page


TRUE_E = 14.0  # kPa, of the measured curve


def measured(folder: Path) -> None:
    """Write a curve of the template's gel in mm and mN.

    It is a Hertz curve times the effect of thickness, with 1 % of noise.
    """
    followed(["indent-sim init gel"], folder)
    truth = indent_sim.load(
        str(folder / "gel.yaml"), [f"material.E={TRUE_E} kPa", "loading.steps=12"]
    )
    rows = list(indent_sim.states(indent_sim.resolve(truth)))
    delta, force = (np.array([getattr(row, name) for row in rows]) for name in ("delta", "force"))
    stiffening = np.polynomial.Polynomial.fit(
        delta, force / delta**1.5, 4
    )  # smooth: to 1e-4 between the rows
    depth = np.linspace(-0.5 * delta[-1], delta[-1], 300)
    curve = np.maximum(depth, 0) ** 1.5 * stiffening(np.maximum(depth, 0))
    noisy = curve + 0.01 * force[-1] * np.random.default_rng(1).standard_normal(len(depth))
    lines = [
        "Depth [mm]\tForce [mN]",
        *(f"{x:.6g}\t{y:.6g}" for x, y in zip(depth, noisy, strict=True)),
    ]
    (folder / "measured.txt").write_text("\n".join(lines) + "\n")
    (folder / "gel.yaml").unlink()
    (folder / "scene.schema.json").unlink()


def afm_user(folder: Path) -> None:
    """The modulus has an interval a few per cent wide that holds the true one, on a page."""
    (row,) = csv.DictReader(
        (folder / "results" / "fit-measured" / "fit.csv").read_text().splitlines()
    )
    low, high = float(row["material.E_low"]), float(row["material.E_high"])
    assert low < TRUE_E < high and high - low < 0.1 * TRUE_E
    html_page.check(
        (folder / "results" / "fit-measured" / "report.html").read_text(encoding="utf-8")
    )


def other_program(folder: Path) -> None:
    """Write the curve of the same rubber by another method on other elements, as two columns."""
    followed(["indent-sim init rubber"], folder)
    settings = [
        "contact.method=active_set",
        "mesh.h_contact=0.15",
        "output={fields: none, surface: none}",
    ]
    rows = indent_sim.states(
        indent_sim.resolve(indent_sim.load(str(folder / "rubber.yaml"), settings))
    )
    lines = ["Depth [mm]\tForce [N]", *(f"{row.delta:.9g}\t{row.force:.9g}" for row in rows)]
    (folder / "theirs.txt").write_text("\n".join(lines) + "\n")
    (folder / "rubber.yaml").unlink()
    (folder / "scene.schema.json").unlink()


def fe_engineer(folder: Path) -> None:
    """Forces with error bars were compared, and fields of every step are there for ParaView."""
    run = read_run(folder / "results" / "rubber")
    assert len(run) == 9 and (run["force_error"][:-1] > 0).all()
    assert (folder / "results" / "rubber" / "fields.xdmf").exists()


def nothing(folder: Path) -> None:
    """Begin with an empty folder."""


Step = Callable[[Path], None]
JOURNEYS: list[
    tuple[str, Step, Step]
] = [  # a word of the commands, what there is before, and what there is after them
    ("run cell.yaml", nothing, afm_biologist),
    ("run film.yaml", nothing, film_engineer),
    ("run gel.yaml", nothing, gel_researcher),
    ("study study.yaml", nothing, cluster_user),
    ("fit measured.txt", measured, afm_user),
    ("run rubber.yaml", other_program, fe_engineer),
]


@pytest.mark.parametrize(
    ("word", "before", "arrived"), JOURNEYS, ids=[arrived.__name__ for *_, arrived in JOURNEYS]
)
def test_three_commands_are_enough(word: str, before: Step, arrived: Step, tmp_path: Path) -> None:
    page = (ROOT / "docs" / "how_do_i.md").read_text(encoding="utf-8")
    block = next(
        text
        for _, text in BLOCK.findall(page)
        if text.startswith("indent-sim init") and word in text
    )
    commands = block.splitlines()
    assert len(commands) <= MOST
    before(tmp_path)
    followed(commands, tmp_path)
    arrived(tmp_path)
