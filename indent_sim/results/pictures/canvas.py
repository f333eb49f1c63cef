"""Canvas of all pictures: style, axes and units, saving, and whose a file is."""

from __future__ import annotations

import os
import tempfile
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from indent_sim.process.errors import UsageError, printable
from indent_sim.results.folder import content, read_report

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
LETTERS = 9.0  # of a title to the inch
SUBTITLE, LABEL = 200, 120  # most letters
PREFIXES = {-9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
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


@contextmanager
def canvas(size: tuple[float, float] = (9.2, 4.8)) -> Iterator[Figure]:
    """An empty figure in the style of all pictures."""
    with warnings.catch_warnings():  # of an Axes3D that is not wanted here, where two matplotlibs are installed
        warnings.filterwarnings("ignore", "Unable to import Axes3D")
        import matplotlib
        from matplotlib.figure import Figure
    with matplotlib.rc_context(STYLE):
        yield Figure(figsize=size, layout="constrained")


def from_zero(axes: Axes, *curves: Any) -> None:
    """Show from 0 to a little above the highest point."""
    highest = max((np.nanmax(curve) for curve in curves if np.size(curve) and np.isfinite(curve).any()), default=0)
    axes.set_ylim(0, 1.08 * highest if highest > 0 else 1)


def hollow(marker: str, colour: str) -> dict[str, Any]:
    """The look of a marker without a filling."""
    return {"marker": marker, "mfc": "none", "mec": colour, "ls": "", "ms": 6, "zorder": 2}


def name_axes(axes: Axes, x: str, y: str) -> None:
    """Label both axes."""
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


def choice(report: Mapping[str, Any], key: str) -> str | None:
    """What a run decided for a key of its plan, None where it says nothing."""
    choices = report.get("plan", {}).get("choices", [])
    return next((str(choice["value"]) for choice in choices if choice.get("key") == key), None)


def is_plane_strain(results: Results) -> bool:
    """Whether forces are per unit length."""
    return choice(results.report, "kinematics") == "plane_strain"


def axis(column: str, runs: Sequence[Results]) -> Axis:
    """The axis of a column of the force table, in the common unit of the runs."""
    names = {
        "delta": ("depth δ", "length"),
        "force": ("force F", "force"),
        "a": ("contact radius a", "length"),
    }
    name, kind = names[column]
    if all(is_plane_strain(run) for run in runs):
        name, kind = {"a": ("contact half-width a", "length"), "force": ("force F per length", "line")}.get(
            column, (name, kind)
        )
    return scaled(kind, runs, np.concatenate([run[column] for run in runs]), name)


def scaled(kind: str, runs: Sequence[Results], values: np.ndarray, name: str) -> Axis:
    """An axis in the common unit of the runs, with the SI prefix that makes its largest number readable."""
    units = {unit_of(kind, run.report.get("units") or {}) for run in runs}
    unit = units.pop() if len(units) == 1 else ""
    finite = np.abs(values[np.isfinite(values)])
    if unit not in SI or not finite.size or finite.max() == 0:
        return Axis(name, 1.0, unit)
    power = int(np.clip(3 * np.floor((np.log10(finite.max()) - 0.3) / 3 + 1e-9), -9, 9))
    return Axis(name, 10.0**-power, PREFIXES[power] + unit)


def unit_of(kind: str, units: Mapping[str, str]) -> str:
    """The label of a kind of number (length, force, line, pressure) from those of length and force."""
    length, force = units.get("length", ""), units.get("force", "")
    if kind == "length" or not (length and force):
        return {"length": length, "force": force}.get(kind, "")
    if kind == "pressure" and force == "N" and length in ("m", "mm"):
        return "Pa" if length == "m" else "MPa"
    return {"force": force, "line": f"{force}/{length}", "pressure": f"{force}/{length}²"}[kind]
