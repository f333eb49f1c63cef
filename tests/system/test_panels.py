"""Pictures on request, checked by the data that are drawn.

Curves are the tables, legends hide nothing, and units are those that were asked for.
"""

from __future__ import annotations

import dataclasses
import re
import warnings
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from made_results import a_result, some_fields
from matplotlib.axes import Axes
from matplotlib.collections import TriMesh

from indent_sim.model.tips import Paraboloid, Sphere
from indent_sim.process.errors import UsageError
from indent_sim.results.field_arrays import ARRAYS, OPTIONAL_ARRAYS
from indent_sim.results.field_writer import FieldWriter
from indent_sim.results.pictures import fields, figures, forces, panels
from indent_sim.results.pictures.fields import FIELDS, deformed_section
from indent_sim.results.tip_geometry import tip_mesh

SCENE = """\
body: {{shape: {body}, radius: 1.0, height: 1.0}}
material: {{model: linear_elastic, E: 1.0, nu: 0.3}}
indenter: {tip}
loading: {{delta: 0.1}}
mesh: {{h_contact: 0.05}}
"""


@pytest.fixture
def drawn(tmp_path, monkeypatch):
    """A function that returns the laid-out figure of a request."""
    drawn_figures = []

    def keep(figure, path):
        figures.apply_layout(figure)
        drawn_figures.append(figure)

    for module in (panels.figures, forces):
        monkeypatch.setattr(module, "save", keep)

    def draw(runs, **wish):
        panels.draw(runs, panels.plot_request(wish), tmp_path / "picture.png")
        return drawn_figures[-1]

    return draw


def in_folder(folder: Path, result, tip="{shape: paraboloid, R: 1.0}"):
    """A result beside its scene."""
    folder.mkdir(exist_ok=True)
    (folder / "config.yaml").write_text(SCENE.format(body="cylinder", tip=tip))
    return dataclasses.replace(result, path=folder)


def up_and_down():
    result = a_result(units={}, theory=None)
    both = {
        name: np.concatenate([result[name], result[name][-2::-1]])
        for name in ("delta", "force", "a")
    }
    result.table.update(both)
    result.table["step"] = np.arange(1.0, len(result["delta"]) + 1)
    return result


