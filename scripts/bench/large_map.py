#!/usr/bin/env python3
"""Measures the fit of a large map: CPU time, memory, coverage of the intervals, and refusals.

usage: scripts/bench/large_map.py [--rows N] [--columns N] [--points N] [--spring]

The map is a gel on glass under a bead: 2 kPa with discs of 0.8, 5 and 8 kPa, and a thickness from
2.4 to 5.8 um that is known for every pixel. Each curve has its own contact point and baseline, and
noise of 1 % of its largest force, half of which is correlated over ten samples. 1 % of the curves
have no contact, and 0.5 % are saturated. The forces are those of a solution for each hundredth of a
micrometre of thickness; the fit interpolates between fewer ones.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.fitting.curve_fit import FitRequest
from indent_sim.fitting.forward_model.forward_model import ForwardModel
from indent_sim.fitting.map_estimate import fit_map
from indent_sim.fitting.map_fit import REASONS, SATURATED
from indent_sim.fitting.map_result import MapFit
from indent_sim.fitting.map_thickness import Thickness
from indent_sim.process.usage import current_memory, peak_memory, reset_peak_memory
from indent_sim.results.measured.measured_map import MeasuredMap
from indent_sim.results.measured.measurement import MeasuredCurve

NOISE_LEVEL = 0.01
STIFFNESS = 20.0  # nN/um: twice as compliant as the gel at the largest depth
MAX_DEPTH = 1.2  # um


@dataclass(frozen=True)
class SyntheticMap:
    """Depths (n,) [um], forces (N, n) [nN] and the truth of each pixel (N,)."""

    x: np.ndarray
    force: np.ndarray
    modulus: np.ndarray
    contact_point: np.ndarray
    thickness: np.ndarray
    is_dead: np.ndarray
    is_saturated: np.ndarray


def scene(height: float, has_spring: bool) -> dict[str, object]:
    """Return the scene with a layer of this height [um]."""
    document: dict[str, object] = {
        "units": {"length": "um", "force": "nN"},
        "body": {"shape": "layer", "height": height},
        "material": {"model": "linear_elastic", "E": 2.0, "nu": 0.5},
        "indenter": {"shape": "sphere", "R": 5.0},
        "loading": {"delta": 0.5},
    }
    spring = {"experiment": {"cantilever": {"stiffness": STIFFNESS}}}
    return document | (spring if has_spring else {})


def make_map(rows: int, columns: int, points: int, has_spring: bool) -> SyntheticMap:
    """Return the map."""
    draw = np.random.default_rng(3)
    count = rows * columns
    y, x = np.mgrid[:rows, :columns].reshape(2, -1) / max(rows, columns)
    modulus = np.full(count, 2.0)
    for centre, radius, value in (((0.3, 0.3), 0.15, 8.0), ((0.7, 0.3), 0.15, 5.0)):
        modulus[np.hypot(x - centre[0], y - centre[1]) < radius] = value
    modulus[np.hypot(x - 0.5, y - 0.75) < 0.15] = 0.8
    thickness = np.round(4.1 + 1.7 * np.sin(7.0 * x + 2.0 * y) * np.cos(5.0 * y), 2)
    contact_point = draw.uniform(-0.05, 0.05, count)
    end = 1.5 if has_spring else 0.55
    path = np.linspace(-1.4 * end, end, points)
    force = np.zeros((count, points))
    for height in np.unique(thickness):
        config = config_from_mapping(scene(float(height), has_spring))
        model = ForwardModel(config, ["material.E"], MAX_DEPTH)
        pixels = np.flatnonzero(thickness == height)
        depth = path - contact_point[pixels, None]
        force[pixels] = model(np.log(modulus[pixels, None]), depth)
    scale = force.max(axis=1, keepdims=True)
    rho = np.exp(-1.0 / 10.0)
    is_dead = draw.random(count) < 0.01
    is_saturated = ~is_dead & (draw.random(count) < 0.005)
    force[is_dead] = 0.0
    for first in range(0, count, 1000):
        block = slice(first, first + 1000)
        white = draw.standard_normal((2, *force[block].shape))
        coloured = np.sqrt(1.0 - rho**2) * lfilter([1.0], [1.0, -rho], white[1], axis=1)
        force[block] += NOISE_LEVEL * scale[block] * np.sqrt(0.5) * (white[0] + coloured)
    force += scale * (draw.uniform(-0.5, 0.5, (count, 1)) + 0.05 * path / end)
    for pixel in np.flatnonzero(is_saturated):
        curve = force[pixel]
        np.minimum(curve, np.quantile(curve, 0.9), out=curve)
    return SyntheticMap(path, force, modulus, contact_point, thickness, is_dead, is_saturated)


def main() -> None:
    """Make a map, fit it, and print what was found."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rows", type=int, default=320)
    parser.add_argument("--columns", type=int, default=313)
    parser.add_argument("--points", type=int, default=600)
    parser.add_argument("--spring", action="store_true", help="the map is measured behind a spring")
    options = parser.parse_args()
    shape = (options.rows, options.columns)
    start = time.process_time()
    truth = make_map(*shape, options.points, options.spring)
    print(f"{len(truth.force)} curves of {options.points} points made", flush=True)
    print(f"CPU time of their making: {time.process_time() - start:.0f} s", flush=True)
    places = np.column_stack(np.divmod(np.arange(len(truth.force)), shape[1]))

    def read_curve(index: int) -> MeasuredCurve:
        depth, z = (None, truth.x) if options.spring else (truth.x, None)
        parts = {"approach": slice(0, len(truth.x))}
        return MeasuredCurve(str(index), truth.force[index], depth, z, parts=parts)

    curves = MeasuredMap(shape, None, places, read_curve, units={})
    request = FitRequest(config_from_mapping(scene(4.1, options.spring)), ("material.E",))
    data = current_memory()
    reset_peak_memory()
    start = time.process_time()
    found, sample = fit_map(
        curves, request, Thickness(values=truth.thickness.reshape(shape)), tell=_print_line
    )
    seconds = time.process_time() - start
    one_by_one = sum(fit.entry["seconds"] for fit in sample)
    print(f"CPU time: {seconds:.1f} s, of which {one_by_one:.1f} s for {len(sample)} single curves")
    print(f"CPU time per curve without these: {1e3 * (seconds - one_by_one) / len(curves):.2f} ms")
    print(f"memory above the data: {peak_memory() - data:.0f} MB")
    for line in report_lines(truth, found):
        print(line)


