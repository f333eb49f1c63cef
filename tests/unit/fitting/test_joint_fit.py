"""Fits of the loops of two cones together: intervals, contradictions, refusals, and the design.

Loops follow published formulas instead of runs.
"""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from loops_of_cones import KEYS, loop_of_angle, recorded, solved_by_formula

from indent_sim.cli import commands
from indent_sim.config.scene_file import config_from_mapping
from indent_sim.config.schema import Config
from indent_sim.fitting import design
from indent_sim.fitting.curve_fit import FitRequest, fit_curve
from indent_sim.fitting.forward_model import cone_loop
from indent_sim.fitting.forward_model.cone_loop import HARDENING_KEY, ConeLoop, Metal
from indent_sim.fitting.forward_model.forward_model_cache import ForwardModelCache
from indent_sim.fitting.forward_model.parameters import number_at
from indent_sim.fitting.inference.noise import NORMAL_95
from indent_sim.fitting.joint_fit import fit_together
from indent_sim.fitting.measured_constants import LOOP_RECOVERY_ERROR
from indent_sim.process.errors import ConfigError
from indent_sim.results.measured.measurement import MeasuredCurve

ALL_KEYS = (*KEYS, HARDENING_KEY)
ANGLES = (70.3, 50.0)
SHARP = "indenter.half_angle=50"
TRUTH = Metal(100.0, 0.8, 0.2)
# Errors of tabulated loops, as those of runs are.
C_ERROR = 0.006
S_ERROR = 0.009


def document(metal: Metal, half_angle: float = 70.3) -> dict[str, Any]:
    plasticity = {"yield_stress": metal.yield_stress, "hardening": {"n": metal.n}}
    return {
        "units": {"length": "um", "force": "mN"},
        "body": {"shape": "half_space"},
        "material": {"model": "hencky", "E": metal.E, "nu": 0.3, "plasticity": plasticity},
        "indenter": {"shape": "cone", "half_angle": half_angle},
        "loading": {"delta": 1.0, "steps": 20},
    }


SCENE = config_from_mapping(document(Metal(70.0, 1.0, 0.1)))
REQUEST = FitRequest(SCENE, ALL_KEYS, "both", other_tips=(SHARP,))


def tabulate_with_errors(monkeypatch: pytest.MonkeyPatch, draw: np.random.Generator | None) -> None:
    """Let the tables have their stated errors, drawn for each angle; None for exact tables."""
    drawn: dict[float, np.ndarray] = {}

    def solve(config: Config, depth: float) -> ConeLoop:
        exact = solved_by_formula(config, depth)
        angle = number_at(config, "indenter.half_angle")
        if angle not in drawn:
            drawn[angle] = np.zeros(3) if draw is None else draw.standard_normal(3)
        c, s, recovery = 1.0 + drawn[angle] / NORMAL_95 * [C_ERROR, S_ERROR, LOOP_RECOVERY_ERROR]
        return replace(
            exact,
            curvature=exact.curvature * c,
            stiffness=exact.stiffness * s,
            recovery=exact.recovery * recovery,
            curvature_error=C_ERROR,
            stiffness_error=S_ERROR,
        )

    monkeypatch.setattr(cone_loop, "solve_cone_loop", solve)


def loops(
    draw: np.random.Generator, metals: tuple[Metal, ...] = (TRUTH, TRUTH)
) -> list[MeasuredCurve]:
    pairs = zip(ANGLES, metals, strict=True)
    return [
        replace(recorded(loop_of_angle(metal, angle), metal.E, draw), name=f"cone {angle:g}")
        for angle, metal in pairs
    ]