class TestForces:
    def test_a_curve_is_its_table(self, drawn):
        result = a_result(units={}, theory=None)
        lines = drawn([result], what=("force",)).axes[0].get_lines()
        marks = next(line for line in lines if line.get_marker() not in ("", "None"))
        assert marks.get_xdata() == pytest.approx(
            result["delta"]
        ) and marks.get_ydata() == pytest.approx(result["force"])

    def test_loading_is_told_from_unloading(self, drawn):
        result = up_and_down()
        axes = drawn([result], what=("force",)).axes[0]
        dashed = [
            line
            for line in axes.get_lines()
            if line.get_linestyle() == "--" and len(line.get_xdata())
        ]
        hollow = [
            line
            for line in axes.get_lines()
            if line.get_markerfacecolor() == "white" and len(line.get_xdata())
        ]
        assert len(dashed) == len(hollow) == 1
        assert hollow[0].get_xdata() == pytest.approx(result["delta"][5:])
        assert forces.UNLOADING_LABEL in axes.get_legend_handles_labels()[1]

    def test_error_bands_follow_the_branches(self, drawn):
        """The way in and the way out have one error band each, as wide as each row's error."""
        result = up_and_down()
        result.table["force_error"] = 0.1 * result["force"]
        bands = [
            part
            for part in drawn([result], what=("force",)).axes[0].collections
            if len(part.get_paths())
        ]
        assert len(bands) == 2
        for band, rows in zip(bands, (slice(0, 5), slice(4, 9)), strict=True):
            x, y = band.get_paths()[0].vertices.T
            for delta, force in zip(result["delta"][rows], result["force"][rows], strict=True):
                at = y[np.isclose(x, delta, rtol=1e-12)]
                assert at.min() == pytest.approx(0.9 * force) and at.max() == pytest.approx(
                    1.1 * force
                )

    def test_way_in_and_out_of_an_elastic_body_are_one_curve(self, drawn):
        """Both branches of Hertz' law in five rows are F = 1000 delta^1.5 between the rows too."""
        result = a_result(units={}, theory=None, steps=3)
        for name in ("delta", "force", "a"):
            result.table[name] = np.append(result[name], [result[name][1], 0.0])
        result.table["step"] = np.arange(1.0, 6.0)
        lines = [
            line
            for line in drawn([result], what=("force",)).axes[0].get_lines()
            if len(line.get_xdata()) > 5
        ]
        assert len(lines) == 2
        for line in lines:
            assert line.get_ydata() == pytest.approx(
                1e3 * np.asarray(line.get_xdata()) ** 1.5, rel=1e-9, abs=1e-15
            )

    def test_forces_over_time_are_those_of_the_rows(self, drawn):
        """Forces over time are those of the rows, and each branch begins where the one before ends.

        Two runs have a ramp and a hold over four decades of time.
        """
        t = np.array([0.0, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0])
        runs = [a_result(units={}, theory=None, steps=7) for _ in range(2)]
        for run, factor in zip(runs, (1.0, 2.0), strict=True):
            falls = np.array([0.0, 0.5, 1.0, 1.5, 1.2, 1.1, 1.0])
            run.table.update(
                {
                    "t": t,
                    "force": factor * falls,
                    "branch": np.array(["approach"] * 4 + ["hold"] * 3),
                }
            )
        axes = drawn(runs, what=("time",)).axes[0]
        assert axes.get_xscale() == "log" and axes.get_xlabel() == "time t"
        ramps, holds = (
            [line for line in axes.get_lines() if len(line.get_xdata()) > 2][k::2] for k in (0, 1)
        )
        for ramp, hold, factor in zip(ramps, holds, (1.0, 2.0), strict=True):
            assert hold.get_xdata()[[0, -1]] == pytest.approx([1e-3, 1.0])
            assert hold.get_ydata()[[0, -1]] == pytest.approx([1.5 * factor, factor])
            assert ramp.get_ydata()[-1] == pytest.approx(1.5 * factor)

    def test_a_run_without_times_has_none_to_draw(self, drawn):
        with pytest.raises(UsageError, match="has no times"):
            drawn([a_result(units={}, theory=None)], what=("time",))

    def test_the_half_space_ends_at_its_mark(self, drawn):
        """The dotted line of the half-space ends at its mark, also beyond the depth of the run.

        Under a force its depth may be larger than the run's.
        """
        result = a_result(units={})
        curve = {"delta": [1e-5, 2e-5], "force": [1e3 * 1e-5**1.5, 1e3 * 2e-5**1.5]}
        closed = {"name": "Hertz", "delta": 7e-5, "deviation": 0.4, "curve": curve}
        theory = {"name": "layer theory", "delta": 5e-5, "force": 1e3 * 7e-5**1.5}
        result.report["theory"] = theory | {"half_space": closed}
        lines = drawn([result], what=("force",)).axes[0].get_lines()
        dotted = next(line for line in lines if line.get_linestyle() == ":")
        mark = next(line for line in lines if line.get_marker() == "D")
        assert [dotted.get_xdata()[-1], dotted.get_ydata()[-1]] == pytest.approx(
            [*mark.get_xdata(), *mark.get_ydata()]
        )
        assert dotted.get_ydata() == pytest.approx(
            1e3 * np.asarray(dotted.get_xdata()) ** 1.5, rel=1e-9
        )

    @pytest.mark.parametrize("control", ["one result", "several"])
    def test_no_legend_lies_on_a_curve(self, tmp_path, monkeypatch, control):
        drawn_figures = []
        monkeypatch.setattr(
            forces,
            "save",
            lambda figure, path: (figure.draw_without_rendering(), drawn_figures.append(figure)),
        )
        runs = [a_result(error=True), a_result(title="another")][
            : 1 if control == "one result" else 2
        ]
        forces.draw_overlay(runs, tmp_path / "picture.png")
        legends = [
            *drawn_figures[0].legends,
            *(axes.get_legend() for axes in drawn_figures[0].axes if axes.get_legend()),
        ]
        assert len(legends) == 1
        box = legends[0].get_window_extent()
        assert not any(
            box.overlaps(axes.get_window_extent()) for axes in drawn_figures[0].axes if axes.axison
        )
        assert drawn_figures[0].bbox.y0 <= box.y0 and box.x1 <= drawn_figures[0].bbox.x1

    def test_sixty_curves_without_a_warning(self, tmp_path, monkeypatch):
        """Sixty curves are drawn without a warning, and the legend has all sixty names."""
        runs = [a_result(title=f"R = {k}") for k in range(60)]
        monkeypatch.setitem(figures.RC_PARAMETERS, "svg.fonttype", "none")
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            panels.draw(runs, panels.plot_request({"what": ("force",)}), tmp_path / "p.svg")
            forces.draw_overlay(runs, tmp_path / "q.svg")
        for name in ("p.svg", "q.svg"):
            assert set(re.findall(r">(R = \d+)<", (tmp_path / name).read_text())) == {
                f"R = {k}" for k in range(60)
            }

    @pytest.mark.parametrize(
        ("kind", "unit", "factor"), [("length", "nm", 1e9), ("force", "pN", 1e12)]
    )
    def test_units_asked_for(self, drawn, kind, unit, factor):
        axes = drawn([a_result(theory=None)], what=("force",), units={kind: unit}).axes[0]
        marks = next(line for line in axes.get_lines() if line.get_marker() not in ("", "None"))
        data, label, column = {
            "length": (marks.get_xdata(), axes.get_xlabel(), "delta"),
            "force": (marks.get_ydata(), axes.get_ylabel(), "force"),
        }[kind]
        assert data == pytest.approx(factor * a_result()[column]) and f"[{unit}]" in label

    def test_width_and_font_size_are_those_asked_for(self, drawn):
        figure = drawn([a_result()], what=("force",), width=85.0, font=7.0)
        assert figure.get_figwidth() * 25.4 == pytest.approx(85)
        assert figure.axes[0].xaxis.label.get_size() == pytest.approx(7)


