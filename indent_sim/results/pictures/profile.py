"""The deformed surface below the tip, as a line in the vertical plane through the tip's axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from indent_sim.config.schema import Config
from indent_sim.results.outline import pieces, scene_of, section
from indent_sim.results.pictures.axes import Axis, choice, middle_of, scaled
from indent_sim.results.pictures.canvas import GREY, Axes
from indent_sim.results.reader import Results

PROFILE_VIEW = 3.0  # contact radii around the tip that are shown
TALL = 0.12  # height of the frame over its width below which heights are magnified


@dataclass(frozen=True)
class Line:
    """The surface in the plane y = center of a step: x and z deformed (n,), z before; a and delta
    [length].
    """

    x: np.ndarray
    z: np.ndarray
    before: np.ndarray
    a: float
    delta: float


def line_of(results: Results, step: float) -> Line:
    """The surface in the plane through the tip's axis, mirrored where half of it is modelled."""
    surface = {
        name: column[results.surface["step"] == step] for name, column in results.surface.items()
    }
    x = surface["x"]
    y = surface["y"]
    before = surface.get("z", np.zeros(len(surface["x"])))
    moved_x = x + np.nan_to_num(surface["u_x"])
    moved_z = np.nan_to_num(before) + surface["u_z"]
    center = np.array([*results.report.get("center", [0.0, 0.0]), 0.0][:2])
    x, moved_x, moved_z, before = on_line(y - center[1], x, moved_x, moved_z, np.nan_to_num(before))
    if (
        x.min(initial=np.inf) >= center[0] - 1e-9 * np.ptp(x)
        and choice(results.report, "symmetry") != "full"
    ):
        moved_x = np.concatenate([2 * center[0] - moved_x[::-1], moved_x])
        moved_z, before = (np.concatenate([values[::-1], values]) for values in (moved_z, before))
    row = results["step"] == step
    return Line(
        moved_x, moved_z, before, float(results["a"][row][0]), float(results["delta"][row][0])
    )


def on_line(y: np.ndarray, x: np.ndarray, *values: np.ndarray) -> tuple[np.ndarray, ...]:
    """Places and values on the line y = 0 of a surface, in order of x.

    These are the points that lie there; of a surface with fewer than five of them, what is
    interpolated between its points.
    """
    on = np.abs(y) <= 1e-9 * max(np.ptp(y), np.ptp(x))
    if on.sum() >= 5:  # they are the line; with fewer the surface is interpolated
        order = np.argsort(x[on])
        return tuple(column[on][order] for column in (x, *values))
    from matplotlib.tri import LinearTriInterpolator, Triangulation

    along = np.linspace(x.min(), x.max(), 400)
    surface = Triangulation(x, y)
    found = [
        np.ma.filled(LinearTriInterpolator(surface, column)(along, 0 * along), np.nan)
        for column in values
    ]
    known = np.isfinite(found).all(axis=0)
    return tuple(column[known] for column in (along, *found))


def draw_profiles(axes: Axes, shown: Sequence[tuple[Results, float, str, object]]) -> None:
    """Deformed surfaces of several steps, each with its name, colour and tip, filled at the
    deepest, true to scale.

    Where the depths are too small beside the width for that, heights are magnified and the axis
    says so.
    """
    runs = [results for results, *_ in shown]
    lines = [line_of(results, step) for results, step, *_ in shown]
    reach = max(PROFILE_VIEW * max(line.a, abs(line.delta)) for line in lines)
    middle, name = middle_of(runs)
    length = scaled("length", runs, reach, name)
    lines = [
        replace(line, x=line.x - middle_of([run])[0] + middle)
        for run, line in zip(runs, lines, strict=True)
    ]
    heights = np.concatenate([line.z[np.abs(line.x - middle) <= reach] for line in lines])
    deepest = max(range(len(lines)), key=lambda i: lines[i].delta)
    delta = lines[deepest].delta
    low = min(heights.min(initial=0.0), -delta)
    high = max(heights.max(initial=0.0), 0.3 * delta)
    if (scene := scene_of(runs[deepest].path)) is not None:
        draw_tip(axes, scene, delta, middle, PROFILE_VIEW * reach, length)
    for i, ((run, _, name, colour), line) in enumerate(zip(shown, lines, strict=True)):
        if i != deepest and (scene := scene_of(run.path)) is not None:
            s, z = _tip(scene, line.delta, middle, PROFILE_VIEW * reach, length)
            axes.plot(s, z, color=colour, lw=0.7, ls=(0, (1, 1.5)), zorder=2)
        axes.plot(length(line.x), length(line.z), color=colour, label=name or None, zorder=3)
    axes.plot(
        length(lines[0].x),
        length(lines[0].before),
        color=GREY,
        lw=0.8,
        ls=":",
        zorder=2,
        label="undeformed",
    )
    margin = 0.08 * (high - low)
    axes.set(
        xlim=length([middle - reach, middle + reach]),
        ylim=length([low - margin, high + 3 * margin]),
    )
    is_true = (high - low) > TALL * 2 * reach
    if is_true:  # all of the panel, with as much of the tip as it has room for
        axes.set_aspect("equal", adjustable="datalim")
    axes.set(
        xlabel=length.label,
        ylabel=Axis("height z" if is_true else "height z, magnified", unit=length.unit).label,
    )


def draw_tip(
    axes: Axes, scene: Config, delta: float, middle: float, width: float, length: Axis
) -> None:
    """The rigid tip at a depth, in the plane through its axis."""
    s, z = _tip(scene, delta, middle, width, length)
    axes.fill(
        np.append(s, [s[-1], s[0]]),
        np.append(z, [max(z[-1], z[0])] * 2),
        color=GREY,
        alpha=0.18,
        lw=0,
        zorder=1,
    )
    axes.plot(s, z, color=GREY, lw=1.0, zorder=4)


def _tip(
    scene: Config, delta: float, middle: float, width: float, length: Axis
) -> tuple[np.ndarray, np.ndarray]:
    """The outline of the rigid tip at a depth, as it is shown."""
    s, z = section(scene.indenter, width)
    return length(s + middle), length(z - delta / pieces(scene.body))
