"""JPK files of every layout: their exact numbers, or the reason of a refusal."""

from __future__ import annotations

import io
import re
import struct
import tracemalloc
import zipfile
from pathlib import Path

import jpk_files
import numpy as np
import pytest
from jpk_files import segment

from indent_sim.process.errors import IndentSimError
from indent_sim.results.measured.curve_file import curve_files, read_curves
from indent_sim.results.measured.measurement import MeasuredCurve, NoCurve, Uncalibrated

TWO = [segment("extend", 7), segment("retract", 5)]
HEADER = "segments/0/segment-header.properties"
SHARED = "shared-data/header.properties"
HEIGHTS = "segments/0/channels/measuredHeight.dat"


def written(folder: Path, curves, name: str = "gel.jpk-force", **layout) -> Path:  # type: ignore[no-untyped-def]
    """Write a file of curves."""
    return jpk_files.write(folder / name, jpk_files.members(curves, **layout))


def assert_has(
    curve: MeasuredCurve,
    segments,  # type: ignore[no-untyped-def]
    heights=jpk_files.HEIGHT_SCALINGS,  # type: ignore[no-untyped-def]
) -> None:
    """Assert that a curve has the numbers of these segments, exactly."""
    stored = np.concatenate([one.heights for one in segments])
    deflections = np.concatenate([one.deflections for one in segments])
    assert curve.z is not None
    assert np.array_equal(curve.z, -jpk_files.scaled(stored, heights))
    expected = jpk_files.scaled(deflections, jpk_files.DEFLECTION_SCALINGS)
    assert np.array_equal(curve.force, expected)


def test_a_force_distance_curve(tmp_path):
    (curve,) = read_curves(written(tmp_path, [TWO]))
    assert_has(curve, TWO)
    assert curve.name == "gel"
    assert curve.stiffness == jpk_files.STIFFNESS
    assert curve.units == {"length": "m", "force": "N", "time": "s"}
    assert curve.parts == {"approach": slice(0, 7), "retract": slice(7, 12)}
    assert curve.t == pytest.approx(np.r_[np.arange(7) / 7, 1 + np.arange(5) / 5])


def test_z_increases_while_the_height_decreases(tmp_path):
    # The encoder of the height has a negative factor.
    rising = jpk_files.Segment("extend", np.arange(9), np.arange(9))
    (curve,) = read_curves(written(tmp_path, [[rising]]))
    assert np.all(np.diff(curve.z) > 0)
    assert np.all(np.diff(curve.force) > 0)


def test_creep_compliance_begins_with_its_extension(tmp_path):
    creep = [segment("extend", 6), segment("pause", 4, 1, 2.0), segment("retract", 3, 2)]
    (curve,) = read_curves(written(tmp_path, [creep]))
    assert_has(curve, creep)
    parts = {"approach": slice(0, 6), "hold": slice(6, 10), "retract": slice(10, 13)}
    assert curve.parts == parts
    assert len(curve.part("hold")) == 10
    assert curve.t[6] == 1.0
    assert curve.t[10] == 3.0


def test_a_pause_before_the_approach_only_takes_time(tmp_path):
    relaxation = [segment(style, 5, seed) for seed, style in enumerate(("extend", "pause"))]
    (curve,) = read_curves(written(tmp_path, [[segment("pause", 3, 9, 0.5), *relaxation]]))
    assert_has(curve, relaxation)
    assert curve.parts == {"approach": slice(0, 5), "hold": slice(5, 10)}
    assert curve.t[0] == 0.5


def test_pauses_and_modulations(tmp_path):
    styles = ("extend", "pause", "pause", "modulation", "modulation", "retract", "pause")
    curve_segments = [segment(style, 4, seed) for seed, style in enumerate(styles)]
    (curve,) = read_curves(written(tmp_path, [curve_segments]))
    assert_has(curve, curve_segments)
    assert curve.parts == {
        "approach": slice(0, 4),
        "hold": slice(4, 12),
        "modulation": slice(12, 20),
        "retract": slice(20, 24),
    }


def test_a_pause_after_the_retraction_is_no_hold(tmp_path):
    (curve,) = read_curves(written(tmp_path, [[*TWO, segment("pause", 4)]]))
    assert curve.parts == {"approach": slice(0, 7), "retract": slice(7, 12)}


def test_maps_have_their_curves_by_number(tmp_path):
    curves = [[segment("extend", n), segment("retract", n)] for n in (5, 9, 3)]
    grid = jpk_files.Grid(4, 4, 1e-6, 1e-6, True)
    for kind, name in (
        ("force-scan-map", "m.jpk-force-map"),
        ("quantitative-imaging-map", "q.jpk-qi-data"),
    ):
        # The third is stored first.
        path = written(tmp_path, curves, name, kind=kind, grid=grid, numbers=(4, 11, 2))
        read = read_curves(path)
        assert [one.name for one in read] == [f"{path.stem}-{k}" for k in range(3)]
        for curve, segments in zip(read, (curves[2], curves[0], curves[1]), strict=True):
            assert_has(curve, segments)