class TestPressure:
    def test_a_profile_is_the_surface_table(self, drawn):
        result = a_result(units={})
        line = drawn([result], what=("pressure",)).axes[0].get_lines()[0]
        assert line.get_xdata() == pytest.approx(result.surface["x"])
        assert line.get_ydata() == pytest.approx(result.surface["pressure"])

    @pytest.mark.parametrize(
        ("gap", "stretch", "name"), [("current", 1.1, "deformed r"), ("reference", 1.0, "r")]
    )
    def test_places_are_on_the_surface_whose_contact_radius_is_read(
        self, drawn, gap, stretch, name
    ):
        """Pressures are drawn over the surface of the gap, and the axis names it.

        That is the deformed surface where the gap is tested there.
        """
        result = a_result(units={}, gap=gap)
        result.surface.update(u_x=0.1 * result.surface["x"], u_y=np.zeros(len(result.surface["x"])))
        axes = drawn([result], what=("pressure",)).axes[0]
        assert axes.get_lines()[0].get_xdata() == pytest.approx(stretch * result.surface["x"])
        assert axes.get_xlabel().startswith(name)

    def test_the_stick_radius_has_a_name(self, drawn):
        """The stick radius is a dotted line with a name in the legend.

        It is absent where nothing sticks.
        """
        for sticks, shown in ((0.7, True), (0.0, False)):
            result = a_result(units={})
            result.surface["shear"] = 0.1 * result.surface["pressure"]
            result.table["stick_radius"] = sticks * result["a"]
            axes = drawn([result], what=("pressure",)).axes[0]
            at = [
                line.get_xdata()[0]
                for line in axes.get_lines()
                if line.get_ls() == ":" and len(line.get_xdata())
            ]
            assert at == pytest.approx([0.7 * result["a"][-1]] if shown else [])
            assert ("stick radius" in axes.get_legend_handles_labels()[1]) == shown

    def test_steps_that_are_not_there_are_refused(self, drawn):
        with pytest.raises(
            UsageError, match=r"no surface of step 3, only of 5; run with --set output\.surface=all"
        ):
            drawn([a_result()], what=("pressure",), steps=("3",))

    @pytest.mark.parametrize(
        ("tip", "place"),
        [("{shape: cone, half_angle: 70}", 0.0), ("{shape: flat_punch, radius: 1e-4}", 1e-4)],
    )
    def test_an_infinite_pressure_is_not_drawn_as_a_finite_one(self, drawn, tmp_path, tip, place):
        """Where p_max is empty no curve goes through the place; a line to the top marks it."""
        result = in_folder(tmp_path / "cone", a_result(units={}), tip)
        (tmp_path / "cone" / "config.yaml").write_text(
            SCENE.format(body="cylinder", tip=tip).replace("0.05", "1e-6")
        )
        result.table["p_max"] = np.full(len(result), np.nan)
        curve, edge = drawn([result], what=("pressure",)).axes[0].get_lines()
        shown = np.isfinite(curve.get_ydata())
        assert np.abs(
            curve.get_xdata()[shown] - place
        ).min() > 1.4e-6 and edge.get_xdata() == pytest.approx([place] * 2)

    @pytest.mark.parametrize("tip", ["cone, half_angle: 70", "flat_punch, radius: 1e-4"])
    @pytest.mark.parametrize("kind", ["axisymmetric", "three_dimensional"])
    def test_few_elements_beside_a_singularity_leave_the_pressure_inside(
        self, drawn, tmp_path, tip, kind
    ):
        """Elements are larger than the contact: most of the pressure is shown nevertheless.

        The scale ends between the pressure at the axis and five times the median.
        """
        result = a_result(kind, units={}, center=[0.0, 0.0])
        a = result["a"][-1]
        result = in_folder(tmp_path / "run", result, f"{{shape: {tip.replace('1e-4', str(a))}}}")
        result.table["p_max"] = np.full(len(result), np.nan)
        axes, *bars = drawn([result], what=("pressure",)).axes
        if kind == "axisymmetric":
            x, p = axes.get_lines()[0].get_data()
            assert np.isfinite(p[x < a]).sum() > 0.5 * (x < a).sum()
            assert 0.5 < axes.get_ylim()[1] < 5
        else:
            (bar,) = axes.child_axes
            assert 0.5 < bar.get_xlim()[1] < 5
            assert not bars

    def test_a_map_is_mirrored_and_centred(self, drawn):
        """The map of a quarter model shows the whole contact with the tip in the middle.

        No number touches another.
        """
        result = a_result("three_dimensional", units={}, center=[0.0, 0.0])
        figure = drawn([result], what=("pressure",))
        axes = figure.axes[0]
        assert (
            axes.get_xlim()
            == axes.get_ylim()
            == pytest.approx((-1.5 * result["a"][-1], 1.5 * result["a"][-1]))
        )
        corners = np.concatenate(
            [path.vertices for drawn_ in axes.collections for path in drawn_.get_paths()]
        )
        assert (
            corners[:, 0].min() == pytest.approx(-corners[:, 0].max(), rel=1e-6)
            and corners[:, 0].min() < 0
        )
        ends = sorted(
            label.get_window_extent().extents[[0, 2]].tolist()
            for label in axes.get_xticklabels()
            if label.get_text()
        )
        assert all(before[1] < after[0] for before, after in pairwise(ends))


