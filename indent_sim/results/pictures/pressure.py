"""Contact pressure: curves over the radius, or maps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar, Literal

import numpy as np

from indent_sim.model.tips import max_radius
from indent_sim.results.pictures.axes import (
    Axis,
    axis_of_column,
    horizontal_axis_name,
    plan_choice,
    scaled_axis,
    time_text,
    tip_axis_position,
)
from indent_sim.results.pictures.figures import (
    COLOURS,
    GREY,
    Axes,
    BarPosition,
    PlotStyle,
    draw_colour_bar,
    draw_panel_title,
    start_at_zero,
)
from indent_sim.results.pictures.profile import values_on_line
from indent_sim.results.reader import Results
from indent_sim.results.result_scene import scene_of

# A pressure peak is shown up to this multiple of the median pressure inside the contact. A
# singularity would otherwise make the rest of the curve invisible.
PEAK_MEDIANS = 5.0
# A point is in contact if its pressure exceeds this fraction of the median pressure inside the
# contact; a smaller pressure may be an oscillation of the solution.
PRESSED_FRACTION = 0.02


@dataclass(frozen=True)
class ContactSurface:
    """Pressure on the modelled part of the contact surface at one step.

    Points are on the deformed surface if the gap is evaluated there, since the contact radius is
    then also measured there.

    Attributes
    ----------
    x, y
        Positions (n,) relative to the tip's axis [length].
    p
        Contact pressure (n,) [pressure].
    center
        Position of the tip's axis (2,) [length].
    mirror_axes
        Two values: whether the model ends at the tip's axis in the x direction, and whether it ends
        there in the y direction.
    a
        Contact radius [length].
    singularities
        Pairs of a distance from the axis at which the exact pressure is infinite, and a width
        around it in which the computed pressure depends on the mesh [length].
    shear
        Shear traction (n,) with friction, otherwise None.
    stick_radius
        Radius of the stick zone [length].
    """

    x: np.ndarray
    y: np.ndarray
    p: np.ndarray
    center: np.ndarray
    mirror_axes: tuple[bool, bool]
    a: float
    singularities: tuple[tuple[float, float], ...]
    shear: np.ndarray | None = None
    stick_radius: float = 0.0
    slide: np.ndarray = field(default_factory=lambda: np.zeros(2))

    @property
    def median_pressure(self) -> float:
        """Median of the absolute pressure inside the contact."""
        inside = np.hypot(self.x, self.y) <= self.a
        size = np.abs(self.p)
        return float(np.median(size[inside])) if inside.any() else float(size.max(initial=0.0))

    @property
    def half_width(self) -> float:
        """Half-width of the view [length]: 1.5 contact radii, or more to show all loaded points.

        The corners of a polygonal contact with few sides are farther from the axis than 1.5 times
        the radius of a circle of equal area.
        """
        pressed = np.abs(self.p) > PRESSED_FRACTION * self.median_pressure
        farthest = max(
            np.abs(self.x[pressed]).max(initial=0.0), np.abs(self.y[pressed]).max(initial=0.0)
        )
        # Half-width of the view around the tip, in contact radii.
        view = 1.5
        return max(view * self.a, farthest + 0.1 * self.a)

    def is_bounded(self) -> np.ndarray:
        """Mask (n,) of the points outside the vicinity of pressure singularities."""
        r = np.hypot(self.x, self.y)
        return np.all(
            [
                np.ones(len(r)),
                *(
                    np.abs(r - place) > excluded_radius
                    for place, excluded_radius in self.singularities
                ),
            ],
            axis=0,
        )

    def profile(self, middle: float) -> tuple[np.ndarray, np.ndarray]:
        """Return positions [length] and pressures along a line, NaN near singularities.

        `middle` is the position of the tip.
        """
        order = np.argsort(self.x)
        return self._mirror_line(
            self.x[order], np.where(self.is_bounded(), self.p, np.nan)[order], middle
        )

    def shear_profile(self, middle: float) -> tuple[np.ndarray, np.ndarray]:
        """Return positions [length] and absolute shear along a line, averaged over each element.

        Nodal values of shear within an element depend on the step in which each node came into
        contact; under a sticking tip they oscillate by as much as their mean. `middle` is the
        position of the tip.
        """
        assert self.shear is not None
        order = np.argsort(self.x)
        x = self.x[order]
        tau = self.shear[order]
        # Middle nodes of deformed elements are this close to the midpoint, relative to
        # the element.
        middle_node_tolerance = 0.1
        if (
            len(x) % 2
            and (
                np.abs(x[1::2] - (x[:-2:2] + x[2::2]) / 2)
                <= middle_node_tolerance * (x[2::2] - x[:-2:2])
            ).all()
        ):
            x = x[1::2]
            tau = (tau[:-2:2] + 4 * tau[1::2] + tau[2::2]) / 6
        return self._mirror_line(x, np.abs(tau), middle)

    def _mirror_line(
        self, x: np.ndarray, p: np.ndarray, middle: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Complete a profile by its mirror image, and shift it to the position of the tip."""
        if self.mirror_axes[0]:
            x = np.concatenate([-x[::-1], x])
            p = np.concatenate([p[::-1], p])
        return x + middle, p