def test_a_map_is_read_curve_by_curve(tmp_path):
    files = jpk_files.members([TWO, TWO], kind="force-scan-map")
    files["index/1/segments/0/channels/vDeflection.dat"] = b""
    curves = read_curves(jpk_files.write(tmp_path / "m.jpk-force-map", files))
    assert len(curves) == 2
    assert_has(curves[0], TWO)
    with pytest.raises(NoCurve, match="0 points instead of 7"):
        curves[1]


@pytest.mark.parametrize("height", ["capacitiveSensorHeight", "strainGaugeHeight"])
def test_measured_heights_of_earlier_files(tmp_path, height):
    (curve,) = read_curves(written(tmp_path, [TWO], height=height))
    assert_has(curve, TWO)


def test_the_height_of_the_piezo_if_it_is_the_only_one(tmp_path):
    (curve,) = read_curves(written(tmp_path, [TWO], height="height"))
    assert_has(curve, TWO, jpk_files.PIEZO_SCALINGS)


def test_old_headers_without_shared_data(tmp_path):
    small = [
        jpk_files.Segment(style, np.arange(-9, 9) * 900, np.arange(18)[::-1] * 800)
        for style in ("extend", "retract")
    ]
    (curve,) = read_curves(written(tmp_path, [small], is_old=True, height="strainGaugeHeight"))
    assert_has(curve, small)
    assert curve.parts == {"approach": slice(0, 18), "retract": slice(18, 36)}


def test_lines_end_as_on_other_systems(tmp_path):
    files = jpk_files.members([TWO])
    files = {
        name: data.replace(b"\n", b"\r\n") if name.endswith("properties") else data
        for name, data in files.items()
    }
    (curve,) = read_curves(jpk_files.write(tmp_path / "dos.JPK-FORCE", files))
    assert_has(curve, TWO)


def test_what_is_not_calibrated_is_said_and_may_be_given(tmp_path):
    path = written(tmp_path, [TWO], spring=None)
    with pytest.raises(Uncalibrated, match=r"lacks spring constant: --set experiment\.cantilever"):
        read_curves(path)
    (curve,) = read_curves(path, stiffness=0.5)
    assert curve.stiffness == 0.5
    deflections = np.concatenate([one.deflections for one in TWO])
    scalings = jpk_files.DEFLECTION_SCALINGS[:2]
    assert np.array_equal(curve.force, 0.5 * jpk_files.scaled(deflections, scalings))
    path = written(tmp_path, [TWO], spring=None, sensitivity=None)
    with pytest.raises(Uncalibrated, match="lacks spring constant, sensitivity: "):
        read_curves(path)
    with pytest.raises(Uncalibrated, match="lacks sensitivity: "):
        read_curves(path, stiffness=0.5)
    # The file's own spring constant counts.
    (curve,) = read_curves(written(tmp_path, [TWO]), stiffness=0.5)
    assert curve.stiffness == jpk_files.STIFFNESS


def test_a_folder_lists_them(tmp_path):
    for name in ("a.jpk-force", "b.jpk-force-map", "c.jpk-qi-data"):
        (tmp_path / name).touch()
    assert [path.name[0] for path in curve_files(tmp_path)] == ["a", "b", "c"]


# ---- broken and malicious files ----


def replaced(name: str, old: str, new: str) -> dict[str, bytes]:
    """Return the members of a curve, with a text of one of them replaced."""
    files = jpk_files.members([TWO])
    text, count = re.subn(old, new, files[name].decode())
    assert count
    return files | {name: text.encode()}


