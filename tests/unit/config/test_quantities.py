"""Quantities with units: the same digits as in one system of units, and helpful messages."""

from __future__ import annotations

import random
from dataclasses import dataclass
from decimal import Decimal
from typing import Annotated

import numpy as np
import pytest

from indent_sim.config.json_schema import json_schema
from indent_sim.config.key_types import field_types
from indent_sim.config.quantities import Conversion
from indent_sim.config.scene_file import config_from_mapping, load, loads, to_mapping, to_yaml
from indent_sim.config.schema import SchemaNode
from indent_sim.model.units import FORCE, TIME, Scales, Unit, UnitRow
from indent_sim.process.errors import ConfigError
from indent_sim.scene.scene import resolve

LENGTHS = {"pm": -12, "nm": -9, "um": -6, "µm": -6, "mm": -3, "cm": -2, "m": 0, "km": 3}
FORCES = {"pN": -12, "nN": -9, "uN": -6, "mN": -3, "N": 0, "kN": 3}
PRESSURES = {
    "mPa": -3,
    "Pa": 0,
    "kPa": 3,
    "MPa": 6,
    "GPa": 9,
    "N/m^2": 0,
    "N/mm²": 6,
    "mN/um**2": 9,
    "J/m^3": 0,
}
BASE = """\
units: {length: um, force: nN}
body: {shape: cylinder, radius: 30, height: 10}
material: {model: linear_elastic, E: 1, nu: 0.3}
indenter: {shape: cone, half_angle: 70, tip_radius: 0.05}
loading: {delta: 0.5}
"""


def a_scene(chance: random.Random) -> dict:
    """A scene of random numbers with four digits, in random units."""

    def number(low: float, high: float) -> float:
        return float(f"{chance.uniform(low, high):.4g}")

    E, height = number(0.1, 9), number(5, 20)
    return {
        "units": {"length": chance.choice(list(LENGTHS)), "force": chance.choice(list(FORCES))},
        "body": {
            "shape": "cylinder",
            "radius": number(30, 60),
            "layers": [
                {
                    "thickness": height,
                    "material": {"model": "linear_elastic", "mu": E, "nu": number(0, 0.4)},
                }
            ],
            "height": height,
        },
        "indenter": {"shape": "sphere", "R": number(1, 9)},
        "contact": {"method": "penalty", "epsilon_n": number(10, 90)},
        "loading": {"deltas": [number(0.1, 0.2), number(0.2, 0.4)]},
        "mesh": {"h_contact": number(0.1, 0.3)},
    }


def with_units(value, key: str, units: dict, chance: random.Random):
    """The same scene with most numbers of a dimension in random units."""
    if isinstance(value, dict):
        return {name: with_units(part, name, units, chance) for name, part in value.items()}
    if isinstance(value, list):
        return [with_units(part, key, units, chance) for part in value]
    length, force = LENGTHS[units["length"]], FORCES[units["force"]]
    stiffnesses = {"kPa/um": 9, "Pa/mm": 3, "N/m^3": 0}
    tables = {"mu": (PRESSURES, force - 2 * length), "epsilon_n": (stiffnesses, force - 3 * length)}
    table, own = tables.get(key, (LENGTHS, length))
    if not isinstance(value, float) or key == "nu" or chance.random() < 0.2:
        return value
    unit = chance.choice(list(table))
    return f"{Decimal(repr(value)).scaleb(own - table[unit])}{chance.choice(['', ' '])}{unit}"


@pytest.mark.parametrize("seed", range(30))
def test_mixed_units_give_the_digits_of_one_system(seed):
    """Mixed units give every number to the last bit, in the config and in the resolved config."""
    chance = random.Random(seed)
    plain = a_scene(chance)
    mixed = with_units(plain, "", plain["units"], chance)
    assert mixed != plain and to_mapping(config_from_mapping(mixed)) == to_mapping(
        config_from_mapping(plain)
    )
    assert loads(to_yaml(config_from_mapping(mixed))) == config_from_mapping(plain)


