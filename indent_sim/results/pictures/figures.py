"""Figures: style of all pictures, legends, layout, and saving."""

from __future__ import annotations

import hashlib
import io
import os
import re
import tempfile
import textwrap
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from indent_sim.process.errors import UsageError
from indent_sim.results.atomic_files import write_atomically
from indent_sim.results.pictures.axes import picture_text
from indent_sim.results.result_files import is_own_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes
    from matplotlib.figure import Figure as Figure
    from matplotlib.figure import SubFigure as SubFigure
    from matplotlib.legend import Legend
else:
    Axes = Figure = SubFigure = object  # Matplotlib is imported only when something is drawn.

INK = "#222222"
GREY = "#6e6e6e"
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
FORCE_PICTURE = "force_indentation.png"
PICTURE_FORMATS = (".png", ".svg", ".pdf")
FONT_SIZE = 10.0  # Standard font size [points].
MAX_MARKED_POINTS = 40  # A line with more points has no markers.
# Height of the labels below a panel at the standard font size [inches].
AXIS_LABEL_HEIGHT = 0.58
MM_PER_INCH = 25.4
BarPosition = Literal["right", "bottom", "beside"]
PlotStyle = dict[str, Any]  # Keyword arguments of matplotlib's functions.
# Formulas of the half-space are drawn beside the curve of any body.
FORMULA_STYLE: PlotStyle = {"color": GREY, "ls": ":", "lw": 1.2, "zorder": 2}
RC_PARAMETERS: PlotStyle = {
    "figure.dpi": 100,  # Resolution at which the sizes of labels are measured.
    "legend.framealpha": 0.85,  # A long line of text may cross a steep curve.
    "text.usetex": False,  # Titles are users' texts, and LaTeX would execute commands in them.
    "svg.hashsalt": "indent-sim",  # Equal results give equal files.
    "axes.titlesize": "medium",
    "axes.formatter.limits": (-3, 4),
    "lines.linewidth": 1.6,
    "legend.fontsize": "small",
    "legend.edgecolor": "none",
    **dict.fromkeys(("axes.spines.top", "axes.spines.right", "legend.fancybox"), False),
    **dict.fromkeys(("axes.edgecolor", "xtick.color", "ytick.color"), GREY),
    **dict.fromkeys(("axes.labelcolor", "text.color", "xtick.labelcolor", "ytick.labelcolor"), INK),
}


@contextmanager
def new_figure(size: tuple[float, float] = (9.2, 4.8), font: float = FONT_SIZE) -> Iterator[Figure]:
    """Yield an empty figure of a size [inches] and a font size [points] in the common style."""
    with warnings.catch_warnings():
        # If two versions of matplotlib are installed, it warns about Axes3D, which is not used.
        warnings.filterwarnings("ignore", "Unable to import Axes3D")
        import matplotlib
        from matplotlib.figure import Figure
    # Lengths at the standard font size [points]; they grow with the letters.
    rc_lengths = {
        **dict.fromkeys(("xtick.major.size", "ytick.major.size"), 3.5),
        **dict.fromkeys(("xtick.minor.size", "ytick.minor.size"), 2.0),
        **dict.fromkeys(("xtick.major.pad", "ytick.major.pad"), 3.5),
        "axes.labelpad": 4.0,
        "axes.titlepad": 6.0,
    }
    lengths = {name: length * font / FONT_SIZE for name, length in rc_lengths.items()}
    with matplotlib.rc_context(RC_PARAMETERS | lengths | {"font.size": font}):
        yield Figure(figsize=size, layout="constrained")


def start_at_zero(axes: Axes, *curves: np.ndarray) -> None:
    """Set the vertical limits from 0 (or from below a negative minimum) to above the maximum."""
    values = np.concatenate([np.ravel(curve) for curve in curves])
    values = values[np.isfinite(values)]
    lowest = values.min(initial=0)
    highest = values.max(initial=-np.inf)
    axes.set_ylim(1.08 * lowest, 1.08 * highest if highest > 0 else 1)