FACTOR = r"lcd-info.2.encoder.scaling.multiplier=.*"
BROKEN = {
    "nothing": ({}, "without a segment"),
    "no segment": ({"header.properties": b"type=force-scan-series\n"}, "without a segment"),
    "only a pause": (jpk_files.members([[segment("pause", 5)]]), "an approach, only hold"),
    "no points": (replaced(HEADER, "num-points=7", ""), "no number of points"),
    "other points": (replaced(HEADER, "num-points=7", "num-points=8"), "7 points instead of 8"),
    "huge points": (replaced(HEADER, "num-points=7", "num-points=999999999"), "more than"),
    "negative points": (replaced(HEADER, "num-points=7", "num-points=-7"), "no number of points"),
    "no style": (replaced(SHARED, "settings.style", "settings.smile"), "has no style"),
    "no channels": (replaced(HEADER, "channel[.]", "kennel."), "has no height"),
    "no deflection": (replaced(HEADER, "vDeflection", "other"), "has no vDeflection"),
    "no shared data": ({k: v for k, v in jpk_files.members([TWO]).items() if k != SHARED}, "style"),
    "no numbers": ({k: v for k, v in jpk_files.members([TWO]).items() if k != HEIGHTS}, "missing"),
    "half a number": (jpk_files.members([TWO]) | {HEIGHTS: bytes(27)}, "6 points instead of 7"),
    "too many numbers": (jpk_files.members([TWO]) | {HEIGHTS: bytes(32)}, "has 32 bytes"),
    "another folder": (
        replaced(HEADER, "channels/measuredHeight.dat", "../../../etc/passwd"),
        "etc/passwd is missing",
    ),
    "an absolute path": (replaced(HEADER, "channels/measuredHeight.dat", "/etc/passwd"), "missing"),
    "NaN factor": (replaced(SHARED, FACTOR, "lcd-info.2.encoder.scaling.multiplier=NaN"), "linear"),
    "infinite factor": (
        replaced(SHARED, FACTOR, "lcd-info.2.encoder.scaling.multiplier=1e308"),
        "12 of 12 rows lack a number",
    ),
    "unknown encoding": (replaced(SHARED, "=signedinteger", "=morse"), "encoding 'morse'"),
    "other unit": (replaced(SHARED, "unit.unit=m", "unit.unit=ft"), "in 'ft' instead of m"),
    "circle": (
        replaced(SHARED, "calibration-slot=absolute", "calibration-slot=nominal"),
        "in a circle",
    ),
    "long properties": (
        jpk_files.members([TWO]) | {SHARED: b"x" * 5_000_000},
        "5000000 bytes",
    ),
    "long headers": (
        jpk_files.members([[segment("extend", 1)]])
        | {
            f"segments/{k}/segment-header.properties": jpk_files.members([TWO])[HEADER].replace(
                b"num-points=7", b"num-points=1"
            )
            + b"#" * 1_500_000
            for k in range(7)
        },
        "bytes of headers",
    ),
    "many segments": (
        jpk_files.members([[segment("extend", 1)]])
        | {
            f"segments/{k}/segment-header.properties": jpk_files.members([TWO])[HEADER].replace(
                b"num-points=7", b"num-points=1"
            )
            for k in range(1001)
        },
        "more than 1000 segments",
    ),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_archive_is_no_curve(tmp_path, name):
    files, reason = BROKEN[name]
    path = jpk_files.write(tmp_path / "broken.jpk-force", files)
    with pytest.raises(NoCurve, match=re.escape(reason)) as raised:
        read_curves(path)
    assert raised.value.file == str(path)


def test_what_is_no_zip_archive_is_no_curve(tmp_path):
    path = tmp_path / "text.jpk-force"
    for data in (b"", b"PK", b"a,b\n1,2\n", bytes(5000)):
        path.write_bytes(data)
        with pytest.raises(NoCurve, match="not a curve: not a zip archive"):
            read_curves(path)


def test_a_zip_bomb_is_not_unpacked(tmp_path):
    files = jpk_files.members([TWO])
    # 200 MB of zeros, of which the archive states the true length or that of seven points.
    for stated in (None, 28):
        path = tmp_path / "bomb.jpk-force"
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, data in files.items():
                if name != HEIGHTS:
                    archive.writestr(name, data)
            with archive.open(HEIGHTS, "w") as file:
                for _ in range(200):
                    file.write(bytes(1_000_000))
        if stated:
            data = path.read_bytes().replace(struct.pack("<I", 200_000_000), struct.pack("<I", 28))
            path.write_bytes(data)
        tracemalloc.start()
        with pytest.raises(NoCurve, match="damaged" if stated else "200000000 bytes"):
            read_curves(path)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 20_000_000


def test_other_compressions_are_refused(tmp_path):
    path = tmp_path / "lzma.jpk-force"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_LZMA) as archive:
        for name, data in jpk_files.members([TWO]).items():
            archive.writestr(name, data)
    with pytest.raises(NoCurve, match="unknown method"):
        read_curves(path)


def test_damaged_bytes_end_in_a_curve_or_a_reason(tmp_path):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in jpk_files.members([TWO]).items():
            archive.writestr(name, data)
    good = buffer.getvalue()
    draw = np.random.default_rng(0)
    path = tmp_path / "damaged.jpk-force"
    refused = 0
    for _ in range(400):
        data = bytearray(good)
        for place in draw.integers(0, len(data), int(draw.integers(1, 6))):
            data[place] = int(draw.integers(0, 256))
        path.write_bytes(data[: int(draw.integers(1, len(data)))] if draw.random() < 0.1 else data)
        try:
            read_curves(path)
        except IndentSimError as error:
            assert isinstance(error, NoCurve)
            assert "\n" not in error.problem
            refused += 1
    assert refused > 200
