"""Pictures for a paper: panels where they are asked for, no overlaps, no axes without a name."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.figure import Figure
from picture_checks import faults

import indent_sim
from indent_sim.cli import commands
from indent_sim.process.errors import UsageError
from indent_sim.results.pictures import experiment, figures, forces, panels

ROOT = Path(__file__).resolve().parents[2]
SCENES = sorted([*(ROOT / "configs").glob("*.yaml"), *(ROOT / "configs" / "notes").glob("*.yaml")])
GEL = {
    "title": "A gel",
    "units": {"length": "mm", "force": "mN"},
    "body": {"shape": "cylinder", "radius": 6, "height": 3, "sides": "roller"},
    "material": {"model": "neo_hookean", "E": 3, "nu": 0.45},
    "indenter": {"shape": "sphere", "R": 1},
    "loading": {"deltas": [0.2, 0.4, 0.6, 0.3]},
    "mesh": {"h_contact": 0.15},
    "output": {"fields": "all", "surface": "all"},
}


@pytest.fixture(scope="module")
def gel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("results") / "gel"
    indent_sim.simulate(indent_sim.load(GEL), directory=folder)
    return folder


def panels_of(figure: Any) -> list[Any]:
    return [axes for axes in figure.axes if axes.axison and axes.get_label() != "<colorbar>"]


@pytest.mark.parametrize(
    "wish",
    [
        {"what": "force,pressure,fields", "layout": (1, 3), "width": 170, "font": 8},
        {
            "what": "force,pressure,profile",
            "layout": (1, 3),
            "width": 170,
            "font": 7,
            "steps": "1,2,3",
        },
        {"what": "force,fields", "layout": (1, 2), "width": 85, "font": 6},
        {
            "what": "fields",
            "fields": "von_mises,principal_3,J,displacement",
            "layout": (2, 2),
            "width": 170,
            "font": 8,
        },
        {
            "what": "fields",
            "steps": "1,2,3",
            "layout": (1, 3),
            "width": 170,
            "font": 8,
            "zoom": 1.5,
        },
        {"what": "force,pressure,profile,fields"},
        {"what": "force", "layout": (1, 1), "width": 60, "font": 8},
    ],
    ids=str,
)
@pytest.mark.parametrize("letters", ["", "a"])
def test_panels_stand_where_they_are_asked_for_without_faults(
    gel: Path, wish: dict[str, Any], letters: str
) -> None:
    figure = indent_sim.plot(gel, **wish, letters=letters)
    assert faults(figure) == []
    shown = panels_of(figure)
    if letters:
        assert [axes.get_title(loc="left")[:3] for axes in shown] == ["(a)", "(b)", "(c)", "(d)"][
            : len(shown)
        ]
    if layout := wish.get("layout"):
        assert len(shown) == layout[0] * layout[1]
        lefts = sorted(
            {
                round(axes.get_window_extent().x0 // (figure.bbox.width / layout[1]))
                for axes in shown
            }
        )
        assert lefts == list(range(layout[1]))
    if width := wish.get("width"):
        assert figure.get_size_inches()[0] == pytest.approx(width / 25.4)


def test_colours_and_frame_are_those_asked_for(gel: Path) -> None:
    def mesh(figure: Any) -> Any:
        return next(one for one in panels_of(figure)[0].collections if one.get_array() is not None)

    near = indent_sim.plot(gel, "fields", zoom=1.0, limits=(0, 2))
    whole = indent_sim.plot(gel, "fields", zoom=float("inf"))
    assert mesh(near).get_clim() == (0, 2)
    assert panels_of(whole)[0].get_xlim()[1] == pytest.approx(
        6, rel=1e-6
    )  # the body's radius, in mm
    radius = indent_sim.read(gel)["a"][2]
    assert panels_of(near)[0].get_xlim()[1] == pytest.approx(radius, rel=1e-6)


@pytest.mark.parametrize("what", ["force", "pressure", "profile", "fields"])
def test_panels_are_drawn_into_axes_of_ones_own(gel: Path, what: str) -> None:
    """Axes in the second column, and axes outside of a grid, have both names and their numbers."""
    own = Figure()
    for axes in (own.subplots(1, 2)[1], own.add_axes((0.1, 0.1, 0.4, 0.4))):
        assert indent_sim.plot(gel, what, ax=axes) is own
        assert axes.get_xlabel()
        assert axes.get_ylabel()
        assert any(label.get_text() for label in axes.get_yticklabels())


def test_a_layout_without_room_is_refused(gel: Path) -> None:
    with pytest.raises(UsageError, match=r"1x1 has room for 1 panels, but the picture has 2"):
        indent_sim.plot(gel, "force,pressure", layout=(1, 1))
    with pytest.raises(UsageError, match=r"4 panels side by side .* need --width"):
        indent_sim.plot(gel, "force", layout=(1, 4), width=60)
    with pytest.raises(UsageError, match="plot has no option colour; its options are fields"):
        indent_sim.plot(gel, "force", colour="red")


@pytest.mark.parametrize(("width", "font"), [(85, 40), (50, 10)], ids=str)
@pytest.mark.parametrize("what", ["force", "pressure", "fields"])
def test_letters_too_large_for_a_width_are_refused(
    gel: Path, what: str, width: float, font: float
) -> None:
    """The message names a width and a font size, and both of them make a picture without faults."""
    with pytest.raises(UsageError, match="pt need --width") as refused:
        indent_sim.plot(gel, what, width=width, font=font)
    needed_width, fitting_font = re.findall(
        r"--width (\d+), or --font-size ([\d.]+)", str(refused.value)
    )[0]
    for size in (
        {"width": float(needed_width), "font": font},
        {"width": width, "font": float(fitting_font)},
    ):
        assert faults(indent_sim.plot(gel, what, **size)) == []


def test_the_smallest_picture_of_the_command_has_letters_too_large(gel: Path) -> None:
    words = ["--what", "force", "--width", "30", "--font-size", "40"]
    done = CliRunner().invoke(commands.program, ["plot", str(gel), *words])
    assert done.exit_code == 2
    assert "need --width 265, or --font-size 4.5" in done.stderr


def test_a_text_without_room_is_refused() -> None:
    """Matplotlib's layout leaves no room for axes: an error instead of a picture of letters."""
    with figures.new_figure((1.0, 1.0), 40.0) as figure:
        figure.subplots().set(xlabel="depth", ylabel="force")
        with pytest.raises(UsageError, match="no room for the panels in a width of 25 mm"):
            figures.apply_layout(figure)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--layout", "3"], "is not ROWSxCOLUMNS"),
        (["--layout", "0x2"], "is not ROWSxCOLUMNS"),
        (["--limits", "1"], "is not A:B"),
        (["--zoom", "far"], "neither a number > 0 nor 'all'"),
        (["--zoom", "0"], "neither a number > 0 nor 'all'"),
        (["--zoom", "2"], "--zoom is only for --what fields"),
        (["--what", "fields", "--zoom", "1e-6"], "no point of the mesh is in view"),
        (["--what", "fields", "--limits", "2:1"], "the first must be below the second"),
    ],
)
def test_options_that_make_no_picture_are_refused(gel: Path, options: list[str], said: str) -> None:
    done = CliRunner().invoke(commands.program, ["plot", str(gel), *options])
    assert done.exit_code == 2 and said in done.stderr


