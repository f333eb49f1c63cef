"""The glossary has a meaning, a symbol and a dimension for every name in YAML and CSV."""

from __future__ import annotations

import dataclasses
import json
import re
from typing import get_args, get_origin

import pytest
from reference_pages import config_page

from indent_sim.config import schema
from indent_sim.config.json_schema import json_schema, sections_and_kinds
from indent_sim.config.key_types import bare_type, field_types, union_members
from indent_sim.config.scene_file import config_from_mapping
from indent_sim.config.schema import Config
from indent_sim.fitting import fit_table
from indent_sim.model.state import DERIVED_COLUMNS, STATE_COLUMNS, State, Surface
from indent_sim.model.symbols import GROUPS, SYMBOLS, lookup
from indent_sim.model.units import unit_of
from indent_sim.results.tables import SURFACE_COLUMNS
from indent_sim.studies import parameter_points, study_file, study_table
from indent_sim.studies.reference import scoreboard


def yaml_fields() -> list[tuple[str, type, str]]:
    """Section, dataclass and name of every key of the scene file.

    Keys inside a key and keys of list items have their own entries.
    """
    found = [("", Config, name) for name in Config.model_fields]
    for section, kinds in schema.sections().items():
        for kind in kinds:
            inside = {name: bare_type(hint) for name, hint in field_types(kind).items()}
            innermost = {
                name: bare_type(hint)
                for owner in inside.values()
                if dataclasses.is_dataclass(owner)
                for name, hint in field_types(owner).items()
            }
            owners = [
                (section, kind),
                *((section, hint) for hint in inside.values()),
                *inside.items(),
                *innermost.items(),
            ]
            lists = {
                name: bare_type(hint)
                for name, hint in field_types(kind).items()
                if get_origin(bare_type(hint)) is tuple
            }
            owners += [
                (name, item)
                for name, hint in lists.items()
                for item in union_members(get_args(hint)[0])
            ]
            found += [
                (where, owner, name)
                for where, owner in owners
                if dataclasses.is_dataclass(owner)
                for name in field_types(owner)
            ]
    return list(dict.fromkeys(found))


def test_every_key_has_a_meaning():
    """Every key of the scene file has a glossary entry, with the dimension of its unit."""
    missing = []
    for section, kind, name in yaml_fields():
        symbol = lookup(name, section)
        unit = unit_of(field_types(kind)[name])
        if not symbol or not symbol.meaning or (unit and symbol.dimension != unit.text):
            missing.append((section, kind.__name__, name))
    assert missing == [], "add them to indent_sim/model/symbols.py"


def test_what_has_a_dimension_is_marked_with_it():
    """Every key whose glossary entry has a dimension is marked with a unit.

    By these marks quantities are converted and scenes are scaled.
    """
    unmarked = [
        (section, kind.__name__, name)
        for section, kind in [("", Config), *sections_and_kinds()]
        for name, hint in field_types(kind).items()
        if not unit_of(hint) and lookup(name, section).dimension not in ("1", "word")
    ]
    assert unmarked == [], "mark them with their units"


def test_every_column_has_a_meaning():
    """Every column of the row table and the surface table has a glossary entry."""
    columns = [*STATE_COLUMNS, *DERIVED_COLUMNS, "force_error", *SURFACE_COLUMNS]
    assert [name for name in columns if name not in SYMBOLS] == []


def test_every_column_of_a_study_has_a_meaning():
    """Every column of a study's table and scoreboard has a glossary entry."""
    columns = ["index", "run", *study_table.STUDY_COLUMNS, *scoreboard.SCOREBOARD_COLUMNS]
    assert [name for name in columns if not lookup(name, "study")] == []


def test_every_column_of_a_fit_has_a_meaning():
    """Every column of a fit's table has a glossary entry."""
    columns = [*fit_table.FIRST_COLUMNS, *fit_table.LAST_COLUMNS]
    assert [name for name in columns if not lookup(name, "fit")] == []


def test_every_key_of_a_study_has_a_meaning():
    """Every key of a study file and of its ranges has a glossary entry."""
    keys = [*study_file.STUDY_KEYS, *parameter_points.RANGE_KEYS, "zip"]
    assert [name for name in keys if not lookup(name, "study")] == []


@pytest.mark.parametrize("kind", [State, Surface])
def test_every_field_of_a_state_has_a_meaning(kind):
    assert [f.name for f in dataclasses.fields(kind) if f.name not in SYMBOLS] == []


def test_one_entry_a_name():
    names = [symbol.name for group in GROUPS.values() for symbol in group]
    assert len(names) == len(set(names))


def test_an_entry_for_one_section_names_a_section_and_key():
    known = {f"{section}.{name}" for section, _, name in yaml_fields()}
    study_names = (
        *study_file.STUDY_KEYS,
        *parameter_points.RANGE_KEYS,
        *study_table.STUDY_COLUMNS,
    )
    known |= {f"study.{name}" for name in study_names}
    known |= {f"fit.{name}" for name in (*fit_table.FIRST_COLUMNS, *fit_table.LAST_COLUMNS)}
    assert [name for name in SYMBOLS if "." in name and name not in known] == []


def test_the_json_schema_describes_the_file():
    found = json_schema()
    assert json.loads(json.dumps(found)) == found
    assert list(found["properties"]) == list(schema.allowed_keys_at((), {}))
    for section, kinds in schema.sections().items():
        for kind in kinds:
            properties = found["$defs"][kind.__name__]["properties"]
            placement = schema.PLACEMENT_KEYS if section == "indenter" else ()
            expected = {*schema.file_order(kind), *placement}
            assert set(properties) == expected
            assert all(entry["description"] for entry in properties.values())
            assert found["$defs"][kind.__name__]["additionalProperties"] is False


def test_the_json_schema_knows_walls_tags_and_defaults():
    kinds = json_schema()["$defs"]
    assert kinds["Box"]["properties"]["sides"]["anyOf"][0]["enum"] == ["free", "roller", "fixed"]
    assert kinds["Box"]["properties"]["sides"]["default"] == "free"
    assert kinds["Box"]["required"] == ["shape", "size"]
    assert kinds["Penalty"]["required"] == ["method"]
    assert "required" not in kinds["AutoContact"]
    assert kinds["SolverSettings"]["properties"]["rtol"]["maximum"] == 1e-9


def test_the_page_of_the_scene_file_says_which_sections_another_may_replace():
    """The page of the scene file marks `material` as replaceable by materials of layers."""
    layers = [{"material": {"model": "linear_elastic", "E": 1.0, "nu": 0.3}}]
    body, loading = {"shape": "half_space", "layers": layers}, {"history": [[0, 0], [1, 0.01]]}
    config_from_mapping(
        {"body": body, "indenter": {"shape": "sphere", "R": 1.0}, "loading": loading}
    )
    rows = [
        row.split(" | ")
        for row in config_page().splitlines()
        if row.startswith("| [`") and "**required**" in row
    ]
    unless = {row[0].strip("| [`").split("`")[0]: "unless" in row[1] for row in rows}
    assert {name for name, is_conditional in unless.items() if is_conditional} == {"material"}


def test_the_page_of_the_scene_file_has_no_row_twice():
    rows = [row for row in config_page().splitlines() if row.startswith("| `")]
    assert len(rows) > 100 and len(rows) == len(set(rows))


def test_the_page_of_the_scene_file_has_every_key():
    page = config_page()
    missing = [
        name
        for section, kind, name in yaml_fields()
        if section and not re.search(f"[`.]{name}", page)
    ]
    walls = {"x_min", "x_max", "y_min", "y_max"}  # named in the row of `sides`
    assert set(missing) <= walls