@pytest.mark.parametrize(
    ("override", "key", "problem", "remedy"),
    [
        ("material.E=1,0", "material.E", "a comma is not a decimal point", "write 1.0"),
        ("material.E='1,5 kPa'", "material.E", "a comma is not a decimal point", "write 1.5 kPa"),
        ("material.E=1 kpa", "material.E", "no unit 'kpa'", "did you mean kPa?"),
        ("material.E=1 um", "material.E", "a length, not a pressure", "for example 1 kPa"),
        ("material.E=1 N", "material.E", "a force, not a pressure", "for example 1 kPa"),
        ("material.E=1 furlong^", "material.E", "no unit 'furlong^'", "for example um"),
        ("material.nu=0.3 um", "material.nu", "number without unit", "write 0.3"),
        ("material.nu=30 %", "material.nu", "number without unit", "write 30"),
        ("body.height=10 umm", "body.height", "no unit 'umm'", "did you mean um?"),
        ("body.height=10 kPa", "body.height", "a pressure, not a length", "for example 2.5 um"),
        ("body.height=10 um^2", "body.height", "length^2, not a length", "for example 2.5 um"),
        ("body.height=10 um*um", "body.height", "length^2, not a length", "for example 2.5 um"),
        ("body.height=10 deg", "body.height", "an angle, not a length", "for example 2.5 um"),
        ("indenter.half_angle=70 um", "indenter.half_angle", "is not an angle", "70 deg"),
        ("loading={force: 3 Pa}", "loading.force", "a pressure, not a force", "for example 3 nN"),
        (
            "loading={deltas: [0.1, 2 s]}",
            "loading.deltas[1]",
            "a time, not a length",
            "for example 2.5 um",
        ),
        (
            "contact={method: penalty, epsilon_n: 3 kPa}",
            "contact.epsilon_n",
            "not a pressure per length",
            "kPa/um",
        ),
        ("mesh.h_contact=0.1 apples", "mesh.h_contact", "no unit 'apples'", "for example um"),
        (
            "units={length: um}",
            "material.E",
            "does not define the unit of force",
            "length: um, force: nN",
        ),
        ("units={length: zorp, force: nN}", "units.length", "no unit 'zorp'", ""),
        (
            "units={length: kPa, force: nN}",
            "units.length",
            "a pressure, not a length",
            "for example um",
        ),
    ],
)
def test_wrong_ones_name_key_and_remedy(override, key, problem, remedy):
    base = BASE.replace("E: 1,", "E: 1 kPa,").replace("delta: 0.5", "delta: 500 nm")
    with pytest.raises(ConfigError) as caught:
        loads(base, "scene.yaml", [override])
    found = next(
        (one for one in getattr(caught.value, "errors", [caught.value]) if one.key == key),
        caught.value,
    )
    assert found.key == key and problem in found.problem and remedy in found.remedy and found.file


def test_plain_numbers_and_labels_of_any_kind_stay():
    config = loads(BASE.replace("um", "blob").replace("nN", "push"))
    assert config.body.height == 10.0 and not config.source.quantities


def test_plan_says_what_was_converted():
    scene = resolve(loads(BASE.replace("E: 1,", "E: 0.001 MPa,")))
    choice = next(choice for choice in scene.plan.choices if choice.key == "material.E")
    assert choice.value == 1.0 and "given as 0.001 MPa" in choice.why and "um and nN" in choice.why


def test_forces_on_a_strip_are_per_length():
    text = (
        BASE.replace("cylinder, radius: 30", "strip, width: 30")
        .replace("delta: 0.5", "force: 2 mN/m")
        .replace("{shape: cone, half_angle: 70, tip_radius: 0.05}", "{shape: sphere, R: 5}")
    )
    assert loads(text).loading.force == 2.0
    with pytest.raises(ConfigError, match="a force, not a force per length"):
        loads(text.replace("2 mN/m", "2 nN"))
    mesh = "shape: mesh, kinematics: plane_strain, file: a.msh"
    from_file = text.replace("shape: strip, width: 30, height: 10", mesh)
    with pytest.raises(ConfigError, match="a force, not a force per length"):
        loads(from_file.replace("2 mN/m", "2 nN"))


