"""Text exports of instruments: the right modulus, or a refusal that names what is missing."""

from __future__ import annotations

from pathlib import Path

import instrument_exports
import pytest
from instrument_exports import Export

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.fitting.curve_fit import FitRequest, cantilever_stiffness_si, fit_curve
from indent_sim.fitting.forward_model.forward_model_cache import ForwardModelCache
from indent_sim.process.errors import IndentSimError
from indent_sim.results.measured.curve_file import read_curves

TABLES = ForwardModelCache()
EXPORTS = list(instrument_exports.exports())
# A fit of 300 points with one per cent of noise is wrong by less than this with certainty: 95 %
# intervals have half-widths of 1 to 3 %. Taken for a retraction, or without the spring, the modulus
# is wrong by 30 % or more.
LARGEST_ERROR = 0.1


def fitted(export: Export, folder: Path) -> tuple[dict[str, object] | None, str]:
    """Return the entry of the fit, or None and the reason of the refusal."""
    path = folder / f"curve{export.suffix}"
    path.write_bytes(export.data)
    config = config_from_mapping(export.scene)
    try:
        curve = read_curves(
            path,
            export.words.get("columns"),
            export.words.get("units"),
            cantilever_stiffness_si(config),
            export.words.get("sensitivity"),
        )[0]
    except IndentSimError as error:
        return None, str(error)
    entry = fit_curve(curve, FitRequest(config, ("material.E",)), TABLES).entry
    return (entry, "") if entry["status"] == "done" else (None, str(entry["reason"]))


@pytest.mark.parametrize("export", EXPORTS, ids=[f"{one.instrument}, {one.way}" for one in EXPORTS])
def test_the_modulus_is_right_or_refused_with_the_missing_word(export, tmp_path):
    entry, reason = fitted(export, tmp_path)
    if export.refusal:
        assert entry is None
        assert export.refusal in reason
        return
    assert entry is not None, reason
    stated = entry["parameters"]["material.E"]
    modulus = export.measurement.modulus
    error = stated["value"] / modulus - 1
    assert abs(error) < LARGEST_ERROR, (error, entry["warnings"])
    # Twice the half-width of a 95 % interval is left by one fit in ten thousand.
    assert 2 * (stated["low"] - stated["value"]) < modulus - stated["value"]
    assert modulus - stated["value"] < 2 * (stated["high"] - stated["value"])
    assert export.said in " ".join(entry["warnings"])


def test_there_are_six_files_of_each_of_ten_instruments():
    instruments = [export.instrument for export in EXPORTS]
    assert {instruments.count(name) for name in instruments} == {6}
    assert len(EXPORTS) == 60
