"""Pictures of results: one run beside its theory, or several runs over one another.

Colours are those of Okabe and Ito, told apart by colour-blind readers too. No pyplot: a figure is an object
here, drawn off screen, and nothing of matplotlib's global state changes.
"""

from __future__ import annotations

import os
import re
import tempfile
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from indent_sim.process.errors import ConfigError, UsageError, printable
from indent_sim.results.folder import CONFIG, content, read_report

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from indent_sim.results.reader import Results


INK, GREY = "#222222", "#6e6e6e"
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
PICTURE = "force_indentation.png"
SOFTWARE, HEAD = b"Software\0indent-sim", 1000  # in the first bytes of a PNG of ours
FORMATS = (".png", ".svg", ".pdf")
MANY = 40  # points from which a line carries no markers
PEAK = 5.0  # medians inside the contact up to which a peak is shown: beside a singular edge nothing else would be seen
LETTERS = 9.0  # of a title to the inch
SUBTITLE, LABEL = 200, 120  # most letters
VIEW = 1.5  # contact radii around the tip in which the pressure is shown
PRESSED = 0.02  # of the median pressure within the contact radius: beyond it there is contact, below a ripple
MARGIN = 0.1  # contact radii around what is pressed
MANY_RUNS = 10  # from which their colours are those of a map, in their order
LEGEND_LINES = 30  # in a column
ESTIMATED = "estimated error"
PANELS, LETTER = 9.2, 0.07  # inches: width of all panels, and of a letter in the legend beside them
PREFIXES = {-9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
SILENT = ("title", "units", "output")  # sections that say nothing of the physics
MOST_LETTERS = 48  # of a name
SI = ("m", "N", "Pa", "N/m")
THEORY: dict[str, Any] = {"color": "#D55E00", "ls": "--", "lw": 1.4, "zorder": 3}
STYLE: dict[str, Any] = {
    "font.size": 10,
    "axes.titlesize": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": GREY,
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": GREY,
    "ytick.color": GREY,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "legend.fancybox": False,
    "legend.edgecolor": "none",
    "legend.framealpha": 0.85,  # a long line of text may cross a steep curve
    "lines.linewidth": 1.6,
    "axes.formatter.use_mathtext": True,
    "axes.formatter.limits": (-3, 4),
    "text.usetex": False,  # titles are text, and LaTeX is a program
    "svg.hashsalt": "indent-sim",  # the same results give the same file
}


@dataclass(frozen=True)
class Axis:
    """What an axis shows: its name, and the factor and unit its numbers are shown in."""

    name: str
    factor: float = 1.0
    unit: str = ""

    @property
    def label(self) -> str:
        """The text along the axis."""
        return f"{self.name} [{in_picture(self.unit)}]" if self.unit else self.name

    def __call__(self, values: Any) -> np.ndarray:
        """Values as they are shown."""
        return np.asarray(values, dtype=float) * self.factor


def in_picture(text: str, most: int = 60) -> str:
    """Text of a stranger as a picture shows it: on one line, shortened, a dollar sign being no formula."""
    text = printable(text)
    text = text if len(text) <= most else f"{text[: most - 1]}…"
    text = text.replace("$", r"\$")
    return f" {text}" if text.startswith("_") else text  # what begins with _ is left out of a legend


def plot_run(folder: Path | str) -> Path:
    """Draw the picture of a result folder into it; returns its path."""
    from indent_sim.results.reader import read

    path = Path(folder) / PICTURE
    force_indentation(read(folder), path)
    return path


def force_indentation(results: Results, path: Path | str, theory: Mapping[str, Any] | None = None) -> None:
    """The picture of a run: force against depth beside theory, contact radius, and the pressure at the largest force.

    `theory` as in run.json (taken from there when not given): name, force_deviation (load control:
    delta_deviation), and curve with delta, force and a.
    """
    theory = theory if theory is not None else results.report.get("theory")
    strongest = _strongest(results)
    with canvas() as figure:
        panels: dict[str, Any] = figure.subplot_mosaic(
            [["force", "a"], ["force", "pressure"]] if strongest else [["force", "a"]],
            width_ratios=[1.55, 1],
        )
        head(figure, _title(results), _subtitle(results))
        _draw_forces(panels["force"], [results], theory)
        _draw_radius(panels["a"], results, theory)
        if strongest:
            _draw_pressure(panels["pressure"], results, strongest)
        save(figure, path)


def overlay(runs: Sequence[Results], path: Path | str) -> None:
    """Force and contact radius of several runs over one another, named after what differs between them.

    UsageError when they have different units, which no axis can show.
    """
    if len(runs) == 1:
        return force_indentation(runs[0], path)
    _refuse_other_units(runs)
    named = sorted(zip(map(in_picture, _names(runs)), runs, strict=True), key=lambda pair: in_order(pair[0]))
    runs, names = [run for _, run in named], [name for name, _ in named]
    columns = -(-len(runs) // LEGEND_LINES)
    beside = columns * (0.7 + LETTER * max(map(len, [ESTIMATED, *names])))
    with canvas((PANELS + beside, max(4.8, 0.19 * len(runs) / columns + 0.6))) as figure:
        panels: dict[str, Any] = figure.subplot_mosaic(
            [["force", "a", "names"]], width_ratios=[PANELS / 2, PANELS / 2, beside]
        )
        _draw_forces(panels["force"], runs, None, names)
        x, y = _axis("a", runs), _axis("delta", runs)
        for i, run in enumerate(runs):
            _curve(panels["a"], y(run["delta"]), x(run["a"]), _look(i, len(runs)))
        _name_axes(panels["a"], y.label, x.label)
        panels["a"].locator_params(axis="x", nbins=6)
        _from_zero(panels["a"], *(x(run["a"]) for run in runs))
        _legend_beside(panels["names"], panels["force"], columns)
        save(figure, path)
    return None


def in_order(name: str) -> list[tuple[float, str]]:
    """Sorts names by the numbers in them, as numbers."""
    parts = re.split(r"([-+]?\d+\.?\d*(?:e[-+]?\d+)?)", name)
    return [(float(part), "") if i % 2 else (0.0, part) for i, part in enumerate(parts)]


def _look(i: int, of: int) -> dict[str, Any]:
    """Colour and mark of the i-th of so many curves; of many, colours of a map from dark to light, without marks."""
    if of <= MANY_RUNS:
        return {"color": COLOURS[i % len(COLOURS)], "marker": MARKERS[i % len(MARKERS)]}
    from matplotlib import colormaps

    return {"color": colormaps["viridis"](0.95 * i / (of - 1)), "marker": ""}  # its lightest yellow is lost on white


def _legend_beside(axes: Axes, named: Axes, columns: int) -> None:
    """The legend of a panel in one of its own."""
    named.get_legend().remove()
    axes.axis("off")
    handles, labels = named.get_legend_handles_labels()
    axes.legend(handles, labels, loc="upper left", fontsize=8, ncol=columns, borderaxespad=0)


@contextmanager
def canvas(size: tuple[float, float] = (9.2, 4.8)) -> Iterator[Figure]:
    """An empty figure in the style of all pictures."""
    with warnings.catch_warnings():  # of an Axes3D that is not wanted here, where two matplotlibs are installed
        warnings.filterwarnings("ignore", "Unable to import Axes3D")
        import matplotlib
        from matplotlib.figure import Figure
    with matplotlib.rc_context(STYLE):
        yield Figure(figsize=size, layout="constrained")


def _draw_forces(axes: Axes, runs: Sequence[Results], theory: Mapping[str, Any] | None,
                 names: Sequence[str] = ("this run",)) -> None:  # fmt: skip
    depth, force = _axis("delta", runs), _axis("force", runs)
    judged = [run for run in runs if "force_error" in run.table and np.isfinite(run["force_error"]).any()]
    for i, (run, name) in enumerate(zip(runs, names, strict=True)):
        x, y, look = depth(run["delta"]), force(run["force"]), _look(i, len(runs))
        _curve(axes, x, y, look, name)
        if any(run is other for other in judged):
            half = force(np.nan_to_num(run["force_error"]))
            label = f"{ESTIMATED}{_of_last(half, y) if len(runs) == 1 else ''}" if run is judged[-1] else None
            if len(x) > 1:
                axes.fill_between(x, y - half, y + half, color=look["color"], alpha=0.2, lw=0, label=label)
            else:  # a band needs two
                axes.errorbar(x, y, half, color=look["color"], alpha=0.5, capsize=6, ls="", label=label)
    if theory and theory.get("curve", {}).get("delta"):
        curve = theory["curve"]
        x, y = depth([0, *curve["delta"]]), force([0, *curve["force"]])
        axes.plot(x, y, **THEORY, label=_theory_label(theory))
    closed = (theory or {}).get("half_space")
    if theory and closed:
        label = in_picture(f"{closed['name'].split(' (')[0]}, half-space{_against_run(closed.get('deviation'))}", LABEL)
        at = theory | closed  # the formula's force at the run's depth, or its depth at the run's force
        axes.plot(depth([at["delta"]]), force([at["force"]]), **_hollow("D", GREY), label=label)
    _name_axes(axes, depth.label, force.label)
    axes.axhline(0, color=GREY, lw=0.6, zorder=0)
    axes.locator_params(axis="x", nbins=6)  # numbers such as 0.0025 are wide
    axes.legend(loc="upper left")


def _of_last(half: np.ndarray, y: np.ndarray) -> str:
    """The last error in words: a thin band cannot be read off."""
    return f", \N{PLUS-MINUS SIGN}{abs(half[-1] / y[-1]):.2%} at the last step" if y[-1] != 0 else ""


def _draw_radius(axes: Axes, results: Results, theory: Mapping[str, Any] | None) -> None:
    depth, radius = _axis("delta", [results]), _axis("a", [results])
    _curve(axes, depth(results["delta"]), radius(results["a"]), _look(0, 1))
    curve = (theory or {}).get("curve", {})
    if curve.get("a"):
        axes.plot(depth(curve["delta"]), radius(curve["a"]), **THEORY)
    _name_axes(axes, depth.label, radius.label)
    axes.locator_params(axis="x", nbins=3)
    _from_zero(axes, radius(results["a"]), radius(curve.get("a", [])))


def _draw_pressure(axes: Axes, results: Results, step: float) -> None:
    """The contact pressure of a step, around the tip: a profile along a line or a map."""
    surface = results.surface
    x, y, p = (surface[name][surface["step"] == step] for name in ("x", "y", "pressure"))
    center, a = _tip(results, x, y, p), _contact_radius(results, step, x, y)
    inside = np.hypot(x - center[0], y - center[1]) <= a
    pressed = p > PRESSED * np.median(p[inside]) if inside.any() else inside
    frame = [_view(along, c, a, along[pressed]) for along, c in ((x, center[0]), (y, center[1]))]
    near = _within(x, frame[0]) & _within(y, frame[1])
    length = _scaled("length", [results], x[near], "x" if _is_plane_strain(results) else "r")
    pressure = _scaled("pressure", [results], p, "pressure")
    axes.set_title(f"step {step:g}, depth {_depth_text(results, step)}", color=GREY, loc="left", fontsize=9)
    if np.ptp(y) > 0:
        return _draw_map(axes, length(x), length(y), pressure(p), [length(side) for side in frame],
                         pressure.label, Axis("x", unit=length.unit))  # fmt: skip
    shown = np.argsort(x)
    axes.fill_between(length(x[shown]), pressure(p[shown]), color=COLOURS[0], alpha=0.15, lw=0)
    axes.plot(length(x[shown]), pressure(p[shown]), color=COLOURS[0], marker="." if near.sum() <= MANY else "")
    _name_axes(axes, length.label, pressure.label)
    axes.locator_params(axis="x", nbins=4)
    axes.set_xlim(*length(frame[0]))
    _from_zero(axes, np.minimum(pressure(p), PEAK * np.median(pressure(p[inside]))) if inside.any() else pressure(p))
    return None


def _strongest(results: Results) -> float | None:
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
    _name_axes(axes, along.label, Axis("y", unit=along.unit).label)


def _curve(axes: Axes, x: np.ndarray, y: np.ndarray, look: Mapping[str, Any], label: str | None = None) -> None:
    if len(x) > MANY or not look["marker"]:
        axes.plot(x, y, color=look["color"], label=label, zorder=3)
        return
    axes.plot(x, y, color=look["color"], lw=1.2, alpha=0.6, zorder=2)
    axes.plot(x, y, **look, ls="", ms=6, mec="white", mew=0.6, label=label, zorder=4)


def _from_zero(axes: Axes, *curves: Any) -> None:
    """Show from 0 to a little above the highest point."""
    highest = max((np.nanmax(curve) for curve in curves if np.size(curve) and np.isfinite(curve).any()), default=0)
    axes.set_ylim(0, 1.08 * highest if highest > 0 else 1)


def _hollow(marker: str, colour: str) -> dict[str, Any]:
    return {"marker": marker, "mfc": "none", "mec": colour, "ls": "", "ms": 6, "zorder": 2}


def _name_axes(axes: Axes, x: str, y: str) -> None:
    axes.set_xlabel(x)
    axes.set_ylabel(y)


def legend_above(figure: Figure, handles: Sequence[Any], names: Sequence[str], title: str | None = None) -> None:
    """One legend above all panels, which make room for it (matplotlib 3.6 knows no place outside of them)."""
    room = (0.62 if title else 0.38) / figure.get_figheight()  # inches
    figure.get_layout_engine().set(rect=(0, 0, 1, 1 - room))  # type: ignore[union-attr, call-arg]
    figure.legend(handles, names, loc="upper center", ncol=len(names), fontsize=9, title=title)


def head(figure: Figure, title: str, subtitle: str) -> None:
    """Title, as far as it fits, and subtitle above the panels."""
    height, fits = figure.get_figheight(), int(LETTERS * figure.get_figwidth())  # inches
    figure.get_layout_engine().set(rect=(0, 0, 1, 1 - 0.64 / height))  # type: ignore[union-attr, call-arg]
    figure.text(0.01, 1 - 0.12 / height, in_picture(title, fits), ha="left", va="top", fontsize=13, fontweight="bold")
    figure.text(0.01, 1 - 0.46 / height, in_picture(subtitle, SUBTITLE), ha="left", va="top", color=GREY, fontsize=9)


def refuse_foreign(path: Path) -> None:
    """UsageError when a picture with a name that nobody chose would replace a file that this program did not make."""
    is_result = path.name == PICTURE and bool(read_report(path.parent))
    if os.path.lexists(path) and not is_result and not _is_own(path):
        raise UsageError(f"{path} is there already and no picture of indent-sim; choose another name with --output")


def _is_own(path: Path) -> bool:
    """Whether a PNG names this program in its metadata, which stand before the picture."""
    try:
        return not path.is_symlink() and SOFTWARE in content(path)[:HEAD]
    except OSError:
        return False


def save(figure: Figure, path: Path | str) -> None:
    """Write PNG, SVG or PDF after the suffix, all at once."""
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise UsageError(f"{path}: a picture ends in {', '.join(FORMATS)}")
    metadata: dict[str, Any] = {"png": {"Software": "indent-sim"}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}
    descriptor, temporary = tempfile.mkstemp(suffix, f".{path.stem[:100]}.", path.parent)  # nobody's, and no link
    try:
        with open(descriptor, "wb") as file:
            figure.savefig(file, format=suffix[1:], dpi=160, metadata=metadata[suffix[1:]])
            os.fchmod(file.fileno(), 0o666 & ~_umask())
        os.replace(temporary, path)
    finally:
        with suppress(FileNotFoundError):
            os.unlink(temporary)


def _umask() -> int:
    """The permissions that new files do not get; there is no other way to ask."""
    mask = os.umask(0o077)
    os.umask(mask)
    return mask


# ---- words and units ------------------------------------------------------------


def _title(results: Results) -> str:
    return results.report.get("title") or _names([results])[0]


def _subtitle(results: Results) -> str:
    report = results.report
    parts = [_choice(report, "symmetry"), _choice(report, "kinematics"), report.get("method")]
    if report.get("gap"):
        parts.append(f"gap at the {'undeformed' if report['gap'] == 'reference' else 'deformed'} point")
    if report.get("status") not in (None, "done", "running"):
        parts.append(f"{report['status']}: {report.get('reason') or 'no reason given'}")
    words = dict.fromkeys(str(part).replace("_", " ") for part in parts if part)
    return "  ·  ".join(word if len(word) <= 90 else f"{word[:89]}…" for word in words)


def _names(runs: Sequence[Results]) -> list[str]:
    """Short names: titles where they differ, else the keys of the configs that do, else the folders' own."""
    titles = [run.report.get("title", "") for run in runs]
    if all(titles) and len(set(titles)) == len(titles) and len(titles) > 1:
        return titles
    settings = _differences(runs)
    if all(settings) and len(set(settings)) == len(settings):
        return settings
    folders = [run.path.resolve() for run in runs]
    names = [folder.name for folder in folders]
    return names if len(set(names)) == len(names) else [str(run.path) for run in runs]


def _differences(runs: Sequence[Results]) -> list[str]:
    """What was given differently, as in "nu 0.3, method penalty"; empty where a config is missing."""
    configs = [config_of(run.path) for run in runs]
    if not all(configs):
        return [""] * len(runs)
    chosen = {key for run in runs for key in run.report.get("plan", {}).get("auto", [])}
    keys = list(dict.fromkeys(key for config in configs for key in config))
    keys = [key for key in keys if key not in chosen and key.split(".")[0] not in SILENT]
    told = [key for key in keys if len({str(config.get(key)) for config in configs}) > 1]
    return [_setting(config, told) for config in configs]


def config_of(folder: Path) -> dict[str, Any]:
    """The resolved config of a result folder by dotted key; empty where there is none to read."""
    from indent_sim.config import strict_yaml

    try:
        sections, _ = strict_yaml.parse((folder / CONFIG).read_text(encoding="utf-8"))
    except (OSError, ValueError, ConfigError):
        return {}
    return dict(_flat(sections)) if isinstance(sections, dict) else {}


def _flat(section: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in section.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{above}{key}.")
        else:
            yield f"{above}{key}", value


def _setting(config: Mapping[str, Any], keys: Sequence[str]) -> str:
    parts = []
    for key in keys:
        value, name = config.get(key), key.rpartition(".")[2]
        if value is not None:
            parts.append(f"{name} {value:.4g}" if isinstance(value, float) else f"{name} {value}")
    text = ", ".join(parts)
    return text if len(text) <= MOST_LETTERS else f"{text[: MOST_LETTERS - 1]}…"


def _refuse_other_units(runs: Sequence[Results]) -> None:
    """UsageError when two runs measure in different units; one that does not say is shown as it is."""
    for kind in ("length", "force"):
        known = {unit: run.path for run in runs if (unit := _unit(kind, run.report.get("units") or {}))}
        if len(known) > 1:
            (one, first), (other, second) = list(known.items())[:2]
            raise UsageError(f"{first} measures {kind} in {one}, {second} in {other}: draw them apart")
    flat = {_is_plane_strain(run): run.path for run in runs if _choice(run.report, "kinematics")}
    if len(flat) > 1:
        raise UsageError(f"the forces of {flat[True]} are per length, those of {flat[False]} are not: draw them apart")


def _theory_label(theory: Mapping[str, Any]) -> str:
    deviation = theory.get("force_deviation")
    beside = "" if deviation is None else f", this run {deviation:+.2%}"
    if "delta_deviation" in theory:
        beside = f", depth of this run {theory['delta_deviation']:+.2%}"
    return in_picture(f"{theory.get('name', 'theory')}{beside}", LABEL)


def _against_run(deviation: float | None) -> str:
    return "" if deviation is None else f": {abs(deviation):.1%} {'below' if deviation < 0 else 'above'} this run"


def _choice(report: Mapping[str, Any], key: str) -> str | None:
    choices = report.get("plan", {}).get("choices", [])
    return next((str(choice["value"]) for choice in choices if choice.get("key") == key), None)


def _is_plane_strain(results: Results) -> bool:
    return _choice(results.report, "kinematics") == "plane_strain"


def _depth_text(results: Results, step: float) -> str:
    delta = results["delta"][results["step"] == step]
    depth = _axis("delta", [results])
    return f"{depth(delta[0]):.4g} {in_picture(depth.unit)}".strip() if len(delta) else "?"


def _axis(column: str, runs: Sequence[Results]) -> Axis:
    names = {
        "delta": ("depth δ", "length"),
        "force": ("force F", "force"),
        "a": ("contact radius a", "length"),
    }
    name, kind = names[column]
    if all(_is_plane_strain(run) for run in runs):
        name, kind = {"a": ("contact half-width a", "length"), "force": ("force F per length", "line")}.get(
            column, (name, kind)
        )
    return _scaled(kind, runs, np.concatenate([run[column] for run in runs]), name)


def _scaled(kind: str, runs: Sequence[Results], values: np.ndarray, name: str) -> Axis:
    """An axis in the common unit of the runs, with the SI prefix that makes its largest number readable."""
    units = {_unit(kind, run.report.get("units") or {}) for run in runs}
    unit = units.pop() if len(units) == 1 else ""
    finite = np.abs(values[np.isfinite(values)])
    if unit not in SI or not finite.size or finite.max() == 0:
        return Axis(name, 1.0, unit)
    power = int(np.clip(3 * np.floor((np.log10(finite.max()) - 0.3) / 3 + 1e-9), -9, 9))
    return Axis(name, 10.0**-power, PREFIXES[power] + unit)


def _unit(kind: str, units: Mapping[str, str]) -> str:
    length, force = units.get("length", ""), units.get("force", "")
    if kind == "length" or not (length and force):
        return {"length": length, "force": force}.get(kind, "")
    if kind == "pressure" and force == "N" and length in ("m", "mm"):
        return "Pa" if length == "m" else "MPa"
    return {"force": force, "line": f"{force}/{length}", "pressure": f"{force}/{length}²"}[kind]
