"""Malformed scenes are refused with exit code 3, line, key and a helpful message."""

from __future__ import annotations

import time

import pytest

from indent_sim.config.key_types import field_names, field_types, join_words, types_by_tag
from indent_sim.config.scene_file import load
from indent_sim.config.schema import Config, section_tags
from indent_sim.process.errors import ConfigError

SCENE = """\
title: Hertz
units: {length: m, force: N}
body:
  shape: box
  size: [1.0, 1.0, 1.0]
  base: fixed
  sides: free
material:
  model: linear_elastic
  E: 1.0
  nu: 0.3
indenter:
  shape: paraboloid
  R: 1.0
  center: [0.5, 0.5]
contact:
  method: penalty
  epsilon_n: 1e4
loading:
  delta: 0.01
  steps: 10
mesh:
  h_contact: 0.01
  order: 2
solver:
  rtol: 1e-10
output:
  directory: results/hertz
  fields: last
  plot: true
"""


def edited(old: str, new: str) -> str:
    """Return the scene with one replacement."""
    assert SCENE.count(old) == 1
    return SCENE.replace(old, new)


def tip(lines: str) -> str:
    """Return the scene with another tip."""
    return edited("shape: paraboloid\n  R: 1.0", lines)


def matter(lines: str) -> str:
    """Return the scene with another material."""
    return edited("model: linear_elastic\n  E: 1.0\n  nu: 0.3", lines)


def body(lines: str) -> str:
    """Return the scene with another body."""
    return edited("shape: box\n  size: [1.0, 1.0, 1.0]\n  base: fixed\n  sides: free", lines)


def round_body(lines: str, over: str = "shape: plate") -> str:
    """Return the scene with an axisymmetric body and a tip on its axis."""
    return body(lines).replace("shape: paraboloid\n  R: 1.0\n  center: [0.5, 0.5]", over)


def choices(section: str, parameter: str = "") -> list[str]:
    """Names of all kinds of a section, or of those that have a parameter."""
    kinds = types_by_tag(field_types(Config)[section], section_tags()[section])
    return [name for name, kind in kinds.items() if not parameter or parameter in field_names(kind)]


BODIES, MATERIALS = (", ".join(choices(section)) for section in ("body", "material"))
STIFF = join_words(choices("contact", "epsilon_n"), "and")

