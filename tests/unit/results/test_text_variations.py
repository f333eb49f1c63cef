"""Random spellings of one curve as text: the same numbers, or a refusal."""

from __future__ import annotations

from pathlib import Path

import instrument_exports
import numpy as np
import pytest

from indent_sim.process.errors import ConfigError, IndentSimError
from indent_sim.results.measured.column_titles import parse_title, unit_factor
from indent_sim.results.measured.header_calibration import parse_sensitivity, read_calibration
from indent_sim.results.measured.measurement import MeasuredCurve, NoCurve, Uncalibrated
from indent_sim.results.measured.text_curve import read_text_curves

SCENE_UNITS = {"length": "um", "force": "nN"}
STIFFNESS = 0.02  # N/m
SENSITIVITY = "40 nm/V"
# Numbers are written with eight digits.
DIGITS = 1e-6
LENGTHS = ("nm", "um", "µm", "mm", "m")
FORCES = ("pN", "nN", "uN", "µN", "mN", "N")
TITLES = {
    "z": ("z", "Z", "Piezo", "ZSnsr", "Height", "Height (measured)", "Z Scan", "stage"),
    "delta": ("Indentation", "Depth", "penetration depth", "delta"),
    "force": ("Force", "Load", "Fn", "normal force"),
    "deflection": ("Deflection", "Defl", "Vertical Deflection"),
    "t": ("Time", "t", "Series Time"),
    "other": ("Temperature", "Auxiliary", "Index", "Lateral Deflection", "E[eff] (Pa)"),
}


def read(text: str | bytes, **how) -> MeasuredCurve:  # type: ignore[no-untyped-def]
    """Read the only curve of a text, in um, nN and s."""
    data = text.encode() if isinstance(text, str) else text
    (curve,) = read_text_curves(Path("curve.txt"), data, **how)
    return curve.convert_units(SCENE_UNITS)