def draw_legend_right(axes: Axes, labelled_axes: Axes) -> None:
    """Draw the legend of a panel to the right of another panel, and enlarge the figure."""
    figure = axes.get_figure()
    handles, names = labelled_axes.get_legend_handles_labels()
    if not names:
        return
    # A legend beside a panel with more names has columns.
    max_stacked_names = 30
    legend = axes.legend(
        handles,
        names,
        loc="upper left",
        bbox_to_anchor=(1, 1),
        ncol=-(-len(names) // max_stacked_names),
    )
    legend_width, legend_height = legend.get_window_extent().size / figure.dpi
    width, height = figure.get_size_inches()
    # Smallest distance above and below a legend beside a panel [inches].
    legend_margin = 0.6
    figure.set_size_inches(width + legend_width, max(height, legend_height + legend_margin))


def draw_legend_under(axes: Axes) -> float:
    """Draw the legend of a panel below it, not wider than it, and return its height [inches].

    The layout reserves space for the legend. Legends of panels side by side begin at the same
    height, because their panels end at the same height.
    """
    handles, names = axes.get_legend_handles_labels()
    if not names:
        return 0.0
    width = _panel_width(axes)
    draw = partial(
        axes.legend,
        handles,
        _wrap_names(names, width),
        loc="upper left",
        bbox_to_anchor=(0, -AXIS_LABEL_HEIGHT),
        bbox_transform=_inches_below(axes),
        borderaxespad=0,
        borderpad=0,
    )
    return float(_draw_in_columns(draw, width).get_window_extent().height / axes.get_figure().dpi)


def draw_figure_legend(figure: Figure, labelled_axes: Axes) -> None:
    """Draw the legend of a panel below all panels; the figure grows by its height."""
    handles, names = labelled_axes.get_legend_handles_labels()
    if not names:
        return
    width, height = figure.get_size_inches()
    # Left margin of a legend below all panels [inches].
    legend_left = 0.6
    draw = partial(
        figure.legend,
        handles,
        names,
        loc="lower left",
        bbox_to_anchor=(legend_left / width, 0),
        borderaxespad=0,
    )
    legend = _draw_in_columns(draw, width - legend_left)
    legend_height = legend.get_window_extent().height / figure.dpi
    figure.set_size_inches(width, height + legend_height)
    _reserve_margin(figure, below=legend_height)


def _draw_in_columns(draw: Callable[..., Legend], width: float) -> Legend:
    """Draw a legend with as many columns as fit into a width [inches], and return it."""
    legend = draw(ncol=1)
    column_width = legend.get_window_extent().width / legend.figure.dpi
    names = legend.get_texts()
    points_per_inch = 72.0
    gap = legend.columnspacing * names[0].get_fontsize() / points_per_inch
    legend.remove()
    return draw(ncol=int(np.clip((width + gap) / (column_width + gap), 1, len(names))))


def _wrap_names(names: Sequence[str], width: float) -> list[str]:
    """Break the names of a legend into lines that fit into a width [inches] with their handles."""
    # Width of the handle before a name at the standard font size [inches].
    handle_width = 0.45
    return [_wrap_text(name, width - handle_width * _font_scale()) for name in names]


def draw_panel_title(axes: Axes, title: str) -> None:
    """Draw a small title above a panel, broken into lines by the width of the panel."""
    width = _panel_width(axes)
    wrapped_title = "\n".join(_wrap_text(line, width) for line in title.split("\n"))
    axes.set_title(wrapped_title, loc="left", fontsize="small", color=GREY)


def _wrap_text(text: str, width: float) -> str:
    """Break a small text into lines that fit into a width [inches]."""
    # Width of a small letter at the standard font size [inches].
    letter_width = 0.07
    letters = int(width / (letter_width * _font_scale()))
    # Smallest number of letters in a line of a broken text.
    min_letters = 12
    return "\n".join(textwrap.wrap(text, max(min_letters, letters)))


def _panel_width(axes: Axes) -> float:
    """Return the width of a panel [inches]; an estimate before the layout is computed."""
    figure = axes.get_figure()
    spec = getattr(axes, "get_subplotspec", lambda: None)()
    if spec is None:  # Axes outside of a grid already have their final position.
        return float(axes.get_window_extent().width / figure.dpi)
    # Width of the labels to the left of a panel at the standard font size [inches].
    axis_label_width = 0.75
    return float(
        figure.bbox.width / figure.dpi / spec.get_gridspec().ncols
        - axis_label_width * _font_scale()
    )


def draw_colour_bar(
    panels: Sequence[Axes], drawn: Any, label: str, where: BarPosition, **look: Any
) -> Any:
    """Draw the colour bar of maps and return it.

    Parameters
    ----------
    panels
        Panels of the maps.
    drawn
        Object that matplotlib returned for one of the maps.
    label
        Label of the bar.
    where
        Position of the bar: "right" of all panels with their height; at the "bottom" of a single
        panel; or "beside" a single panel that is true to scale.
    """
    figure = panels[0].get_figure()
    if where == "right":
        look |= {"ax": list(panels), "aspect": 25}
    elif where == "beside":
        look["cax"] = panels[0].inset_axes((1.07, 0.0, 0.07, 1.0), label="<colorbar>")
    else:
        look["orientation"] = "horizontal"
        # Height of a colour bar at the standard font size [inches].
        bar_height = 0.12
        look["cax"] = panels[0].inset_axes(
            (0, -AXIS_LABEL_HEIGHT - bar_height, 1, bar_height),
            transform=_inches_below(panels[0]),
            label="<colorbar>",
        )
    # With uniform spacing the colour bar of contours would draw numbers beyond its ends at the
    # ends.
    bar = figure.colorbar(drawn, label=label, spacing="proportional", **look)
    bar.outline.set_visible(False)
    return bar


def _inches_below(axes: Axes) -> Any:
    """Return a transform of x in panel widths and y in inches above the panel's lower edge.

    The inches are scaled by the font size relative to the standard one.
    """
    from matplotlib.transforms import Affine2D, ScaledTranslation, blended_transform_factory

    inches = Affine2D().scale(_font_scale()) + axes.get_figure().dpi_scale_trans
    return blended_transform_factory(
        axes.transAxes, inches + ScaledTranslation(0, 0, axes.transAxes)
    )


def _reserve_margin(figure: Figure, above: float = 0.0, below: float = 0.0) -> None:
    """Reserve a height [inches] above or below the panels for texts."""
    height = figure.get_figheight()
    engine = figure.get_layout_engine()
    x, y, wide, high = engine.get()["rect"]  # type: ignore[union-attr]
    low = y + below / height
    top = y + high - above / height
    engine.set(rect=(x, low, wide, top - low))  # type: ignore[union-attr, call-arg]


def _font_scale() -> float:
    """Return the font size of the current figure, relative to the standard one."""
    from matplotlib import rcParams

    return float(rcParams["font.size"]) / FONT_SIZE


def draw_title(figure: Figure, title: str, subtitle: str) -> None:
    """Draw a title, shortened to the width of the figure, and a subtitle above the panels.

    The figure must have its final height.
    """
    height = figure.get_figheight()
    letters_per_inch = 9.0
    title_letters = int(letters_per_inch * figure.get_figwidth())
    _reserve_margin(figure, above=0.64)
    figure.text(
        0.01,
        1 - 0.12 / height,
        picture_text(title, title_letters),
        ha="left",
        va="top",
        fontsize=13,
        fontweight="bold",
    )
    # Longer subtitles are shortened.
    max_subtitle_letters = 200
    figure.text(
        0.01,
        1 - 0.46 / height,
        picture_text(subtitle, max_subtitle_letters),
        ha="left",
        va="top",
        color=GREY,
        fontsize=9,
    )


def refuse_foreign_picture(path: Path) -> None:
    """Raise UsageError if a file with the default name exists that this program did not make."""
    if os.path.lexists(path) and not is_own_file(path):
        raise UsageError(
            f"{path} exists and is not a picture of indent-sim; choose another name with --output"
        )


def picture_format(path: Path) -> str:
    """Return png, svg or pdf by the suffix of a file; raise UsageError for other suffixes."""
    if path.suffix.lower() not in PICTURE_FORMATS:
        raise UsageError(f"{path}: the name of a picture must end in {', '.join(PICTURE_FORMATS)}")
    return path.suffix.lower()[1:]


def svg_element(draw: Callable[[Path], object]) -> str:
    """Return a drawing as an SVG element of an HTML page; empty if nothing was drawn.

    Texts can be selected. The element has no prolog and no metadata, and its ids are unique among
    the pictures of the page.

    Parameters
    ----------
    draw
        Function that draws into a file.
    """
    import matplotlib

    with tempfile.TemporaryDirectory() as folder, matplotlib.rc_context({"svg.fonttype": "none"}):
        svg_file = Path(folder) / "picture.svg"
        draw(svg_file)
        if not svg_file.exists():
            return ""
        text = svg_file.read_text(encoding="utf-8")
    text = re.sub(
        r"<metadata>.*?</metadata>|<!--.*?-->", "", text[text.index("<svg") :], flags=re.DOTALL
    )
    text = re.sub(r' xmlns(:\w+)?="[^"]*"', "", text).replace("xlink:href", "href")
    prefix = hashlib.sha256(text.encode()).hexdigest()[:8]
    text = re.sub(r'(\bid="|href="#|url\(#)', rf"\g<1>p{prefix}-", text)
    return text.replace("<svg ", '<svg role="img" ', 1)


def apply_layout(figure: Figure) -> None:
    """Fix the positions of all panels by matplotlib's constrained layout.

    An axis whose tick labels would touch gets fewer labels. The layout is computed twice, since the
    margins change when labels are removed and when panels are drawn true to scale.

    Raises
    ------
    UsageError
        If the texts leave no space for the panels.
    """
    place_panels(figure)
    thin_tick_labels(figure)
    place_panels(figure)
    figure.set_layout_engine("none")


def place_panels(figure: Figure) -> None:
    """Place all panels by the layout of the figure; raise UsageError without enough space."""
    with warnings.catch_warnings():
        warnings.filterwarnings("error", ".*axes sizes collapsed to zero", UserWarning)
        try:
            figure.get_layout_engine().execute(figure)  # type: ignore[union-attr]
        except UserWarning:
            width = figure.get_figwidth() * MM_PER_INCH
            raise UsageError(
                f"the texts leave no room for the panels in a width of {width:.0f} mm",
                "increase --width, or decrease --font-size",
            ) from None


def thin_tick_labels(figure: Figure) -> None:
    """Fix the numbers of ticks of linear axes so that their labels do not touch.

    Otherwise these numbers would depend on the font size of the program that draws the figure.
    """
    from matplotlib.ticker import MaxNLocator

    panels = figure.axes
    bars = [bar for axes in panels for bar in axes.child_axes]
    max_ticks = 9
    for axes in (*panels, *bars):
        # Axes true to scale, and colour bars below panels, get the position in which matplotlib
        # draws them.
        locator = axes.get_axes_locator()
        axes.apply_aspect(locator(axes, None) if locator else None)
        for axis in (axes.xaxis, axes.yaxis):
            ticks = axis.get_major_locator()
            if not isinstance(ticks, MaxNLocator):
                continue
            bins = int(np.clip(axis.get_tick_space(), 1, max_ticks))
            ticks.set_params(nbins=bins)
            while bins > 1 and _has_touching_labels(axis):
                bins -= 1
                ticks.set_params(nbins=bins)


def _has_touching_labels(axis: Any) -> bool:
    """Return whether two tick labels of an axis touch."""
    boxes = [
        label.get_window_extent()
        for label in axis.get_ticklabels()
        if label.get_text() and label.get_visible()
    ]
    side = 0 if axis.axis_name == "x" else 1
    ends = sorted((box.min[side], box.max[side]) for box in boxes)
    # Smallest distance of tick labels [pixels].
    least_gap = 3.0
    return any(after[0] - before[1] < least_gap for before, after in pairwise(ends))


def save(figure: Figure, path: Path | str, dpi: float | None = None) -> None:
    """Write a figure as PNG, SVG or PDF by the suffix of the file, atomically.

    Parameters
    ----------
    figure
        The figure.
    path
        The file.
    dpi
        Resolution of rasterized parts; by default that of the format.

    Raises
    ------
    UsageError
        If the suffix is unknown, or the picture would have too many pixels.
    """
    path = Path(path)
    kind = picture_format(path)
    # Resolution of rasterized parts [dots per inch].
    resolutions = {"png": 160, "svg": 200, "pdf": 300}
    _refuse_too_many_pixels(figure, dpi or resolutions[kind])
    # A box stands for a letter that the font lacks, without a warning.
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"Glyph \d+ .*missing from", UserWarning)
        apply_layout(figure)
        picture = io.BytesIO()
        # No date is written: equal results give equal files.
        metadata: dict[str, dict[str, str | None]] = {
            "png": {"Software": "indent-sim"},
            "svg": {"Date": None},
            "pdf": {"CreationDate": None},
        }
        figure.savefig(picture, format=kind, dpi=dpi or resolutions[kind], metadata=metadata[kind])
    write_atomically(path, picture.getvalue(), sync=False)


def _refuse_too_many_pixels(figure: Figure, dpi: float) -> None:
    """Raise UsageError for a picture too large for matplotlib, or for the memory."""
    width, height = (float(inches) for inches in figure.get_size_inches())
    # Agg cannot draw longer sides [pixels]. A pixel takes 11 bytes until it is compressed: the
    # second limit keeps a picture below about 1 GB.
    max_side_pixels = 2**16 - 1
    max_pixels = 1e8
    max_dpi = min((max_pixels / (width * height)) ** 0.5, max_side_pixels / max(width, height))
    if dpi > max_dpi:
        size = f"{width * dpi:.0f} x {height * dpi:.0f} pixels"
        raise UsageError(
            f"{size} are too many for a picture", f"--dpi {int(max_dpi)} is possible at this size"
        )
