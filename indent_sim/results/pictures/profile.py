"""Deformed surface below the tip, as a line in the vertical plane through the tip's axis."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from indent_sim.config.schema import Config
from indent_sim.results.pictures.axes import Axis, plan_choice, scaled_axis, tip_axis_position
from indent_sim.results.pictures.figures import GREY, Axes
from indent_sim.results.reader import Results
from indent_sim.results.result_scene import contacts_per_body, scene_of
from indent_sim.results.tip_geometry import section

Profile = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class SurfaceProfile:
    """Surface of a step in the vertical plane through the tip's axis.

    Attributes
    ----------
    x, z
        Positions on the deformed surface (n,) [length].
    undeformed_z
        Heights of the undeformed surface (n,) [length].
    a, delta
        Contact radius and depth [length].
    """

    x: np.ndarray
    z: np.ndarray
    undeformed_z: np.ndarray
    a: float
    delta: float


def surface_profile(results: Results, step: float) -> SurfaceProfile:
    """Return the surface in the plane through the tip's axis, completed by its mirror image."""
    surface = {
        name: column[results.surface["step"] == step] for name, column in results.surface.items()
    }
    x = surface["x"]
    y = surface["y"]
    undeformed_z = surface.get("z", np.zeros(len(surface["x"])))
    moved_x = x + np.nan_to_num(surface["u_x"])
    moved_z = np.nan_to_num(undeformed_z) + surface["u_z"]
    center = np.array([*results.report.get("center", [0.0, 0.0]), 0.0][:2])
    center = center + results.slide_at(step)
    x, moved_x, moved_z, undeformed_z = values_on_line(
        y - center[1], x, moved_x, moved_z, np.nan_to_num(undeformed_z)
    )
    if (
        x.min(initial=np.inf) >= center[0] - 1e-9 * np.ptp(x)
        and plan_choice(results.report, "symmetry") != "full"
    ):
        moved_x = np.concatenate([2 * center[0] - moved_x[::-1], moved_x])
        moved_z, undeformed_z = (
            np.concatenate([values[::-1], values]) for values in (moved_z, undeformed_z)
        )
    row = results["step"] == step
    return SurfaceProfile(
        moved_x, moved_z, undeformed_z, float(results["a"][row][0]), float(results["delta"][row][0])
    )


