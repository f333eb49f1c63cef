"""Scene files: what is read, what is written back, and the position that errors name."""

from __future__ import annotations

import os
import pickle

import numpy as np
import pytest
import yaml

from indent_sim.config.scene_file import (
    config_from_mapping,
    load,
    loads,
    locate_error,
    read_document,
    to_mapping,
    to_yaml,
)
from indent_sim.config.schema import Config
from indent_sim.config.strict_yaml import parse
from indent_sim.model.body import Cylinder
from indent_sim.model.contact import AutoContact, Penalty
from indent_sim.model.linear_elasticity import LinearElastic
from indent_sim.model.load_path import LoadPath
from indent_sim.model.loading import Loading
from indent_sim.model.tips import Cone, Paraboloid
from indent_sim.model.walled_bodies import Box, BoxSides
from indent_sim.process.errors import ConfigError, ConfigErrors, UsageError

SCENE = """\
title: Rigid paraboloid on an elastic cylinder
units: {length: m, force: N}

body:
  shape: cylinder
  radius: 1
  height: 1.5

material:
  model: linear_elastic
  E: 1e-6
  nu: 0.3

indenter:
  shape: paraboloid
  R: 1.0

loading:
  delta: 0.01
"""

BOX = """\
body: {shape: box, size: [1, 2, 3], sides: roller}
material: {model: linear_elastic, mu: 1, kappa: 2}
indenter: {shape: cone, half_angle: 70.3, center: [0.1, -0.2]}
contact: {method: penalty, epsilon_n: 1e4, gap: reference}
loading: {deltas: [0.1, 0.2, -0.05]}
mesh: {h_contact: 0.01, order: 2, symmetry: half}
solver: {rtol: 1e-10, max_iterations: 20}
output: {directory: out/on, fields: none, plot: false}
"""


def test_defaults():
    config = loads(SCENE)
    assert config.body == Cylinder(radius=1.0, height=1.5)
    assert isinstance(config.body.radius, float)
    assert config.material == LinearElastic(E=1e-6, nu=0.3)
    assert config.indenter == Paraboloid(R=1.0)
    assert config.contact == AutoContact()
    assert config.loading.path().values == pytest.approx([0.001 * i for i in range(1, 11)])
    assert config.loading.path().control == "depth"
    assert (config.mesh.h_contact, config.mesh.order, config.mesh.symmetry) == ("auto", 2, "auto")
    assert (config.output.fields, config.output.plot, config.output.directory) == (
        "auto",
        True,
        None,
    )
    assert config.center is None


def test_sections_are_the_dataclasses_of_model():
    config = loads(BOX)
    assert config.body == Box(size=(1.0, 2.0, 3.0), sides=BoxSides(*["roller"] * 4))
    assert config.indenter == Cone(half_angle=70.3)
    assert config.center == (0.1, -0.2)
    assert config.contact == Penalty(epsilon_n=1e4, gap="reference")
    assert config.loading == Loading(deltas=(0.1, 0.2, -0.05))
    assert (config.solver.rtol, config.solver.max_iterations) == (1e-10, 20)


def test_contact_without_a_method_is_auto():
    assert loads(SCENE + "contact: {gap: current}\n").contact == AutoContact(gap="current")


ROUND = """\
body: {shape: cap, base_radius: 2.0, contact_angle: 50.0, base: roller}
material: {model: linear_elastic, E: 1.0, nu: 0.3}
indenter: {shape: plate}
loading: {delta: 0.1, steps: 2}
"""


@pytest.mark.parametrize("text", [SCENE, BOX, ROUND])
def test_yaml_written_is_yaml_read(text):
    config = loads(text)
    assert loads(to_yaml(config)) == config
    assert config_from_mapping(to_mapping(config)) == config
    assert to_yaml(loads(to_yaml(config))) == to_yaml(config)


@pytest.mark.parametrize("text", [SCENE, BOX])
def test_written_yaml_means_the_same_to_a_yaml_1_1_reader(text):
    written = to_yaml(loads(text))
    assert yaml.safe_load(written) == parse(written)[0]


def test_written_yaml_follows_the_order_of_the_contract():
    written = to_mapping(loads(BOX))
    assert list(written) == [
        "title",
        "units",
        "body",
        "material",
        "indenter",
        "contact",
        "loading",
        "mesh",
        "solver",
        "output",
    ]
    assert list(written["indenter"]) == ["shape", "half_angle", "tip_radius", "center"]
    assert written["body"]["sides"] == "roller"
    assert written["loading"] == {"deltas": [0.1, 0.2, -0.05]}


def test_walls_one_by_one():
    config = loads(BOX, overrides=["body.sides={x_min: fixed}"])
    assert config.body.sides == BoxSides(x_min="fixed")
    assert loads(to_yaml(config)) == config


