"""Pictures of results of every shape show what they should."""

from __future__ import annotations

import dataclasses
import os
import re
import warnings
from itertools import pairwise
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from made_results import TITLES, a_result
from matplotlib.text import Text

from indent_sim.process.errors import UsageError, printable
from indent_sim.results.pictures import figures, forces
from indent_sim.results.pictures.run_names import config_by_key
from indent_sim.results.reader import Results
from indent_sim.studies import study_picture


def text_of(path: Path) -> str:
    return path.read_text()


@pytest.fixture
def svg(tmp_path, monkeypatch):
    """Path of an SVG picture whose words can be read."""
    monkeypatch.setitem(figures.RC_PARAMETERS, "svg.fonttype", "none")
    return tmp_path / "picture.svg"


@pytest.fixture
def panels(tmp_path, monkeypatch):
    """The panels of a run by the first word along their vertical axis."""
    drawn_figures = []
    monkeypatch.setattr(forces, "save", lambda figure, path: drawn_figures.append(figure))

    def draw(result):
        forces.draw_force_indentation(result, tmp_path / "picture.png")
        return {axes.get_ylabel().split(" ")[0]: axes for axes in drawn_figures[-1].axes}

    return draw


def drawn_points(axes) -> np.ndarray:
    """All points (n, 2) through which lines of a panel go."""
    return np.concatenate(
        [np.empty((0, 2)), *(np.reshape(line.get_xydata(), (-1, 2)) for line in axes.get_lines())]
    )


class TestOneRun:
    @pytest.mark.parametrize(
        ("kind", "suffix"),
        [
            ("axisymmetric", ".png"),
            ("axisymmetric", ".svg"),
            ("plane_strain", ".pdf"),
            ("three_dimensional", ".png"),
        ],
    )
    def test_every_kind_and_every_format(self, tmp_path, kind, suffix):
        path = tmp_path / f"picture{suffix}"
        forces.draw_force_indentation(a_result(kind, error=True), path)
        assert path.stat().st_size > 5000 and list(tmp_path.iterdir()) == [path]

    def test_the_power_of_ten_of_an_axis_is_written_beside_it(self, tmp_path, monkeypatch):
        drawn_figures = []
        monkeypatch.setattr(forces, "save", lambda figure, path: drawn_figures.append(figure))
        forces.draw_force_indentation(a_result(units={}), tmp_path / "picture.png")
        figures.apply_layout(drawn_figures[0])
        along = drawn_figures[0].axes[0].xaxis
        assert along.get_offset_text().get_text() == "1e−5"

    def test_the_words_on_it(self, svg):
        forces.draw_force_indentation(a_result(error=True), svg)
        words = (
            "A title",
            "undeformed point",
            "penalty",
            "[µm]",
            "layer theory",
            "+0.10%",
            "Hertz",
            "estimated error",
        )
        assert [word for word in words if word not in text_of(svg)] == []

    def test_the_error_of_a_single_step_is_drawn(self, svg):
        """The error of a single step is a bar, as a band needs two points.

        It reaches from 0.9 to 1.1 of the force.
        """
        forces.draw_force_indentation(a_result(steps=1, error=True), svg)
        assert "LineCollection" in text_of(svg) and "estimated error" in text_of(svg)

    def test_plane_strain_forces_are_per_length(self, svg):
        forces.draw_force_indentation(a_result("plane_strain"), svg)
        assert "N/m]" in text_of(svg) and "half-width" in text_of(svg)

    def test_a_length_and_force_stay_and_a_pressure_is_one(self, svg):
        """Lengths and forces keep their units, and a pressure in mN/mm² is shown in Pa."""
        forces.draw_force_indentation(a_result(units={"length": "mm", "force": "mN"}), svg)
        assert "[mm]" in text_of(svg) and "[mN]" in text_of(svg) and "[Pa]" in text_of(svg)

    def test_units_unknown_to_us_are_shown_as_they_are(self, svg):
        forces.draw_force_indentation(a_result(units={"length": "inch", "force": "lbf"}), svg)
        assert "[inch]" in text_of(svg) and "[lbf/inch²]" in text_of(svg)

    def test_a_failed_run_says_so(self, svg):
        forces.draw_force_indentation(a_result(status="failed", reason="step 6: no"), svg)
        assert "failed: step 6: no" in text_of(svg)

    @pytest.mark.parametrize("steps", [1, 200])
    def test_few_and_many_steps(self, panels, steps):
        """The curve goes through every row."""
        result = a_result(steps=steps, units={}, theory=None)
        points = {tuple(point) for point in drawn_points(panels(result)["force"])}
        assert set(zip(result["delta"], result["force"], strict=True)) <= points

    def test_a_bare_table_out_of_contact(self, panels):
        """Rows without force are drawn, without a panel of the pressure."""
        table = {"step": [1.0, 2.0], "delta": [-0.1, 0.0], "force": [0.0, 0.0], "a": [0.0, 0.0]}
        drawn = panels(
            Results(Path("a.csv"), {name: np.array(column) for name, column in table.items()})
        )
        assert {(-0.1, 0.0), (0.0, 0.0)} <= {tuple(point) for point in drawn_points(drawn["force"])}
        assert "pressure" not in drawn

    def test_no_rows_at_all(self, panels):
        empty = {name: np.array([]) for name in ("step", "delta", "force", "a")}
        drawn = panels(Results(Path("a.csv"), empty))
        assert set(drawn) >= {"force", "contact"} and "pressure" not in drawn
        for name in ("force", "contact"):  # nothing but the line of zero
            assert not drawn_points(drawn[name])[:, 1].any()

    def test_one_point_in_contact(self, panels):
        """A map shows a single point in contact within an element of it."""
        result = a_result("three_dimensional", units={})
        result.surface["pressure"] = np.where(result.surface["pressure"] == 1, 1.0, 0.0)
        assert np.count_nonzero(result.surface["pressure"]) == 1
        regions = [
            path
            for part in panels(result)["y"].collections
            for path in part.get_paths()
            if len(path.vertices)
        ]
        assert np.abs(regions[-1].vertices).max() <= np.unique(result.surface["x"])[1]

    @pytest.mark.parametrize("suffix", figures.PICTURE_FORMATS)
    def test_two_drawings_are_the_same_file(self, tmp_path, suffix):
        for name in ("a", "b"):
            forces.draw_force_indentation(a_result(), tmp_path / f"{name}{suffix}")
        assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