def contact_surface(results: Results, step: float) -> ContactSurface:
    """Return the contact surface of a step of a result."""
    surface = results.surface
    is_known = (surface["step"] == step) & np.isfinite(surface["pressure"])
    x, y, p = (surface[name][is_known] for name in ("x", "y", "pressure"))
    if is_deformed(results):
        x = x + surface["u_x"][is_known]
        y = y + surface["u_y"][is_known]
    # Results of older versions have no center: the largest pressure marks it.
    given_center = results.report.get("center")
    center = (
        np.array([*given_center, 0.0][:2]) + results.slide_at(step)
        if given_center
        else np.array([x[p.argmax()], y[p.argmax()]])
    )
    x = x - center[0]
    y = y - center[1]
    small = 1e-9 * max(np.ptp(x), np.ptp(y), 1e-300)
    is_part = plan_choice(results.report, "symmetry") != "full"
    ends_at_axis = [
        bool(np.ptp(along) > 0 and (along.min() > -small or along.max() < small))
        for along in (x, y)
    ]
    mirrored = (is_part and ends_at_axis[0], is_part and ends_at_axis[1])
    radius = results["a"][results["step"] == step]
    is_pulled = p < -PRESSED_FRACTION * np.abs(p).max(initial=0.0)
    a = float(radius[0]) if len(radius) else 0.0
    # Without contact, the radius of the region under tension or the size of the surface is used.
    if not a > 0:
        a = (
            float(np.hypot(x, y)[is_pulled].max())
            if is_pulled.any()
            else float(np.hypot(np.ptp(x), np.ptp(y)))
        )
    singularities = _pressure_singularities(results, step, a)
    shear = surface["shear"][is_known] if "shear" in surface else None
    stick_radii = results.table.get("stick_radius", np.zeros(len(results)))[results["step"] == step]
    stick_radius = float(stick_radii.max(initial=0.0))
    return ContactSurface(
        x,
        y,
        p,
        center,
        mirrored,
        a,
        singularities,
        shear,
        stick_radius,
        results.slide_at(step),
    )


def is_deformed(results: Results) -> bool:
    """Return whether the gap of a run is evaluated on the deformed surface."""
    return results.report.get("gap") == "current"


def position_label(name: str, runs: Sequence[Results]) -> str:
    """Return the label of positions, which names the surface on which they are measured."""
    deformed = [is_deformed(run) for run in runs]
    if all(deformed):
        return f"deformed {name}"
    return f"{name} (deformed at finite strain)" if any(deformed) else name


def _pressure_singularities(
    results: Results, step: float, a: float
) -> tuple[tuple[float, float], ...]:
    """Return radii at which a sharp tip makes the pressure infinite, each with a width.

    Points closer to the radius than the width are not drawn.
    """
    peak = results.table.get("p_max", np.zeros(len(results)))[results["step"] == step]
    if not len(peak) or np.isfinite(peak[0]) or (scene := scene_of(results.path)) is None:
        return ()
    tip = scene.tip
    mesh = scene.mesh
    size = mesh.h_contact if isinstance(mesh.h_contact, float) else 0.0
    element_sizes = {True: mesh.h_axis or size, False: mesh.h_edge or size}
    # A singularity up to this multiple of the contact radius counts as inside the contact, since
    # the contact radius of a row is that of nodes.
    contact_radius_factor = 1.02
    radii = [r for r, _ in tip.slope_discontinuities() if r <= contact_radius_factor * a]
    end = max_radius(tip)
    # Points that are not drawn take up at most this fraction of the contact radius. With few
    # elements in the contact no points would be left otherwise.
    max_excluded_fraction = 0.5
    # A width is excluded on both sides of its radius.
    max_width = max_excluded_fraction * a / (2 * max(1, len(radii)))
    # Number of elements next to a slope discontinuity of the tip within which the computed
    # pressure depends on the mesh, because the exact pressure is infinite there; these points
    # are not drawn.
    discontinuity_elements = 1.5
    # The same next to the end of a tip, where the singularity is r^(-1/2) and not
    # logarithmic.
    tip_end_elements = 4.0
    return tuple(
        (
            r,
            min(
                (tip_end_elements if r >= end else discontinuity_elements) * element_sizes[r == 0],
                max_width,
            ),
        )
        for r in radii
    )