def test_overrides_use_the_same_reader():
    config = loads(
        SCENE,
        overrides=["contact.method=penalty", "contact.epsilon_n=1e3", "mesh.grading=1", "title=on"],
    )
    assert config.contact == Penalty(epsilon_n=1000.0)
    assert config.mesh.grading == 1
    assert config.title == "on"
    assert loads(SCENE, overrides=["loading={deltas: [0.1, 0.2]}"]).loading.deltas == (0.1, 0.2)


def test_an_override_reaches_a_section_the_file_does_not_have():
    assert loads(SCENE, overrides=["solver.max_iterations=7"]).solver.max_iterations == 7


def test_changing_the_method_reports_what_the_new_one_does_not_have():
    with pytest.raises(
        ConfigError, match=r"scene.yaml:4: contact.epsilon_n: the chosen method 'auto' has no"
    ):
        loads(BOX, "scene.yaml", ["contact.method=auto"])


@pytest.mark.parametrize(
    ("override", "fragment"),
    [
        (
            "contact.methd=penalty",
            "--set contact.methd=penalty: contact.methd: unknown key, did you mean 'method'?",
        ),
        (
            "mesh.h_contact=-1",
            "--set mesh.h_contact=-1: mesh.h_contact: must be > 0 or auto, got -1",
        ),
        ("nonsense", "--set nonsense: is not key=value"),
        ("=1", "--set =1: is not key=value"),
        ("a..b=1", "is not key=value"),
        ("loading.deltas[0]=1", "loading.deltas is not a list"),
        ("colour.red=1", "--set colour.red=1: colour: unknown key"),
        ("title.x=1", "title is not a section"),
        ("title=[1", "--set title=[1: title: not YAML"),
        ("title=.nan", ".nan is not a finite number"),
        ("title=*a", "anchors"),
        ("loading.deltas=[1, 2]", "contradicts delta"),
        ("body.sides=rolling", "body.sides: must be free, roller or fixed, got 'rolling'"),
        (
            "body={shape: box, size: [1, 1, 1], sides: rolling}",
            "body.sides: must be free, roller or fixed (or",
        ),
    ],
)
def test_a_wrong_override_is_named(override, fragment):
    with pytest.raises(ConfigError) as caught:
        loads(SCENE, "scene.yaml", [override])
    assert fragment in str(caught.value)
    assert caught.value.exit_code == 3


def test_the_same_key_twice_on_the_command_line():
    with pytest.raises(ConfigError, match="title: given twice with --set"):
        loads(SCENE, overrides=["title=a", "title=b"])


