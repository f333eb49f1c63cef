"""Templates of `init`: each is a scene that can be run, and no file is overwritten."""

from __future__ import annotations

import json
import os
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from indent_sim.cli import commands
from indent_sim.config.scene_file import load
from indent_sim.scene.scene import resolve


def said(*words: str):
    return CliRunner().invoke(commands.program, words)


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


SCENES = [kind for kind in commands.TEMPLATES if kind != "study"]


@pytest.mark.parametrize("kind", SCENES)
def test_a_template_is_a_scene_of_little_cost(kind):
    """A template is predicted to run in half a minute, and its comments name its file."""
    done = said("init", kind)
    assert done.exit_code == 0 and done.stdout == f"{kind}.yaml\n"
    config = load(f"{kind}.yaml")
    assert (
        resolve(config).plan.prediction.get("seconds", 0.0) < 30
        and config.units.length
        and config.source.quantities
    )
    text = Path(f"{kind}.yaml").read_text()
    assert (
        text.startswith("# yaml-language-server: $schema=scene.schema.json\n")
        and f"plan {kind}.yaml" in text
    )
    assert max(map(len, text.splitlines())) <= 128
    told = json.loads(said("plan", f"{kind}.yaml", "--json").stdout)
    assert told["exit_code"] == 0


def test_the_study_is_one_of_little_cost():
    """All runs of the study template are predicted to take half a minute."""
    assert said("init", "study").stdout == "study.yaml\n"
    done = said("plan", "study.yaml", "--json")
    assert done.exit_code == 0, done.stderr
    told = json.loads(done.stdout)
    assert len(told["rows"]) == 6 and told["seconds"] < 30
    assert max(map(len, Path("study.yaml").read_text().splitlines())) <= 128


def test_a_file_that_is_there_stays(tmp_path):
    Path("cell.yaml").write_text("mine")
    done = said("init")
    assert done.exit_code == 2 and "cell.yaml exists already" in done.stderr
    assert Path("cell.yaml").read_text() == "mine" and os.listdir() == ["cell.yaml"]
    os.symlink("nowhere", "link.yaml")
    assert said("init", "--output", "link.yaml").exit_code == 2 and not os.path.exists("nowhere")
    assert said("init", "gel", "--output", "new.yaml").exit_code == 0
    assert (
        said("init", "--output", "no/such/folder.yaml").exit_code == 2
        and said("init", "metal").exit_code == 2
    )


def test_what_the_wheel_needs_is_package_data():
    project = (Path(__file__).resolve().parents[2] / "pyproject.toml").read_text()
    there = (Path(commands.__file__).parent / "templates").glob("*.yaml")
    assert '"*.yaml"' in project and sorted(path.stem for path in there) == sorted(
        commands.TEMPLATES
    )


def test_the_schema_that_a_scene_names_is_written_beside_it():
    """The schema is written next to a scene; an existing one stays, and a study has none."""
    assert said("init", "study").exit_code == 0 and not Path("scene.schema.json").exists()
    assert said("init", "gel").exit_code == 0
    assert json.loads(Path("scene.schema.json").read_text()) == json.loads(said("schema").stdout)
    Path("scene.schema.json").write_text("mine")
    assert said("init", "film").exit_code == 0 and Path("scene.schema.json").read_text() == "mine"


@pytest.mark.parametrize(
    ("words", "option", "begun", "found"),
    [
        ("run", "overrides", "body.hei", ["body.height="]),
        ("plan", "overrides", "material.n", ["material.nu="]),
        ("plot", "fields", "J,von", ["J,von_mises"]),
        ("plot", "fields", "sigma_z", ["sigma_zz"]),
    ],
)
def test_a_shell_completes_keys_and_fields(words, option, begun, found):
    command = commands.program.commands[words]
    parameter = next(one for one in command.params if one.name == option)
    completed = [item.value for item in parameter.shell_complete(click.Context(command), begun)]
    assert set(found) <= set(completed) and all(item.startswith(begun) for item in completed)