def test_two_cones_tell_hardening(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both curves have the same intervals, which are narrower than those of one cone."""
    tabulate_with_errors(monkeypatch, None)
    curves = loops(np.random.default_rng(2))
    tables = ForwardModelCache()
    fits = fit_together(curves, REQUEST, tables)
    assert all(fit.is_done and fit.entry["explained"] for fit in fits), fits[0].entry
    one = fit_curve(curves[0], replace(REQUEST, other_tips=()), tables).entry
    for key, value in zip(ALL_KEYS, (TRUTH.E, TRUTH.yield_stress, TRUTH.n), strict=True):
        first, second = (fit.entry["parameters"][key] for fit in fits)
        assert first == second
        assert first["low"] < value < first["high"]
        alone = one["parameters"][key]
        assert first["high"] - first["low"] < 0.9 * (alone["high"] - alone["low"])
    words = fits[0].entry["words"]
    assert "with the loops of all tips together" in words and "One cone" not in words
    assert fits[0].entry["tied"][HARDENING_KEY] < 0.7 * one["tied"][HARDENING_KEY]
    assert fits[0].plotted is not None and fits[1].plotted is not None


@pytest.mark.verify
def test_the_intervals_contain_the_truth(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 40 draws of noise and of errors of the tables 95 %; 85 % is three deviations below.

    The probability that the tips contradict each other is then evenly distributed.
    """
    inside = []
    probabilities = []
    for seed in range(40):
        draw = np.random.default_rng(seed)
        tabulate_with_errors(monkeypatch, draw)
        entry = fit_together(loops(draw), REQUEST, ForwardModelCache())[0].entry
        assert entry["status"] == "done", entry
        found = [entry["parameters"][key] for key in ALL_KEYS]
        pairs = zip(found, (TRUTH.E, TRUTH.yield_stress, TRUTH.n), strict=True)
        inside.append([one["low"] < value < one["high"] for one, value in pairs])
        probabilities.append(entry["together"]["p"])
    assert np.mean(inside, axis=0).min() > 0.85
    assert 0.2 < np.median(probabilities) < 0.8
    assert min(probabilities) > 1e-4


def test_loops_of_two_metals_contradict_each_other(monkeypatch: pytest.MonkeyPatch) -> None:
    """Moduli that differ by a fifth are no error of the tables."""
    tabulate_with_errors(monkeypatch, None)
    curves = loops(np.random.default_rng(1), (TRUTH, replace(TRUTH, E=120.0)))
    for fit in fit_together(curves, REQUEST, ForwardModelCache()):
        assert fit.entry["cause"] == ["tips"] and not fit.entry["explained"]
        assert fit.entry["together"]["p"] < 1e-3


def test_the_design_of_a_second_cone_is_that_of_fits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Widths of predicted intervals and of fits with as many samples agree to 20 %."""
    tabulate_with_errors(monkeypatch, None)
    planned = design.design_measurement(config_from_mapping(document(TRUTH)), ALL_KEYS, 0.003, 800)
    second = planned.helps[-1]
    assert second.change == {"and indenter.half_angle": 50.0}
    draw = np.random.default_rng(3)
    found = fit_together(loops(draw), REQUEST, ForwardModelCache())[0].entry["parameters"]
    for key in ALL_KEYS:
        wanted = second.parameters[key].high - second.parameters[key].low
        assert found[key]["high"] - found[key]["low"] == pytest.approx(wanted, rel=0.2)


def test_what_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    tabulate_with_errors(monkeypatch, None)
    curves = loops(np.random.default_rng(0))
    tables = ForwardModelCache()
    for changes, problem in (
        ({"other_tips": ("material.nu=0.2",)}, "no key of the tip"),
        ({"curve_part": "approach"}, "loading and unloading"),
        ({"other_tips": ("indenter.shape=sphere",)}, r"indenter\.R: missing"),
        ({"other_tips": ("indenter={shape: sphere, R: 5}",)}, "needs a sharp cone"),
    ):
        with pytest.raises(ConfigError, match=problem):
            fit_together(curves, replace(REQUEST, **changes), tables)
    elastic = config_from_mapping(
        document(TRUTH) | {"material": {"model": "linear_elastic", "E": 1.0, "nu": 0.3}}
    )
    with pytest.raises(ConfigError, match="a body that yields"):
        fit_together(curves, replace(REQUEST, config=elastic, varied_keys=KEYS[:1]), tables)
    flat = replace(curves[1], force=0.0 * curves[1].force)
    rejected = fit_together([curves[0], flat], REQUEST, tables)
    assert all("cone 50" in fit.entry["reason"] for fit in rejected)


def test_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two files and --other-tip give a folder with both curves; a second call repeats nothing."""
    tabulate_with_errors(monkeypatch, None)
    monkeypatch.chdir(tmp_path)
    for name, curve in zip(("usual", "sharp"), loops(np.random.default_rng(4)), strict=True):
        assert curve.delta is not None
        rows = zip(curve.delta.tolist(), curve.force.tolist(), strict=True)
        lines = [f"{h},{F}" for h, F in rows]
        Path(f"{name}.csv").write_text("\n".join(["Depth [um],Load [mN]", *lines]))
    Path("scene.yaml").write_text(json.dumps(document(Metal(70.0, 1.0, 0.1))))
    words = ["fit", "usual.csv", "sharp.csv", "--scene", "scene.yaml", "--segment", "both"]
    words += [part for key in ALL_KEYS for part in ("--vary", key)]
    together = [*words, "--other-tip", SHARP, "--output", "out", "--json"]
    done = CliRunner().invoke(commands.program, together)
    assert done.exit_code == 0, done.stderr
    names = [entry["curve"] for entry in json.loads(done.stdout)["curves"]]
    assert names == ["usual", "sharp"]
    report = json.loads(Path("out/fit.json").read_text())
    assert report["request"]["other_tips"] == [SHARP]
    assert Path("out/curves/sharp.csv").exists() and Path("out/pictures/sharp.png").exists()
    again = CliRunner().invoke(commands.program, together)
    assert json.loads(again.stdout)["curves"] == json.loads(done.stdout)["curves"]
    alone = [word for word in together if word != "usual.csv"]
    alone[alone.index("out")] = "other"
    refused = CliRunner().invoke(commands.program, alone)
    assert refused.exit_code == 2 and "one curve for each tip" in refused.stderr
    for wrong, problem in (
        (["--jobs", "2"], "one fit"),
        (["--rows", "0:2"], "applies only to a map"),
        (["--map"], "a map is fitted to the approach"),
    ):
        refused = CliRunner().invoke(commands.program, [*together, *wrong])
        assert refused.exit_code == 2 and problem in refused.stderr, refused.stderr
    planned = ["fit", "--design", "scene.yaml", "--vary", KEYS[0], "--noise", "0.01"]
    refused = CliRunner().invoke(commands.program, [*planned, "--other-tip", SHARP])
    assert refused.exit_code == 2 and "takes no --other-tip" in refused.stderr
    assert math.isfinite(report["curves"][0]["together"]["p"])