def a_bump(center: tuple[float, float] | None = None, **report):
    """A map whose pressure is 1 - x/3 - y/9 inside the contact, measured from the tip's axis."""
    result = a_result(
        "three_dimensional", units={}, **({"center": list(center)} if center else {}), **report
    )
    x, y = (
        result.surface[name] - at for name, at in zip(("x", "y"), center or (0.0, 0.0), strict=True)
    )
    inside = np.hypot(x, y) <= result["a"][-1]
    result.surface["pressure"] = np.where(inside, 1 - x / 3 / x.max() - y / 9 / y.max(), 0.0)
    return result


class TestPressureOfThreeDimensions:
    def test_maps_of_several_runs_share_colours_and_frame(self, drawn):
        """Maps of several runs have one colour bar up to the largest pressure, and one frame.

        The second run has twice the pressure and three times the radius.
        """
        one, other = (
            a_result("three_dimensional", units={}, title="soft"),
            a_result("three_dimensional", units={}),
        )
        other.surface["pressure"] = 2 * other.surface["pressure"]
        for name in ("x", "y"):
            other.surface[name] = 3 * other.surface[name]
        other.table["a"] = 3 * other["a"]
        figure = drawn([one, other], what=("pressure",))
        maps = [axes for axes in figure.axes if axes.get_label() != "<colorbar>"]
        limits = {(axes.get_xlim(), axes.get_ylim()) for axes in maps}
        assert len(maps) == 2 and len(limits) == 1
        assert maps[0].get_xlim()[1] == pytest.approx(1.5 * other["a"][-1])
        (bar,) = [axes for axes in figure.axes if axes.get_label() == "<colorbar>"]
        assert max(bar.get_ylim()) == pytest.approx(other.surface["pressure"].max(), rel=0.05)

    @pytest.mark.parametrize("what", ["pressure", "pressure_x"])
    def test_limits_hold_for_pressures(self, drawn, what):
        """`limits` are the ends of the colours of maps and of the axis of curves."""
        figure = drawn([a_result("three_dimensional", units={})], what=(what,), limits=(0.0, 7.0))
        bars = [axes for axes in figure.findobj(Axes) if axes.get_label() == "<colorbar>"]
        shown = bars[0].get_xlim() if bars else figure.axes[0].get_ylim()
        assert shown == pytest.approx((0.0, 7.0)) and bool(bars) == (what == "pressure")

    @pytest.mark.parametrize("along", [0, 1])
    def test_a_line_through_the_axis_is_the_surface_there(self, drawn, along):
        """The pressure along x or y is that of the nodes on the line."""
        result = a_bump()
        axes = drawn([result], what=(("pressure_x", "pressure_y")[along],)).axes[0]
        on = np.abs(result.surface["xy"[1 - along]]) < 1e-12
        places, pressure = (result.surface[name][on] for name in ("xy"[along], "pressure"))
        line = axes.get_lines()[0]
        right = line.get_xdata() > 0  # the left half is its image
        assert line.get_xdata()[right] == pytest.approx(places[places > 0])
        assert line.get_ydata()[right] == pytest.approx(pressure[places > 0])
        assert axes.get_xlabel() == "xy"[along]

    def test_a_body_of_revolution_has_no_y(self, drawn):
        with pytest.raises(UsageError, match="has no y axis"):
            drawn([a_result(units={})], what=("pressure_y",))


