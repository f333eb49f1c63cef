"""Measured curves from text files of any format: their numbers, or the reason of a refusal."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from indent_sim.process.errors import ConfigError, IndentSimError, UsageError
from indent_sim.results.measured.curve_file import curve_files, read_curves
from indent_sim.results.measured.measurement import NoCurve, curve_parts, curve_parts_by_name
from indent_sim.results.measured.tab_file import tab_text
from indent_sim.results.measured.text_curve import read_text_curves
from indent_sim.results.reader import Results

DEPTHS = np.linspace(-1.0, 2.0, 61)
FORCES = np.maximum(DEPTHS, 0.0) ** 1.5 - 0.25
# Numbers are written with 9 digits
DIGITS = {"rtol": 1e-8, "atol": 1e-8}


def rows(separator: str, decimal: str = ".") -> str:
    """Rows of the curve as lines of two numbers."""
    lines = (f"{x:.9f}{separator}{y:.9f}" for x, y in zip(DEPTHS, FORCES, strict=True))
    return "\n".join(line.replace(".", decimal) for line in lines) + "\n"


def read(text: str | bytes, **how):  # type: ignore[no-untyped-def]
    """Read a curve from a text."""
    (curve,) = read_text_curves(
        Path("curve.csv"), text if isinstance(text, bytes) else text.encode(), **how
    )
    return curve


@pytest.mark.parametrize(
    "separator, decimal",
    [
        ("\t", "."),
        ("\t", ","),
        (";", "."),
        (";", ","),
        (",", "."),
        ("  ", "."),
        ("  ", ","),
        (" ; ", ","),
    ],
)
@pytest.mark.parametrize(
    "head", ["", "delta{s}force\n", "A file\n# of March 3, 2021\n\n% depth{s}load\n"]
)
@pytest.mark.parametrize("begin, line_end", [("", "\n"), ("\ufeff", "\r\n")])
def test_any_separator_decimal_sign_and_header(separator, decimal, head, begin, line_end):
    text = begin + head.format(s=separator) + rows(separator, decimal)
    curve = read(text.replace("\n", line_end))
    np.testing.assert_allclose(curve.delta, DEPTHS, **DIGITS)
    np.testing.assert_allclose(curve.force, FORCES, **DIGITS)


@pytest.mark.parametrize(
    "titles, units",
    [
        ("Depth [um],Force (nN)", ("um", "nN")),
        ("Indentation (nm),Load (µN)", ("nm", "µN")),
        ("indentation um,force nN", ("um", "nN")),
        ("z_mm,load_mN", ("mm", "mN")),
        ("depth,force\n(um),(mN)", ("um", "mN")),
        ("delta,force", ("m", "N")),
        ("depth (measured),force", None),
    ],
)
def test_units_of_titles_stand_over_those_given(titles, units):
    if units is None:
        with pytest.raises(NoCurve, match="no column of depth among"):
            read(titles + "\n" + rows(","))
        return
    curve = read(titles + "\n" + rows(","), given={"length": "m", "force": "N"})
    assert (curve.units["length"], curve.units["force"]) == units
    in_scene = curve.convert_units({"length": "um", "force": "nN"})
    factors = {"um": 1, "nN": 1, "nm": 1e-3, "µN": 1e3, "mm": 1e3, "mN": 1e6, "m": 1e6, "N": 1e9}
    np.testing.assert_allclose(
        in_scene.abscissa_values(in_scene.available_abscissa("delta")),
        DEPTHS * factors[units[0]],
        **DIGITS,
    )
    np.testing.assert_allclose(
        in_scene.force, FORCES * factors[units[1]], rtol=1e-8, atol=1e-8 * factors[units[1]]
    )


def test_a_unit_needs_one_in_the_scene():
    with pytest.raises(
        ConfigError, match="the curve has the length in um, and the scene has no unit for it"
    ):
        read("depth [um],force\n" + rows(",")).convert_units({"length": "", "force": ""})


def test_titles_in_another_language_are_told_by_their_units():
    head = "Zeit (s);Eindringtiefe (µm);Kraft (nN)\n"
    lines = "".join(f"{k};{line}\n" for k, line in enumerate(rows(";", ",").splitlines()))
    curve = read(head + lines)
    np.testing.assert_allclose(curve.delta, DEPTHS, **DIGITS)
    np.testing.assert_allclose(curve.force, FORCES, **DIGITS)
    assert curve.units == {"length": "µm", "force": "nN", "time": "s"} and curve.t[-1] == 60
    with pytest.raises(NoCurve, match="no column of depth"):  # which of two lengths?
        read("Weg (µm);Hub (µm);Kraft (nN)\n" + lines)


def test_columns_by_title_or_number():
    table = "a,b,c\n" + "".join(
        f"{k},{f:.9f},{x:.9f}\n" for k, (x, f) in enumerate(zip(DEPTHS, FORCES, strict=True))
    )
    for columns in (["c", "b"], ["3", "2", "1"], ["C", "2"]):
        curve = read(table, columns=columns)
        np.testing.assert_allclose(curve.delta, DEPTHS, **DIGITS)
        np.testing.assert_allclose(curve.force, FORCES, **DIGITS)
        assert (curve.t is not None) == (len(columns) == 3)
    with pytest.raises(ConfigError, match=r"no column 'd'; there are a, b, c") as caught:
        read(table, columns=["d", "b"])
    assert caught.value.exit_code == 3


def test_a_way_that_falls_towards_the_body_is_turned():
    text = "z,force\n" + "".join(f"{-x:.9f},{f:.9f}\n" for x, f in zip(DEPTHS, FORCES, strict=True))
    curve = read(text)
    np.testing.assert_allclose(curve.z, DEPTHS, **DIGITS)
    assert curve.delta is None and curve.notes == (
        "z decreases towards the body: its sign is reversed",
    )
    height = read(text.replace("z,force", "height,force"))
    np.testing.assert_allclose(height.z, DEPTHS, **DIGITS)
    assert not height.notes


def test_approach_hold_and_retract_by_their_path():
    go, stay = np.linspace(0, 1, 100), np.ones(50)
    assert curve_parts(go) == {"approach": slice(0, 100)}
    assert curve_parts(np.append(go, go[::-1])) == {
        "approach": slice(0, 100),
        "retract": slice(100, 200),
    }
    held = curve_parts(np.concatenate([go, stay, go[::-1]]))
    assert list(held) == ["approach", "hold", "retract"] and abs(held["hold"].stop - 150) <= 1
    assert list(curve_parts(np.concatenate([go, stay]))) == ["approach", "hold"]
    assert curve_parts(go[::-1]) == {
        "approach": slice(0, 100)
    }  # a file that is sorted the other way
    assert curve_parts(np.zeros(5)) == {"approach": slice(0, 5)}


def test_parts_by_words():
    words = np.array(["extend"] * 3 + ["pause"] * 2 + ["retract"] * 4)
    assert curve_parts_by_name(words) == {
        "approach": slice(0, 3),
        "hold": slice(3, 5),
        "retract": slice(5, 9),
    }
    numbers = np.array(["0"] * 3 + ["1"] * 2)
    assert curve_parts_by_name(numbers) == {"approach": slice(0, 3), "retract": slice(3, 5)}
    curve = read(
        "delta,force,branch\n"
        + "".join(f"{k},{k},approach\n" for k in range(4))
        + "3,2,retract\n2,1,retract\n"
    )
    assert (
        len(curve.part("approach")) == 4
        and len(curve.part("retract")) == 2
        and len(curve.part("all")) == 6
    )
    with pytest.raises(NoCurve, match="has no hold, only approach, retract"):
        curve.part("hold")


def test_rows_that_lack_a_number_are_left_out():
    lines = rows(",").splitlines()
    lines[5], lines[7] = lines[5].split(",")[0] + ",", "nan,nan"
    curve = read("\n".join(["delta,force", *lines, ""]))
    assert len(curve) == len(DEPTHS) - 2 and curve.notes == (
        "2 rows that lack a number are left out",
    )


def hostile() -> dict[str, bytes]:
    """Files without a usable curve, by their defect."""
    good = rows(",")
    middle = good[: len(good) // 2]
    files = {
        "empty": b"",
        "blank": b"\n \n\n",
        "binary": bytes(range(256)) * 50,
        "words": b"to be,or not\n" * 50,
        "one column": b"1\n2\n3\n" * 20,
        "three columns": b"1,2,3\n" * 40,
        "no force": b"delta,width\n1,2\n3,4\n",
        "ragged": (good + "1\n" + good).encode(),
        "word inside": (good + "1,abc\n" + good).encode(),
        "all nan": b"delta,force\n" + b"nan,nan\n" * 40,
        "half": b"delta,force\n" + b"1,\n" * 40,
        "long line": b"1," * 200_000,
        "utf-16 cut": b"\xff\xfe1\x002",
        "underscores": b"delta,force\n" + b"1_0,2\n" * 40,
        "infinite": b"delta,force\n" + b"inf,1e999\n" * 40,
        "absurd": b"delta,force\n" + b"1e200,1e300\n" * 40,
        "json": b'{"delta": [1, 2]}',
        "xml": b"<a>\n<b/>\n</a>\n",
        "quotes": b'"\n' * 30,
        "commas": b",,,,\n" * 30,
        "header": b"delta,force\n",
        "cut number": (middle + "\n1e,2\n" + middle).encode(),
    }
    return files


@pytest.mark.parametrize("name, data", hostile().items())
def test_a_file_without_a_curve_has_a_reason(name, data):
    with pytest.raises(NoCurve, match=r"^not a curve: .{8,}") as caught:
        read(data)
    assert "\n" not in str(caught.value)


def test_broken_files_at_random_end_in_a_curve_or_a_reason():
    """Randomly damaged files give finite numbers or a reason, and no other exception."""
    source, draw = rows(";", ",").encode(), np.random.default_rng(1)
    for _ in range(200):
        data = bytearray(b"depth [um];force [nN]\n" + source)
        for place in draw.integers(0, len(data), draw.integers(1, 30)):
            data[place] = draw.integers(1, 256)
        data = data[draw.integers(0, 50) : draw.integers(60, len(data))]
        try:
            curve = read(bytes(data))
            assert np.isfinite(curve.force).all() and len(curve.force) == len(
                curve.abscissa_values(curve.available_abscissa("delta"))
            )
        except IndentSimError as error:
            assert str(error)


def test_files_that_are_not_there(tmp_path):
    with pytest.raises(UsageError, match=r"cannot read .*nothing\.csv: No such file"):
        read_curves(tmp_path / "nothing.csv")
    with pytest.raises(UsageError, match="there is no file"):
        curve_files(tmp_path / "nothing.csv")
    with pytest.raises(UsageError, match="contains no curve file"):
        curve_files(tmp_path)
    os.mkfifo(tmp_path / "pipe.csv")
    with pytest.raises(UsageError, match="cannot read"):
        read_curves(tmp_path / "pipe.csv")
    (tmp_path / "b.csv").write_text(rows(","))
    (tmp_path / "notes.md").write_text("no curve")
    assert [path.name for path in curve_files(tmp_path)] == ["b.csv", "pipe.csv"]


def test_tab_file_comes_back_in_si_units(tmp_path):
    delta = np.linspace(0.1, 2.0, 20)
    table = {
        "step": np.arange(1.0, 21),
        "delta": delta,
        "force": 3 * delta**1.5,
        "a": np.sqrt(delta),
    }
    result = Results(tmp_path, table, {"units": {"length": "um", "force": "nN"}})
    (tmp_path / "x.tab").write_text(text := tab_text(result))
    (curve,) = read_curves(tmp_path / "x.tab")
    there = curve.convert_units({"length": "um", "force": "nN"})
    approach = there.part("approach")
    np.testing.assert_allclose(approach.delta[-20:], delta, rtol=1e-11)  # of 13 digits written
    np.testing.assert_allclose(approach.force[-20:], table["force"], rtol=1e-11)
    np.testing.assert_allclose(
        approach.z, approach.delta + approach.force / there.stiffness, rtol=1e-11, atol=1e-11
    )
    head = text.split("# END METADATA")[0].splitlines()[1:]
    assert json.loads("".join(line[1:] for line in head))["imaging mode"] == "force-distance"
    with pytest.raises(UsageError, match="has no units"):
        tab_text(Results(tmp_path, table))