# text, line, key, fragment of the message
MALFORMED = [
    # the file
    ("", 1, "", "the file is empty"),
    ("# only a comment\n", 1, "", "the file is empty"),
    ("just text\n", 1, "", "sections"),
    ("- a\n- b\n", 1, "", "sections"),
    (edited("  R: 1.0", "\tR: 1.0"), 14, "", "spaces, not tabs"),
    (edited("[0.5, 0.5]", "[0.5, 0.5"), 16, "", "not YAML"),
    (edited("plot: true", "plot: 'true"), 30, "", "found unexpected end of stream"),
    (edited("title: Hertz", "title: Hertz: ball"), 1, "", "mapping values are not allowed"),
    (edited("title: Hertz", "title: \0"), 1, "", "U+0000"),
    (SCENE + "---\n" + SCENE, 31, "", "second document"),
    # what strict YAML does without
    (edited("nu: 0.3", "nu: 0.3\n  nu: 0.4"), 12, "material.nu", "given twice, first in line 11"),
    (SCENE + "mesh:\n  order: 2\n", 31, "mesh", "given twice, first in line 22"),
    (edited("R: 1.0", "R: &r 1.0"), 14, "indenter.R", "anchors"),
    (edited("R: 1.0", "R: *r"), 14, "indenter.R", "anchors"),
    (edited("R: 1.0", "R: !!float 1.0"), 14, "indenter.R", "tags"),
    (edited("R: 1.0", "R: !!python/object/apply:os.getcwd []"), 14, "indenter.R", "tags"),
    (edited("R: 1.0", "1: 1.0"), 14, "indenter", "a key must be a word"),
    (edited("R: 1.0", "[a]: 1.0"), 14, "indenter", "a key must be a word"),
    (edited("title: Hertz", f"title: {'[' * 50}"), 1, "title[0][0]", "nested deeper than"),
    (edited("R: 1.0", "R: .inf"), 14, "indenter.R", ".inf is not a finite number"),
    (edited("R: 1.0", "R: .NaN"), 14, "indenter.R", ".NaN is not a finite number"),
    (edited("R: 1.0", "R: 1e999"), 14, "indenter.R", "too large a number"),
    (edited("R: 1.0", f"R: {'9' * 350}"), 14, "indenter.R", "too large a number"),
    (edited("R: 1.0", f"R: {'9' * 5000}"), 14, "indenter.R", "5000 characters is too long"),
    # keys
    (edited("R: 1.0", "r: 1.0"), 14, "indenter.r", "unknown key, did you mean 'R'?"),
    (edited("fields: last", "field: last"), 29, "output.field", "did you mean 'fields'?"),
    (SCENE + "colour: red\n", 31, "colour", "unknown key; valid here: title, units, body"),
    (SCENE + "materials: {}\n", 31, "materials", "did you mean 'material'?"),
    (SCENE + "delta: 0.1\n", 31, "delta", "it belongs in loading"),
    (SCENE + "center: [0, 0]\n", 31, "center", "it belongs in indenter"),
    (
        edited("sides: free", "sides: {left: free}"),
        7,
        "body.sides.left",
        "valid here: x_min, x_max, y_min",
    ),
    (
        edited("R: 1.0", "half_angle: 60"),
        14,
        "indenter.half_angle",
        "'paraboloid' has no parameter",
    ),
    (edited("method: penalty", "method: auto"), 18, "contact.epsilon_n", f"it belongs to {STIFF}"),
    (
        edited("  size: [1.0, 1.0, 1.0]\n", ""),
        3,
        "body.size",
        "missing; give a list of 3 numbers > 0",
    ),
    (edited("  R: 1.0\n", ""), 12, "indenter.R", "missing; give a number > 0"),
    (
        edited("loading:\n  delta: 0.01\n  steps: 10\n", ""),
        1,
        "loading",
        "section is missing; its keys",
    ),
    (edited("body:\n  shape: box\n", "body:\n"), 3, "body.shape", f"choose one of {BODIES}"),
    (edited("  rtol: 1e-10\n", ""), 25, "solver", "this section is empty"),
    (
        edited("mesh:\n  h_contact: 0.01\n  order: 2", "mesh: 3"),
        22,
        "mesh",
        "a mapping of keys to values, got 3",
    ),
    # choices
    (
        edited("shape: paraboloid", "shape: parabola"),
        13,
        "indenter.shape",
        "did you mean 'paraboloid'?",
    ),
    (
        edited("shape: paraboloid", "shape: 7"),
        13,
        "indenter.shape",
        "there is no indenter 7; choose one of",
    ),
    (
        edited("model: linear_elastic", "model: rubber"),
        9,
        "material.model",
        f"choose one of {MATERIALS}",
    ),
    (edited("method: penalty", "method: Penalty"), 17, "contact.method", "did you mean 'penalty'?"),
    (edited("base: fixed", "base: free"), 6, "body.base", "must be fixed or roller, got 'free'"),
    (edited("sides: free", "sides: rollers"), 7, "body.sides", "did you mean 'roller'?"),
    (
        edited("sides: free", "sides: {x_min: rolls}"),
        7,
        "body.sides.x_min",
        "must be free, roller or fixed",
    ),
    (
        edited("h_contact: 0.01", "h_contact: Auto"),
        23,
        "mesh.h_contact",
        "a number > 0 or auto, got 'Auto'",
    ),
    (
        edited("fields: last", "fields: true"),
        29,
        "output.fields",
        "must be auto, none, last or all, got true",
    ),
    # types
    (edited("R: 1.0", "R: '1.0'"), 14, "indenter.R", "must be a number > 0, got '1.0'"),
    (edited("R: 1.0", "R: 1.0 mmm"), 14, "indenter.R", "there is no unit 'mmm'; did you mean mm?"),
    (
        edited("R: 1.0", "R: 1,5"),
        14,
        "indenter.R",
        "a comma is not a decimal point: '1,5'; write 1.5",
    ),
    (edited("R: 1.0", "R: true"), 14, "indenter.R", "must be a number > 0, got true"),
    (edited("R: 1.0", "R:"), 14, "indenter.R", "must be a number > 0, got nothing"),
    (edited("R: 1.0", "R: [1.0]"), 14, "indenter.R", "must be a number > 0, got [1.0]"),
    (edited("R: 1.0", "R: nan"), 14, "indenter.R", "got 'nan'"),
    (edited("steps: 10", "steps: 10.0"), 21, "loading.steps", "must be a whole number > 0"),
    (edited("order: 2", "order: true"), 24, "mesh.order", "must be 2, got true"),
    (edited("plot: true", "plot: on"), 30, "output.plot", "must be true or false, got 'on'"),
    (edited("plot: true", "plot: 1"), 30, "output.plot", "must be true or false, got 1"),
    (edited("title: Hertz", "title: 1882"), 1, "title", "must be text, got 1882"),
    (
        edited("{length: m, force: N}", "m"),
        2,
        "units",
        "must be a mapping of keys to values, got 'm'",
    ),
    (edited("directory: results/hertz", "directory: ''"), 28, "output.directory", "non-empty text"),
    (
        edited("size: [1.0, 1.0, 1.0]", "size: 1.0"),
        5,
        "body.size",
        "a list of 3 numbers > 0, got 1.0",
    ),
    (
        edited("size: [1.0, 1.0, 1.0]", "size: [1.0, 1.0]"),
        5,
        "body.size",
        "3 numbers > 0, got [1.0, 1.0]",
    ),
    (
        edited("size: [1.0, 1.0, 1.0]", "size: [1, x, 1]"),
        5,
        "body.size[1]",
        "must be a number > 0, got 'x'",
    ),
    (
        edited("rtol: 1e-10", "petsc: {}"),
        26,
        "solver.petsc",
        "set PETSC_OPTIONS in the environment",
    ),
    (
        edited("rtol: 1e-10", "petsc: {ksp_type: [cg]}"),
        26,
        "solver.petsc",
        "was removed; the keys of solver",
    ),
    # ranges
    (edited("R: 1.0", "R: -1"), 14, "indenter.R", "must be > 0, got -1"),
    (edited("R: 1.0", "R: 0"), 14, "indenter.R", "must be > 0, got 0"),
    (edited("nu: 0.3", "nu: 0.7"), 11, "material.nu", "must be > -1 and <= 0.5, got 0.7"),
    (edited("steps: 10", "steps: 0"), 21, "loading.steps", "must be > 0"),
    (
        edited("order: 2", "order: 1"),
        24,
        "mesh.order",
        "must be 2, got 1; linear elements were removed: with the same number of unknowns, "
        "quadratic elements give a force that is ten times as accurate",
    ),
    (edited("order: 2", "order: 3"), 24, "mesh.order", "must be 2, got 3"),
    (edited("rtol: 1e-10", "rtol: 1e-6"), 26, "solver.rtol", "must be > 0 and <= 1e-09, got 1e-06"),
    (
        edited("size: [1.0, 1.0, 1.0]", "size: [1, 1,\n    -1]"),
        6,
        "body.size[2]",
        "must be > 0, got -1",
    ),
    # contradictions
    (edited("nu: 0.3", "nu: 0.3\n  mu: 1"), 8, "material", "needs exactly two of E, nu, mu"),
    (edited("  nu: 0.3\n", ""), 8, "material", "needs exactly two of E, nu, mu"),
    (edited("E: 1.0\n  nu: 0.3", "E: 1\n  mu: 0.1"), 8, "material", "a stable material has"),
    (
        edited("E: 1.0\n  nu: 0.3", "mu: 1\n  lame_lambda: -1"),
        8,
        "material",
        "give no E; a stable material",
    ),
    (
        edited("E: 1.0\n  nu: 0.3", "mu: 1\n  lame_lambda: -1"),
        8,
        "material",
        "and therefore lame_lambda > -2 mu/3",
    ),
    (
        edited("E: 1.0\n  nu: 0.3", "kappa: 1\n  lame_lambda: 3"),
        8,
        "material",
        "and therefore lame_lambda < kappa",
    ),
    (
        edited("E: 1.0\n  nu: 0.3", "nu: 0\n  lame_lambda: 1"),
        8,
        "material",
        "and therefore lame_lambda/nu > 0",
    ),
    (
        edited("delta: 0.01", "delta: 0.01\n  deltas: [0.1]"),
        21,
        "loading.deltas",
        "contradicts delta",
    ),
    (edited("delta: 0.01", "deltas: [0.1]"), 21, "loading.steps", "applies only to a single delta"),
    (edited("  delta: 0.01\n", ""), 19, "loading", "gives no depth and no force"),
    (edited("delta: 0.01", "delta: 0.01\n  force: 0.1"), 21, "loading.force", "contradicts delta"),
    (
        edited("delta: 0.01\n  steps: 10", "deltas: [0.1]\n  forces: [0.1]"),
        21,
        "loading.forces",
        "contradicts deltas",
    ),
    (
        edited("delta: 0.01", "force: 0.1\n  forces: [0.1]"),
        21,
        "loading.forces",
        "contradicts force",
    ),
    (
        edited("delta: 0.01", "forces: [0.1]"),
        21,
        "loading.steps",
        "applies only to a single force, which is divided into equal steps, but forces are given",
    ),
    (edited("delta: 0.01", "force: -0.1"), 20, "loading.force", "must be > 0, got -0.1"),
    (edited("delta: 0.01", "force: 0"), 20, "loading.force", "must be > 0, got 0"),
    (edited("delta: 0.01", "force: .nan"), 20, "loading.force", "nan"),
    (
        edited("delta: 0.01\n  steps: 10", "forces: [1, -0.1]"),
        20,
        "loading.forces[1]",
        "there is no adhesion",
    ),
    (edited("delta: 0.01\n  steps: 10", "forces: [1, .inf]"), 20, "loading.forces[1]", "inf"),
    (
        edited("delta: 0.01\n  steps: 10", "forces: []"),
        20,
        "loading.forces",
        "list of 1 to 100000 numbers, got []",
    ),
    (
        edited("delta: 0.01\n  steps: 10", "forces: [0, 0]"),
        20,
        "loading.forces",
        "every force is 0",
    ),
    (
        edited("delta: 0.01\n  steps: 10", "deltas: []"),
        20,
        "loading.deltas",
        "list of 1 to 100000 numbers, got []",
    ),
    # tips and bodies
    (
        tip("shape: flat_punch\n  radius: 0.2\n  edge_radius: 0.21"),
        15,
        "indenter.edge_radius",
        "at most 0.2",
    ),
    (
        tip("shape: pyramid\n  half_angle: 90"),
        14,
        "indenter.half_angle",
        "must be > 1e-06 and < 90, got 90",
    ),
    (
        tip("shape: pyramid\n  half_angle: 60\n  faces: 2"),
        15,
        "indenter.faces",
        "must be >= 3 and <= 64, got 2",
    ),
    (tip("shape: pyramid\n  half_angle: 60\n  faces: 4.0"), 15, "indenter.faces", "a whole number"),
    (
        tip("shape: pyramid\n  half_angle: 60\n  tip_radius: -1"),
        15,
        "indenter.tip_radius",
        "must be >= 0",
    ),
    (tip("shape: pyramid"), 12, "indenter.half_angle", "missing; give a number > 1e-06 and < 90"),
    (
        tip("shape: hyperboloid\n  R: 1.0"),
        12,
        "indenter.half_angle",
        "missing; give a number > 1e-06 and < 90",
    ),
    (tip("shape: hyperboloid\n  half_angle: 35"), 12, "indenter.R", "missing; give a number > 0"),
    (
        tip("shape: hyperboloid\n  half_angle: 90\n  R: 1.0"),
        14,
        "indenter.half_angle",
        "and < 90, got 90",
    ),
    (tip("shape: hyperboloid\n  half_angle: 35\n  R: 0"), 15, "indenter.R", "must be > 0, got 0"),
    (matter("model: fung\n  mu: 1.0\n  nu: 0.3"), 8, "material.b", "missing; give a number > 0"),
    (
        matter("model: fung\n  mu: -1.0\n  b: 1.0\n  nu: 0.3"),
        10,
        "material.mu",
        "must be > 0, got -1",
    ),
    (matter("model: fung\n  mu: 1.0\n  b: 0\n  nu: 0.3"), 11, "material.b", "must be > 0, got 0"),
    (
        matter("model: fung\n  mu: 1.0\n  b: 1.0"),
        8,
        "material",
        "needs exactly one of nu and kappa",
    ),
    (
        matter("model: fung\n  mu: 1.0\n  b: 1.0\n  nu: 0.3\n  kappa: 2.0"),
        8,
        "material",
        "exactly one of nu and kappa",
    ),
    (
        tip("shape: cone\n  half_angle: 60\n  faces: 4"),
        15,
        "indenter.faces",
        "(it belongs to pyramid)",
    ),
    (tip("shape: profile"), 12, "indenter.points", "missing; give a list of 2 to 1000 lists of 2"),
    (tip("shape: profile\n  points: [[0, 0]]"), 14, "indenter.points", "list"),
    (
        tip("shape: profile\n  points: [[0, 0], 1]"),
        14,
        "indenter.points[1]",
        "list of 2 numbers >= 0, got 1",
    ),
    (
        tip("shape: profile\n  points: [[0, 0], [1, 1, 1]]"),
        14,
        "indenter.points[1]",
        "list of 2 numbers",
    ),
    (
        tip("shape: profile\n  points: [[0, 0], [1, -1]]"),
        14,
        "indenter.points[1][1]",
        "must be >= 0, got -1",
    ),
    (tip("shape: profile\n  points: [[0, 1], [1, 2]]"), 14, "indenter.points", "the apex [0, 0]"),
    (
        tip("shape: profile\n  points: [[0, 0], [1, 1], [1, 2]]"),
        14,
        "indenter.points",
        "r must increase",
    ),
    (
        tip("shape: profile\n  points: [[0, 0], [1, 1], [2, 1.5]]"),
        14,
        "indenter.points",
        "must be convex",
    ),
    (
        body("shape: half_space"),
        12,
        "indenter.center",
        "all positions on a half_space are equivalent",
    ),
    (
        body("shape: half_space\n  base: fixed"),
        5,
        "body.base",
        "'half_space' has no parameter 'base'",
    ),
    (
        body("shape: half_space\n  radius: 1"),
        5,
        "body.radius",
        "(it belongs to cylinder, ball and ellipsoid)",
    ),
    # bodies about an axis
    (
        round_body("shape: cap\n  base_radius: 2.0"),
        3,
        "body.height",
        "missing, and so is contact_angle",
    ),
    (
        round_body("shape: cap\n  base_radius: 2.0\n  height: 1.0\n  contact_angle: 50.0"),
        7,
        "body.contact_angle",
        "cannot be combined with height",
    ),
    (
        round_body("shape: cap\n  base_radius: 2.0\n  contact_angle: 180.0"),
        6,
        "body.contact_angle",
        "must be > 0 and < 180",
    ),
    (
        round_body("shape: cap\n  base_radius: 2.0\n  contact_angle: 178.0"),
        3,
        "body",
        "almost a ball that rests on a point",
    ),
    (round_body("shape: cap\n  base_radius: 2.0\n  height: 1e-3"), 3, "body", "nearly flat"),
    (
        round_body("shape: cap\n  base_radius: 2.0\n  height: 1.0\n  base: free"),
        7,
        "body.base",
        "'free'",
    ),
    (round_body("shape: cap\n  height: 1.0"), 3, "body.base_radius", "missing"),
    (
        round_body("shape: ball\n  radius: 1.0\n  height: 1.0"),
        6,
        "body.height",
        "'ball' has no parameter 'height'",
    ),
    (round_body("shape: ball\n  radius: -1.0"), 5, "body.radius", "must be > 0"),
    (
        round_body("shape: ball\n  radius: 1.0\n  layers: [{thickness: 1.0}]"),
        6,
        "body.layers[0].thickness",
        "the last layer of a ball is its core, which has no thickness",
    ),
    (
        round_body("shape: ball\n  radius: 1.0", "shape: plate\n  center: [0.1, 0.0]"),
        12,
        "indenter.center",
        "tip is on the axis",
    ),
    (
        round_body("shape: ball\n  radius: 1.0", "shape: pyramid\n  half_angle: 65.0"),
        11,
        "indenter.shape",
        "which is axisymmetric",
    ),
    (
        round_body("shape: ball\n  radius: 1.0", "shape: plate\n  R: 1.0"),
        12,
        "indenter.R",
        "'plate' has no parameter",
    ),
    (
        edited("center: [0.5, 0.5]", "center: [0.5]"),
        15,
        "indenter.center",
        "must be [x, y], got 1",
    ),
    (
        edited("center: [0.5, 0.5]", "center: [0.5, a]"),
        15,
        "indenter.center[1]",
        "must be a number, got 'a'",
    ),
]


