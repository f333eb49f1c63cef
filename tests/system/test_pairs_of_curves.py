"""Every kind of curve beside every other in `compare`, `plot` and `compare_to`.

Curves are results of all ways, studies and measured files.
"""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from indent_sim.cli import commands

HEAD = "units: {length: um, force: nN}\nindenter: {shape: paraboloid, R: 5 um}\n"
HALF_SPACE, CYLINDER = (
    "body: {shape: half_space}\n",
    "body: {shape: cylinder, radius: 8 um, height: 4 um}\n",
)
LINEAR, RUBBER = (
    f"material: {{model: {model}, E: 1 kPa, nu: 0.45}}\n"
    for model in ("linear_elastic", "neo_hookean")
)
PRESSED, MESH = "loading: {delta: 0.5 um, steps: 5}\n", "mesh: {h_contact: 0.15 um}\n"
HELD = "loading: {history: [[0, 0], [1, 0.5], [3, 0.5]]}\n"
SCENES = {
    "theory": HALF_SPACE + LINEAR + PRESSED,
    "condensed": CYLINDER + LINEAR + PRESSED + MESH + "solver: {method: condensed}\n",
    "steps": CYLINDER + RUBBER + PRESSED + MESH,
    "forces": HALF_SPACE + LINEAR + "loading: {forces: [0.4 nN, 0.8 nN, 1.2 nN]}\n",
    "back": HALF_SPACE + LINEAR + "loading: {deltas: [0.1, 0.3, 0.5, 0.4, 0.3, 0.1]}\n",
    "curve": HALF_SPACE + LINEAR.replace("}", ", relaxation: {prony: [[0.5, 1]]}}") + HELD,
    "history": CYLINDER
    + LINEAR.replace("}", ", relaxation: {prony: [[0.5, 1]], of: shear}}")
    + HELD
    + MESH,
    "spring": HALF_SPACE + LINEAR + PRESSED + "experiment: {cantilever: {stiffness: 50}}\n",
    "adhesion": HALF_SPACE + LINEAR + PRESSED + "experiment: {adhesion: {work: 0.005}}\n",
}
HISTORIES = ("curve", "history")
FILES = ("csv.csv", "bare.csv", "timed.csv", "tabbed.tab")
OTHERS = ("theory/force_indentation.csv", "study/study.csv", "study")
NAMES = (*SCENES, *FILES, *OTHERS)
ALIKE = (
    "theory",
    "back",
    "spring",
    "adhesion",
    "csv.csv",
    "bare.csv",
    "timed.csv",
    "tabbed.tab",
    OTHERS[0],
)
NOISE = 1e-4  # of the files, of the largest force


def call(*words: object) -> Result:
    done = CliRunner().invoke(commands.program, [str(word) for word in words])
    assert done.exception is None or isinstance(done.exception, SystemExit), (words, done.exc_info)
    return done


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of all scenes, a study, and files of the half-space's curve in other units."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place := tmp_path_factory.mktemp("pairs"))
        for name, text in SCENES.items():
            Path(f"{name}.yaml").write_text(HEAD + text + "output: {plot: false}\n")
            done = call("run", f"{name}.yaml", "--output", name)
            assert done.exit_code == 0, done.output
        Path("study.yaml").write_text("base: theory.yaml\nvary: {material.E: [1 kPa, 2 kPa]}\n")
        assert call("study", "study.yaml", "--output", "study").exit_code == 0
        assert call("plot", "theory", "--output", "tabbed.tab").exit_code == 0
        write_files()
        return place


def write_files() -> None:
    """Write the half-space's Hertz curve in nm and pN, without a header, and with times."""
    x = np.linspace(-0.5, 0.5, 401)
    force = 4 / 3 / (1 - 0.45**2) * np.sqrt(5) * np.maximum(x, 0) ** 1.5
    force += NOISE * force.max() * np.random.default_rng(0).standard_normal(len(x))
    table = [(float(a), float(b)) for a, b in zip(x, force, strict=True)]
    Path("csv.csv").write_text(
        "delta [nm],force [pN]\n" + "".join(f"{1e3 * a},{1e3 * b}\n" for a, b in table)
    )
    Path("bare.csv").write_text("".join(f"{a};{b}\n" for a, b in table[::2]))
    timed = "".join(f"{k}\t{a}\t{b}\n" for k, (a, b) in enumerate(table))
    Path("timed.csv").write_text("t [s]\tdepth [um]\tforce [nN]\n" + timed)


@pytest.fixture(autouse=True)
def _there(folder, monkeypatch):
    monkeypatch.chdir(folder)


def compared(first: str, second: str) -> dict[str, object]:
    done = call("compare", first, second, "--json")
    assert done.exit_code in (0, 6), (first, second, done.output)
    return json.loads(done.stdout)


