"""The functions for notebooks need no file and give the numbers of the commands.

What they show fits a screen.
"""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import indent_sim
from indent_sim.cli import commands
from indent_sim.process.errors import BackendError, ConfigError, UsageError
from indent_sim.process.repr_tables import MAX_ROWS, ReprTable

ROOT = Path(__file__).resolve().parents[2]

SCENE: dict[str, Any] = {
    "title": "A gel <on> glass",
    "units": {"length": "um", "force": "nN"},
    "body": {"shape": "layer", "height": "10 um"},
    "material": {"model": "linear_elastic", "E": np.float64(1.0), "nu": 0.3},
    "indenter": {"shape": "sphere", "R": 5},
    "loading": {"deltas": np.linspace(0.1, 0.5, 30)},
}
WIDEST = 200  # letters in a line of a screen


@pytest.fixture
def result(tmp_path: Path) -> Any:
    indent_sim.simulate(indent_sim.load(SCENE), directory=tmp_path / "run")
    return indent_sim.read(tmp_path / "run")


def test_dir_shows_the_public_names() -> None:
    assert dir(indent_sim) == sorted(indent_sim.__all__) and all(
        hasattr(indent_sim, name) for name in dir(indent_sim)
    )


def test_a_dictionary_is_a_scene_as_its_file(tmp_path: Path) -> None:
    config = indent_sim.load(SCENE, ["material.nu=0.4"])
    (tmp_path / "scene.json").write_text(
        json.dumps(SCENE | {"loading": {"deltas": list(SCENE["loading"]["deltas"])}})
    )
    assert config == indent_sim.load(tmp_path / "scene.json", ["material.nu=0.4"])
    with pytest.raises(ConfigError, match=r"body\.hight: unknown key, did you mean 'height'"):
        indent_sim.load(SCENE | {"body": {"shape": "layer", "hight": 1}})


def test_a_dictionary_is_enough(tmp_path: Path) -> None:
    """A dictionary is accepted wherever a scene is, without `load` or `resolve`."""
    forces = [state.force for state in indent_sim.states(SCENE)]
    outcome = indent_sim.simulate(SCENE, directory=str(tmp_path / "run"))
    assert forces == [state.force for state in outcome.states]
    (tmp_path / "scene.json").write_text(
        json.dumps(SCENE | {"loading": {"deltas": list(SCENE["loading"]["deltas"])}})
    )
    assert next(iter(indent_sim.states(tmp_path / "scene.json"))).force == pytest.approx(
        forces[0], rel=1e-12
    )
    with pytest.raises(TypeError, match="not a resolved Scene"):
        indent_sim.simulate(
            indent_sim.resolve(indent_sim.load(SCENE)), directory=tmp_path / "other"
        )


def test_changes_are_values_by_their_keys() -> None:
    """Changes given as values by keys are those of --set, for a dictionary, file or config.

    Values may be numpy numbers and sections.
    """
    changes = {
        "material.nu": np.float64(0.4),
        "body.height": "20 um",
        "indenter": {"shape": "cone", "half_angle": 70},
    }
    words = ["material.nu=0.4", "body.height=20 um", "indenter={shape: cone, half_angle: 70}"]
    changed = indent_sim.load(SCENE, changes)
    assert (
        changed == indent_sim.load(SCENE, words) == indent_sim.load(indent_sim.load(SCENE), changes)
    )
    with pytest.raises(ConfigError, match=r"material\.nuu: unknown key, did you mean 'nu'"):
        indent_sim.load(SCENE, {"material.nuu": 0.4})
    with pytest.raises(ConfigError, match=r"'material nu' is not a key; write it with dots"):
        indent_sim.load(SCENE, {"material nu": 0.4})


def test_a_panel_is_drawn_into_axes_of_ones_own(result: Any) -> None:
    from matplotlib.figure import Figure

    own = Figure()
    first, second = own.subplots(1, 2)
    assert indent_sim.plot(result, "profile", ax=second) is own
    assert second.get_lines() and second.get_legend() and not first.get_lines()
    for what, wish, said in (
        ("force,profile", {}, "the request has 2"),
        ("force", {"width": 80}, "determined by the figure of ax"),
    ):
        with pytest.raises(UsageError, match=said):
            indent_sim.plot(result, what, ax=first, **wish)