def _print_line(line: str) -> None:
    print(f"  {line}", flush=True)


def report_lines(truth: SyntheticMap, found: MapFit) -> list[str]:
    """Return sentences on coverage and refusals."""
    reason = found.reason.ravel()
    is_good = ~(truth.is_dead | truth.is_saturated)
    fitted = is_good & (reason == 0)

    def share(values: np.ndarray, where: np.ndarray) -> str:
        return f"{100.0 * np.mean(values[where]):.1f} %"

    def covers(low: np.ndarray, high: np.ndarray, value: np.ndarray) -> np.ndarray:
        covered: np.ndarray = (low.ravel() <= value) & (value <= high.ravel())
        return covered

    modulus = covers(found.low, found.high, truth.modulus)
    pixels: dict[str, np.ndarray] = found.pixels
    contact = covers(pixels["contact_point_low"], pixels["contact_point_high"], truth.contact_point)
    half = 0.5 * (found.high - found.low) / found.value
    lines = [
        f"coverage: modulus {share(modulus, fitted)}, contact point {share(contact, fitted)}",
        f"half width: {100.0 * np.nanmedian(half):.1f} % in the median",
        f"no contact: {share(reason > 0, truth.is_dead)} of {truth.is_dead.sum()} refused",
        f"saturated: {share(reason == SATURATED, truth.is_saturated)} of "
        f"{truth.is_saturated.sum()} refused as saturated",
        f"good ones: {np.count_nonzero(is_good & (reason != 0))} of {is_good.sum()} refused",
    ]
    for value in np.unique(truth.modulus):
        where = fitted & (truth.modulus == value)
        median = np.nanmedian(found.value.ravel()[where])
        lines.append(f"E = {value} kPa: coverage {share(modulus, where)}, median {median:.4f} kPa")
    wrong = [REASONS[code] for code in np.unique(reason[is_good & (reason > 0)])]
    return [*lines, *(f"reason of a good one: {text}" for text in wrong)]


if __name__ == "__main__":
    main()