def test_every_pair_is_compared_the_same_both_ways():
    """Every pair has the same comparison both ways, and a curve has no difference to itself.

    A study as a whole is refused; its runs have tables.
    """
    for first, second in itertools.combinations_with_replacement((*SCENES, *FILES, *OTHERS[:2]), 2):
        one, other = compared(first, second), compared(second, first)
        assert len(one["rows"]) == len(other["rows"]), (first, second)
        assert one["residual"] == (other["residual"] and pytest.approx(other["residual"])), (
            first,
            second,
        )
        if first == second:
            assert not one["differences"] and one["residual"]["percent_largest"] == 0
    for name in NAMES:
        assert call("compare", name, "study").exit_code == 2


def test_curves_of_one_body_are_alike_in_any_units_and_order():
    """Curves of one body are alike in any units and order.

    A curve drawn by chords between 5 rows is off by up to 1 % of the largest force; noise and the
    files' own chords by 0.1 %. Two files that state different units are left to the first one's; in
    files without units the numbers count.
    """
    for first, second in itertools.combinations(ALIKE, 2):
        if {first, second} <= {*FILES, OTHERS[0]}:
            continue
        found = compared(first, second)["residual"]
        assert found["percent_largest"] < (1.2 if "tabbed.tab" in (first, second) else 0.2), (
            first,
            second,
            found,
        )


def test_a_history_and_a_file_in_other_units_are_compared_in_one():
    """A history has the same residual to one curve in nm and pN and in the scene's units.

    The second file has every second row. A table beside its run.json is compared too.
    """
    for name in HISTORIES:
        off = [
            compared(name, file)["residual"]["percent_largest"] for file in ("csv.csv", "bare.csv")
        ]
        assert off[0] == pytest.approx(off[1], rel=0.01) and 5 < off[0] < 60
    assert compared(OTHERS[0], "csv.csv")["residual"]["percent_largest"] < 0.2


def picture_of(first: str, second: str) -> None:
    done = call("plot", first, second, "--output", "two.png")
    assert done.exit_code == (2 if "study" in (first, second) else 0), (first, second, done.output)
    assert done.exit_code or Path("two.png").stat().st_size > 10_000
    Path("two.png").unlink(missing_ok=True)


def test_every_curve_is_drawn_beside_another():
    for first, second in zip(NAMES, (*NAMES[1:], NAMES[0]), strict=True):
        picture_of(first, second)


@pytest.mark.verify
def test_pairs_are_drawn():
    """Every sixth pair is drawn, so that each name is in several of them, first and second."""
    for first, second in itertools.islice(itertools.combinations(NAMES, 2), 0, None, 6):
        picture_of(first, second)


def study_of(scene: str, reference: str) -> None:
    """Run a study with a reference, which gives errors of its rows or a reason why it cannot."""
    name = f"of_{scene}_{reference}".replace("/", "_").replace(".", "_")
    text = f"base: {scene}.yaml\nvary: {{material.E: [1 kPa, 2 kPa]}}\ncompare_to: ./{reference}\n"
    Path(f"{name}.yaml").write_text(text + "output: {plot: false}\n")
    done = call("study", f"{name}.yaml", "--output", name, "--json")
    off = (
        [row.get("force_error_vs") for row in json.loads(done.stdout)["rows"]]
        if not done.exit_code
        else None
    )
    if scene in HISTORIES or reference == "study":
        said = (
            "contains a study"
            if scene not in HISTORIES
            else "a time history passes a depth several times"
        )
        assert done.exit_code == 3 and said in done.stderr, done.output
    elif off is None:
        assert done.exit_code == 3 and "does not reach the depth" in done.stderr, done.output
    else:
        assert np.isfinite(off).all(), (scene, reference, off)
        if (
            scene in ("theory", "spring", "adhesion") and reference in ALIKE
        ):  # rows of elastic contact
            np.testing.assert_allclose(
                off, [0, 1], atol=0.01, err_msg=reference
            )  # noise, chords of 5 rows


def test_a_theory_scene_is_compared_with_everything():
    for reference in NAMES:
        study_of("theory", reference)


def test_a_history_as_reference_counts_by_its_approach():
    """A history as reference counts by its approach, whose force is that of Lee and Radok.

    With one term of one half and a ramp and time of one second 0.39 of the force is missing.
    """
    study_of("theory", "curve")
    done = call("study", "of_theory_curve.yaml", "--output", "of_theory_curve", "--json")
    rows = [row["force_error_vs"] for row in json.loads(done.stdout)["rows"]]
    t = (np.arange(10_000) + 0.5) / 10_000
    relaxed = np.mean((0.5 + 0.5 * np.exp(t - 1)) * 1.5 * np.sqrt(t))
    np.testing.assert_allclose(
        rows, np.array([1, 2]) / relaxed - 1, rtol=2e-3
    )  # rows of the program's own times


@pytest.mark.verify
def test_scenes_are_compared_with_everything():
    """Every fifth pair of a scene and a reference is a study or a reason why not.

    There are sixteen names, so that each scene meets different ones.
    """
    for scene, reference in itertools.islice(itertools.product(SCENES, NAMES), 0, None, 5):
        study_of(scene, reference)
