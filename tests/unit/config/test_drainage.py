"""Pore fluid in a scene file: refusals with key and remedy, and the decided scene."""

from __future__ import annotations

from typing import Any

import pytest

from indent_sim.config.scene_file import config_from_mapping, loads, to_yaml
from indent_sim.model.drainage import Conductance
from indent_sim.model.history import doubling_times
from indent_sim.process.errors import ConfigError
from indent_sim.scene.scene import resolve

FLOW = {"permeability": 0.9}
WET: dict[str, Any] = {"model": "linear_elastic", "E": 1.0, "nu": 0.2, "flow": FLOW}
RUBBER: dict[str, Any] = {"model": "neo_hookean", "E": 1.0, "nu": 0.2}
HISTORY = [[3, 0], [4, 0.02], [8, 0.02]]
SCENE: dict[str, Any] = {
    "body": {"shape": "cylinder", "radius": 2.0, "height": 1.0, "sides": "roller"},
    "material": WET,
    "indenter": {"shape": "paraboloid", "R": 1.0},
    "loading": {"history": HISTORY},
    "mesh": {"h_contact": 0.02},
}


@pytest.mark.parametrize(
    ("sections", "key", "words"),
    [
        (
            {"material": WET | {"flow": {}}},
            "material",
            "exactly one of permeability and diffusivity",
        ),
        ({"material": WET | {"flow": FLOW | {"diffusivity": 1.0}}}, "material", "exactly one"),
        ({"material": WET | {"nu": 0.5}}, "material", "an incompressible body cannot drain"),
        ({"loading": {"delta": 0.02}}, "material.flow", "needs a load path in time"),
        (
            {"material": RUBBER | {"flow": FLOW | {"alpha": 0.9}}},
            "material.flow.alpha",
            "incompressible",
        ),
        (
            {"material": RUBBER | {"flow": FLOW | {"storage": 0.9}}},
            "material.flow.storage",
            "incompressible",
        ),
        (
            {"material": WET | {"flow": FLOW | {"holmes_mow": {"phi0": 0.2}}}},
            "flow.holmes_mow",
            "finite strain",
        ),
        (
            {"material": WET | {"relaxation": {"prony": [[0.5, 1]]}}},
            "material.relaxation.of",
            "linear, frictionless",
        ),
        ({"material": WET | {"flow": None}, "drainage": {}}, "drainage", "no material has a flow"),
        (
            {"material": WET | {"flow": None}, "loading": {"history": HISTORY, "per_doubling": 4}},
            "per_doubling",
            "time-dependent bodies",
        ),
        (
            {"loading": {"history": HISTORY, "times": [2.0]}},
            r"loading.times\[0\]",
            "outside the history",
        ),
        (
            {"drainage": {"bath": [[1, 0], [1, 0.1]]}},
            r"drainage.bath\[1\]",
            "time does not increase",
        ),
        ({"drainage": {"tip": {"conductance": 0}}}, "drainage.tip.conductance", "must be > 0"),
        (
            {"contact": {"method": "nitsche"}},
            "contact.method",
            "nitsche uses the stress of the",
        ),
        ({"solver": {"method": "theory"}}, "solver.method", "theory does not include pore fluid"),
        ({"solver": {"method": "condensed"}}, "solver.method", "inside the body"),
        (
            {"experiment": {"adhesion": {"work": 1e-3}}},
            "experiment.adhesion",
            "needs an elastic curve",
        ),
        (
            {"body": {"shape": "box", "size": [2.0, 2.0, 1.0]}, "solver": {"linear": "iterative"}},
            "solver.linear",
            "does not support the pore pressure",
        ),
    ],
)
def test_what_does_not_go_with_fluid_is_refused(
    sections: dict[str, Any], key: str, words: str
) -> None:
    with pytest.raises(ConfigError, match=words) as error:
        resolve(config_from_mapping(SCENE | sections))
    assert key.replace("\\", "") in str(error.value)


def test_a_scene_comes_back_from_its_own_text() -> None:
    drainage = {"tip": {"conductance": 2.0}, "base": "drained", "bath": [[3, 0.0], [5, 0.1]]}
    config = config_from_mapping(SCENE | {"drainage": drainage})
    assert loads(to_yaml(config)) == config
    assert config.drainage and config.drainage.tip == Conductance(2.0)
    assert loads(to_yaml(config_from_mapping(SCENE))) == config_from_mapping(SCENE)


def test_quantities_and_scales() -> None:
    """Lengths are scaled by the height, pressures by E; times only lose the history's begin."""
    flow = {"diffusivity": "40 um^2/s"}
    drainage = {"base": {"conductance": "2 um/(kPa s)"}, "bath": [[3, "1 kPa"], [4, "500 Pa"]]}
    body = {"shape": "cylinder", "radius": "20 um", "height": "0.01 mm"}
    sections = {
        "units": {"length": "um", "force": "nN"},
        "body": body,
        "material": WET | {"E": "10 kPa", "flow": flow},
        "drainage": drainage,
        "indenter": {"shape": "paraboloid", "R": 10.0},
        "loading": {"history": [[3, 0], [4, 0.2]]},
        "mesh": {"h_contact": 0.2},
    }
    physics = resolve(config_from_mapping(sections)).physics
    law = physics.material
    assert law.flow and law.flow.diffusivity is None
    assert law.diffusivity == pytest.approx(0.4, rel=1e-12)
    assert law.flow.permeability == pytest.approx(0.4 / law.confined_modulus, rel=1e-12)
    base = physics.drainage.base
    assert isinstance(base, Conductance) and base.conductance == pytest.approx(2.0, rel=1e-12)
    (region,) = physics.permeable_regions
    assert [physics.bath_pressure(region, t) for t in (0.0, 0.5, 9.0)] == pytest.approx(
        [0.0, 0.075, 0.05], rel=1e-12
    )
    alone = resolve(
        config_from_mapping(sections | {"drainage": {"bath": "1 kPa"}})
    ).physics.drainage
    assert alone.bath_at(1.0) == pytest.approx(0.1, rel=1e-12)


