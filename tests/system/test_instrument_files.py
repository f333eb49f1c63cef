"""The page of instruments: each of its commands fits a file of its row."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import instrument_exports
import pytest
import yaml

PAGE = Path(__file__).resolve().parents[2] / "docs" / "instrument_files.md"
ROW = re.compile(r"^\| ([^|]+) \| [^|]+ \| `(indent-sim fit [^`]+)` \|$", re.MULTILINE)
# The export of each row, by the instrument and what is unusual.
WAYS = {
    "JPK": ("JPK", "stacked segments"),
    "NanoScope": ("NanoScope", "volts"),
    "NanoScope, volts without header": ("NanoScope", "volts, no header"),
    "Asylum": ("Asylum", "wave note"),
    "Asylum, Igor text": ("Asylum", "Igor text"),
    "Nanosurf": ("Nanosurf", "stacked tables"),
    "Park": ("Park", "two lines, a blank one and a mark"),
    "Park, volts": ("Park", "volts, decimal comma"),
    "NT-MDT": ("NT-MDT", "roles and sensitivity"),
    "Optics11": ("Optics11", "as exported"),
    "Anton Paar": ("Anton Paar", "as exported"),
    "Hysitron": ("Hysitron", "as exported"),
    "CellScale": ("CellScale", "as exported"),
    "CellScale, negative forces": ("CellScale", "negative forces"),
}
ROWS = dict(ROW.findall(PAGE.read_text(encoding="utf-8")))


def test_every_row_has_a_file():
    assert ROWS.keys() == WAYS.keys()


@pytest.mark.parametrize("name", WAYS)
def test_the_command_of_a_row_gives_the_modulus(name, tmp_path):
    """The tolerance is that of tests/unit/fitting/test_instrument_exports.py."""
    exports = {(one.instrument, one.way): one for one in instrument_exports.exports()}
    export = exports[WAYS[name]]
    _, *words = shlex.split(ROWS[name])
    (tmp_path / words[1]).write_bytes(export.data)
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(json.loads(json.dumps(export.scene))))
    done = subprocess.run(
        [sys.executable, "-m", "indent_sim", *words, "--output", "out", "--json"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    entry = json.loads(done.stdout)["curves"][0]
    value = entry["parameters"]["material.E"]["value"]
    assert value == pytest.approx(export.measurement.modulus, rel=0.1)


def test_other_columns_are_another_fit(tmp_path):
    """A second call with other options for reading does not keep the earlier result."""
    exports = {(one.instrument, one.way): one for one in instrument_exports.exports()}
    export = exports["Optics11", "as exported"]
    (tmp_path / "a.txt").write_bytes(export.data)
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(json.loads(json.dumps(export.scene))))
    command = [sys.executable, "-m", "indent_sim", "fit", "a.txt", "--scene", "scene.yaml"]
    command += ["--vary", "material.E", "--output", "out", "--json"]
    values = []
    for words in ([], ["--columns", "depth=Piezo,force=Load"], []):
        done = subprocess.run(
            [*command, *words], cwd=tmp_path, capture_output=True, text=True, check=False
        )
        report = json.loads((tmp_path / "out" / "fit.json").read_text())
        assert done.returncode == 0, done.stderr
        values.append(report["curves"][0].get("parameters"))
    assert values[0]
    assert values[0] == values[2] != values[1]