def written(draw: np.random.Generator) -> tuple[bytes, dict[str, np.ndarray]]:
    """Return a random spelling of a curve, and its true numbers by role."""
    m = instrument_exports.afm(draw)
    abscissa = str(draw.choice(["z", "delta"]))
    ordinate = str(draw.choice(["force", "force", "deflection"]))
    is_falling = bool(draw.random() < 0.3)
    length, force = str(draw.choice(LENGTHS)), str(draw.choice(FORCES))
    x = (m.z if abscissa == "z" else m.delta) * 1e-6 / unit_factor(length, "length")
    columns = [(abscissa, length, -x if is_falling else x)]
    if ordinate == "force":
        columns.append(("force", force, 1e-9 * m.force / unit_factor(force, "force")))
    elif draw.random() < 0.5:
        unit = str(draw.choice(LENGTHS))
        columns.append((ordinate, unit, 1e-6 * m.deflection / unit_factor(unit, "length")))
    else:
        unit, factor = [("V", 1.0), ("mV", 1e3)][int(draw.integers(2))]
        columns.append((ordinate, unit, factor * m.deflection / 0.04))
    if draw.random() < 0.5:
        unit, factor = [("s", 1.0), ("ms", 1e3)][int(draw.integers(2))]
        columns.append(("t", unit, factor * m.t))
    for _ in range(int(draw.integers(0, 3))):
        columns.append(("other", "", draw.uniform(20, 30, len(m.t))))
    columns = [columns[k] for k in draw.permutation(len(columns))]
    separator = str(draw.choice(["\t", ";", ",", "   "]))
    decimal = str(draw.choice([".", ","])) if separator != "," else "."
    names = [str(draw.choice(TITLES[role])) for role, _, _ in columns]
    units = [unit for _, unit, _ in columns]
    if separator == "   ":
        names = [name.replace(" ", "_") if "(" not in name else "Other" for name in names]
        names = [
            "Piezo" if name == "Other" and role == "z" else name
            for name, (role, _, _) in zip(names, columns, strict=True)
        ]
    style = str(draw.choice(["[{}]", "({})", "line", "bracketed line"]))
    if "line" in style:
        form = "{}" if style == "line" else "[{}]"
        unit_line = separator.join(form.format(unit) if unit else "-" for unit in units)
        titles = separator.join(names) + "\n" + unit_line
    else:
        gap = "" if separator == "   " else str(draw.choice(["", " "]))
        titles = separator.join(
            name + (gap + style.format(unit) if unit else "")
            for name, unit in zip(names, units, strict=True)
        )
    numbers = instrument_exports.table(
        [values for _, _, values in columns], separator, decimal, ".8e"
    )
    between = str(draw.choice(["", "\n", "\n\n", "eoh\n", "\n---\n"]))
    head = str(draw.choice(["", "Operator: me\n", "Date\t12.05.2025\nPoints\t600\n\n", "# a\n"]))
    text = f"{head}{titles}\n{between}{numbers}"
    if draw.random() < 0.2:
        lines = text.split("\n")
        lines.insert(len(lines) // 2, str(draw.choice(["", "# pause", "eoh"])))
        text = "\n".join(lines)
    if draw.random() < 0.3:
        text = text.replace("\n", "\r\n")
    encoding = str(draw.choice(["utf-8", "latin-1", "utf-8-sig", "utf-16"]))
    truth = {abscissa: m.z if abscissa == "z" else m.delta, "force": m.force}
    return text.encode(encoding), truth


@pytest.mark.parametrize("seed", range(150))
def test_a_random_spelling_gives_the_numbers_or_a_refusal(seed):
    data, truth = written(np.random.default_rng(seed))
    try:
        curve = read(data, stiffness=STIFFNESS, sensitivity=SENSITIVITY)
    except IndentSimError as error:
        pytest.fail(f"{error}\n{data[:400]!r}")
    for role, values in truth.items():
        found = getattr(curve, role)
        assert found is not None, curve.notes
        tolerance = DIGITS * float(np.ptp(values))
        assert np.abs(found - values).max() < tolerance, (role, curve.notes, data[:300])
    # The noise of the force is in the depth, whose largest value is some rows from the turn.
    assert abs(curve.parts["approach"].stop - instrument_exports.POINTS) < 20
    assert "retract" in curve.parts


BARE = "".join(f"{x:.6f}\t{max(x, 0.0) ** 1.5:.6f}\n" for x in np.linspace(-1, 2, 100))
FALLING = "".join(f"{-x:.6f}\t{max(x, 0.0) ** 1.5:.6f}\n" for x in np.linspace(-1, 2, 100))


@pytest.mark.parametrize(
    "title, name, unit, kind, part",
    [
        ("Defl_pN_Ex", "defl", "pN", "force", "approach"),
        ("Calc_Ramp_Rt_nm", "calc ramp", "nm", "length", "retract"),
        ("height (measured & smoothed) [m]", "height (measured & smoothed)", "m", "length", ""),
        ("Extend T-B(V)", "t-b", "V", "voltage", "approach"),
        ("Time_S", "time", "s", "time", ""),
        ("Eindringtiefe / µm", "eindringtiefe", "µm", "length", ""),
        ("Kraft in nN", "kraft", "nN", "force", ""),
        ("DFL Forward, nA", "dfl", "nA", "current", "approach"),
        ("approach", "approach", "", "", ""),
        ("Loading rate", "loading rate", "", "", ""),
        ("DeflV", "deflv", "V", "voltage", ""),
    ],
)
def test_titles(title, name, unit, kind, part):
    parsed = parse_title(title)
    assert (parsed.name, parsed.unit, parsed.kind, parsed.part) == (name, unit, kind, part)


@pytest.mark.parametrize(
    "line, stiffness, sensitivity",
    [
        ("# springConstant: 0.0122", 0.0122, None),
        ('"\\Spring Constant: 0.07444"', 0.07444, None),
        ("k (N/m)\t0,019", 0.019, None),
        ("Spring Constant: 40 mN/m", 0.04, None),
        ("Force Constant, nN/nm:\t1.5", 1.5, None),
        ('"\\@Sens. DeflSens: V 36.35 nm/V"', None, 36.35e-9),
        ("# sensitivity: 7.4E-8", None, 7.4e-8),
        ("InvOLS: 5e-8", None, 5e-8),
        ("Deflection sensitivity (nm/V): 50", None, 50e-9),
        ("\\X sensitivity: 20.3268", None, None),
        ("\\Deflection Sensitivity Correction: 1.08", None, None),
        ("k: 3", None, None),
        ("sensitivity: 50", None, None),
    ],
)
def test_calibration_of_a_header(line, stiffness, sensitivity):
    calibration = read_calibration([line])
    assert calibration.stiffness == (stiffness and pytest.approx(stiffness, rel=1e-12))
    assert calibration.sensitivity == (sensitivity and pytest.approx(sensitivity, rel=1e-12))


def test_sensitivities():
    assert parse_sensitivity("50 nm/V") == (pytest.approx(5e-8), "voltage")
    assert parse_sensitivity("0.05um/mV") == (pytest.approx(5e-5), "voltage")
    assert parse_sensitivity("25 nm/nA") == (pytest.approx(25.0), "current")
    for text in ("50", "50 nN/V", "nm/V", "-5 nm/V", "50 nm/s"):
        with pytest.raises(ConfigError, match="not a length divided by a voltage"):
            parse_sensitivity(text)


def test_two_bare_columns_are_a_guess_that_is_said():
    assert read(BARE).is_abscissa_guessed
    curve = read(FALLING)
    note = "column 1 falls while the force rises: it is taken as the tip-sample separation"
    assert note in curve.notes
    assert np.all(np.diff(curve.delta) > 0)
    assert not read(BARE, columns=["1", "2"]).is_abscissa_guessed
    assert "the file has no unit of force: nN is assumed, the unit of the scene" in curve.notes


@pytest.mark.parametrize("titles", ["Distance (um)\tForce (nN)", "[um]\t[nN]"])
def test_a_length_without_a_name_is_a_guess(titles):
    assert read(f"{titles}\n{BARE}").is_abscissa_guessed
    assert not read(f"Depth (um)\tForce (nN)\n{BARE}").is_abscissa_guessed


def test_titles_of_other_columns_are_refused():
    for text in ("z (um)\tF (nN)\tComment\n" + BARE, "z (um),F (nN)\n" + "0,1,2,5\n" * 50):
        with pytest.raises(NoCurve, match=r"are not those of \d columns"):
            read(text)


def test_lines_of_units_below_each_other():
    curve = read("z\tF\n(nm)\t(pN)\n\t\n(raw)\t(raw)\n" + BARE)
    assert curve.z.max() == pytest.approx(2e-3)
    assert curve.force.max() == pytest.approx(1e-3 * 2.0**1.5, rel=1e-6)


def test_a_length_is_never_read_as_a_force():
    text = "z (nm)\tDefl (nm)\n" + BARE
    for columns in (None, ["1", "2"], ["z=1", "force=2"], ["z=1", "deflection=2"]):
        with pytest.raises(Uncalibrated, match="deflection in nm: lacks spring constant: --set"):
            read(text, columns=columns)
        curve = read(text, columns=columns, stiffness=STIFFNESS)
        # 20 pN/nm
        expected = np.maximum(np.linspace(-1, 2, 100), 0.0) ** 1.5 * 0.02
        assert curve.force == pytest.approx(expected, abs=1e-7)
        assert curve.z is not None
        assert any("0.02 N/m (scene)" in note for note in curve.notes)


def test_what_is_missing_is_named():
    volts = "z (nm)\tDefl (V)\n" + BARE
    with pytest.raises(Uncalibrated, match=r"lacks spring constant, sensitivity: --set .*--sens"):
        read(volts)
    with pytest.raises(Uncalibrated, match="lacks sensitivity: --sensitivity '50 nm/V'"):
        read(volts, stiffness=STIFFNESS)
    with pytest.raises(NoCurve, match="no unit: give it with --units deflection=nm"):
        read("z (nm)\tDefl\n" + BARE, stiffness=STIFFNESS)
    with pytest.raises(NoCurve, match=r"the unit 'foo' of column 'Load .foo.' is unknown"):
        read("z (nm)\tLoad (foo)\n" + BARE, columns=["z=1", "force=2"])
    with pytest.raises(NoCurve, match=r"3 columns without a header.*--columns z=1,deflection=2"):
        read(BARE.replace("\n", "\t1\n"))


@pytest.mark.parametrize(
    "columns, problem",
    [
        (["z=1", "weight=2"], "there is no role 'weight'"),
        (["z=1", "2"], "only some of the columns have the form ROLE=COLUMN"),
        (["z=1", "z=2"], "there are two columns of z"),
        (["z=1", "depth=1"], "no column of force"),
        (["z=1", "force=7"], "there is no column '7'"),
        (["depth=2", "force=1"], "is in nN, which is not a unit of depth"),
    ],
)
def test_roles_that_cannot_be(columns, problem):
    with pytest.raises(ConfigError, match=problem):
        read("z (nm)\tForce (nN)\n" + BARE, columns=columns)


def test_a_force_is_used_beside_a_deflection():
    text = "z (nm)\tDefl (V)\tForce (nN)\n" + BARE.replace("\t", "\t5\t")
    curve = read(text, columns=["z=1", "deflection=2", "force=3"])
    assert curve.force.max() == pytest.approx(2.0**1.5, rel=1e-6)
    assert read(text).force.max() == pytest.approx(2.0**1.5, rel=1e-6)


def test_a_phase_is_no_segment():
    rows = "".join(f"{line}\t{k / 7:.3f}\n" for k, line in enumerate(BARE.splitlines()))
    curve = read("z (um)\tForce (nN)\tPhase\n" + rows)
    assert curve.parts == {"approach": slice(0, 100)}
    assert any("names a part" in note for note in curve.notes)
    assert not read("z (um)\tForce (nN)\tPhase (deg)\n" + rows).notes


def test_a_minus_turns_the_sign_of_a_column():
    text = "z (um)\tForce (nN)\n" + BARE.replace("\t", "\t-")
    curve = read(text, columns=["z=z", "force=-Force"])
    assert curve.force[-1] == pytest.approx(2.0**1.5, rel=1e-6)


@pytest.mark.parametrize(
    "number, value",
    [
        ("1.234,5", 1234.5),
        ("1.234.567,5", 1234567.5),
        ("1'234.5", 1234.5),
        ("1\u00a0234,5", 1234.5),
        ("1,234.5", 1234.5),
        ("0,234", 0.234),
    ],
)
def test_thousands_marks_and_decimal_signs(number, value):
    rows = "".join(f"{number}\t{k}\n" for k in range(50))
    assert read("z (um)\tForce (nN)\n" + rows).z[0] in (value, -value)


def test_signs_that_contradict_each_other():
    rows = "".join(f"1,25\t{k}.5\n" for k in range(50))
    with pytest.raises(NoCurve, match="some numbers have a decimal point and others a decimal"):
        read("z (um)\tForce (nN)\n" + rows)


def test_a_retraction_is_told_by_time():
    x = np.linspace(2, -1, 100)
    text = "z (um),Force (nN),Time (s)\n" + "".join(
        f"{a:.6f},{max(a, 0.0) ** 1.5:.6f},{k}\n" for k, a in enumerate(x)
    )
    assert read(text).parts == {"retract": slice(0, 100)}
    order = np.random.default_rng(0).permutation(100)
    lines = text.splitlines()
    mixed = "\n".join([lines[0], *(lines[1 + k] for k in order)])
    assert read(mixed).z == pytest.approx(read(text).z)
    assert "the rows are sorted by time" in read(mixed).notes


def test_hostile_lines_take_no_time():
    blank = "z" + " " * 90_000 + "(nm)\tF" + "(" * 5_000 + "\n"
    for text in (blank + BARE, "#" * 1_000_000 + "\n" + BARE, BARE + "eoh\n" * 30_000):
        try:
            read(text, stiffness=STIFFNESS)
        except IndentSimError as error:
            assert str(error)