def draw_pressure(axes: Axes, results: Results, step: float) -> None:
    """Draw the contact pressure of a step around the tip, as a profile or a map."""
    contact = contact_surface(results, step)
    if np.ptp(contact.y) > 0:  # The surface is that of a body in 3D.
        PressureMaps([(results, step, "")]).draw([axes], where="beside")
    else:
        draw_pressures(axes, [(results, contact, "", COLOURS[0])])
        if contact.shear is not None:
            axes.legend(loc="upper right")
    axes.set_title(
        f"step {step:g}, depth {depth_text(results, step)}"
        + (f", slide {slide}" if (slide := slide_text(results, step)) else ""),
        color=GREY,
        loc="left",
        fontsize="small",
    )


def surface_on_axis(contact: ContactSurface, along: Literal[0, 1]) -> ContactSurface:
    """Return the pressure in 3D on the line through the tip's axis along x (0) or y (1)."""
    x, y = (contact.x, contact.y) if along == 0 else (contact.y, contact.x)
    values = [contact.p] if contact.shear is None else [contact.p, contact.shear]
    places, p, *shear = values_on_line(y, x, *values)
    return replace(
        contact,
        x=places,
        y=np.zeros(len(places)),
        p=p,
        shear=shear[0] if shear else None,
        center=np.roll(contact.center, along),
        mirror_axes=(contact.mirror_axes[along], False),
    )


def draw_pressures(
    axes: Axes,
    shown: Sequence[tuple[Results, ContactSurface, str, object]],
    limits: tuple[float, float] | None = None,
    along: Literal[0, 1] = 0,
) -> None:
    """Draw pressures over r, in plane strain over x, in 3D along a line through the tip's axis.

    Parameters
    ----------
    axes
        The panel.
    shown
        Result, contact surface, name and colour of each curve.
    limits
        Ends of the pressure axis in the unit shown; None for the range of the curves.
    along
        Axis on which the positions are: 0 for x, 1 for y.
    """
    runs = [results for results, *_ in shown]
    slides = [surface.slide for _, surface, *_ in shown]
    middle, name_of_axis = tip_axis_position(runs, along, slides)
    is_half = all(horizontal_axis_name(run) == "r" for run in runs)  # Axisymmetric bodies.
    contacts = [
        replace(surface, mirror_axes=(False, False)) if is_half else surface
        for _, surface, *_ in shown
    ]
    half_width = max(contact.half_width for contact in contacts)
    length = scaled_axis("length", runs, half_width, position_label(name_of_axis, runs))
    pressures = np.concatenate([contact.p[contact.is_bounded()] for contact in contacts])
    pressure = scaled_axis("pressure", runs, pressures, "pressure p")
    sides = (1,) if is_half else (-1, 1)
    pressure_ends = []
    has_stick_radius = False
    for contact, (*_, name, colour) in zip(contacts, shown, strict=True):
        places, p = contact.profile(middle)
        x = length(places)
        y = pressure(p)
        if not name:
            axes.fill_between(x, y, color=colour, alpha=0.12, lw=0)
        axes.plot(x, y, color=colour, label=name or None)
        pressure_ends += [
            min(np.nanmax(y, initial=0.0), PEAK_MEDIANS * pressure(contact.median_pressure)),
            np.nanmin(y, initial=0.0),
        ]
    for contact, (*_, name, colour) in zip(contacts, shown, strict=True):
        if contact.shear is None:
            continue
        x, shear = contact.shear_profile(middle)
        shear_colour = colour if name else COLOURS[1]
        radius = contact.stick_radius
        axes.plot(
            length(x),
            pressure(shear),
            color=shear_colour,
            ls="--",
            label=", ".join(filter(None, [name, "shear"])),
        )
        for side in sides if radius else ():
            axes.axvline(
                length(middle + side * radius), color=shear_colour if name else GREY, lw=0.8, ls=":"
            )
        has_stick_radius |= radius > 0
    if has_stick_radius:  # One entry in the legend stands for all stick radii.
        axes.plot([], [], color=GREY, lw=0.8, ls=":", label="stick radius")
    axes.set(xlabel=length.label, ylabel=pressure.label)
    axes.set_xlim(0.0 if is_half else length(middle - half_width), length(middle + half_width))
    if limits is None:
        start_at_zero(axes, np.array(pressure_ends))
    else:
        axes.set_ylim(limits)
    annotation_style: PlotStyle = {
        "xytext": (3, 0),
        "textcoords": "offset points",
        "ha": "left",
        "va": "top",
    }
    for place in sorted({place for contact in contacts for place, _ in contact.singularities}):
        at = length(place + middle)
        axes.axvline(at, color=GREY, lw=0.8, ls=":", zorder=1)
        axes.annotate(
            "∞", (at, 1), xycoords=("data", "axes fraction"), color=GREY, **annotation_style
        )