def test_every_step_is_a_row() -> None:
    """Increments double from the first one on, up to a twentieth of a segment; a jump is a row."""
    path = resolve(
        config_from_mapping(SCENE | {"loading": {"history": HISTORY, "per_doubling": 3}})
    ).physics.path
    steps = [after - before for before, after in zip(path.times, path.times[1:], strict=False)]
    ramp = [dt for dt, branch in zip(steps, path.branches[1:], strict=True) if branch == "approach"]
    hold = [dt for dt, branch in zip(steps, path.branches[1:], strict=True) if branch == "hold"]
    assert ramp[0] == pytest.approx(ramp[2], rel=1e-9) and ramp[3] == pytest.approx(
        2 * ramp[0], rel=1e-9
    )
    assert max(ramp) <= 1 / 15 * (1 + 1e-9) and sum(ramp) == pytest.approx(1.0, rel=1e-12)
    assert hold[:4] == pytest.approx([ramp[0]] * 3 + [2 * ramp[0]], rel=1e-9)
    assert path.segment(1) == ((0.0, 0.0),) and path.segment(len(path.values))[-1][
        1
    ] == pytest.approx(5.0, rel=1e-12)
    jump = resolve(
        config_from_mapping(SCENE | {"loading": {"history": [[3, 0.02], [8, 0.02]]}})
    ).physics.path
    assert jump.segment(1) == ((0.02, 0.0),) and jump.branches[:2] == ("approach", "hold")


def test_rows_at_some_times_pass_the_other_steps() -> None:
    loading = {"history": HISTORY, "times": [3.5, 8.0]}
    path = resolve(config_from_mapping(SCENE | {"loading": loading})).physics.path
    assert path.times == (3.5, 8.0) and path.values == pytest.approx((0.01, 0.02), rel=1e-12)
    moments = [t for step in (1, 2) for _, t in path.segment(step)]
    assert moments == sorted(moments) and moments[-1] == 5.0 and len(moments) > 40


def test_half_steps_halve_the_time() -> None:
    path = resolve(
        config_from_mapping(SCENE | {"loading": {"history": HISTORY, "times": [3.5, 8.0]}})
    ).physics.path
    fine = path.with_halved_increments()
    assert fine.values[1::2] == path.values and fine.times[1::2] == path.times
    coarse = [place for step in (1, 2) for place in path.segment(step)]
    dense = [place for step in (1, 2, 3, 4) for place in fine.segment(step)]
    assert dense[1::2] == coarse


def test_a_ladder_ends_on_its_span() -> None:
    assert doubling_times(1.0, 0.1, 2) == pytest.approx([0.1, 0.2, 0.4, 0.6])
    assert doubling_times(1.0, 0.1, 2, 0.1) == pytest.approx([0.1 * n for n in range(1, 10)])
    assert doubling_times(0.05, 0.1, 4) == []


def test_what_is_doubtful_is_said() -> None:
    def keys(**sections: Any) -> set[str]:
        return {
            doubt.key
            for doubt in resolve(config_from_mapping(SCENE | sections)).plan.model_warnings
        }

    jump = {"history": [[0, 0.02], [1, 0.02]], "times": [1e-6, 1.0]}
    assert not {"sealed", "early", "diffusion"} & keys()
    assert "sealing" in keys()
    assert "sealing" not in keys(drainage={"tip": "drained"}) | keys(mesh={"h_contact": 0.01})
    assert "sealed" in keys(drainage={"surface": "sealed"})
    assert "early" in keys(
        loading=jump, drainage={"tip": "drained"}
    )  # a tip that seals has no film below it
    endless = {"shape": "half_space"}
    assert "diffusion" in keys(body=endless, loading={"history": [[0, 0], [1, 0.02], [1e6, 0.02]]})


def test_a_sudden_force_on_a_closed_column_comes_with_the_first_step() -> None:
    """A sudden load on a body that cannot yield at once comes in the first increment.

    Free sides or storage let the body yield at once. A sudden depth of a closed body would take an
    infinite force.
    """
    punch = {"shape": "flat_punch", "radius": 2.0}
    sudden = {"force_history": [[0, 0.1], [1, 0.1]]}

    def first(**sections: Any) -> float:
        given = SCENE | {"indenter": punch, "loading": sudden, "mesh": {"h_contact": 0.2}}
        given |= {"drainage": {"tip": "drained"}} | sections
        return resolve(config_from_mapping(given)).physics.path.times[0]

    assert first() > 0
    assert first(body=SCENE["body"] | {"sides": "free"}) == 0
    assert first(material=WET | {"flow": FLOW | {"storage": 1.0}}) == 0
    assert (
        first(loading={"history": [[0, 0.02], [1, 0.02]]}) > 0
    )  # a depth at once would take an infinite force
