"""Pictures: what they show is in them, in every shape a result can have."""

from __future__ import annotations

import dataclasses
import os
import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from indent_sim.process.errors import UsageError
from indent_sim.results.pictures import canvas, forces
from indent_sim.results.pictures.names import config_of
from indent_sim.results.reader import Results


def a_result(kind: str = "axisymmetric", steps: int = 5, error: bool = False, **report) -> Results:
    delta = 1e-5 * np.arange(1, steps + 1)
    a, force = np.sqrt(1e-3 * delta), 1e3 * delta**1.5
    x = np.linspace(0, 3 * a[-1], 40)
    y = np.zeros(40)
    if kind == "three_dimensional":
        x, y = (part.ravel() for part in np.meshgrid(x, x))
    pressure = np.sqrt(np.maximum(1 - (x**2 + y**2) / a[-1] ** 2, 0))
    surface = {"step": np.full(len(x), float(steps)), "x": x, "y": y, "pressure": pressure}
    table = {"step": np.arange(1.0, steps + 1), "delta": delta, "force": force, "a": a}
    if error:
        table["force_error"] = 0.1 * force
    plan = {"choices": [{"key": "kinematics", "value": kind, "why": ""}]}
    theory = {
        "name": "layer theory",
        "delta": delta[-1],
        "force_deviation": 0.001,
        "half_space": {"name": "Hertz", "force": 0.9 * force[-1], "deviation": -0.1},
        "curve": {"delta": delta.tolist(), "force": force.tolist(), "a": a.tolist()},
    }
    units = {"length": "m", "force": "N"}
    facts = {"title": "A title", "gap": "reference", "method": "penalty", "units": units, "theory": theory}
    return Results(Path("results/one"), table, facts | {"plan": plan} | report, surface)


def text_of(path: Path) -> str:
    return path.read_text()


@pytest.fixture
def svg(tmp_path, monkeypatch):
    """Draw into an SVG whose words can be read."""
    monkeypatch.setitem(canvas.STYLE, "svg.fonttype", "none")
    return tmp_path / "picture.svg"


class TestOneRun:
    @pytest.mark.parametrize(
        ("kind", "suffix"),
        [("axisymmetric", ".png"), ("axisymmetric", ".svg"), ("plane_strain", ".pdf"), ("three_dimensional", ".png")],
    )
    def test_every_kind_and_every_format(self, tmp_path, kind, suffix):
        path = tmp_path / f"picture{suffix}"
        forces.force_indentation(a_result(kind, error=True), path)
        assert path.stat().st_size > 5000 and list(tmp_path.iterdir()) == [path]

    def test_numbers_are_text_and_their_power_of_ten_a_formula(self, tmp_path, monkeypatch):
        figures = []
        monkeypatch.setattr(forces, "save", lambda figure, path: figures.append(figure))
        forces.force_indentation(a_result(units={}), tmp_path / "picture.png")
        canvas.keep_ticks_apart(figures[0])
        along = figures[0].axes[0].xaxis
        assert "10^{−5}" in along.get_offset_text().get_text()
        assert {"−1", "2"} <= {label.get_text() for label in along.get_ticklabels()}

    def test_the_words_on_it(self, svg):
        forces.force_indentation(a_result(error=True), svg)
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
        """A band needs two points: one has a bar, from 0.9 to 1.1 of the force here."""
        forces.force_indentation(a_result(steps=1, error=True), svg)
        assert "LineCollection" in text_of(svg) and "estimated error" in text_of(svg)

    def test_plane_strain_forces_are_per_length(self, svg):
        forces.force_indentation(a_result("plane_strain"), svg)
        assert "N/m]" in text_of(svg) and "half-width" in text_of(svg)

    def test_a_length_and_force_stay_and_a_pressure_is_one(self, svg):
        """1 mN/mm² is 1 kPa."""
        forces.force_indentation(a_result(units={"length": "mm", "force": "mN"}), svg)
        assert "[mm]" in text_of(svg) and "[mN]" in text_of(svg) and "[Pa]" in text_of(svg)

    def test_units_unknown_to_us_are_shown_as_they_are(self, svg):
        forces.force_indentation(a_result(units={"length": "inch", "force": "lbf"}), svg)
        assert "[inch]" in text_of(svg) and "[lbf/inch²]" in text_of(svg)

    def test_a_failed_run_says_so(self, svg):
        forces.force_indentation(a_result(status="failed", reason="step 6: no"), svg)
        assert "failed: step 6: no" in text_of(svg)

    @pytest.mark.parametrize("steps", [1, 200])
    def test_few_and_many_steps(self, svg, steps):
        forces.force_indentation(a_result(steps=steps), svg)

    def test_a_bare_table_out_of_contact(self, svg):
        table = {"step": [1.0, 2.0], "delta": [-0.1, 0.0], "force": [0.0, 0.0], "a": [0.0, 0.0]}
        bare = Results(Path("a.csv"), {name: np.array(column) for name, column in table.items()})
        forces.force_indentation(bare, svg)

    def test_no_rows_at_all(self, svg):
        empty = {name: np.array([]) for name in ("step", "delta", "force", "a")}
        forces.force_indentation(Results(Path("a.csv"), empty), svg)

    def test_one_point_in_contact(self, svg):
        result = a_result("three_dimensional")
        result.surface["pressure"] = np.where(result.surface["pressure"] == 1, 1.0, 0.0)
        forces.force_indentation(result, svg)

    def test_two_drawings_are_the_same_file(self, tmp_path):
        for name in ("a.svg", "b.svg"):
            forces.force_indentation(a_result(), tmp_path / name)
        assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()


