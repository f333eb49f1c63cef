"""Pictures of studies, checked by the data that are drawn.

They have small multiples of many runs, and columns over what varies.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from picture_checks import faults

import indent_sim
from indent_sim.cli import commands
from indent_sim.process.errors import UsageError
from indent_sim.results.pictures import figures
from indent_sim.results.reader import Results
from indent_sim.studies import small_multiples, study_picture
from indent_sim.studies.curve_table import CurveGroups, RunCurve

UNITS = {"length": "um", "force": "nN"}
HEIGHTS, RADII, RATIOS, MODULI = (
    (2.0, 4.0, 8.0, 16.0, 32.0),
    (2.0, 5.0, 10.0, 20.0, 40.0),
    (0.3, 0.4, 0.45, 0.5),
    (1.0, 4.0),
)


def force_of(height: float = 8.0, R: float = 5.0, nu: float = 0.3, E: float = 1.0) -> float:
    """A law in which every key matters."""
    return E * R**0.5 * (1 + R / height) / (1 - nu**2)


def families(**numbers: tuple[float, ...]) -> CurveGroups:
    """A grid of runs over these numbers; forces grow as the depth to the power 3/2."""
    grid = np.stack(np.meshgrid(*numbers.values(), indexing="ij"), axis=-1).reshape(
        -1, len(numbers)
    )
    delta = np.linspace(0.1, 0.5, 5)
    curves = []
    for point in grid:
        values = dict(zip(numbers, map(float, point), strict=True))
        last = force_of(**{name.split(".")[-1]: value for name, value in values.items()})
        force = last * (delta / 0.5) ** 1.5
        table = {"step": np.arange(1.0, 6.0), "delta": delta, "force": force, "a": np.sqrt(delta)}
        table |= {"p_max": force, "penetration": 1e-3 * force}
        run = Results(Path("run"), table, {"status": "done", "units": UNITS, "method": "penalty"})
        curves.append(RunCurve(values, run))
    return CurveGroups(tuple(curves), tuple(numbers))


def panels_of(figure: Any) -> list[Any]:
    return [axes for axes in figure.axes if axes.axison and axes.get_label() != "<colorbar>"]


@pytest.fixture(scope="module")
def four() -> CurveGroups:
    return families(
        **{"body.height": HEIGHTS, "material.nu": RATIOS, "indenter.R": RADII, "material.E": MODULI}
    )


def test_two_hundred_runs_of_four_keys_are_told_apart(four: CurveGroups) -> None:
    """Every curve is in the panel of its R and nu, with the colour of its height.

    Its dashes are those of its E.
    """
    with study_picture.curves_figure(four, "200 runs") as figure:
        figures.apply_layout(figure)
        assert faults(figure) == []
        small = panels_of(figure)[: len(RADII) * len(RATIOS)]
        shades, _ = small_multiples.styles_by_key(four, "body.height")
        colours = {
            curve.values["body.height"]: look["color"]
            for curve, look in zip(four.curves, shades, strict=True)
        }
        for place, axes in enumerate(small):
            nu, R = RATIOS[place // len(RADII)], RADII[place % len(RADII)]
            assert axes.get_title(loc="left") == f"R {R:g}, nu {nu:g}"
            (lines,) = axes.collections
            assert len(lines.get_paths()) == len(HEIGHTS) * len(MODULI)
            ends = sorted(path.vertices[-1, 1] for path in lines.get_paths())
            assert ends == pytest.approx(
                sorted(force_of(h, R, nu, E) for h in HEIGHTS for E in MODULI)
            )
            for path, colour, (_, dashes) in zip(
                lines.get_paths(), lines.get_colors(), lines.get_linestyles(), strict=True
            ):
                E = MODULI[dashes is not None]
                (height,) = [
                    h
                    for h in HEIGHTS
                    if path.vertices[-1, 1] == pytest.approx(force_of(h, R, nu, E))
                ]
                assert tuple(colour) == pytest.approx(to_rgba(colours[height]))
        over = panels_of(figure)[len(small) :]
        assert [axes.get_xlabel() for axes in over] == ["height [µm]", "nu", "R [µm]"]
        points = np.concatenate([part.get_offsets() for part in over[0].collections])
        assert len(points) == 200 and {tuple(point) for point in np.round(points, 6)} == {
            (h, round(force_of(h, R, nu, E), 6))
            for h in HEIGHTS
            for R in RADII
            for nu in RATIOS
            for E in MODULI
        }


def test_the_force_over_two_numbers_is_a_map() -> None:
    """The force over two numbers is a map whose colours span the forces of the runs.

    Every run is a dot at its numbers.
    """
    two = families(**{"body.height": HEIGHTS, "indenter.R": RADII})
    with small_multiples.column_figure(two, "force", "two") as figure:
        figures.apply_layout(figure)
        assert faults(figure) == []
        (axes,) = panels_of(figure)
        (dots,) = axes.get_lines()
        assert set(zip(*dots.get_data(), strict=True)) == {(h, R) for h in HEIGHTS for R in RADII}
        forces = [force_of(h, R) for h in HEIGHTS for R in RADII]
        bar = next(one for one in figure.findobj(Axes) if one.get_label() == "<colorbar>")
        assert bar.get_xlim() == pytest.approx((min(forces), max(forces)))
        numbers = [float(label.get_text()) for label in bar.get_xticklabels() if label.get_text()]
        assert sum(min(forces) <= number <= max(forces) for number in numbers) >= 3


@pytest.mark.parametrize("column", small_multiples.PLOTTED_COLUMNS)
def test_columns_over_one_number_are_the_rows(column: str) -> None:
    one = families(**{"indenter.R": RADII, "body.height": (2.0, 4.0)})
    with small_multiples.column_figure(one, column, "one") as figure:
        figures.apply_layout(figure)
        axes = panels_of(figure)[0]
        assert axes.get_xlabel() == "R [µm]"
        scale = (
            small_multiples.representative_values(one, column)[0][0]
            / one.curves[0].results[column][-1]
        )  # of the unit shown
        points = np.concatenate([part.get_offsets() for part in axes.collections])
        asked = [
            (curve.values["indenter.R"], scale * curve.results[column][-1]) for curve in one.curves
        ]
        assert np.array(sorted(map(tuple, points))) == pytest.approx(np.array(sorted(asked)))


def test_a_study_without_numbers_has_nothing_to_draw_over() -> None:
    two = families(**{"indenter.R": RADII})
    words = CurveGroups(
        tuple(RunCurve({"contact.method": "penalty"}, curve.results) for curve in two.curves),
        ("contact.method",),
    )
    with (
        pytest.raises(UsageError, match="no number varies"),
        small_multiples.column_figure(words, "force", "words"),
    ):
        pass


LAYER = {
    "units": UNITS,
    "body": {"shape": "layer", "height": "10 um"},
    "material": {"model": "linear_elastic", "E": "1 kPa", "nu": 0.3},
    "indenter": {"shape": "sphere", "R": "5 um"},
    "loading": {"delta": "0.5 um", "steps": 2},
}


def test_runs_of_one_depth_have_numbers_along_the_depth() -> None:
    """Forces over six decades, a single depth: a logarithmic axis of it would have no ends."""
    curves = families(**{"material.E": (1.0, 1e3, 1e6), "indenter.R": RADII}).curves
    single = tuple(
        RunCurve(
            curve.values,
            Results(
                Path("run"),
                {name: column[-1:] for name, column in curve.results.table.items()},
                curve.results.report,
            ),
        )
        for curve in curves
    )
    groups = CurveGroups(single, ("material.E", "indenter.R"))
    with study_picture.curves_figure(groups, "one depth") as figure:
        figures.apply_layout(figure)
        assert faults(figure) == []
        first = panels_of(figure)[0]
        assert (first.get_xscale(), first.get_yscale()) == ("linear", "log")


def test_a_study_is_drawn_into_axes_of_ones_own(tmp_path: Path) -> None:
    """By its folder too: a column over one number is a panel, and so are the curves."""
    folder = tmp_path / "study"
    study = indent_sim.study({"base": LAYER, "vary": {"body.height": [5, 10]}}, directory=folder)
    own = Figure()
    first, second = own.subplots(1, 2)
    assert indent_sim.plot(folder, "a", ax=second) is own
    points = np.concatenate([part.get_offsets() for part in second.collections])
    assert np.asarray(points) == pytest.approx(np.column_stack([[5, 10], study["a"]]))
    assert not first.lines and not first.collections
    assert indent_sim.plot(str(folder), ax=first) is own
    assert first.get_xlabel() == "depth δ [µm]"
    ends = [line.get_ydata()[-1] for line in first.lines if len(line.get_xdata()) > 2]
    assert study["force"] == pytest.approx(ends[:2])
    assert len(indent_sim.plot(folder).axes) == len(indent_sim.plot(study).axes)
    for what, options, said in (
        ("pressure", {}, "plotted as curves"),
        ("a", {"zoom": 2}, "has no option zoom"),
    ):
        with pytest.raises(UsageError, match=said):
            indent_sim.plot(folder, what, ax=first, **options)


def test_a_column_of_several_panels_does_not_fit_into_axes(four: CurveGroups) -> None:
    with pytest.raises(UsageError, match="ax is one panel, but force needs 3"):
        small_multiples.draw_column_into(Figure().subplots(), four, "force")


def test_the_command_draws_a_study(tmp_path: Path) -> None:
    folder = tmp_path / "study"
    study = indent_sim.study({"base": LAYER, "vary": {"body.height": [5, 10]}}, directory=folder)
    done = CliRunner().invoke(
        commands.program, ["plot", str(folder), "--what", "a", "--output", str(tmp_path / "a.png")]
    )
    assert done.exit_code == 0 and (tmp_path / "a.png").stat().st_size > 5000
    figure = indent_sim.plot(study, "a")
    points = np.concatenate([part.get_offsets() for part in figure.axes[0].collections])
    assert np.asarray(points) == pytest.approx(np.column_stack([[5, 10], study["a"]]))
    for options, said in (
        (["--what", "pressure"], "must be one of curves"),
        (["--zoom", "2"], "has no option zoom"),
    ):
        refused = CliRunner().invoke(commands.program, ["plot", str(folder), *options])
        assert refused.exit_code == 2 and said in refused.stderr


def test_the_penetration_is_over_epsilon_n_beside_what_a_penalty_yields() -> None:
    """The penetration of penalty runs is drawn over epsilon_n beside p_max / epsilon_n."""
    runs = families(**{"indenter.R": RADII}).curves
    stiffness = np.geomspace(1e2, 1e6, len(runs))
    curves = tuple(
        RunCurve({"contact.epsilon_n": float(one)}, curve.results)
        for one, curve in zip(stiffness, runs, strict=True)
    )
    with small_multiples.column_figure(
        CurveGroups(curves, ("contact.epsilon_n",)), "penetration", "penalty"
    ) as figure:
        figures.apply_layout(figure)
        assert faults(figure) == []
        (axes,) = panels_of(figure)
        points = np.concatenate([part.get_offsets() for part in axes.collections])
        scale = (
            small_multiples.representative_values(
                CurveGroups(curves, ("contact.epsilon_n",)), "penetration"
            )[0][0]
            / runs[0].results["penetration"][-1]
        )
        assert np.asarray(points) == pytest.approx(
            np.array(
                [
                    (k, scale * curve.results["penetration"][-1])
                    for k, curve in zip(stiffness, runs, strict=True)
                ]
            )
        )
        yields = next(line for line in axes.get_lines() if "epsilon" in str(line.get_label()))
        assert yields.get_ydata() == pytest.approx(
            scale * np.array([run.results["p_max"][-1] for run in runs]) / stiffness
        )
        assert (
            axes.get_xscale() == axes.get_yscale() == "log"
            and axes.get_xlabel() == "epsilon_n [nN/µm³]"
        )