def test_the_scene_itself_is_right(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text(SCENE)
    assert load(path).title == "Hertz"


@pytest.mark.parametrize(("text", "line", "key", "fragment"), MALFORMED)
def test_malformed(tmp_path, text, line, key, fragment):
    path = tmp_path / "scene.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load(path)
    assert caught.value.exit_code == 3
    errors = getattr(caught.value, "errors", [caught.value])
    error = next(error for error in errors if fragment in str(error))
    assert (error.file, error.line, error.key) == (str(path), line, key)
    assert str(error).startswith(f"{path}:{line}: {key}")


@pytest.mark.parametrize(
    "text",
    [
        "a: &a [x, x]\nb: &b [*a, *a]\nc: &c [*b, *b]\n",
        "title: " + "[" * 400_000,
        "title: " + "{a: " * 200_000,
        "- " * 400_000,
        "? " * 400_000,
        "loading: {deltas: [" + "x, " * 300_000 + "x]}",
        "R: " + "9" * 900_000,
        "R: 0." + "9" * 900_000,
        "title: '" + "x" * 3_000_000 + "'",
        "".join(f"key{i}: 1\n" for i in range(60_000)),
    ],
    ids=[
        "aliases",
        "lists",
        "mappings",
        "dashes",
        "keys",
        "items",
        "integer",
        "float",
        "size",
        "sections",
    ],
)
def test_bombs_are_refused_fast(tmp_path, text):
    path = tmp_path / "scene.yaml"
    path.write_text(text)
    start = time.process_time()
    with pytest.raises(ConfigError) as caught:
        load(path)
    assert len(str(caught.value)) < 5000
    assert time.process_time() - start < 10


@pytest.mark.parametrize(("key", "key_of_list"), [("delta", "deltas"), ("force", "forces")])
def test_a_list_where_its_own_key_takes_lists(key: str, key_of_list: str, tmp_path) -> None:
    file = tmp_path / "scene.yaml"
    file.write_text(edited("delta: 0.01\n  steps: 10", f"{key}: [0.01, 0.02]"))
    with pytest.raises(ConfigError) as caught:
        load(file)
    assert caught.value.key == f"loading.{key}"
    assert f"'{key_of_list}'" in caught.value.remedy