class TestPressure:
    """The pressure is shown where the contact is, whatever ripples there are elsewhere."""

    @pytest.mark.parametrize("kind", ["axisymmetric", "plane_strain"])
    def test_ripples_outside_do_not_scale_a_profile(self, panels, kind):
        result = a_result(kind, units={})
        surface, a = result.surface, result["a"][-1]
        surface["pressure"] = np.where(surface["x"] > a, 1e-7, surface["pressure"])
        axes = panels(result)["pressure"]
        assert axes.get_ylim() == pytest.approx((0, 1.08))
        assert axes.get_xlim() == pytest.approx(
            (0, 1.5 * a) if kind == "axisymmetric" else (-1.5 * a, 1.5 * a)
        )

    def test_the_largest_force_is_shown_when_the_tip_has_left(self, panels):
        result = a_result(units={})
        result.table["force"][-1] = 0.0
        left = {name: np.append(column, column) for name, column in result.surface.items()}
        left["step"][: len(left["x"]) // 2] = 4.0
        left["pressure"][len(left["x"]) // 2 :] = 1e-17
        result.surface.update(left)
        assert panels(result)["pressure"].get_title(loc="left").startswith("step 4,")
        result.table["force"][:] = result.table["a"][:] = 0.0  # nothing touches
        assert "pressure" not in panels(result)

    def test_a_singular_edge_does_not_hide_the_rest(self, panels):
        result = a_result(units={})
        pressure = result.surface["pressure"]
        pressure[np.flatnonzero(pressure)[-1]] = 1e3
        assert panels(result)["pressure"].get_ylim()[1] < 10

    @pytest.mark.parametrize("center", [None, (0.0, 0.0)])
    def test_a_map_shows_the_contact_and_not_the_whole_top(self, panels, center):
        result = a_result("three_dimensional", units={}, **({"center": center} if center else {}))
        surface, a = result.surface, result["a"][-1]
        surface["pressure"] = np.where(
            np.hypot(surface["x"], surface["y"]) > a, 1e-7, surface["pressure"]
        )
        axes = panels(result)["y"]
        assert axes.get_xlim() == axes.get_ylim() == pytest.approx((-1.5 * a, 1.5 * a))

    def test_the_words_on_a_map_with_friction_stand_inside_it(self, panels):
        result = a_result("three_dimensional", units={})
        result.surface["shear"] = 0.1 * result.surface["pressure"]
        result.table["stick_radius"] = 0.5 * result["a"]
        axes = panels(result)["y"]
        axes.figure.draw_without_rendering()
        (words,) = axes.texts
        inside, text = axes.get_window_extent(), words.get_window_extent()
        assert "stick radius" in words.get_text()
        assert (
            inside.x0 < text.x0
            and text.x1 < inside.x1
            and inside.y0 < text.y0
            and text.y1 < inside.y1
        )

    @pytest.mark.parametrize("faces", [3, 4, 5])
    def test_a_map_shows_the_corners_of_a_contact(self, panels, faces):
        """A map shows the corners of a contact that is a regular polygon of the area pi a^2.

        The corners of a triangle are 1.56 a from its middle.
        """
        x, y = (
            part.ravel() for part in np.meshgrid(np.linspace(-3, 3, 121), np.linspace(-3, 3, 121))
        )
        apothem = np.sqrt(np.pi / (faces * np.tan(np.pi / faces)))
        normals = 2 * np.pi * np.arange(faces) / faces
        inside = (
            np.max([x * np.cos(turn) + y * np.sin(turn) for turn in normals], axis=0) <= apothem
        )
        pressure = np.where(inside, 1.0, 1e-7)
        surface = {"step": np.full(len(x), 1.0), "x": x, "y": y, "pressure": pressure}
        table = {"step": [1.0], "delta": [1.0], "force": [1.0], "a": [1.0]}
        plan = {"choices": [{"key": "kinematics", "value": "three_dimensional"}]}
        report = {"title": "A polygon", "center": [0.0, 0.0], "plan": plan}
        axes = panels(
            Results(Path("one"), {name: np.array(v) for name, v in table.items()}, report, surface)
        )["y"]
        for along, (low, high) in ((x, axes.get_xlim()), (y, axes.get_ylim())):
            assert low < along[inside].min() and along[inside].max() < high and high - low < 4
            assert low == pytest.approx(-high)

    def test_a_tip_beside_the_origin_is_found(self, panels):
        result = a_result("plane_strain", units={}, center=[2.0])
        result.surface["x"] = np.concatenate([2 - result.surface["x"], 2 + result.surface["x"]])
        for name in ("y", "pressure", "step"):
            result.surface[name] = np.tile(result.surface[name], 2)
        a = result["a"][-1]
        assert panels(result)["pressure"].get_xlim() == pytest.approx((2 - 1.5 * a, 2 + 1.5 * a))

    def test_depths_under_the_radius_do_not_touch(self, panels):
        axes = panels(a_result(units={}))["contact"]
        figures.apply_layout(axes.figure)
        labels = [label for label in axes.get_xticklabels() if label.get_text()]
        ends = sorted(tuple(label.get_window_extent().intervalx) for label in labels)
        assert len(ends) > 2 and all(before[1] < after[0] for before, after in pairwise(ends))


class TestSeveralRuns:
    def test_each_is_named(self, svg):
        runs = [a_result(title="soft"), a_result(title="stiff", steps=8)]
        forces.draw_overlay(runs, svg)
        assert "soft" in text_of(svg) and "stiff" in text_of(svg)

    def test_titles_that_do_not_tell_them_apart_give_way_to_folders(self, svg):
        forces.draw_overlay([a_result(), a_result()], svg)
        assert "results/one" in text_of(svg)

    @pytest.mark.parametrize(
        "units", [{"length": "mm", "force": "N"}, {"length": "m", "force": "mN"}]
    )
    def test_units_that_differ_are_refused(self, tmp_path, units):
        with pytest.raises(UsageError, match="draw them separately"):
            forces.draw_overlay([a_result(), a_result(units=units)], tmp_path / "picture.png")
        assert not list(tmp_path.iterdir())

    def test_forces_per_length_beside_forces_are_refused(self, tmp_path):
        with pytest.raises(UsageError, match="per length"):
            forces.draw_overlay([a_result(), a_result("plane_strain")], tmp_path / "picture.png")

    def test_no_unit_is_claimed_for_a_curve_that_names_none(self, svg):
        """Beside a curve without units the axes name none, and the legend has all units."""
        forces.draw_overlay(
            [a_result(title="simulated"), a_result(title="measured", units={})], svg
        )
        said = re.findall(r">([^<>]*\[[^<>]*\])<", text_of(svg))
        assert sorted(said) == ["measured [unit unknown]", "simulated [m and N]"]

    @pytest.fixture
    def drawn(self, tmp_path, monkeypatch):
        """A function that returns the laid-out figure of runs in folders with configs."""
        drawn_figures = []
        monkeypatch.setattr(
            forces,
            "save",
            lambda figure, path: (figure.draw_without_rendering(), drawn_figures.append(figure)),
        )

        def draw(settings, error=False):
            runs = []
            for i, (nu, method) in enumerate(settings):
                place = tmp_path / f"{i * 0x9E3779B9:016x}"  # as a study names its runs
                place.mkdir()
                config = (
                    f"material: {{nu: {nu!r}}}\ncontact: {{method: "
                    f"{method}, epsilon_n: {nu + 100}}}\n"
                )
                (place / "config.yaml").write_text(config)
                result = a_result(error=error, units={})
                result.report["plan"]["auto"] = ["contact.epsilon_n"]
                runs.append(dataclasses.replace(result, path=place))
                runs[-1].table["force"] = result["force"] * (1 + nu)
            forces.draw_overlay(runs, tmp_path / "picture.png")
            return drawn_figures[-1]

        return draw

    @pytest.mark.parametrize(("number", "error"), [(2, True), (10, False), (60, True)])
    def test_the_legend_says_what_differs_and_hides_nothing(self, drawn, number, error):
        values = np.linspace(0, 0.49, number)
        figure = drawn([(float(nu), "penalty") for nu in values[::-1]], error)
        force, radius = figure.axes
        told = [text.get_text() for text in radius.get_legend().get_texts()]
        names = [f"nu {nu:.4g}" for nu in values]
        assert [name for name in told if name != forces.ERROR_LABEL] == names and (
            forces.ERROR_LABEL in told
        ) == error
        legend = radius.get_legend().get_window_extent()
        assert not any(legend.overlaps(axes.get_window_extent()) for axes in (force, radius))
        assert (
            figure.bbox.x0 <= legend.x0
            and legend.x1 <= figure.bbox.x1
            and figure.bbox.y0 <= legend.y0
        )

    def test_every_curve_is_its_table_in_a_colour_of_its_own(self, drawn):
        values = np.linspace(0, 0.49, 11)
        lines = [
            line
            for line in drawn([(float(nu), "penalty") for nu in values]).axes[0].get_lines()
            if line.get_label().startswith("nu")
        ]
        plain = a_result()
        for nu, line in zip(values, lines, strict=True):
            rows = np.isin(
                line.get_xdata(), plain["delta"]
            )  # the others lie on a smooth curve between them
            assert line.get_xdata()[rows] == pytest.approx(plain["delta"])
            assert line.get_ydata()[rows] == pytest.approx(plain["force"] * (1 + nu))
        assert len({tuple(line.get_color()) for line in lines}) == 11

    def test_several_keys_that_differ_are_all_named(self, drawn):
        figure = drawn([(nu, method) for nu in (0.1, 0.3) for method in ("penalty", "nitsche")])
        told = [text.get_text() for text in figure.axes[1].get_legend().get_texts()]
        assert told == [
            f"nu {nu}, method {method}" for nu in (0.1, 0.3) for method in ("nitsche", "penalty")
        ]

    def test_more_runs_than_colours(self, drawn):
        """More runs than colours have a curve and a name each."""
        number = len(figures.COLOURS) + 2
        axes = drawn([(0.05 * k, "penalty") for k in range(number)]).axes
        named = [
            line.get_label() for line in axes[0].get_lines() if line.get_label().startswith("nu")
        ]
        assert len(set(named)) == number == len(axes[1].get_legend().get_texts())


class TestText:
    """Text of a stranger is only text in a picture too."""

    @pytest.mark.parametrize("title", TITLES[:6:2])
    def test_a_picture_shows_it_too(self, tmp_path, monkeypatch, title):
        monkeypatch.setitem(figures.RC_PARAMETERS, "svg.fonttype", "none")
        run = a_result(title=title, units={"length": title, "force": title})
        forces.draw_overlay(
            [run, a_result(title="another", units=run.report["units"])], tmp_path / "two.svg"
        )
        forces.draw_force_indentation(run, tmp_path / "one.svg")
        for name in ("one", "two"):
            text = (tmp_path / f"{name}.svg").read_text()
            escaped = printable(title).replace("&", "&amp;")
            assert escaped in text, name

    def test_and_that_of_a_study(self, tmp_path):
        costs = {"cpu_s": 1.0, "status": "done", "index": 1, "run": "x", "dofs": 10}
        rows = [
            costs
            | {
                "contact.method": title,
                "force_error_vs": 0.01 * (1 + n),
                "cpu_s": 1.0 + n,
                "method": title,
            }
            for n, title in enumerate(TITLES[:6])
        ]
        study_picture.draw_cost(rows, ["contact.method"], "$\\frac{", "$x", tmp_path / "study.png")
        assert (tmp_path / "study.png").stat().st_size > 5000

    @pytest.mark.parametrize("name", ["one.png", "one.svg", "one.pdf"])
    def test_a_letter_that_the_font_lacks_is_no_warning(self, tmp_path, name):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            forces.draw_force_indentation(a_result(title="細胞"), tmp_path / name)
        assert (tmp_path / name).stat().st_size > 5000

    def test_latex_is_not_started(self, tmp_path, monkeypatch):
        """The title is drawn as the letters that it is, and LaTeX is not started."""
        drawn = []
        monkeypatch.setattr(
            forces, "save", lambda figure, path: (drawn.append(figure), figures.save(figure, path))
        )
        with matplotlib.rc_context({"text.usetex": True}):
            forces.draw_force_indentation(
                a_result(title=r"\input{/etc/passwd}"), tmp_path / "one.png"
            )
        words = drawn[0].findobj(Text)
        assert any(r"\input{/etc/passwd}" in word.get_text().replace(r"\$", "$") for word in words)
        assert (
            not any(word.get_usetex() for word in words)
            and (tmp_path / "one.png").stat().st_size > 5000
        )


def test_an_unknown_format_is_refused(tmp_path):
    with pytest.raises(UsageError, match="picture"):
        forces.draw_force_indentation(a_result(), tmp_path / "picture.bmp")
    assert not list(tmp_path.iterdir())


def test_a_config_that_never_ends_is_none(tmp_path):
    """A pipe in the place of config.yaml is no config; opening it would wait for a writer."""
    os.mkfifo(tmp_path / "config.yaml")
    assert config_by_key(tmp_path) == {}
    (tmp_path / "config.yaml").unlink()
    (tmp_path / "config.yaml").write_text("body: {height: 1}\n")
    assert config_by_key(tmp_path) == {"body.height": 1}