@dataclass(frozen=True)
class PressureMaps:
    """Pressure maps of several results or steps in plan view, with the same view and colours.

    Each map is centred on its tip, and completed by mirror images. The view contains all loaded
    points.

    Attributes
    ----------
    steps
        Result, step and label of each map.
    limits
        Ends of the colour range in the unit shown; None for the range of all pressures.
    """

    steps: Sequence[tuple[Results, float, str]]
    limits: tuple[float, float] | None = None
    aspect: ClassVar[float] = 1.0  # Ratio of the height of the view to its width.

    @cached_property
    def surfaces(self) -> list[ContactSurface]:
        """Contact surface of each map."""
        return [contact_surface(results, step) for results, step, _ in self.steps]

    @property
    def _runs(self) -> list[Results]:
        """Result of each map."""
        return [results for results, *_ in self.steps]

    @cached_property
    def half_width(self) -> float:
        """Half-width of the view [length]."""
        return max(contact.half_width for contact in self.surfaces)

    def draw(
        self,
        panels: Sequence[Axes],
        some: slice = slice(None),
        where: BarPosition = "right",
        aspect: float = 1.0,
    ) -> None:
        """Draw some of the maps with one colour bar.

        Parameters
        ----------
        panels
            The panel of each map.
        some
            The maps to be drawn.
        where
            Position of the colour bar.
        aspect
            Ratio of height to width of the panels, at least 1.
        """
        from matplotlib.ticker import AutoLocator

        runs = self._runs
        length = scaled_axis("length", runs, self.half_width, position_label("x", runs))
        bounded = np.concatenate([contact.p[contact.is_bounded()] for contact in self.surfaces])
        pressure = scaled_axis("pressure", runs, bounded, "pressure p")
        low, top = self.limits or self._colour_range(pressure)
        for axes, (run, step, words), contact in zip(
            panels, self.steps[some], self.surfaces[some], strict=True
        ):
            drawn = self._draw_map(axes, contact, length, pressure, (low, top), aspect)
            draw_panel_title(axes, panel_title(run, step, words))
        draw_colour_bar(panels, drawn, pressure.label, where, ticks=AutoLocator())

    def _colour_range(self, pressure: Axis) -> tuple[float, float]:
        """Return the smallest and the largest pressure shown.

        Pressures near a singularity are limited to PEAK_MEDIANS times the median pressure.
        """
        highest = []
        for contact in self.surfaces:
            largest = float(contact.p[contact.is_bounded()].max(initial=0.0))
            highest.append(
                min(largest, PEAK_MEDIANS * contact.median_pressure)
                if contact.singularities
                else largest
            )
        low = min(
            float(pressure(self._points_near_frame(contact)[2].min(initial=0.0)))
            for contact in self.surfaces
        )
        return low, float(pressure(max(highest))) or float(low == 0.0)

    def _points_near_frame(
        self, contact: ContactSurface, aspect: float = 1.0
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return positions and pressures of the points in and around the view.

        Points around the view are needed for triangles that extend beyond it.
        """
        x, y, p = _mirror_surface(contact)
        is_near = (np.abs(x) < 2 * self.half_width) & (np.abs(y) < 2 * aspect * self.half_width)
        if is_near.sum() < 3 or np.ptp(x[is_near]) == 0 or np.ptp(y[is_near]) == 0:
            is_near[:] = True
        return x[is_near], y[is_near], p[is_near]

    def _draw_map(
        self,
        axes: Axes,
        contact: ContactSurface,
        length: Axis,
        pressure: Axis,
        colours: tuple[float, float],
        aspect: float,
    ) -> Any:
        """Draw one map, and return the contours from which a colour bar is made."""
        x, y, p = self._points_near_frame(contact, aspect)
        low, top = colours
        levels = np.linspace(low, top, 25)
        beyond = {(False, True): "max", (True, False): "min", (True, True): "both"}
        extend = beyond.get(
            (bool(pressure(p.min()) < low), bool(top < pressure(p.max()))), "neither"
        )
        places = (
            length(along + middle) for along, middle in zip((x, y), contact.center, strict=True)
        )
        drawn = axes.tricontourf(*places, pressure(p), levels=levels, cmap="cividis", extend=extend)
        _draw_shear(axes, contact, length)
        axes.set_aspect("equal")
        for set_limits, middle, half in zip(
            (axes.set_xlim, axes.set_ylim),
            contact.center,
            (self.half_width, aspect * self.half_width),
            strict=True,
        ):
            set_limits(length(middle - half), length(middle + half))
        axes.set(
            xlabel=length.label,
            ylabel=Axis(position_label("y", self._runs), unit=length.unit).label,
        )
        return drawn


def _mirror_surface(contact: ContactSurface) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return positions and pressures with their mirror images.

    The mirror images are needed if the model domain is a half or a quarter of the body.
    """
    x = contact.x
    y = contact.y
    p = contact.p
    if contact.mirror_axes[0]:
        x = np.concatenate([x, -x])
        y = np.tile(y, 2)
        p = np.tile(p, 2)
    if contact.mirror_axes[1]:
        x = np.tile(x, 2)
        y = np.concatenate([y, -y])
        p = np.tile(p, 2)
    _, first = np.unique(np.round(np.column_stack([x, y]), 12), axis=0, return_index=True)
    return x[first], y[first], p[first]


def _draw_shear(axes: Axes, contact: ContactSurface, length: Axis) -> None:
    """Draw lines of equal shear, and the stick radius as a dotted circle."""
    if contact.shear is None or not contact.shear.any():
        return
    x, y, shear = _mirror_surface(replace(contact, p=contact.shear))
    places = (length(along + middle) for along, middle in zip((x, y), contact.center, strict=True))
    axes.tricontour(*places, shear, levels=3, colors="white", linewidths=0.5, alpha=0.7)
    angle = np.linspace(0.0, 2 * np.pi, 181)
    stick_circle = (
        contact.stick_radius * np.array([np.cos(angle), np.sin(angle)]) + contact.center[:, None]
    )
    axes.plot(*map(length, stick_circle), color="black", lw=1.4, ls=":")
    # Labels may lie outside of the body: their background is the darkest colour of the colour map.
    background = "#00224e"
    look: PlotStyle = {
        "color": "white",
        "fontsize": "x-small",
        "bbox": {"facecolor": background, "lw": 0, "pad": 1.5},
    }
    axes.annotate(
        "lines: equal shear\ndots: stick radius", (0.03, 0.03), xycoords="axes fraction", **look
    )


def largest_force_step(results: Results) -> float | None:
    """Return the step of the largest force among those with a stored surface.

    If no force is compressive, the step of the widest contact is returned; if there is no contact
    either, the step of the largest tensile force. The result is None if all forces are zero.
    """
    has_surface = (
        np.isin(results["step"], results.surface["step"]) if results.surface else np.array([])
    )
    if not np.any(results["force"][has_surface] if has_surface.any() else 0.0):
        return None
    for size in (results["force"], results["a"], -results["force"]):
        sizes = np.where(has_surface, size, 0.0)
        if sizes.max() > 0:
            return float(results["step"][np.argmax(sizes)])
    return None


def panel_title(results: Results, step: float, words: str, apart: str = ", ") -> str:
    """Return the title of a panel with a label, the time and the depth.

    Parameters
    ----------
    results, step
        Result and step.
    words
        Label that distinguishes the panel from others.
    apart
        Separator between time, depth and slide.
    """
    times = results.table.get("t", np.full(len(results), np.nan))[results["step"] == step]
    time = f"t = {time_text(results, float(times[0]))}{apart}" if np.isfinite(times).any() else ""
    slide = slide_text(results, step)
    place = f"{time}δ = {depth_text(results, step)}" + (f"{apart}x = {slide}" if slide else "")
    return ", ".join(filter(None, [words, place]))


def slide_text(results: Results, step: float) -> str:
    """Return the slide of the tip at a step as text; empty if the tip does not slide."""
    rows = results["step"] == step
    if "x" not in results.table or not rows.any():
        return ""
    return axis_of_column("x", [results]).value_text(float(results["x"][rows][0]))


def depth_text(results: Results, step: float) -> str:
    """Return the depth of a step as text, in the unit of the picture."""
    delta = results["delta"][results["step"] == step]
    # A depth below this fraction of the largest one is 0: the search for a force of 0 ends
    # near it.
    zero_depth_rtol = 1e-6
    if len(delta) and abs(delta[0]) < zero_depth_rtol * np.nanmax(np.abs(results["delta"])):
        delta = np.zeros(1)
    return axis_of_column("delta", [results]).value_text(delta[0]) if len(delta) else "?"