def values_on_line(y: np.ndarray, x: np.ndarray, *values: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return positions and values on the line y = 0 of a surface, in order of x.

    Points on the line are used if there are at least five; otherwise the surface is interpolated.

    Parameters
    ----------
    y, x
        Positions of the points (n,).
    values
        Columns of values (n,).
    """
    is_on_line = np.abs(y) <= 1e-9 * max(np.ptp(y), np.ptp(x))
    if is_on_line.sum() >= 5:
        order = np.argsort(x[is_on_line])
        return tuple(column[is_on_line][order] for column in (x, *values))
    from matplotlib.tri import LinearTriInterpolator, Triangulation

    line_x = np.linspace(x.min(), x.max(), 400)
    surface = Triangulation(x, y)
    interpolated = [
        np.ma.filled(LinearTriInterpolator(surface, column)(line_x, 0 * line_x), np.nan)
        for column in values
    ]
    is_inside = np.isfinite(interpolated).all(axis=0)
    return tuple(column[is_inside] for column in (line_x, *interpolated))


def draw_profiles(axes: Axes, shown: Sequence[tuple[Results, float, str, object]]) -> None:
    """Draw deformed surfaces of several steps with their tips, true to scale.

    The tip at the largest depth is filled. If the depths are very small compared to the width,
    heights are magnified, and the axis label gives the factor.

    Parameters
    ----------
    axes
        The panel.
    shown
        Result, step, name and colour of each surface.
    """
    runs = [results for results, *_ in shown]
    profiles = [surface_profile(results, step) for results, step, *_ in shown]
    # Half-width of the view around the tip, in contact radii or depths.
    view = 3.0
    half_width = max(view * max(line.a, abs(line.delta)) for line in profiles)
    slides = [results.slide_at(step) for results, step, *_ in shown]
    middle, name = tip_axis_position(runs, 0, slides)
    length = scaled_axis("length", runs, half_width, name)
    profiles = [
        replace(line, x=line.x - tip_axis_position([run], 0, [slide])[0] + middle)
        for run, line, slide in zip(runs, profiles, slides, strict=True)
    ]
    heights = np.concatenate([line.z[np.abs(line.x - middle) <= half_width] for line in profiles])
    deepest = max(range(len(profiles)), key=lambda i: profiles[i].delta)
    delta = profiles[deepest].delta
    low = min(heights.min(initial=0.0), -delta)
    high = max(heights.max(initial=0.0), 0.3 * delta)
    if (scene := scene_of(runs[deepest].path)) is not None:
        lift = tip_lift(runs[deepest], shown[deepest][1], scene)
        draw_tip(axes, scene, delta, middle, view * half_width, length, lift)
    for i, ((run, step, name, colour), line) in enumerate(zip(shown, profiles, strict=True)):
        if i != deepest and (scene := scene_of(run.path)) is not None:
            lift = tip_lift(run, step, scene)
            s, z = _tip_line(scene, line.delta, middle, view * half_width, length, lift)
            axes.plot(s, z, color=colour, lw=0.7, ls=(0, (1, 1.5)), zorder=2)
        axes.plot(length(line.x), length(line.z), color=colour, label=name or None, zorder=3)
    axes.plot(
        length(profiles[0].x),
        length(profiles[0].undeformed_z),
        color=GREY,
        lw=0.8,
        ls=":",
        zorder=2,
        label="undeformed",
    )
    margin = 0.08 * (high - low)
    axes.set(
        xlim=length([middle - half_width, middle + half_width]),
        ylim=length([low - margin, high + 3 * margin]),
    )
    # Heights are magnified if the ratio of height to width of the view is below this.
    true_scale_ratio = 0.12
    is_true_scale = (high - low) > true_scale_ratio * 2 * half_width
    if is_true_scale:  # The view is extended to fill the panel, and shows more of the tip.
        axes.set_aspect("equal", adjustable="datalim")
    axes.set(
        xlabel=length.label,
        ylabel=Axis("height z" if is_true_scale else "height z, magnified", unit=length.unit).label,
    )


def tip_lift(results: Results, step: float, scene: Config) -> Profile:
    """Return the displacement of the tip's surface over the distance from its axis [length].

    The result is 0 for a rigid tip. The surface of a soft tip lies above the surface of the body by
    the gap. If the surface of the step is not stored, the undeformed outline of the tip is drawn.
    """
    is_step = results.surface.get("step", np.zeros(0)) == step
    if scene.indenter.elastic_part is None or not is_step.any():
        return lambda s: 0.0 * s
    r, u_r, u_z, gap, z = (
        results.surface[name][is_step] if name in results.surface else np.zeros(is_step.sum())
        for name in ("x", "u_x", "u_z", "gap", "z")
    )
    if not scene.indenter.elastic_part.material.is_small_strain:
        # The gap is that of the deformed point.
        r = r + u_r
    rows = results["step"] == step
    delta = float(results["delta"][rows][0]) / contacts_per_body(scene.body)
    lift = z + u_z + gap - (scene.indenter.height(r, 0.0 * r) - delta)
    is_known = np.isfinite(lift)
    order = np.argsort(r[is_known])
    return lambda s: np.interp(np.abs(s), r[is_known][order], lift[is_known][order])


def draw_tip(
    axes: Axes,
    scene: Config,
    delta: float,
    middle: float,
    width: float,
    length: Axis,
    lift: Profile,
) -> None:
    """Draw the section of the tip through its axis at a depth.

    `lift` is the upward displacement of a soft tip's surface over the distance from the axis.
    """
    s, z = _tip_line(scene, delta, middle, width, length, lift)
    axes.fill(
        np.append(s, [s[-1], s[0]]),
        np.append(z, [max(z[-1], z[0])] * 2),
        color=GREY,
        alpha=0.18,
        lw=0,
        zorder=1,
    )
    axes.plot(s, z, color=GREY, lw=1.0, zorder=4)


def _tip_line(
    scene: Config, delta: float, middle: float, width: float, length: Axis, lift: Profile
) -> tuple[np.ndarray, np.ndarray]:
    """Return the outline (s, z) of the tip at a depth, in the unit shown."""
    s, z = section(scene.tip, width)
    return length(s + middle), length(z + lift(s) - delta / contacts_per_body(scene.body))
