"""The pressure in a picture: its curve over the radius, or its map."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from indent_sim.results.pictures.canvas import (
    COLOURS,
    GREY,
    MANY,
    Axis,
    axis,
    from_zero,
    in_picture,
    is_plane_strain,
    name_axes,
    scaled,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from indent_sim.results.reader import Results


PEAK = 5.0  # medians inside the contact up to which a peak is shown: beside a singular edge nothing else would be seen
VIEW = 1.5  # contact radii around the tip in which the pressure is shown
PRESSED = 0.02  # of the median pressure within the contact radius: beyond it there is contact, below a ripple
MARGIN = 0.1  # contact radii around what is pressed


def draw_pressure(axes: Axes, results: Results, step: float) -> None:
    """The contact pressure of a step, around the tip: a profile along a line or a map."""
    surface = results.surface
    known = (surface["step"] == step) & np.isfinite(surface["pressure"])  # not where it is infinite
    x, y, p = (surface[name][known] for name in ("x", "y", "pressure"))
    center, a = _tip(results, x, y, p), _contact_radius(results, step, x, y)
    inside = np.hypot(x - center[0], y - center[1]) <= a
    pressed = p > PRESSED * np.median(p[inside]) if inside.any() else inside
    frame = [_view(along, c, a, along[pressed]) for along, c in ((x, center[0]), (y, center[1]))]
    near = _within(x, frame[0]) & _within(y, frame[1])
    length = scaled("length", [results], x[near], "x" if is_plane_strain(results) else "r")
    pressure = scaled("pressure", [results], p, "pressure")
    axes.set_title(f"step {step:g}, depth {_depth_text(results, step)}", color=GREY, loc="left", fontsize=9)
    if np.ptp(y) > 0:
        return _draw_map(axes, length(x), length(y), pressure(p), [length(side) for side in frame],
                         pressure.label, Axis("x", unit=length.unit))  # fmt: skip
    shown = np.argsort(x)
    axes.fill_between(length(x[shown]), pressure(p[shown]), color=COLOURS[0], alpha=0.15, lw=0)
    axes.plot(length(x[shown]), pressure(p[shown]), color=COLOURS[0], marker="." if near.sum() <= MANY else "")
    name_axes(axes, length.label, pressure.label)
    if "shear" in surface:
        _draw_shear(axes, length(x[shown]), pressure(np.abs(surface["shear"][known][shown])))
        _mark_stick(axes, length(center[0] + _stick_radius(results, step, is_plane_strain(results))))
    axes.locator_params(axis="x", nbins=4)
    axes.set_xlim(*length(frame[0]))
    from_zero(axes, np.minimum(pressure(p), PEAK * np.median(pressure(p[inside]))) if inside.any() else pressure(p))
    return None


def _draw_shear(axes: Axes, x: np.ndarray, shear: np.ndarray) -> None:
    """The size of the tangential traction, in the pressure's unit."""
    axes.plot(x, shear, color=COLOURS[1], ls="--", label="shear")
    axes.legend(frameon=False, loc="upper right", fontsize=8)


def _stick_radius(results: Results, step: float, is_strip: bool) -> np.ndarray:
    """Where the contact begins to slip, to either side of a strip's tip."""
    radius = float(results["stick_radius"][results["step"] == step][0])
    return np.array([-radius, radius] if is_strip else [radius])


def _mark_stick(axes: Axes, ends: np.ndarray) -> None:
    """Dotted lines at the ends of the part that sticks."""
    for end in ends:
        axes.axvline(end, color=GREY, lw=0.8, ls=":")


def strongest_step(results: Results) -> float | None:
    """The step of the largest force among those whose surface is known; None without any force."""
    shown = np.isin(results["step"], results.surface["step"]) if results.surface else np.array([])
    forces = np.where(shown, results["force"], 0.0) if shown.any() else np.zeros(1)
    return float(results["step"][np.argmax(forces)]) if forces.max() > 0 else None


def _tip(results: Results, x: np.ndarray, y: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Where the tip stands: as run.json says, else where the pressure is largest."""
    center = results.report.get("center")
    return np.array([*center, 0.0][:2]) if center else np.array([x[p.argmax()], y[p.argmax()]])


def _contact_radius(results: Results, step: float, x: np.ndarray, y: np.ndarray) -> float:
    """The contact radius of a step; the size of the surface where the table has none."""
    a = results["a"][results["step"] == step]
    return float(a[0]) if a.size and a[0] > 0 else float(np.hypot(np.ptp(x), np.ptp(y)))


def _view(values: np.ndarray, center: float, a: float, pressed: np.ndarray) -> np.ndarray:
    """What is shown along one axis: VIEW contact radii around the tip, and all that is pressed, where there is a body.

    The corners of a contact with few sides are farther from the tip than VIEW radii of a circle with its area.
    """
    reach = np.array([center - VIEW * a, center + VIEW * a])
    if pressed.size:
        low, high = pressed.min() - MARGIN * a, pressed.max() + MARGIN * a
        reach = np.array([min(reach[0], low), max(reach[1], high)])
    return np.clip(reach, values.min(), values.max())


def _within(values: np.ndarray, side: np.ndarray) -> np.ndarray:
    return (side[0] <= values) & (values <= side[1])


def _draw_map(axes: Axes, x: np.ndarray, y: np.ndarray, p: np.ndarray, frame: Sequence[np.ndarray], label: str,
              along: Axis) -> None:  # fmt: skip
    """The pressure on the modelled part of the surface inside a frame."""
    wider = [side + np.ptp(side) * np.array([-0.5, 0.5]) for side in frame]  # triangles reach beyond its rim
    near = _within(x, wider[0]) & _within(y, wider[1])
    if near.sum() < 3 or np.ptp(x[near]) == 0 or np.ptp(y[near]) == 0:
        near[:] = True
    filled = axes.tricontourf(x[near], y[near], p[near], levels=np.linspace(0, p.max(), 13), cmap="cividis")
    bar = axes.figure.colorbar(filled, ax=axes, label=label, ticks=np.linspace(0, p.max(), 4))
    bar.ax.yaxis.set_major_formatter("{x:.3g}")
    bar.outline.set_visible(False)  # type: ignore[operator, unused-ignore]
    axes.locator_params(nbins=4)
    axes.set_aspect("equal")
    axes.set(xlim=frame[0], ylim=frame[1])
    name_axes(axes, along.label, Axis("y", unit=along.unit).label)


def _depth_text(results: Results, step: float) -> str:
    delta = results["delta"][results["step"] == step]
    depth = axis("delta", [results])
    return f"{depth(delta[0]):.4g} {in_picture(depth.unit)}".strip() if len(delta) else "?"