def test_the_command_takes_all_of_them(gel: Path, tmp_path: Path) -> None:
    """`plot` takes all options at once; 85 mm at 100 dots per inch are 335 pixels."""
    words = (
        "--what force,fields --layout 1x2 --letters --dpi 100 --limits 0:2 --zoom all "
        "--width 85 --font-size 6"
    )
    path = tmp_path / "picture.png"
    done = CliRunner().invoke(
        commands.program, ["plot", str(gel), *words.split(), "--output", str(path)]
    )
    assert done.exit_code == 0, done.output
    assert matplotlib.image.imread(path).shape[1] == pytest.approx(85 / 25.4 * 100, abs=1)


LAYER = {
    "units": {"length": "um", "force": "nN"},
    "body": {"shape": "layer", "height": "10 um"},
    "material": {"model": "linear_elastic", "E": "1 kPa", "nu": 0.3},
    "indenter": {"shape": "sphere", "R": "5 um"},
    "loading": {"delta": "0.5 um", "steps": 5},
}


def test_twenty_curves_have_a_bar_units_and_hertz_beside_them() -> None:
    """Curves over twenty thicknesses have a colour bar with units, and one curve of Hertz.

    Thicknesses as plain numbers are in the scene's um. The half-space does not depend on them.
    """
    vary = {"body.height": {"from": 2, "to": 40, "count": 20, "spacing": "log"}}
    figure = indent_sim.plot(indent_sim.study({"base": LAYER, "vary": vary}))
    assert faults(figure) == []
    curves, *_ = panels_of(figure)
    assert [text.get_text() for text in curves.get_legend().get_texts()] == [
        "Sneddon (sphere), half-space"
    ]
    labels = {axes.get_xlabel() for axes in panels_of(figure)} | {
        axes.get_ylabel() for axes in figure.axes
    }
    assert {"height [µm]", "depth δ [µm]", "force F [nN]"} <= labels
    hertz = next(
        line for line in curves.lines if line.get_linestyle() == figures.FORMULA_STYLE["ls"]
    )
    deepest = indent_sim.plan(LAYER)["prediction"]["force_half_space"]
    assert hertz.get_ydata()[-1] == pytest.approx(deepest, rel=1e-9)


