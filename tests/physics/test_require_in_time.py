"""What `require` says of bodies that drain, or whose shear relaxes: against theory, runs of both models, other methods."""

from __future__ import annotations

from functools import cache
from typing import Any

import pytest

from indent_sim.config.scene_file import from_mapping
from indent_sim.config.schema import Config
from indent_sim.model.materials import Gel
from indent_sim.process.errors import ConfigError
from indent_sim.run.chain import states
from indent_sim.run.requirements.bench import Bench
from indent_sim.run.requirements.cheapest import require
from indent_sim.run.requirements.effects import Effect
from indent_sim.run.requirements.evolution import Evolution, limits_of
from indent_sim.run.requirements.table import REQUIREMENTS
from indent_sim.scene.scene import resolve

DEPTH, CONTACT = 0.02, 0.0219  # a^2 at that depth: a = 0.148
WALLED = {"shape": "cylinder", "radius": 2.0, "height": 1.0, "base": "fixed", "sides": "roller"}
POROUS: dict[str, Any] = {"model": "linear_elastic", "E": 1.0, "nu": 0.2, "flow": {"diffusivity": 1.0}}
AT_ONCE, AT_LAST = 0.0075520868, 0.0044524888  # layer theory in that wall at nu = 0.5 and the same G, and at 0.2


def scene(material: dict[str, Any] = POROUS, way_in: float = CONTACT, **sections: Any) -> Config:
    """The walled layer under a paraboloid, two steps of each length; the way in is a jump where it takes no time."""
    history = [[0, 0], [way_in, DEPTH]] if way_in else [[0, DEPTH], [CONTACT, DEPTH]]
    base = {"body": WALLED, "material": material, "indenter": {"shape": "paraboloid", "R": 1.0}}
    return from_mapping(base | {"loading": {"history": history, "per_doubling": 2}} | sections)


def rows(config: Config) -> dict[str, Effect]:
    """Its rows of time alone."""
    return {effect.name: effect for effect in Evolution(config, resolve(config)).effects}


@cache
def drainage(tip: str, share: float) -> Effect:
    return rows(scene(way_in=share * CONTACT, drainage={"tip": tip}))["drainage"]


@pytest.mark.parametrize(
    ("tip", "share", "over_first", "over_last"),
    [
        ("sealed", 0.1, 0.943, None),
        ("sealed", 1.0, 0.779, 1.321),
        pytest.param("sealed", 10.0, None, 1.099, marks=pytest.mark.verify),
        pytest.param("drained", 0.1, 0.864, None, marks=pytest.mark.verify),
        ("drained", 1.0, 0.730, 1.239),
        pytest.param("drained", 10.0, None, 1.084, marks=pytest.mark.verify),
    ],
)
def test_a_ramp_between_both_limits(tip: str, share: float, over_first: float | None, over_last: float | None) -> None:
    """Forces over those of both limits, of finite elements half as large in steps half as long: 1 % of the force."""
    found = drainage(tip, share)
    assert found.percent is not None and found.high is not None
    ratio = 1 + found.percent / 100
    assert over_last is None or ratio == pytest.approx(over_last, rel=1e-2)
    assert over_first is None or ratio / (1 + found.high / 100) == pytest.approx(over_first, rel=1e-2)


def test_the_range_is_that_of_theory() -> None:
    """Each force is good to 5e-4 of it on ten elements in the contact."""
    found = drainage("sealed", 1.0)
    assert found.low == 0 and found.high == pytest.approx(100 * (AT_ONCE / AT_LAST - 1), abs=0.2)


@pytest.mark.parametrize(
    ("law", "agreement"),
    [
        (POROUS, 1e-3),
        (POROUS | {"model": "neo_hookean"}, 1e-3),
        (POROUS | {"flow": {"permeability": 1.0, "alpha": 0.8, "storage": 0.5}}, 1e-3),
        ({"model": "gel", "G": 1.0, "n_omega": 1e-2, "chi": 0.4, "stretch": 1.3, "flow": {"diffusivity": 1.0}}, 1e-3),
    ],
    ids=["linear", "neo-Hookean", "with storage", "gel"],
)
def test_a_jump_is_undrained(law: dict[str, Any], agreement: float) -> None:
    """The fluid's pressure in a step without time beside the elastic law of no change of volume: two discretisations,
    of which each was within 3e-4 of theory."""
    bath = {"drainage": {"bath": Gel(**{**law, "flow": None}).free_potential(1.3)}} if law["model"] == "gel" else {}
    found = rows(scene(law, 0.0, **bath))["drainage"]
    assert found.percent is not None and found.high is not None and found.high > 1
    assert (100 + found.percent) / (100 + found.high) == pytest.approx(1, abs=agreement)
