"""Scenes of interrupted runs, and the comparison of two result folders."""

from __future__ import annotations

import os
import re
from pathlib import Path

import h5py
import numpy as np

from indent_sim.results.reader import read

SCENE = """\
body: {{shape: cylinder, radius: 1.0, height: 1.0, sides: roller}}
material: {{{material}, E: 1.0, nu: 0.3}}
indenter: {{shape: paraboloid, R: 1.0}}
contact: {{method: {method}}}
loading: {{{loading}}}
mesh: {{h_contact: 0.12, h_far: 0.6}}
output: {{fields: all, surface: all, plot: false}}
"""

DOWN = "delta: 0.15, steps: 15"
HYPERELASTIC = SCENE.format(
    material="model: neo_hookean", method="augmented_lagrangian", loading=DOWN
)
CONDENSED = SCENE.format(
    material="model: linear_elastic", method="augmented_lagrangian", loading=DOWN
)


def same_numbers(out: Path, expected: Path, rtol: float = 1e-8) -> None:
    """Assert that two folders hold the same files, rows, surfaces and fields.

    wall_s grows monotonically across the restart of the resumed run.
    """
    assert {entry.name for entry in out.iterdir()} == {entry.name for entry in expected.iterdir()}
    found, wanted = read(out), read(expected)
    assert found.report["status"] == "done" and found.report["rows"] == len(found) == len(wanted)
    for column in set(wanted.table) - {"wall_s", "newton_iterations"}:
        size = np.nanmax(np.abs(wanted[column]), initial=0.0)
        near = (
            max(rtol, 1e-4) if column == "stiffness" else rtol
        )  # by the last factor, corrected to 1e-5
        np.testing.assert_allclose(
            found[column], wanted[column], rtol=near, atol=near * size, err_msg=column
        )
    assert np.all(np.diff(found["wall_s"]) >= 0)
    for column, values in wanted.surface.items():
        np.testing.assert_allclose(
            found.surface[column],
            values,
            atol=100 * rtol * np.abs(values).max() + 1e-12,
            err_msg=column,
        )
    without_depths = [
        re.sub(r'("delta" Value=")[^"]*', r"\1", (place / "fields.xdmf").read_text())
        for place in (out, expected)
    ]
    assert without_depths[0] == without_depths[1]  # the depths are those of the table
    assert sorted(os.listdir(out / "fields")) == sorted(os.listdir(expected / "fields"))
    ours = kept_fields(out)
    for step, arrays in kept_fields(expected).items():
        for name, values in arrays.items():
            np.testing.assert_allclose(ours[step][name], values, rtol=1e-5, atol=1e-7)


def kept_fields(out: Path) -> dict[int, dict[str, np.ndarray]]:
    """Arrays of every step that fields.xdmf names."""
    text, found = (out / "fields.xdmf").read_text(), {}
    for step, name in re.findall(r'Name="step (\d+)".*?(fields/step-\d+\.h5):/', text, re.DOTALL):
        with h5py.File(out / name) as file:
            found[int(step)] = {name: values[()] for name, values in file.items()}
    return found