@pytest.mark.parametrize(
    ("given", "value"),
    [
        ("cantilever: {stiffness: 10 kPa}", 10.0),
        ("cantilever: {stiffness: 0.01 N/m}", "per length, not a pressure"),
        ("frame: {compliance: 2 um^2/nN}", 2.0),
        ("frame: {compliance: 2 um/nN}", "2 um^2/mN"),
    ],
)
def test_springs_of_a_strip_are_per_length(given, value):
    """The spring constant of a strip is per length, and so a pressure.

    In um and nN, 1 kPa is 1 nN/um^2.
    """
    text = BASE.replace("cylinder, radius: 30", "strip, width: 30").replace(
        "{shape: cone, half_angle: 70, tip_radius: 0.05}", "{shape: sphere, R: 5}"
    )
    if isinstance(value, str):
        with pytest.raises(ConfigError, match=value.replace("^", r"\^")):
            loads(text, "", [f"experiment={{{given}}}"])
    else:
        found = loads(text, "", [f"experiment={{{given}}}"]).experiment
        assert value in (found.compliance, 1 / found.compliance)
    assert loads(
        text, "", ["loading={force_history: [[0, 0], [1, 2 mN/m]]}"]
    ).loading.force_history[-1] == (1.0, 2.0)
    with pytest.raises(ConfigError, match="not a force per length"):
        loads(text, "", ["loading={force_history: [[0, 0], [1, 2 nN]]}"])


@pytest.mark.parametrize("body", ["strip, width: 30", "cylinder, radius: 30"])
def test_work_of_adhesion_is_an_energy_per_area_everywhere(body):
    text = BASE.replace("cylinder, radius: 30", body).replace("tip_radius: 0.05", "tip_radius: 0.5")
    adhesion = "contact={adhesion: {work: 0.1 mJ/m^2, range: 50 nm}}"
    assert loads(text, "", [adhesion]).contact.adhesion.work == 0.1
    with pytest.raises(ConfigError, match="a pressure, not a force per length"):
        loads(text, "", [adhesion.replace("mJ/m^2", "kPa")])


def test_times_are_in_seconds():
    with pytest.raises(ConfigError, match="valid here: length, force") as caught:
        loads(BASE, "", ["units.time=ms", "loading={history: [[0, 0], [2 s, 200 nm]]}"])
    assert caught.value.key == "units.time"


def test_experiments_take_them_too():
    """Histories, relaxation times and frequencies take quantities with units."""
    relaxation, history = (
        "material.relaxation={prony: [[0.4, 100 ms]]}",
        "loading={history: [[0, 0], [2 s, 200 nm]]}",
    )
    given = [
        relaxation,
        history,
        "loading.times=[1 ms, 2 s]",
        "experiment={frequencies: [0.1 kHz]}",
    ]
    text = BASE.replace("cylinder, radius: 30, height: 10", "half_space").replace(
        "{shape: cone, half_angle: 70, tip_radius: 0.05}", "{shape: paraboloid, R: 5}"
    )
    found = loads(text, "", given)
    assert found.material.relaxation.prony == ((0.4, 0.1),) and found.loading.history == (
        (0.0, 0.0),
        (2.0, 0.2),
    )
    assert found.loading.times == (1e-3, 2.0) and found.experiment.frequencies == (100.0,)
    with pytest.raises(ConfigError, match="a length, not a time"):
        loads(text, "", [relaxation, history.replace("2 s", "2 um")])
    work = "experiment={adhesion: {work: 0.1 mJ/m^2}, cantilever: {stiffness: 0.05 N/m}}"
    adhesive = loads(text, "", [work]).experiment
    assert adhesive.adhesion.work == 0.1 and adhesive.cantilever.stiffness == 50.0


def test_relative_uncertainties_have_no_unit():
    """The relative uncertainties `stiffness` and `R` of a calibration take no unit."""
    text = BASE.replace("cylinder, radius: 30, height: 10", "half_space").replace(
        "{shape: cone, half_angle: 70, tip_radius: 0.05}", "{shape: paraboloid, R: 5 um}"
    )
    experiment = (
        "experiment={cantilever: {stiffness: 0.05 N/m}, calibration: {stiffness: 0.1, R: 0.05}}"
    )
    assert loads(text, "", [experiment]).experiment.calibration.stiffness == 0.1
    for key, given, remedy in (("stiffness", "0.0001 N/m", "0.0001"), ("R", "0.05 um", "0.05")):
        with pytest.raises(ConfigError) as caught:
            loads(text, "", [experiment, f"experiment.calibration.{key}={given}"])
        assert (
            caught.value.key == f"experiment.calibration.{key}"
            and caught.value.remedy == f"write {remedy}"
        )
    assert "string" not in str(json_schema()["$defs"]["Calibration"]["properties"])
    assert "string" in str(json_schema()["$defs"]["Cantilever"]["properties"]["stiffness"])