class TestOneHeight:
    @pytest.mark.parametrize(
        "wish", [{}, {"layout": (1, 3)}, {"layout": (1, 3), "width": 170.0, "font": 8.0}]
    )
    def test_panels_side_by_side(self, drawn, wish):
        """A curve, a map and a line end at one height to a pixel, and all legends begin below."""
        figure = drawn(
            [a_result("three_dimensional", units={})],
            what=("force", "pressure", "pressure_x"),
            **wish,
        )
        boxes = [
            axes.get_window_extent() for axes in figure.axes if axes.get_label() != "<colorbar>"
        ]
        assert len(boxes) == 3
        for side in ("y0", "y1"):
            assert np.ptp([getattr(box, side) for box in boxes]) < 1
        legends = [
            axes.get_legend().get_window_extent() for axes in figure.axes if axes.get_legend()
        ]
        assert len(legends) == 2 and np.ptp([legend.y1 for legend in legends]) < 1
        assert max(legend.y1 for legend in legends) < boxes[0].y0
        assert boxes[1].width == pytest.approx(
            boxes[1].height, rel=0.01
        )  # true to scale, and all of its place


class TestProfile:
    def test_it_is_the_deformed_surface_and_its_image(self, drawn, tmp_path):
        result = in_folder(tmp_path / "run", a_result(units={}))
        n = len(result.surface["x"])
        result.surface.update(
            {
                "u_x": np.full(n, 1e-6),
                "u_z": -1e-5 * np.exp(-(result.surface["x"] ** 2)),
                "z": np.zeros(n),
            }
        )
        lines = drawn([result], what=("profile",)).axes[0].get_lines()
        line = next(line for line in lines if line.get_color() == figures.COLOURS[0])
        right = line.get_xdata() > 0
        assert line.get_xdata()[right] == pytest.approx(result.surface["x"] + 1e-6)
        assert line.get_ydata()[right] == pytest.approx(result.surface["u_z"])
        assert line.get_xdata()[~right] == pytest.approx(-line.get_xdata()[right][::-1])
        tip = next(
            line
            for line in lines
            if line.get_color() == figures.GREY and line.get_linestyle() == "-"
        )
        assert tip.get_ydata() == pytest.approx(tip.get_xdata() ** 2 / 2 - result["delta"][-1])


