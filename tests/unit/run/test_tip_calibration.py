"""Area functions from curves of fused silica, drift from a hold, and a second implementation."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from indentation_loops import DIAMOND, FUSED_SILICA, GPA, Loop, Sample, loop
from oliver_pharr_again import oliver_pharr

from indent_sim.process.errors import ConfigError, UsageError
from indent_sim.run.hardness_analysis import HardnessOptions, analyse
from indent_sim.run.tip_calibration import TipCalibration, calibrate_tip, write_table

# Depth [nm] by which the apex of a worn Berkovich tip is lower.
BLUNTING = 15.0


def worn_area(h_c: np.ndarray) -> np.ndarray:
    """Area [nm^2] of a worn Berkovich tip, 24.494 h (h + 2 BLUNTING)."""
    return np.asarray(24.494 * h_c * (h_c + 2 * BLUNTING))


def written(folder: Path, loops: dict[str, Loop]) -> list[Path]:
    paths = []
    for name, made in loops.items():
        path = folder / f"{name}.csv"
        rows = zip(made.t, made.h, made.F, strict=True)
        lines = [f"{t},{h},{F}" for t, h, F in rows]
        path.write_text("\n".join(["Time [s],Depth [nm],Load [mN]", *lines, ""]))
        paths.append(path)
    return paths


def with_worn_tip(sample: Sample, F_max: float) -> Loop:
    """Return a loop at the contact depth of the worn tip, with the stiffness of the area."""
    sharp = loop(sample, F_max=F_max, creep=1e-3)
    shift = sqrt(BLUNTING**2 + F_max / (sample.H * GPA) / 24.494) - BLUNTING - sharp.h_c
    top = int(np.argmax(sharp.F))
    loading = sharp.h[:top] * (1 + shift / sharp.h_max)
    return replace(sharp, h=np.concatenate([loading, sharp.h[top:] + shift]))


FORCES = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0)


def calibrated(folder: Path, **options: Any) -> TipCalibration:
    loops = {f"fs{k}": with_worn_tip(FUSED_SILICA, F) for k, F in enumerate(FORCES)}
    return calibrate_tip(written(folder, loops), "72 GPa,0.17", HardnessOptions(**options))


def test_the_area_of_a_worn_tip_comes_back(tmp_path: Path) -> None:
    """The worn tip is a sum of the function's first two terms, which are found to 1e-3.

    The stiffness of each loop follows from its power law to 2e-4, the area to twice of that.
    """
    found = calibrated(tmp_path)
    assert found.A_p == pytest.approx(worn_area(found.h_c), rel=1e-3)
    h_c = np.geomspace(found.h_c.min(), found.h_c.max(), 50)
    assert found.area(h_c) == pytest.approx(worn_area(h_c), rel=2e-3)
    assert found.scatter < 1e-3 and not found.warnings


def test_the_table_is_an_area_function(tmp_path: Path) -> None:
    """A hard steel measured with the worn tip and the table has its own E and H.

    The ideal tip gives values that are wrong by a fifth.
    """
    table = tmp_path / "area.csv"
    write_table(calibrated(tmp_path), table)
    steel = Sample(E=210.0, H=8.0, nu=0.3, m=1.5)
    (path,) = written(tmp_path, {"steel": with_worn_tip(steel, 3.0)})
    good = analyse(path, HardnessOptions(area=str(table), nu=0.3))
    assert good.values["H_IT"] == pytest.approx(8.0, rel=3e-3)
    assert good.values["E_IT"] == pytest.approx(210.0, rel=3e-3)
    ideal = analyse(path, HardnessOptions(nu=0.3))
    assert ideal.values["H_IT"] > 1.1 * 8.0
    with pytest.raises(ConfigError, match="is not replaced"):
        write_table(calibrated(tmp_path), table)


def test_calibrations_that_are_refused(tmp_path: Path) -> None:
    few = written(tmp_path, {"a": loop(FUSED_SILICA), "b": loop(FUSED_SILICA, F_max=1.0)})
    with pytest.raises(UsageError, match="at least 3"):
        calibrate_tip(few, "72 GPa,0.17", HardnessOptions())
    with pytest.raises(ConfigError, match="is not a sample"):
        calibrate_tip([*few, few[0]], "silica", HardnessOptions())
    micron = tmp_path / "um.csv"
    cells = [line.split(",") for line in few[0].read_text().splitlines()[1:]]
    micron.write_text(
        "Time [s],Depth [um],Load [mN]\n"
        + "".join(f"{t},{float(h) / 1e3},{F}\n" for t, h, F in cells)
    )
    with pytest.raises(UsageError, match="different units"):
        calibrate_tip([*few, micron], "72 GPa,0.17", HardnessOptions())
    same = calibrate_tip([few[0]] * 3, "72 GPa,0.17", HardnessOptions())
    assert "span" in " ".join(same.warnings)


@pytest.mark.parametrize("rate", [0.2, -0.05])
def test_the_drift_is_that_of_the_hold(tmp_path: Path, rate: float) -> None:
    """A loop with a hold of 30 s at 10 % of the force drifts; the hold gives the rate.

    Noise of 0.2 nm over 480 samples of a hold of 24 s: the rate is known to 0.2/(480^0.5 7) nm/s,
    1.3e-3, and E to 0.3 %.
    """
    draw = np.random.default_rng(3)
    exact = loop(FUSED_SILICA)
    row = int(np.flatnonzero(0.1 * exact.F.max() < exact.F)[-1])
    held = 600

    def with_hold(values: np.ndarray) -> np.ndarray:
        return np.concatenate([values[:row], np.full(held, values[row]), values[row:]])

    t = 0.05 * np.arange(len(exact.F) + held)
    h = with_hold(exact.h) + rate * t + 0.2 * draw.standard_normal(len(t))
    F = with_hold(exact.F) + 2e-3 * draw.standard_normal(len(t))
    (path,) = written(tmp_path, {"drifting": replace(exact, t=t, h=h, F=F)})
    result = analyse(path, HardnessOptions(nu=0.17, drift="hold"))
    words = result.assumptions["drift"]
    assert float(words.split()[0]) == pytest.approx(rate, abs=5e-3)
    assert "at 10% of the largest force" in words and "nm/s" in words
    assert result.values["E_IT"] == pytest.approx(72, rel=1e-2)
    (plain,) = written(tmp_path, {"plain": exact})
    with pytest.raises(UsageError, match="needs a hold at 2 to 30 %"):
        analyse(plain, HardnessOptions(nu=0.17, drift="hold"))


def test_twenty_loops_agree_with_a_second_implementation(tmp_path: Path) -> None:
    """S, H and E of loops that are no power laws equal those of another program to 0.5 %.

    The loops recover along a parabola and a power law in changing proportions, so that S is that
    of a fit, not a constant of the loop. Without noise, both find the least squares of nearly the
    same samples; the weights of the two fits differ by at most 0.2 % of S.
    """
    draw = np.random.default_rng(11)
    for k in range(20):
        sample = Sample(
            E=float(np.exp(draw.uniform(np.log(3), np.log(400)))),
            H=0.0,
            nu=float(draw.uniform(0.15, 0.45)),
            m=float(draw.uniform(1.2, 1.8)),
        )
        E_r = 1 / ((1 - sample.nu**2) / sample.E + 1 / DIAMOND)
        sample = replace(sample, H=E_r * float(np.exp(draw.uniform(np.log(0.01), np.log(0.12)))))
        made = loop(sample, F_max=float(np.exp(draw.uniform(np.log(0.5), np.log(300)))))
        top = int(np.argmax(made.F.max() <= made.F)) + 99
        recovered = (made.h_max - made.h[top:]) / (made.h_max - made.h_f)
        mixed = 0.15 * recovered * (1 - recovered)
        h = made.h.copy()
        h[top:] -= mixed * (made.h_max - made.h_f)
        (path,) = written(tmp_path, {f"loop{k}": replace(made, h=h)})
        found = analyse(path, HardnessOptions(nu=sample.nu)).values
        again = oliver_pharr(h, made.F, sample.nu)
        for name in ("S", "h_c", "H_IT", "E_IT"):
            assert found[name] == pytest.approx(again[name], rel=5e-3), (k, name)
