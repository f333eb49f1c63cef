"""Files that would cost too much are refused by counting, within a second or two.

Nothing is built before that.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import pytest
import yaml
from click.testing import CliRunner

from indent_sim.cli import commands

SCENE = """\
body: {shape: cylinder, radius: 1.0, height: 1.0}
material: {model: linear_elastic, E: 1.0, nu: 0.3}
indenter: {shape: paraboloid, R: 1.0}
loading: {delta: 0.01, steps: 3}
"""
HALF_SPACE = SCENE.replace("cylinder, radius: 1.0, height: 1.0", "half_space")
BOX = SCENE.replace("cylinder, radius: 1.0, height: 1.0", "box, size: [1.0, 1.0, 1.0]")
PYRAMID = "pyramid, half_angle: 70"
PLAIN = "".join(f"k{i}: 1\n" for i in range(50_000))
# times PyYAML's events of PLAIN in the same process: 35 at most was measured, busy or not
LIMIT = 100.0

T = TypeVar("T")
LONG = 100_000  # characters


def edited(old: str, new: str, text: str = SCENE) -> str:
    assert text.count(old) == 1
    return text.replace(old, new)


LAUGHS = "".join(
    f"{b}: &{b} [{','.join([f'*{a}'] * 9)}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)
TEXTS = {
    "billion laughs": ("a: &a [x, x]\n" + LAUGHS, "anchors"),
    "one long alias often": (
        "a: &a " + "x" * 300_000 + "\nb: [" + "*a," * 100_000 + "]\n",
        "anchors",
    ),
    "more than a megabyte": (SCENE + "# " + "x" * 1_000_000, "longer than"),
    "deep brackets": ("[" * 900_000, "nested deeper"),
    "deep braces": ("{a: " * 200_000, "nested deeper"),
    "deep lists": ("- " * 400_000, "nested deeper"),
    "deep sections": ("".join(" " * i + "a:\n" for i in range(1300)), "nested deeper"),
    "many values": ("a: [" + "[1]," * 200_000 + "]", "more than 200000 values"),
    "many keys": (
        SCENE + "".join(f"k{i}: 1\n" for i in range(30_000)),
        "and more errors",
    ),
    "a megabyte in one line": (edited("R: 1.0", "R: " + "x" * 990_000), "must be a number"),
    "many wrong numbers": (
        edited("delta: 0.01, steps: 3", f"deltas: [{'x,' * 30_000}]"),
        "and more errors",
    ),
    "deltas": (
        edited("delta: 0.01, steps: 3", f"deltas: [{'0.01,' * 150_000}]"),
        "a list of 1 to 100000 numbers",
    ),
    "steps": (edited("steps: 3", "steps: 1000000000"), "<= 100000"),
    "points": (
        edited("paraboloid, R: 1.0", f"profile, points: [{'[0,0],' * 10_000}]"),
        "a list of 2 to 1000",
    ),
    "terms of a law": (
        edited("linear_elastic, E: 1.0", f"ogden, mu: [{'1,' * 9999}], alpha: [{'2,' * 9999}]"),
        "a list of 1 to 20",
    ),
    "small elements": (SCENE + "mesh: {h_contact: 1e-9}\n", "machine has"),
    "tiny elements": (SCENE + "mesh: {h_contact: 1e-28}\n", "use a smaller body"),
    "small elements everywhere": (SCENE + "mesh: {h_contact: 1e-6, h_far: 1e-6}\n", "machine has"),
    "a billion elements": (BOX + "mesh: {h_contact: 1e-3, h_far: 1e-3}\n", "machine has"),
    "an accuracy beyond any machine": (BOX + "accuracy: 1e-9\n", "accuracy: about"),
    "a pyramid on a half-space": (
        edited("paraboloid, R: 1.0", PYRAMID, HALF_SPACE) + "mesh: {h_contact: 1e-5}\n",
        "machine has",
    ),
    "a needle": (edited("radius: 1.0", "radius: 1e-7"), "too small compared with body.height"),
    "unlike lengths": (edited("R: 1.0", "R: 1e20"), "too small compared with indenter.R"),
    "numbers without end": (edited("E: 1.0", "E: 1e300"), "beyond the range of numbers"),
}
STUDY = "base: scene.yaml\nvary: "
STUDIES = {
    "a billion runs": STUDY
    + "{"
    + ", ".join(f"a.k{i}: {{from: 0, to: 1, count: 1000}}" for i in range(3))
    + "}",
    "a long range": STUDY + "{material.nu: {from: 0, to: 1, count: 1000000000}}",
    "many blocks": STUDY + "\n" + "  - {material.nu: {from: 0, to: 0.4, count: 100000}}\n" * 1000,
    "a long list": STUDY + "{material.nu: [" + "0.1," * 150_000 + "]}",
    "no number a computer knows": STUDY
    + "{indenter.R: {from: 1, to: "
    + "9" * 350
    + ", count: 5}}",
    "an overflowing range": STUDY + "{indenter.R: {from: -1e308, to: 1.7e308, count: 5}}",
    "an enormous force": "base: scene.yaml\ncompare_to: " + "9" * 350 + "\nvary: {mesh.h_far: [1]}",
}


@pytest.fixture(autouse=True, scope="module")
def _imports_are_done(tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("first") / "scene.yaml"
    path.write_text(SCENE)
    assert CliRunner().invoke(commands.program, ["plan", str(path)]).exit_code == 0


def cost_of(call: Callable[[], T]) -> tuple[T, float]:
    """What a call returns, and its processor time over that of PyYAML's events of PLAIN.

    The ratio does not depend on the speed of the machine.
    """
    begin = time.process_time()
    deque(yaml.parse(PLAIN, yaml.CSafeLoader), maxlen=0)
    between = time.process_time()
    found = call()
    return found, (time.process_time() - between) / (between - begin)


def refused(verb: str, path: Path) -> str:
    """What stderr says of a file that is refused at once, with nothing made."""
    before = sorted(path.parent.iterdir())
    done, cost = cost_of(lambda: CliRunner().invoke(commands.program, [verb, str(path)]))
    assert cost < LIMIT
    assert done.exit_code == 3 and done.stdout == "" and "Traceback" not in done.stderr, done.stderr
    assert sorted(path.parent.iterdir()) == before
    assert len(done.stderr) < 10_000
    return done.stderr


@pytest.mark.parametrize(("text", "said"), TEXTS.values(), ids=TEXTS)
def test_scenes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, said: str) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.yaml").write_text(text)
    assert said in refused("plan", tmp_path / "scene.yaml")
    if len(text) < LONG:  # the reader of long ones is the same
        assert said in refused("run", tmp_path / "scene.yaml")


@pytest.mark.parametrize("text", STUDIES.values(), ids=STUDIES)
def test_studies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.yaml").write_text(SCENE)
    (tmp_path / "STUDY.yaml").write_text(text)
    assert refused("study", tmp_path / "STUDY.yaml")