def test_what_is_shown_fits_a_screen(result: Any) -> None:
    """The text of a result has a title, as many lines as fit, and the warnings.

    In HTML nothing of a title is markup.
    """
    for thing in (result, indent_sim.resolve(indent_sim.load(SCENE))):
        lines = repr(thing).splitlines()
        assert "A gel <on> glass" in lines[0] and len(lines) <= MAX_ROWS + 5
        assert max(map(len, lines)) <= WIDEST
        assert (
            "<on>" not in thing._repr_html_() and thing._repr_html_().count("<tr>") <= MAX_ROWS + 2
        )
    assert repr(result).splitlines()[2].split()[:3] == ["1", "0.1", f"{result['force'][0]:.6g}"]


def test_long_tables_show_both_ends() -> None:
    shown = ReprTable("many", ["n"], [[i] for i in range(1000)])
    assert (
        shown.text.splitlines()[2:4] == ["0", "1"]
        and shown.text.splitlines()[-1] == "999"
        and "…" in shown.text
    )


def test_a_study_of_a_dictionary_is_its_table(tmp_path: Path) -> None:
    """A study of a dictionary is its table, in a temporary folder or in a named one.

    A named one can be read back.
    """
    wanted = {"base": SCENE, "vary": {"body.height": [2, 10], "material.E": [1, 2]}}
    found = indent_sim.study(wanted)
    assert (
        found["force"].shape == (4,)
        and list(found["body.height"]) == [2, 2, 10, 10]
        and len(found) == 4
    )
    assert found["force"][1] == pytest.approx(
        2 * found["force"][0], rel=1e-9
    )  # theory is linear in E
    folder = found.directory
    assert (
        (folder / "study.csv").exists()
        and "body.height" in repr(found)
        and "<table>" in found._repr_html_()
    )
    del found
    assert not folder.exists()
    kept = indent_sim.study(wanted, directory=tmp_path / "study")
    again = indent_sim.read(tmp_path / "study")
    assert again.columns == kept.columns and again["force"].tolist() == kept["force"].tolist()
    assert (
        again.keys == ("body.height", "material.E")
        and again["run"].tolist() == kept["run"].tolist()
    )


def test_plan_require_and_compare_are_the_objects_of_the_commands(
    tmp_path: Path, result: Any
) -> None:
    scene = SCENE | {"loading": {"delta": 0.5, "steps": 3}}
    (tmp_path / "scene.json").write_text(json.dumps(scene))
    run = CliRunner().invoke
    for call, name in ((indent_sim.plan, "plan"), (indent_sim.require, "require")):
        told = json.loads(
            run(commands.program, [name, str(tmp_path / "scene.json"), "--json"]).stdout
        )
        assert json.loads(json.dumps(call(scene))) == {
            k: told[k] for k in told if k not in ("status", "exit_code")
        }
    assert indent_sim.compare(result, result)["differences"] == []
    assert (
        indent_sim.plan({"base": scene, "vary": {"material.nu": [0.1, 0.2]}})["rows"][1][
            "material.nu"
        ]
        == 0.2
    )


def test_tables_go_to_pandas_where_it_is_there(
    result: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(BackendError, match="pip install pandas"):
        result.to_pandas()
    stand_in = ModuleType("pandas")
    stand_in.DataFrame = dict  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "pandas", stand_in)
    assert result.to_pandas()["force"].tolist() == result["force"].tolist()


def test_five_lines_are_enough(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Five lines of docs/how_do_i.md give a table and a figure, and one more a derivative.

    The derivative lies between the differences of the table.
    """
    monkeypatch.chdir(tmp_path)
    page = (ROOT / "docs" / "how_do_i.md").read_text(encoding="utf-8")
    lines = re.findall(r"```python\n(.*?)```", page, re.DOTALL)[0]
    assert len([line for line in lines.splitlines() if line]) == 5
    names: dict[str, Any] = {}
    exec(lines, names)
    thin, middle, thick = names["thickness"]["force"]
    assert [entry.name for entry in tmp_path.iterdir()] == ["curves.png"] and thin > middle > thick
    slope = indent_sim.sensitivities(names["layer"], "body.height")["body.height"]["value"][-1]
    assert (thick - middle) / 5 < slope < 0  # the thicker, the less it matters
