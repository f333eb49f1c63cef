"""NanoScope files: their exact numbers, the scale of their words, or the reason of a refusal."""

from __future__ import annotations

import os
import re
from pathlib import Path

import nanoscope_files
import numpy as np
import pytest
from nanoscope_files import deflections, stored

from indent_sim.process.errors import IndentSimError
from indent_sim.results.measured.curve_file import curve_files, read_curves
from indent_sim.results.measured.measured_map import MeasuredMap
from indent_sim.results.measured.measurement import NoCurve, Uncalibrated

N = 60
SINGLE = deflections((1, 1), N)
TRAVEL = nanoscope_files.RAMP_VOLTS * nanoscope_files.Z_SENSITIVITY * 1e-9
NEWTONS = nanoscope_files.STIFFNESS * nanoscope_files.SENSITIVITY * 1e-9


def single(folder: Path, changes: dict[str, str] | None = None, name: str = "gel.spm") -> Path:
    """Write a file of one curve, whose words have 32 bit and are 2^8 finer than stated."""
    return nanoscope_files.write(folder / name, stored(SINGLE, 32, 1 / 256), changes=changes)


def test_forces_and_displacements_in_the_order_of_time(tmp_path):
    (curve,) = read_curves(single(tmp_path))
    assert curve.name == "gel"
    assert curve.stiffness == nanoscope_files.STIFFNESS
    assert curve.parts == {"approach": slice(0, N), "retract": slice(N, 2 * N)}
    step = nanoscope_files.VOLTS / 256
    assert curve.force == pytest.approx(NEWTONS * SINGLE.ravel(), abs=0.51 * NEWTONS * step)
    assert curve.z[:N] == pytest.approx(TRAVEL * np.arange(N) / N)
    assert np.array_equal(curve.z[N:], curve.z[:N][::-1])
    # 302.9614 V/s in, a hold of 0.25 s, and 151.4807 V/s out.
    assert curve.t[[0, N]] == pytest.approx([0, 0.75])
    assert curve.t[-1] == pytest.approx(1.75 - 1 / N)


@pytest.mark.parametrize("bits, factor", [(16, 1.0), (32, 1.0), (32, 1 / 256), (32, 1 / 65536)])
def test_the_trigger_gives_the_step_of_the_words(tmp_path, bits, factor):
    path = nanoscope_files.write(tmp_path / "gel.000", stored(SINGLE, bits, factor))
    (curve,) = read_curves(path)
    step = nanoscope_files.VOLTS * factor
    assert curve.force == pytest.approx(NEWTONS * SINGLE.ravel(), abs=0.51 * NEWTONS * step)


def test_the_correction_of_the_sensitivity_is_part_of_the_spring_constant(tmp_path):
    """In an export of NanoScope Analysis from a file with the factor 1.08, pN/nm is k/1e-3 N/m."""
    added = {"\\Hold Time: 0.25": "\\Hold Time: 0.25\r\n\\Deflection Sensitivity Correction: 1.08"}
    (plain,), (corrected,) = read_curves(single(tmp_path)), read_curves(single(tmp_path, added))
    assert np.array_equal(plain.force, corrected.force)


def test_the_content_tells_a_file_from_its_export(tmp_path):
    file = single(tmp_path, name="gel.txt")
    (curve,) = read_curves(file)
    assert len(curve) == 2 * N
    text = file.read_bytes().partition(b"\x1a")[0].decode("latin-1")
    text += "Calc_Ramp_nm\tDefl_pN\n" + "".join(f"{k}\t{max(k - 50, 0)}\n" for k in range(100))
    (tmp_path / "gel.000").write_text(text)
    (export,) = read_curves(tmp_path / "gel.000")
    assert len(export) == 100
    assert export.stiffness == pytest.approx(1e3 * nanoscope_files.STIFFNESS)


def test_an_absolute_trigger_counts_from_zero(tmp_path):
    path = single(tmp_path, {"Trigger mode: Relative": "Trigger mode: Absolute"})
    with pytest.raises(NoCurve, match="times the trigger threshold"):
        read_curves(path)
    absolute = stored(SINGLE + 0.3, 32, 1 / 256)
    changes = {"Trigger mode: Relative": "Trigger mode: Absolute"}
    (curve,) = read_curves(nanoscope_files.write(tmp_path / "a.spm", absolute, changes=changes))
    assert curve.force[N - 1] == pytest.approx(NEWTONS * 1.2, rel=0.05)


def test_an_unknown_step_is_refused(tmp_path):
    words = stored(SINGLE, 32, 1 / 16)
    with pytest.raises(
        NoCurve, match=r"32-bit deflections is unknown: they turn at 1[56]\.?\d* times the trig"
    ):
        read_curves(nanoscope_files.write(tmp_path / "gel.spm", words))
    for changes in (
        {"Trigger mode: Relative": "Trigger mode: Off"},
        {"Trig Threshold": "Another Threshold"},
    ):
        with pytest.raises(NoCurve, match="since it has no trigger"):
            read_curves(single(tmp_path, changes))
        # The step of words of 16 bit is V/LSB.
        words = stored(SINGLE, 16, 1.0)
        assert read_curves(nanoscope_files.write(tmp_path / "b.spm", words, changes=changes))