class TestFields:
    POINTS = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, -2.0], [0.0, -2.0]])
    CELLS = np.array([[0, 2, 1], [0, 3, 2]])

    @pytest.fixture
    def result(self, tmp_path):
        result = in_folder(tmp_path / "run", a_result(units={}, steps=3))
        result.table.update({"delta": np.array([0.1, 0.2, 0.3]), "a": np.array([0.3, 0.4, 0.5])})
        tip = tip_mesh(Paraboloid(1.0), (0.0,), 1.0, "axisymmetric", 1)
        arrays = ARRAYS | OPTIONAL_ARRAYS
        writer = FieldWriter(
            result.path, self.POINTS, self.CELLS, np.array([0, 1]), tip, keep="all", arrays=arrays
        )
        fluid = {
            "pore_pressure": np.arange(4.0),
            "fluid_content": np.array([0.0, -1.0]),
            "swelling": np.array([2, 3.0]),
        }
        fluid |= {
            "shear": np.zeros(4),
            "plastic_strain": np.zeros(2),
            "nodal_stress": np.zeros((4, 9)),
            "nodal_von_mises": np.zeros(4),
        }
        for step in (1, 2, 3):
            own = {"displacement": np.tile([0.1, -0.1 * step], (4, 1))}
            writer.write(step, 0.1 * step, some_fields(step) | fluid | own)
        return result

    def test_the_section_is_the_deformed_body_and_its_image(self, result):
        """The section is the deformed body and its mirror image, and regions stay apart.

        Each of the two cells has its own value up to their common side.
        """
        found = deformed_section(result, 2.0, FIELDS["von_mises"])
        half = found.points[: len(found.points) // 2]
        deformed = {tuple(point) for point in np.round(self.POINTS + np.array([0.1, -0.2]), 9)}
        assert {tuple(point) for point in np.round(half, 9)} == deformed
        assert found.points[len(half) :] == pytest.approx(half * [-1, 1])
        assert sorted(set(found.values)) == pytest.approx(some_fields(2)["von_mises"])

    @pytest.mark.parametrize(("kind", "sign"), [("plane_strain", -1), ("axisymmetric", 1)])
    def test_shear_changes_its_sign_in_the_image(self, result, kind, sign):
        """A mirror plane x = const is free of shear: sigma_xz is odd across it.

        In cylindrical coordinates sigma_rz refers to the direction away from the axis on both
        sides. Other components are even.
        """
        result.report["plan"]["choices"][0]["value"] = kind
        for name, factor in (("sigma_xz", sign), ("sigma_xx", 1), ("von_mises", 1)):
            values = deformed_section(result, 2.0, FIELDS[name]).values
            half = values[: len(values) // 2]
            assert np.abs(half).max() > 0
            assert values[len(half) :] == pytest.approx(factor * half)

    def test_lines_are_drawn_where_regions_meet(self, result, drawn):
        """A line is drawn at the common side of two regions, and at its image."""
        found = deformed_section(result, 2.0, FIELDS["von_mises"])
        common = {
            tuple(self.POINTS[k] + [0.1, -0.2]) for k in set(self.CELLS[0]) & set(self.CELLS[1])
        }
        ends = found.points[found.interfaces]
        assert len(ends) == 2 and {tuple(end) for end in np.round(ends[0], 9)} == {
            tuple(np.round(c, 9)) for c in common
        }
        assert ends[1] == pytest.approx(ends[0] * [-1, 1])
        (line, *_) = drawn([result], what=("fields",), steps=("2",)).axes[0].lines
        assert np.isnan(line.get_xdata()).sum() == 2

    def test_panels_of_steps_share_frame_and_colours(self, drawn, result):
        figure = drawn([result], what=("fields",), steps=("all",), fields=("von_mises", "J"))
        shown = [axes for axes in figure.axes if axes.get_title(loc="left")]
        assert [axes.get_title(loc="left") for axes in shown] == [
            "δ = 0.1",
            "δ = 0.2",
            "δ = 0.3",
        ] * 2
        for row in (shown[:3], shown[3:]):
            assert len({axes.collections[0].get_clim() for axes in row}) == 1
            assert len({(*axes.get_xlim(), *axes.get_ylim()) for axes in row}) == 1

    def test_no_cell_is_left_out(self, result, drawn, monkeypatch):
        """Cells lower than half a pixel are drawn too, each in the one colour of its values."""
        found = deformed_section(result, 2.0, FIELDS["von_mises"])
        assert (
            not found.is_sliver(1e-3).any()
            and found.is_sliver(10.0).all()
            and found.areas == pytest.approx(2.0)
        )
        monkeypatch.setattr(
            fields.Section, "is_sliver", lambda self, least: np.arange(len(self.triangles)) == 0
        )
        small, rest = drawn([result], what=("fields",), steps=("2",)).axes[0].collections[:2]
        assert list(small.get_array()) == pytest.approx([found.values[found.triangles[0]].mean()])
        assert isinstance(rest, TriMesh) and list(rest.get_array()) == pytest.approx(
            list(found.values)
        )

    def test_a_singular_point_does_not_take_the_colours(self, result, drawn, monkeypatch):
        """A thousand points in a millionth of the area lie beyond the range of colours.

        The rest is within it.
        """
        values = np.append(np.linspace(0, 1, 100), np.full(1000, 50.0))
        areas = np.append(np.ones(100), np.full(1000, 1e-7))
        for name, shift, limits in (("von_mises", 0.0, (0.0, 1.0)), ("J", 1.0, (0.0, 2.0))):
            shown = (values + shift, areas)
            monkeypatch.setattr(fields.Section, "values_in_frame", lambda *_, shown=shown: shown)
            panel = drawn([result], what=("fields",), steps=("2",), fields=(name,)).axes[0]
            assert panel.collections[0].get_clim() == pytest.approx(limits)

    def test_the_contact_is_inside_the_frame(self, result, drawn):
        left, right = drawn([result], what=("fields",), steps=("all",)).axes[0].get_xlim()
        assert left < -0.5 and right > 0.5 and left == pytest.approx(-right)

    @pytest.mark.parametrize("name", FIELDS)
    def test_every_field_can_be_drawn(self, drawn, result, name):
        bar = drawn([result], what=("fields",), fields=(name,)).axes[-1]
        assert bar.get_ylabel()

    def test_tetrahedra_are_cut_through_the_tip(self, tmp_path):
        """The cut through a deformed cube has the area of its face and |u| of the edge it cuts."""
        corners = np.array(
            [[x, y, z] for x in (0, 1) for y in (-1, 1) for z in (-1, 0)], dtype=float
        )
        faces = [(0, 1, 3, 7), (0, 1, 5, 7), (0, 2, 3, 7), (0, 2, 6, 7), (0, 4, 5, 7), (0, 4, 6, 7)]
        kinds = {
            "plan": {
                "choices": [
                    {"key": "kinematics", "value": "three_dimensional"},
                    {"key": "symmetry", "value": "full"},
                ]
            }
        }
        result = in_folder(tmp_path / "run", a_result(units={}, center=[0.5, 0.0], **kinds))
        tip = tip_mesh(Sphere(1.0), (0.5, 0.0), 1.0, "three_dimensional", 1)
        writer = FieldWriter(result.path, corners, np.array(faces), np.zeros(6), tip)
        shift = np.column_stack([3 * corners[:, 0], 0 * corners[:, 0], 4 * corners[:, 2]])
        writer.write(5, 0.1, some_fields(1, 8, 6, 3) | {"displacement": shift})
        found = deformed_section(result, 5.0, FIELDS["displacement"])
        x, z = found.points[:, 0] / 4, found.points[:, 1] / 5
        assert found.points[:, 0].max() == pytest.approx(4) and found.points[
            :, 1
        ].min() == pytest.approx(-5)
        inner = np.isin(
            np.round(x * z, 9), (0.0, -1.0)
        )  # the corners of the cube's faces, where |u| is not interpolated
        assert found.values[inner & (np.abs(z + 1) < 1e-9)].max() == pytest.approx(5)
        a, b, c = (found.points[found.triangles[:, k]] for k in range(3))
        area = np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]).sum() / 2
        assert area == pytest.approx(4 * 5)

    def test_fields_that_are_not_there_are_refused(self, drawn, result, tmp_path):
        with pytest.raises(UsageError, match="no fields of step 4, only of 1, 2, 3"):
            drawn([result], what=("fields",), steps=("4",))
        with pytest.raises(UsageError, match="has no fields"):
            drawn([a_result()], what=("fields",))
        (result.path / "fields" / "step-3.h5").write_bytes(b"no file")
        with pytest.raises(UsageError, match=r"step 3 .* cannot be read"):
            drawn([result], what=("fields",), steps=("last",))