def test_radians_are_degrees_to_rounding():
    assert loads(
        BASE.replace("half_angle: 70", "half_angle: 1.2 rad")
    ).indenter.half_angle == pytest.approx(68.7549354)


def test_files_and_editors_take_them(tmp_path):
    (tmp_path / "scene.yaml").write_text(BASE.replace("height: 10", "height: 0.01 mm"))
    assert load(tmp_path / "scene.yaml", ["material.E=2 kPa"]).material.E == 2.0
    kinds = json_schema()["$defs"]["Cylinder"]["properties"]
    assert {part["type"] for part in kinds["height"]["anyOf"]} == {"number", "string"}
    assert "string" not in str(json_schema()["$defs"]["LinearElastic"]["properties"]["nu"])


@dataclass(frozen=True)
class Draining:
    """Section with keys of every kind of dimension that contains a time."""

    D: Annotated[float, Unit("length^2/time")]
    permeability: Annotated[float, Unit("length^2/(pressure time)")]
    viscosity: Annotated[float, Unit("pressure time")]
    rates: Annotated[tuple[float, ...], Unit("1/time")]
    history: tuple[Annotated[tuple[float, ...], UnitRow((TIME, FORCE))], ...]


SI = {"length": 1e-6, "force": 1e-9}  # um and nN


@pytest.mark.parametrize(
    ("name", "given", "in_SI", "powers"),
    [
        ("D", "40 um^2/s", 40e-12, (2, 0, -1)),
        ("D", "2.4 mm²/min", 4e-8, (2, 0, -1)),
        ("permeability", "1e-15 m^4/(N s)", 1e-15, (4, -1, -1)),
        ("permeability", "3 um^2/(kPa*ms)", 3e-12, (4, -1, -1)),
        ("permeability", "1e-15 m^2/Pa/s", 1e-15, (4, -1, -1)),
        ("viscosity", "5 mPa s", 5e-3, (-2, 1, 1)),
        ("viscosity", "2 kPa·h", 7.2e6, (-2, 1, 1)),
    ],
)
def test_times_are_converted_as_lengths_and_forces_are(name, given, in_SI, powers):
    """Quantities with a time are converted to seconds and to the units of the scene."""
    convert = Conversion({"units": {"length": "um", "force": "nN"}})
    length, force, _ = powers
    hint = field_types(Draining)[name]
    expected = in_SI / (SI["length"] ** length * SI["force"] ** force)
    assert convert.convert_node(SchemaNode((name,), hint, None, given)) == pytest.approx(
        expected, rel=1e-14
    )
    assert not convert.errors
    convert.convert_node(SchemaNode((name,), hint, None, "1 um/s"))
    assert "length^1 time^-1" in convert.errors[0].problem


def test_every_number_of_a_row_has_its_own_unit():
    convert = Conversion({"units": {"length": "um", "force": "nN"}})
    spot = SchemaNode(
        ("history",),
        field_types(Draining)["history"],
        None,
        [[0, "0 pN"], ["2 min", "5 pN"], ["1 h", 3]],
    )
    assert convert.convert_node(spot) == [[0, 0.0], [120.0, 0.005], [3600.0, 3]]
    convert.convert_node(SchemaNode(("history",), spot.type, None, [["2 um", 1]]))
    assert [error.key for error in convert.errors] == ["history[0][0]"]


@pytest.mark.parametrize("dim", [2, 3])
def test_scaling_knows_time(dim):
    """Scaling and its inverse follow the dimensions, written out here by hand."""
    scales = Scales(2.0, 3.0, dim, time=5.0)
    given = Draining(
        D=7.0,
        permeability=11.0,
        viscosity=13.0,
        rates=(17.0, 19.0),
        history=((23.0, 29.0), (0.0, 31.0)),
    )
    force = 3.0 * 2.0 ** (dim - 1)
    expected = Draining(
        D=7.0 * 5 / 4,
        permeability=11.0 * 3 * 5 / 4,
        viscosity=13.0 / 3 / 5,
        rates=(17.0 * 5, 19.0 * 5),
        history=((23.0 / 5, 29.0 / force), (0.0, 31.0 / force)),
    )
    for name, value in vars(scales.nondimensionalize(given)).items():
        assert np.allclose(value, getattr(expected, name), rtol=1e-14), name
    for name, value in vars(scales.to_user_units(expected)).items():
        assert np.allclose(value, getattr(given, name), rtol=1e-14), name