def test_a_force_volume_is_a_map(tmp_path):
    shape = (3, 4)
    volts = deflections(shape, N)
    # One curve did not reach the trigger.
    volts[5, 0] = np.minimum(volts[5, 0], 0.0)
    height = np.arange(12, dtype="<i4").reshape(shape)
    words = stored(volts, 32, 1 / 256)
    found = read_curves(nanoscope_files.write(tmp_path / "gel.021", words, shape, height))
    assert isinstance(found, MeasuredMap)
    assert found.shape == shape
    assert found.size == (1.5e-6, 2e-6)
    assert found.stiffness == nanoscope_files.STIFFNESS
    # No row is traversed backwards.
    assert [found.place(k) for k in (0, 3, 4, 11)] == [(0, 0), (0, 3), (1, 0), (2, 3)]
    step = nanoscope_files.VOLTS / 256
    for index, curve in enumerate(found):
        assert curve.name == f"gel-{index}"
        expected = NEWTONS * volts[index].ravel()
        assert curve.force == pytest.approx(expected, abs=0.51 * NEWTONS * step)
    metres = nanoscope_files.HEIGHT_VOLTS / 256 * nanoscope_files.Z_SENSITIVITY * 1e-9
    assert found.height == pytest.approx(metres * height)


def test_a_map_without_an_image_has_no_height(tmp_path):
    words = stored(deflections((2, 2), N), 16, 1.0)
    found = read_curves(nanoscope_files.write(tmp_path / "gel.spm", words, (2, 2)))
    assert isinstance(found, MeasuredMap)
    assert found.height is None


def test_points_that_were_not_measured(tmp_path):
    words = stored(SINGLE, 32, 1 / 256)
    lowest = np.iinfo(np.int32).min
    words[0, 0, -10:] = lowest
    (curve,) = read_curves(nanoscope_files.write(tmp_path / "gel.spm", words))
    assert curve.parts == {"approach": slice(0, N - 10), "retract": slice(N - 10, 2 * N - 10)}
    assert curve.z[0] == pytest.approx(TRAVEL * 10 / N)
    assert len(curve.t) == len(curve) == 2 * N - 10
    words[0, 1, 7] = lowest
    with pytest.raises(NoCurve, match="points of curve 0 are missing"):
        read_curves(nanoscope_files.write(tmp_path / "gel.spm", words))
    with pytest.raises(NoCurve):
        read_curves(nanoscope_files.write(tmp_path / "gel.spm", np.full_like(words, lowest)))


def test_what_is_missing_is_said_and_may_be_given(tmp_path):
    changes = {f"Spring Constant: {nanoscope_files.STIFFNESS}": "Spring Constant: 0"}
    path = single(tmp_path, changes)
    with pytest.raises(Uncalibrated, match=r"lacks spring constant: --set experiment\.cantilever"):
        read_curves(path)
    assert read_curves(path, stiffness=0.5)[0].stiffness == 0.5
    with pytest.raises(Uncalibrated, match="lacks sensitivity"):
        read_curves(single(tmp_path, {"@Sens. DeflSens": "@Sens. Others"}))


REFUSED = {
    "exceed the travel": {"27.39000": "2739.000"},
    "the same number of points": {rf"\Samps/line: {N} {N}": rf"\Samps/line: {N} 61"},
    "of the ramp": {"Ramp Size: V": "Ramp Sighs: V"},
    "of 16 or 32 bit": {f"Data length: {8 * N}": "Data length: 7"},
    "the file ends": {"Data offset: 8192": "Data offset: 8200"},
    "V/LSB of the z scale": {"Z scale: V": "Z scale: A"},
    "without deflections": {"Ciao force image list": "Ciao farce image list"},
    "curves of the force volume": {
        "mode: Force\r": "mode: Force Volume\r",
        "/line: 256": "/line: 0",
    },
    "not a NanoScope file": {r"\*File list end": ""},
}


@pytest.mark.parametrize("reason", REFUSED)
def test_a_broken_header_is_no_curve(tmp_path, reason):
    with pytest.raises(NoCurve, match=f"not a curve: .*{re.escape(reason)}"):
        read_curves(single(tmp_path, REFUSED[reason]))


def test_huge_numbers_are_refused_before_anything_is_read(tmp_path):
    changes = {
        f"Samps/line: {N} {N}": "Samps/line: 4000000000",
        f"Data length: {8 * N}": "Data length: 9999999999",
    }
    with pytest.raises(NoCurve):
        read_curves(single(tmp_path, changes))


def test_files_are_recognised_by_their_beginning(tmp_path):
    single(tmp_path, name="a.021")
    single(tmp_path, {r"\*Force file list": r"\*File list"}, name="b.spm")
    single(tmp_path, name="c.xyz")
    (tmp_path / "d.001").write_text("1,2\n")
    (tmp_path / "e.spm").write_bytes(b"PK")
    (tmp_path / "f.pfc").touch()
    os.mkfifo(tmp_path / "g.002")
    assert [path.name[0] for path in curve_files(tmp_path)] == ["a", "b", "c", "e", "f"]
    for name in ("a.021", "b.spm", "c.xyz"):
        assert len(read_curves(tmp_path / name)) == 1
    for name in ("e.spm", "f.pfc"):
        with pytest.raises(NoCurve, match="not a NanoScope file"):
            read_curves(tmp_path / name)


def test_damaged_headers_end_in_a_curve_or_a_reason(tmp_path):
    good = single(tmp_path).read_bytes()
    head = good.index(b"\x1a")
    draw = np.random.default_rng(0)
    path = tmp_path / "damaged.spm"
    refused = 0
    for _ in range(500):
        data = bytearray(good)
        for place in draw.integers(0, head, int(draw.integers(1, 30))):
            data[place] = int(draw.integers(0, 256))
        path.write_bytes(data[: int(draw.integers(1, len(data)))] if draw.random() < 0.1 else data)
        try:
            (curve,) = read_curves(path)
            assert np.isfinite(curve.force).all()
        except IndentSimError as error:
            assert isinstance(error, NoCurve) or error.exit_code == 7
            refused += 1
    assert refused > 100