class TestRoom:
    """What is drawn is in the frame, and nothing hides it."""

    def shown(self, folder: Path):
        result = in_folder(folder / "run", a_result(units={}))
        depth = {"u_x": 0 * result.surface["x"], "u_z": -1e-5 * np.exp(-(result.surface["x"] ** 2))}
        result.surface.update(depth | {"z": 0 * result.surface["x"]})
        return result

    @pytest.mark.parametrize(
        "what", [("force",), ("pressure",), ("profile",), ("force", "pressure", "profile")]
    )
    @pytest.mark.parametrize("width", [None, 85.0, 170.0])
    def test_no_legend_lies_on_a_panel(self, drawn, tmp_path, what, width):
        figure = drawn([self.shown(tmp_path)], what=what, width=width)
        panels = [axes for axes in figure.axes if axes.axison]
        legends = [
            axes.get_legend().get_window_extent() for axes in figure.axes if axes.get_legend()
        ]
        assert len(panels) == len(what) == len(legends)
        for box in legends:
            assert not any(box.overlaps(axes.get_window_extent()) for axes in panels)
            assert figure.bbox.x0 <= box.x0 and figure.bbox.y0 <= box.y0

    @pytest.mark.parametrize("what", ["pressure", "profile"])
    def test_the_contact_is_inside_the_frame(self, drawn, tmp_path, what):
        result = self.shown(tmp_path)
        axes = drawn([result], what=(what,)).axes[0]
        a, delta = result["a"][-1], result["delta"][-1]
        assert axes.get_xlim()[1] > 1.2 * a
        if what == "profile":
            low, high = axes.get_ylim()
            assert (
                low < -delta
                and high > 0
                and axes.get_xlim()[0] == pytest.approx(-axes.get_xlim()[1])
            )


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"what": ("forces",)}, "not one of force, time, hardness, pressure"),
        ({"fields": ("J",)}, "--field is only for --what fields"),
        ({"steps": ("2",)}, "--steps is only for"),
        ({"what": ("fields",), "fields": ("mises",)}, "there is no field mises"),
        ({"what": ("pressure",), "steps": ("two",)}, "expected step numbers, 'last' or 'all'"),
        ({"units": {"stress": "kPa"}}, "there are length"),
    ],
)
def test_a_wish_without_effect_is_refused(given, said):
    with pytest.raises(UsageError, match=said):
        panels.plot_request(given)


