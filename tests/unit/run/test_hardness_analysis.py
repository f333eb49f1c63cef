"""Hardness and modulus of synthetic tests, corrections, area functions, units and refusals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from indentation_loops import FUSED_SILICA, STEEL, Loop, Sample, loop

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.process.errors import ConfigError, IndentSimError, UsageError
from indent_sim.run.hardness_analysis import Hardness, HardnessOptions, analyse

TITANIUM = Sample(E=116.0, H=3.2, nu=0.32, m=1.7)


def analysed(folder: Path, made: Loop | str, **options: Any) -> Hardness:
    """Analyse a test, written as a text file."""
    file = folder / "test.csv"
    file.write_text(made if isinstance(made, str) else made.table())
    return analyse(file, HardnessOptions(**options))


def value(result: Hardness, name: str) -> float:
    number = result.values[name]
    assert number is not None
    return number


@pytest.mark.parametrize("sample", [FUSED_SILICA, STEEL, TITANIUM], ids=["silica", "steel", "Ti"])
@pytest.mark.parametrize("hold_rows", [0, 100])
def test_the_properties_come_back(tmp_path: Path, sample: Sample, hold_rows: int) -> None:
    """H_IT, E_IT, S, m and the depths are those that the test was made from.

    The file has depths to 1e-3 nm and forces to 1e-5 mN; over the recovered 50 nm of steel these
    are 1e-4 of the stiffness.
    """
    exact = loop(sample, hold_rows=hold_rows)
    result = analysed(tmp_path, exact, nu=sample.nu)
    assert result.units["H_IT"] == "GPa" and result.units["S"] == "mN/nm"
    wanted = {
        "H_IT": sample.H,
        "E_IT": sample.E,
        "S": exact.S,
        "m": sample.m,
        "h_max": exact.h_max,
        "h_c": exact.h_c,
        "h_f": exact.h_f,
        "h_p": exact.h_f,
        "h_r": exact.h_max - 10 / exact.S,
    }
    for name, number in wanted.items():
        assert value(result, name) == pytest.approx(number, rel=2e-3), name


@pytest.mark.parametrize("hold_rows", [0, 100])
def test_the_stated_errors_hold_with_noise(tmp_path: Path, hold_rows: int) -> None:
    """95 % intervals contain the properties as often as that.

    Of 40 draws the fraction has a standard deviation of 3.4 %: 85 % is three of them below. For
    fused silica at a noise of 0.3 nm and 0.05 % of the force, errors of H and E are about 1 %.
    """
    exact = loop(FUSED_SILICA, hold_rows=hold_rows)
    draw = np.random.default_rng(5)
    wanted = {"H_IT": 9.3, "E_IT": 72.0, "S": exact.S, "m": 1.27, "h_c": exact.h_c}
    inside = []
    for _ in range(40):
        white = draw.standard_normal((2, len(exact.h)))
        test = replace(exact, h=exact.h + 0.3 * white[0], F=exact.F + 0.005 * white[1])
        result = analysed(tmp_path, test, nu=0.17)
        errors = {name: result.errors[name] or 0.0 for name in wanted}
        inside.append([abs(value(result, name) - wanted[name]) < errors[name] for name in wanted])
        assert errors["H_IT"] < 0.02 * 9.3 and errors["E_IT"] < 0.02 * 72
    assert np.mean(inside, axis=0).min() > 0.85


def test_numbers_do_not_depend_on_the_units(tmp_path: Path) -> None:
    exact = loop(FUSED_SILICA)
    nm = analysed(tmp_path, exact, nu=0.17)
    rows = "\n".join(f"{h / 1e3:.9f};{1e3 * F:.9f}" for h, F in zip(exact.h, exact.F, strict=True))
    um = analysed(tmp_path, f"Depth [um];Load [uN]\n{rows}\n", nu=0.17)
    assert um.units["E_IT"] == "MPa" and um.units["S"] == "uN/um" and um.units["A_p"] == "um^2"
    for name, factor in {"E_IT": 1e3, "H_IT": 1e3, "S": 1e6, "A_p": 1e-6, "m": 1.0}.items():
        assert value(um, name) == pytest.approx(factor * value(nm, name), rel=1e-4)


def test_a_file_without_units_has_no_diamond(tmp_path: Path) -> None:
    """H_IT is force over length^2 of the file; E_IT needs the tip in the same units."""
    table = loop(FUSED_SILICA).table().replace("[nm]", "").replace("[mN]", "")
    plain = analysed(tmp_path, table)
    assert value(plain, "H_IT") == pytest.approx(9.3e-6, rel=2e-3)
    assert plain.values["E_IT"] is None and "no units" in " ".join(plain.warnings)
    given = analysed(tmp_path, table, nu=0.17, units={"length": "nm", "force": "mN"})
    assert value(given, "E_IT") == pytest.approx(72, rel=2e-3)
    tip = analysed(tmp_path, table, nu=0.17, tip="1141e-6,0.07")
    assert value(tip, "E_IT") == pytest.approx(72e-6, rel=2e-3)


def test_frame_and_drift_are_subtracted(tmp_path: Path) -> None:
    """A deflection of 0.5 nm/mN and a drift of 0.2 nm/s are removed from the depth."""
    exact = loop(FUSED_SILICA)
    moved = replace(exact, h=exact.h + 0.5 * exact.F + 0.2 * exact.t)
    wrong = analysed(tmp_path, moved, nu=0.17)
    assert abs(value(wrong, "E_IT") / 72 - 1) > 0.02
    for compliance, drift in (
        ("0.5", "0.2"),
        ("0.5 nm/mN", "0.2 nm/s"),
        ("0.5e6 nm/kN", "2e-4 um/s"),
    ):
        right = analysed(tmp_path, moved, nu=0.17, frame_compliance=compliance, drift=drift)
        assert value(right, "E_IT") == pytest.approx(72, rel=2e-3)
        assert right.assumptions["frame compliance"] == "0.5 nm/mN"
    scene = {
        "units": {"length": "um", "force": "mN"},
        "body": {"shape": "half_space"},
        "material": {"model": "linear_elastic", "E": 72, "nu": 0.17},
        "indenter": {"shape": "berkovich"},
        "loading": {"delta": 0.1},
        "experiment": {"frame": {"compliance": 0.5e-3}},
    }
    of_scene = analysed(tmp_path, moved, scene=config_from_mapping(scene), drift="0.2")
    assert value(of_scene, "E_IT") == pytest.approx(72, rel=2e-3)
    assert of_scene.assumptions["nu"] == "0.17, of the scene"


def test_creep_that_goes_on_in_unloading(tmp_path: Path) -> None:
    """Its rate makes unloading steeper, by as much as the warning says.

    The depth grows at the constant rate of the end of the hold in a loop that is made without
    creep. 0.3 nm/s at 1 mN/s and S = 0.09 mN/nm are some 2 to 3 %.
    """
    exact = loop(FUSED_SILICA, hold_rows=100, creep=1e-9)
    moved = replace(exact, h=exact.h + 0.3 * np.maximum(exact.t - exact.t[200], 0.0))
    slow = analysed(tmp_path, moved, nu=0.17)
    assert value(slow, "dh_dt") == pytest.approx(0.3, rel=5e-3)
    assert slow.units["dh_dt"] == "nm/s"
    (warning,) = [text for text in slow.warnings if "hold longer" in text]
    said = float(warning.split("S is ")[1].split(" %")[0])
    assert said == pytest.approx(100 * (value(slow, "S") / exact.S - 1), abs=0.2)
    assert said > 1.0
    assert "hold longer" not in " ".join(analysed(tmp_path, exact, nu=0.17).warnings)


def test_the_rate_of_creep_of_a_run(tmp_path: Path) -> None:
    """Rows in time have it as well; the root of the time at 20 rows of a hold is known to 2 %."""
    made = loop(FUSED_SILICA, rows=30, hold_rows=20, creep=0.02)
    columns = (made.t[1:], made.h[1:], made.F[1:])
    rows = zip(*(column.tolist() for column in columns), strict=True)
    lines = [f"{k},{t},{h},{F},{0.5 * h}" for k, (t, h, F) in enumerate(rows, 1)]
    table = tmp_path / "force_indentation.csv"
    table.write_text("\n".join(["step,t,delta,force,a", *lines, ""]))
    found = analyse(table, HardnessOptions(area="berkovich", nu=0.17))
    mean_rate = (made.h_max - made.hold_start) / 1.0
    assert value(found, "dh_dt") == pytest.approx(3 * (1 - (2 / 3) ** 0.5) * mean_rate, rel=0.02)


def test_a_wrong_poisson_ratio_is_named(tmp_path: Path) -> None:
    """Behind a diamond tip E_IT follows 1 - nu^2 exactly."""
    exact = loop(FUSED_SILICA)
    assumed = analysed(tmp_path, exact)
    assert "0.3 is assumed" in " ".join(assumed.warnings)
    assert value(assumed, "E_IT") == pytest.approx(72 * (1 - 0.09) / (1 - 0.17**2), rel=2e-3)


def test_area_functions(tmp_path: Path) -> None:
    """A table, a cone of equal area and the ideal pyramids: A = 24.494 and 24.504 h_c^2."""
    exact = loop(FUSED_SILICA)
    h_c = exact.h_c
    angle = np.degrees(np.arctan(np.sqrt(24.494 / np.pi)))
    assert analysed(tmp_path, exact, area="berkovich").values["A_p"] == pytest.approx(
        24.494 * h_c**2, rel=1e-3
    )
    assert analysed(tmp_path, exact, area="vickers").values["A_p"] == pytest.approx(
        24.504 * h_c**2, rel=1e-3
    )
    assert analysed(tmp_path, exact, area=f"{angle} deg").values["A_p"] == pytest.approx(
        24.494 * h_c**2, rel=1e-3
    )
    depths = np.linspace(50, 400, 8)
    table = tmp_path / "area.csv"
    for head, factor in (("h_c,A", 1.0), ("h_c [um],A [um^2]", 1e-3)):
        rows = (f"{factor * h},{factor**2 * 25 * h**2}" for h in depths)
        table.write_text("\n".join([head, *rows, ""]))
        result = analysed(tmp_path, exact, area=str(table), nu=0.17)
        assert value(result, "A_p") == pytest.approx(25 * value(result, "h_c") ** 2, rel=1e-9)


def test_a_blunt_tip_is_pointed_out(tmp_path: Path) -> None:
    shallow = analysed(tmp_path, loop(FUSED_SILICA, F_max=1.0))
    assert "apex radius of 150 nm" in " ".join(shallow.warnings)
    deep = analysed(tmp_path, loop(FUSED_SILICA, F_max=5000.0))
    assert "apex radius" not in " ".join(deep.warnings)


def test_epsilon_of_the_exponent(tmp_path: Path) -> None:
    """For m = 1.5 the value that belongs to m is the usual 0.75."""
    exact = loop(STEEL)
    usual, own = (analysed(tmp_path, exact, epsilon=text) for text in ("0.75", "m"))
    assert value(own, "h_c") == pytest.approx(value(usual, "h_c"), rel=1e-4)


def test_a_curve_that_ends_under_load(tmp_path: Path) -> None:
    """The power law completes the work from 10 % of the force, and nothing from 30 %."""
    whole = analysed(tmp_path, loop(FUSED_SILICA))
    ended = analysed(tmp_path, loop(FUSED_SILICA, last=0.1))
    assert value(ended, "eta_IT") == pytest.approx(value(whole, "eta_IT"), rel=1e-3)
    assert (ended.errors["eta_IT"] or 0) > 0.3 and ended.values["h_p"] is None
    cut = analysed(tmp_path, loop(FUSED_SILICA, last=0.3))
    assert cut.values["eta_IT"] is None and "unloading ends at 30%" in " ".join(cut.warnings)


def test_a_depth_not_counted_from_contact_is_pointed_out(tmp_path: Path) -> None:
    exact = loop(FUSED_SILICA)
    late = analysed(tmp_path, replace(exact, h=exact.h + 60))
    assert "not counted from first contact" in " ".join(late.warnings)
    air = np.linspace(-80, -5, 60)
    longer = replace(
        exact,
        t=0.05 * np.arange(60 + len(exact.t)),
        h=np.concatenate([air, exact.h]),
        F=np.concatenate([0 * air, exact.F]) + 0.5,
    )
    assert "subtract the baseline" in " ".join(analysed(tmp_path, longer).warnings)


REFUSED: dict[str, tuple[dict[str, Any], type[IndentSimError], str]] = {
    "area": ({"area": "cubic"}, ConfigError, "neither a file nor a tip"),
    "angle": ({"area": "90"}, ConfigError, "not between 1 and 89"),
    "epsilon": ({"epsilon": "2"}, ConfigError, "between 0 and 1"),
    "epsilon nan": ({"epsilon": "nan"}, ConfigError, "between 0 and 1"),
    "nu": ({"nu": 0.6}, ConfigError, "must lie in"),
    "tip": ({"tip": "steel"}, ConfigError, "give diamond, rigid, or E,NU"),
    "soft tip": ({"tip": "50 GPa,0.3"}, UsageError, "not below the modulus"),
    "tip of a length": ({"tip": "5 nm,0.3"}, ConfigError, "is a length, not a pressure"),
    "compliance": ({"frame_compliance": "-1"}, ConfigError, "must not be negative"),
    "too compliant": ({"frame_compliance": "50"}, UsageError, "must be positive"),
    "drift": ({"drift": "fast"}, ConfigError, "not a number"),
    "beta": ({"beta": 0.0}, ConfigError, "between 0.5 and 2"),
    "per cents": ({"top": (98, 40)}, ConfigError, "two fractions"),
    "reversed": ({"top": (0.4, 0.98)}, ConfigError, "the larger one first"),
    "top": ({"top": (0.98, 0.97)}, UsageError, "at least 5 are needed"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_wrong_options_are_refused(tmp_path: Path, name: str) -> None:
    options, error, problem = REFUSED[name]
    with pytest.raises(error, match=problem):
        analysed(tmp_path, loop(FUSED_SILICA), **options)


@pytest.mark.parametrize(
    ("sample", "problem"),
    [
        (Sample(72.0, 9.3, 0.17, m=0.8), "exponent of unloading is m = 0.8"),
        (Sample(72.0, 9.3, 0.17, m=3.0), "exponent of unloading is m = 3"),
    ],
)
def test_an_exponent_of_no_contact_is_refused(tmp_path: Path, sample: Sample, problem: str) -> None:
    with pytest.raises(UsageError, match=problem):
        analysed(tmp_path, loop(sample))


def test_few_samples_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="at least 5 are needed"):
        analysed(tmp_path, loop(FUSED_SILICA, rows=7, hold_rows=0))


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "the file is empty"),
        ("h_c,A\n1,2\n", "at least two rows"),
        ("h_c,A\n1,2\n2,1\n", "increase from row to row"),
        ("h_c [nm],A\n100,2e5\n500,6e6\n", "all three or none"),
        ("h_c,A\n1,2\n2,8\n", "outside the range of the area function"),
        ("1,2,3\n2,8,3\n", "two columns"),
    ],
)
def test_wrong_area_tables_are_refused(tmp_path: Path, text: str, problem: str) -> None:
    (tmp_path / "area.csv").write_text(text)
    with pytest.raises(UsageError, match=problem):
        analysed(tmp_path, loop(FUSED_SILICA), area=str(tmp_path / "area.csv"))


def test_drift_needs_times(tmp_path: Path) -> None:
    exact = loop(FUSED_SILICA)
    rows = "\n".join(f"{h},{F}" for h, F in zip(exact.h, exact.F, strict=True))
    with pytest.raises(UsageError, match="needs the times"):
        analysed(tmp_path, f"depth [nm],load [mN]\n{rows}\n", drift="0.1")


def test_absurd_numbers_are_refused(tmp_path: Path) -> None:
    exact = loop(FUSED_SILICA)
    huge = replace(exact, h=1e60 * exact.h)
    with pytest.raises(UsageError, match="outside the range"):
        analysed(tmp_path, huge)