def test_later_errors_find_their_line(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text(SCENE)
    config = load(path, ["mesh.grading=1"])
    assert _place(config, "indenter.R") == (str(path), 16)
    assert _place(config, "body.sides") == (str(path), 4)
    assert _place(config, "body.sides.x_min") == (str(path), 4)
    assert _place(config, "mesh.grading") == ("--set mesh.grading=1", None)
    assert _place(config, "output.fields") == (str(path), 1)
    assert _place(config, "") == (str(path), None)
    assert _place(loads(BOX), "loading.deltas[1]") == ("", 5)


def test_several_later_errors_stand_in_the_order_of_the_file():
    both = ConfigErrors([ConfigError("loading.delta", "b"), ConfigError("body.radius", "a")])
    assert str(locate_error(loads(SCENE, "f"), both)).splitlines() == [
        "f:6: body.radius: a",
        "f:19: loading.delta: b",
    ]


def test_an_error_that_knows_its_file_keeps_it():
    error = ConfigError("indenter.R", "x", file="g", line=1)
    assert locate_error(loads(SCENE, "f"), error) is error


def test_all_errors_of_a_file_come_together():
    text = (
        SCENE.replace("radius: 1", "radius: -1")
        .replace("R: 1.0", "r: 1.0")
        .replace("nu: 0.3", "nu: x")
    )
    with pytest.raises(ConfigErrors) as caught:
        loads(text, "f.yaml")
    assert str(caught.value).splitlines() == [
        "f.yaml:6: body.radius: must be > 0, got -1",
        "f.yaml:12: material.nu: must be a number > -1 and <= 0.5, got 'x'",
        "f.yaml:16: indenter.r: unknown key, did you mean 'R'?",
    ]


def test_mistakes_of_every_kind_come_together():
    """Mistakes of every kind are reported together, each with its key and line."""
    text = (
        SCENE.replace("material:", "materal:")
        .replace("nu: 0.3", "nu: 0.7")
        .replace("radius: 1", "radius: 1 kg")
    )
    with pytest.raises(ConfigErrors) as caught:
        loads(text, "f", ["nonsense", "mesh.h_far=-1", "contact.epsilon_n=1", "mesh.h_far=2"])
    found = {error.key: error.line for error in caught.value.errors}
    assert found == {
        "": None,
        "mesh.h_far": None,
        "body.radius": 6,
        "materal": 9,
        "material.nu": 12,
        "contact.epsilon_n": None,
    }
    assert all(error.file and error.problem for error in caught.value.errors)


def test_a_key_of_many_parts_is_refused():
    for key in ("a." * 4999 + "b", "body.layers" + "[0]" * 4999):
        with pytest.raises(ConfigError, match=r"has 500[01] parts") as caught:
            loads(SCENE, "f", [f"{key}=1"])
        assert len(str(caught.value)) < 200


def test_mappings_of_a_notebook():
    data = {
        "body": Box(size=(1.0, 1.0, 1.0)),
        "material": {"model": "linear_elastic", "E": np.float64(2), "nu": np.float32(0.25)},
        "indenter": {"shape": "paraboloid", "R": 1, "center": np.array([0.5, 0.25])},
        "loading": Loading(deltas=(0.1,)),
        "solver": {"max_iterations": np.int64(7)},
    }
    config = config_from_mapping(data, ["title=notebook"])
    assert config.material == LinearElastic(E=2.0, nu=0.25)
    assert config.center == (0.5, 0.25)
    assert (config.title, config.solver.max_iterations) == ("notebook", 7)
    assert "title" not in data


@pytest.mark.parametrize("value", [float("nan"), float("inf"), object(), {1: 2}, "\0", "\ud800"])
def test_a_mapping_holds_only_what_a_file_could(value):
    with pytest.raises(ConfigError):
        config_from_mapping({**parse(SCENE)[0], "title": value})


@pytest.mark.parametrize(
    ("loading", "values"),
    [({"force": 3.0, "steps": 3}, (1.0, 2.0, 3.0)), ({"forces": [2.0, 0.0, 1]}, (2.0, 0.0, 1.0))],
)
def test_forces_instead_of_depths(loading, values):
    config = config_from_mapping(parse(SCENE)[0] | {"loading": loading})
    assert config.loading.path() == LoadPath("force", values)
    assert loads(to_yaml(config)) == config and to_mapping(config)["loading"] == loading


def test_a_config_is_a_value():
    config = loads(SCENE, "f")
    assert pickle.loads(pickle.dumps(config)) == config == loads(SCENE, "g")
    assert _place(pickle.loads(pickle.dumps(config)), "indenter.R") == ("f", 16)
    with pytest.raises(ValueError, match="frozen"):
        config.title = "other"  # type: ignore[misc]


def test_objects_are_checked_too():
    with pytest.raises(ValueError, match="greater than 0"):
        Config(
            body=Cylinder(radius=-1, height=1),
            material=LinearElastic(E=1, nu=0),
            indenter=Paraboloid(R=1),
            loading=Loading(delta=1),
        )


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-6", 1e-6),
        ("1E3", 1e3),
        (".5", 0.5),
        ("1.", 1.0),
        ("-0", 0),
        ("010", 10),
        ("0x1F", 31),
        ("0o17", 15),
        ("on", "on"),
        ("yes", "yes"),
        ("No", "No"),
        ("1:30", "1:30"),
        ("1_000", "1_000"),
        ("true", True),
        ("~", None),
        ("'1'", "1"),
        ("nan", "nan"),
        ("2026-01-01", "2026-01-01"),
        ("[1, [a, b]]", [1, ["a", "b"]]),
        ("<<", "<<"),
    ],
)
def test_scalars_are_those_of_yaml_1_2(text, value):
    found = parse(f"key: {text}")[0]["key"]
    assert found == value and type(found) is type(value)


@pytest.mark.parametrize(
    "text",
    [" lead", "on", "1e5", "a: b", "# no", "q\"'\\", "line\nline\t", "\x7f\x85\ufeffé😀", ""],
)
def test_any_title_survives(text):
    config = config_from_mapping({**parse(SCENE)[0], "title": text})
    assert config.title == text
    assert loads(to_yaml(config)) == config


def test_a_file_that_cannot_be_read_is_a_usage_error(tmp_path):
    for path in (tmp_path / "missing.yaml", tmp_path, "nul\0.yaml"):
        with pytest.raises(UsageError, match="cannot read"):
            load(path)


def test_bytes_that_are_no_scene(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_bytes(b"title: a\nbody: \xff\n")
    with pytest.raises(ConfigError, match=r"scene.yaml:2: the file is not UTF-8"):
        load(path)
    path.write_bytes(b"#" * 2_000_000)
    with pytest.raises(ConfigError, match="longer than"):
        load(path)
    path.write_bytes("\ufeff".encode() + SCENE.encode())
    assert load(path) == loads(SCENE)


def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "scene.yaml")
    for read in (load, read_document):
        with pytest.raises(UsageError, match=r"cannot read the config .*: not a regular file"):
            read(tmp_path / "scene.yaml")
    with pytest.raises(UsageError, match="not a regular file"):
        load("/dev/zero")


def _place(config: Config, key: str) -> tuple[str, int | None]:
    error = locate_error(config, ConfigError(key, "wrong"))
    return error.file, error.line