class TestPressure:
    """The pressure is shown where the contact is, whatever ripples there are elsewhere."""

    @pytest.fixture
    def drawn(self, tmp_path, monkeypatch):
        figures = []
        monkeypatch.setattr(forces, "save", lambda figure, path: figures.append(figure))

        def draw(result):
            forces.force_indentation(result, tmp_path / "picture.png")
            return {axes.get_ylabel().split(" ")[0]: axes for axes in figures[-1].axes}

        return draw

    @pytest.mark.parametrize("kind", ["axisymmetric", "plane_strain"])
    def test_ripples_outside_do_not_scale_a_profile(self, drawn, kind):
        result = a_result(kind, units={})
        surface, a = result.surface, result["a"][-1]
        surface["pressure"] = np.where(surface["x"] > a, 1e-7, surface["pressure"])
        axes = drawn(result)["pressure"]
        assert axes.get_ylim() == pytest.approx((0, 1.08))
        assert axes.get_xlim() == pytest.approx((0, 1.5 * a) if kind == "axisymmetric" else (-1.5 * a, 1.5 * a))

    def test_the_largest_force_is_shown_when_the_tip_has_left(self, drawn):
        result = a_result(units={})
        result.table["force"][-1] = 0.0
        left = {name: np.append(column, column) for name, column in result.surface.items()}
        left["step"][: len(left["x"]) // 2] = 4.0
        left["pressure"][len(left["x"]) // 2 :] = 1e-17
        result.surface.update(left)
        assert drawn(result)["pressure"].get_title(loc="left").startswith("step 4,")
        result.table["force"][:] = result.table["a"][:] = 0.0  # nothing touches
        assert "pressure" not in drawn(result)

    def test_a_singular_edge_does_not_hide_the_rest(self, drawn):
        result = a_result(units={})
        pressure = result.surface["pressure"]
        pressure[np.flatnonzero(pressure)[-1]] = 1e3
        assert drawn(result)["pressure"].get_ylim()[1] < 10

    @pytest.mark.parametrize("center", [None, (0.0, 0.0)])
    def test_a_map_shows_the_contact_and_not_the_whole_top(self, drawn, center):
        result = a_result("three_dimensional", units={}, **({"center": center} if center else {}))
        surface, a = result.surface, result["a"][-1]
        surface["pressure"] = np.where(np.hypot(surface["x"], surface["y"]) > a, 1e-7, surface["pressure"])
        axes = drawn(result)["y"]
        assert axes.get_xlim() == axes.get_ylim() == pytest.approx((-1.5 * a, 1.5 * a))

    def test_the_words_on_a_map_with_friction_stand_inside_it(self, drawn):
        result = a_result("three_dimensional", units={})
        result.surface["shear"] = 0.1 * result.surface["pressure"]
        result.table["stick_radius"] = 0.5 * result["a"]
        axes = drawn(result)["y"]
        axes.figure.draw_without_rendering()
        (words,) = axes.texts
        inside, text = axes.get_window_extent(), words.get_window_extent()
        assert "what sticks" in words.get_text()
        assert inside.x0 < text.x0 and text.x1 < inside.x1 and inside.y0 < text.y0 and text.y1 < inside.y1

    @pytest.mark.parametrize("faces", [3, 4, 5])
    def test_a_map_shows_the_corners_of_a_contact(self, drawn, faces):
        """A regular polygon of the area pi a^2: the corners of a triangle are 1.56 a from its middle."""
        x, y = (part.ravel() for part in np.meshgrid(np.linspace(-3, 3, 121), np.linspace(-3, 3, 121)))
        apothem = np.sqrt(np.pi / (faces * np.tan(np.pi / faces)))
        normals = 2 * np.pi * np.arange(faces) / faces
        inside = np.max([x * np.cos(turn) + y * np.sin(turn) for turn in normals], axis=0) <= apothem
        pressure = np.where(inside, 1.0, 1e-7)
        surface = {"step": np.full(len(x), 1.0), "x": x, "y": y, "pressure": pressure}
        table = {"step": [1.0], "delta": [1.0], "force": [1.0], "a": [1.0]}
        plan = {"choices": [{"key": "kinematics", "value": "three_dimensional"}]}
        report = {"title": "A polygon", "center": [0.0, 0.0], "plan": plan}
        axes = drawn(Results(Path("one"), {name: np.array(v) for name, v in table.items()}, report, surface))["y"]
        for along, (low, high) in ((x, axes.get_xlim()), (y, axes.get_ylim())):
            assert low < along[inside].min() and along[inside].max() < high and high - low < 4
            assert low == pytest.approx(-high)

    def test_a_tip_beside_the_origin_is_found(self, drawn):
        result = a_result("plane_strain", units={}, center=[2.0])
        result.surface["x"] = np.concatenate([2 - result.surface["x"], 2 + result.surface["x"]])
        for name in ("y", "pressure", "step"):
            result.surface[name] = np.tile(result.surface[name], 2)
        a = result["a"][-1]
        assert drawn(result)["pressure"].get_xlim() == pytest.approx((2 - 1.5 * a, 2 + 1.5 * a))

    def test_depths_under_the_radius_do_not_touch(self, drawn):
        axes = drawn(a_result(units={}))["contact"]
        canvas.keep_ticks_apart(axes.figure)
        labels = [label for label in axes.get_xticklabels() if label.get_text()]
        ends = sorted(tuple(label.get_window_extent().intervalx) for label in labels)
        assert len(ends) > 2 and all(before[1] < after[0] for before, after in pairwise(ends))


class TestSeveralRuns:
    def test_each_is_named(self, svg):
        runs = [a_result(title="soft"), a_result(title="stiff", steps=8)]
        forces.overlay(runs, svg)
        assert "soft" in text_of(svg) and "stiff" in text_of(svg)

    def test_titles_that_do_not_tell_them_apart_give_way_to_folders(self, svg):
        forces.overlay([a_result(), a_result()], svg)
        assert "results/one" in text_of(svg)

    @pytest.mark.parametrize("units", [{"length": "mm", "force": "N"}, {"length": "m", "force": "mN"}])
    def test_units_that_differ_are_refused(self, tmp_path, units):
        with pytest.raises(UsageError, match="draw them apart"):
            forces.overlay([a_result(), a_result(units=units)], tmp_path / "picture.png")
        assert not list(tmp_path.iterdir())

    def test_forces_per_length_beside_forces_are_refused(self, tmp_path):
        with pytest.raises(UsageError, match="per length"):
            forces.overlay([a_result(), a_result("plane_strain")], tmp_path / "picture.png")

    def test_no_unit_is_claimed_for_a_curve_that_names_none(self, svg):
        """The axes name none, and the legend says what each is measured in."""
        forces.overlay([a_result(title="simulated"), a_result(title="measured", units={})], svg)
        said = re.findall(r">([^<>]*\[[^<>]*\])<", text_of(svg))
        assert sorted(said) == ["measured [unit unknown]", "simulated [m and N]"]

    @pytest.fixture
    def drawn(self, tmp_path, monkeypatch):
        """The figure of runs in folders with configs, laid out."""
        figures = []
        monkeypatch.setattr(
            forces, "save", lambda figure, path: (figure.draw_without_rendering(), figures.append(figure))
        )

        def draw(settings, error=False):
            runs = []
            for i, (nu, method) in enumerate(settings):
                place = tmp_path / f"{i * 0x9E3779B9:016x}"  # as a study names its runs
                place.mkdir()
                config = f"material: {{nu: {nu!r}}}\ncontact: {{method: {method}, epsilon_n: {nu + 100}}}\n"
                (place / "config.yaml").write_text(config)
                result = a_result(error=error, units={})
                result.report["plan"]["auto"] = ["contact.epsilon_n"]
                runs.append(dataclasses.replace(result, path=place))
                runs[-1].table["force"] = result["force"] * (1 + nu)
            forces.overlay(runs, tmp_path / "picture.png")
            return figures[-1]

        return draw

    @pytest.mark.parametrize(("number", "error"), [(2, True), (10, False), (60, True)])
    def test_the_legend_says_what_differs_and_hides_nothing(self, drawn, number, error):
        values = np.linspace(0, 0.49, number)
        figure = drawn([(float(nu), "penalty") for nu in values[::-1]], error)
        force, radius, beside = figure.axes
        told = [text.get_text() for text in beside.get_legend().get_texts()]
        names = [f"nu {nu:.4g}" for nu in values]
        assert [name for name in told if name != forces.ESTIMATED] == names and (forces.ESTIMATED in told) == error
        legend = beside.get_legend().get_window_extent()
        assert not any(legend.overlaps(axes.get_tightbbox()) for axes in (force, radius))
        assert figure.bbox.x0 <= legend.x0 and legend.x1 <= figure.bbox.x1 and figure.bbox.y0 <= legend.y0

    def test_every_curve_is_its_table_in_a_colour_of_its_own(self, drawn):
        values = np.linspace(0, 0.49, 11)
        lines = [line for line in drawn([(float(nu), "penalty") for nu in values]).axes[0].get_lines()
                 if line.get_label().startswith("nu")]  # fmt: skip
        plain = a_result()
        for nu, line in zip(values, lines, strict=True):
            rows = np.isin(line.get_xdata(), plain["delta"])  # the others lie on a smooth curve between them
            assert line.get_xdata()[rows] == pytest.approx(plain["delta"])
            assert line.get_ydata()[rows] == pytest.approx(plain["force"] * (1 + nu))
        assert len({tuple(line.get_color()) for line in lines}) == 11

    def test_several_keys_that_differ_are_all_named(self, drawn):
        figure = drawn([(nu, method) for nu in (0.1, 0.3) for method in ("penalty", "nitsche")])
        told = [text.get_text() for text in figure.axes[2].get_legend().get_texts()]
        assert told == [f"nu {nu}, method {method}" for nu in (0.1, 0.3) for method in ("nitsche", "penalty")]

    def test_more_runs_than_colours(self, svg):
        forces.overlay([a_result()] * 9, svg)


def test_an_unknown_format_is_refused(tmp_path):
    with pytest.raises(UsageError, match="picture"):
        forces.force_indentation(a_result(), tmp_path / "picture.bmp")
    assert not list(tmp_path.iterdir())


def test_a_config_that_never_ends_is_none(tmp_path):
    """A pipe in the place of config.yaml: opening it waited for a writer."""
    os.mkfifo(tmp_path / "config.yaml")
    assert config_of(tmp_path) == {}
    (tmp_path / "config.yaml").unlink()
    (tmp_path / "config.yaml").write_text("body: {height: 1}\n")
    assert config_of(tmp_path) == {"body.height": 1}