def test_curves_beside_a_panel_with_one_line_of_names_keep_their_own_below_them() -> None:
    """The names of curves stay below them beside a panel with one line of names.

    The panel of the curves spans the cell of the names, which is lower than what stands below an
    axis.
    """
    figure = indent_sim.plot(
        indent_sim.study({"base": LAYER, "vary": {"body.height": [5, 20], "indenter.R": [4, 6]}})
    )
    assert faults(figure) == []


def test_words_that_vary_are_named_and_formulas_that_differ_are_not_drawn() -> None:
    vary = {"indenter": [{"shape": "sphere", "R": 5}, {"shape": "cone", "half_angle": 70}]}
    figure = indent_sim.plot(indent_sim.study({"base": LAYER, "vary": vary}))
    drawn = {line.get_linestyle() for line in figure.axes[0].lines}
    assert faults(figure) == [] and figures.FORMULA_STYLE["ls"] not in drawn


def test_the_checker_finds_what_is_wrong() -> None:
    with figures.new_figure() as figure:
        axes = figure.subplots()
        axes.plot([0, 1])
        figure.text(0.5, 0.5, "one")
        figure.text(0.5, 0.5, "other")
        figure.text(0.99, 0.9, "much too far to the right")
        found = faults(figure)
    assert (
        "'one' lies on 'other'" in found
        and "'much too far to the right' goes beyond the edge" in found
    )
    assert sum("has no name" in fault for fault in found) == 2


def test_the_checker_finds_legends_that_tell_nothing() -> None:
    with figures.new_figure((9.2, 9.0)) as figure:
        axes = figure.subplots()
        for i in range(13):
            axes.plot(
                [0, 1],
                [0, i],
                color=figures.COLOURS[i % 7],
                ls="-" if i < 12 else "--",
                label=f"line {i}",
            )
        axes.legend()
        found = faults(figure)
    assert "a legend of 13 names" in found and "'line 0' looks as 'line 7'" in found
    assert not [fault for fault in found if "'line 12'" in fault]


def test_the_checker_finds_words_on_the_panel_of_another() -> None:
    """The checker of pictures finds words that reach into another panel."""
    with figures.new_figure() as figure:
        one, other = figure.subplots(1, 2)
        for axes in (one, other):
            axes.set(xlabel="x", ylabel="y")
        figure.draw_without_rendering()
        figure.set_layout_engine("none")
        one.text(0.9, 0.5, "a name that is much too long", transform=one.transAxes)
        assert "'a name that is much too long' lies on the panel of another" in faults(figure)


# One of each kind of picture: three dimensions, plane strain, theory alone, histories with and
# without fluid, adhesion, friction, an inclusion, a stack, a tip off the axis
KINDS = (
    "hertz",
    "hertz_cube",
    "plane_strain",
    "wide_layer",
    "draining_gel",
    "creeping_cell",
    "sticky_gel",
    "lifted_sphere",
    "thin_gel_stick",
    "nucleus",
    "bilayer_gel",
    "off_axis",
)


@pytest.mark.verify
@pytest.mark.parametrize(
    "path", [path for path in SCENES if path.stem in KINDS], ids=lambda path: path.stem
)
def test_no_picture_of_a_shipped_scene_has_a_fault(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The pictures of a run of a shipped scene, and every panel on request, have no fault."""
    drawn: list[Any] = []

    def keep(figure: Any, path: Path) -> None:
        figures.apply_layout(figure)
        drawn.append((path.name, faults(figure)))

    for module in (figures, forces, experiment):
        monkeypatch.setattr(module, "save", keep)
    indent_sim.simulate(indent_sim.load(path), directory=tmp_path / "run")
    result = indent_sim.read(tmp_path / "run")
    there = ["force", *(["pressure", "profile"] if np.any(result.surface.get("step", ())) else [])]
    there += ["fields"] if (tmp_path / "run" / "fields").exists() else []
    panels.draw([result], panels.plot_request({"what": tuple(there)}), tmp_path / "all.png")
    assert drawn and [fault for fault in drawn if fault[1]] == []