@pytest.mark.parametrize(
    ("wish", "said"),
    [
        ({"layout": (1000, 1000)}, "has 1000000 panels; a picture has 40 at most"),
        ({"layout": (1, 41)}, "has 41 panels"),
        (
            {"what": ("force", "profile") * 100 + ("force",)},
            "the request has 201 panels, but a picture can have at most 40",
        ),
    ],
)
def test_more_panels_than_a_picture_has_are_refused(drawn, wish, said):
    """Too many panels are refused before anything is drawn.

    A million panels would never end.
    """
    with pytest.raises(UsageError, match=said):
        drawn([a_result(units={})], **wish)


@pytest.mark.parametrize(
    ("width", "dpi", "kind"), [(1000, 2400, "png"), (1000, 1700, "pdf"), (300, 2400, "png")]
)
def test_more_pixels_than_can_be_drawn_are_refused(tmp_path, width, dpi, kind):
    """Too many pixels are refused without a file, and the suggested --dpi is possible."""
    path = tmp_path / f"picture.{kind}"
    wish = panels.plot_request({"width": width, "dpi": dpi})
    with pytest.raises(
        UsageError, match=r"pixels are too many for a picture; --dpi \d+ is possible"
    ) as refused:
        panels.draw([a_result(units={})], wish, path)
    assert not list(tmp_path.iterdir())
    possible = int(re.findall(r"--dpi (\d+)", str(refused.value))[0])
    assert 100 < possible < dpi
    if width == 300:  # inches enough to take a second, not ten
        panels.draw([a_result(units={})], dataclasses.replace(wish, dpi=possible / 8), path)
        assert path.exists()


def test_what_a_killed_picture_left_is_replaced_by_the_next(tmp_path):
    """The leftover of a killed picture is replaced by the next one.

    Its name is not random, so that nobody has to clean up.
    """
    left = tmp_path / ".picture.png.new"
    left.write_bytes(b"half of it")
    panels.draw([a_result(units={})], panels.plot_request({}), tmp_path / "picture.png")
    assert [entry.name for entry in tmp_path.iterdir()] == ["picture.png"]


@pytest.mark.parametrize(
    ("units", "asked", "said"),
    [
        ({}, {"length": "nm"}, "has no unit"),
        ({"length": "inch", "force": "lbf"}, {"length": "nm"}, "has the unit inch"),
        ({"length": "m", "force": "N"}, {"pressure": "nm"}, "not a unit of pressure"),
    ],
)
def test_units_that_cannot_be_shown_are_refused(drawn, units, asked, said):
    with pytest.raises(UsageError, match=said):
        drawn([a_result(units=units)], what=("force", "pressure"), units=asked)
