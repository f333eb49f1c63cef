"""Model warnings: text, stated number and error budget come from one list."""

from __future__ import annotations

from itertools import pairwise
from math import sqrt
from pathlib import Path
from typing import Any

import pytest
from mesh_files import section, write

from indent_sim.config.scene_file import config_from_mapping, to_mapping
from indent_sim.model.contact import Penalty
from indent_sim.model.linear_elasticity import LinearElastic
from indent_sim.model.state import State
from indent_sim.model.tips import Cone, FlatPunch, Indenter, Paraboloid
from indent_sim.run.error_estimation.coarser_run import CoarserRun
from indent_sim.run.error_estimation.error_bars import ErrorBars
from indent_sim.run.explicit_config import explicit_config
from indent_sim.scene.expected_error import penalty_force_loss
from indent_sim.scene.scene import Scene, resolve

SCENES: dict[str, dict[str, Any]] = {
    "plain": {},
    "penalty": {"contact": {"method": "penalty", "epsilon_n": 30.0}},
    "coarse": {"mesh": {"h_contact": 0.1}},
    "several": {"contact": {"method": "active_set", "gap": "current"}},
    "unloading": {"loading": {"deltas": [0.02, 0.001]}, "mesh": {"h_contact": 0.02}},
    "half_space": {"body": {"shape": "half_space"}, "solver": {"method": "condensed"}},
    "layer": {"body": {"shape": "layer", "height": 1.0}, "solver": {"method": "condensed"}},
    "theory": {"body": {"shape": "half_space"}},
    "corners": {
        "body": {"shape": "box", "size": [0.6, 0.6, 1.0]},
        "mesh": {"h_contact": 0.1},
        "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.49},
    },
}
NUMBERS = {
    "plain": set(),
    "penalty": {"penalty"},
    "coarse": {"elements"},
    "several": {"several_equilibria"},
    "unloading": {"elements"},
    "half_space": {"truncation"},
    "layer": {"truncation"},
    "theory": set(),
    "corners": {"corners", "elements"},
}


def document(**sections: Any) -> dict[str, Any]:
    """Mapping of a paraboloid on a thick cylinder; `sections` replace whole sections."""
    given: dict[str, Any] = {
        "body": {"shape": "cylinder", "radius": 2.0, "height": 1.0},
        "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.3},
        "indenter": {"shape": "paraboloid", "R": 1.0},
        "loading": {"delta": 0.01, "steps": 1},
    }
    return {name: part for name, part in (given | sections).items() if part is not None}


def scene(**sections: Any) -> Scene:
    """Resolved scene of that mapping."""
    return resolve(config_from_mapping(document(**sections)))


@pytest.mark.parametrize("name", SCENES)
def test_what_is_stated_is_the_sum_of_what_is_doubted(name: str) -> None:
    found = scene(**SCENES[name])
    assert found.plan.warnings == tuple(
        doubt.message for doubt in found.plan.model_warnings if doubt.message
    )
    assert found.plan.prediction.get("force_error", 0.0) == sum(
        doubt.force_error for doubt in found.plan.model_warnings
    )
    assert {doubt.key for doubt in found.plan.model_warnings if doubt.force_error} == NUMBERS[name]


def test_a_number_stands_in_its_words() -> None:
    (doubt,) = (
        doubt for doubt in scene(**SCENES["penalty"]).plan.model_warnings if doubt.key == "penalty"
    )
    assert f"up to {100 * doubt.force_error:.2g} % too low" in doubt.message


def test_nothing_speaks_against_a_theory_that_is_exact() -> None:
    assert scene(**SCENES["theory"]).plan.model_warnings == ()


def test_a_last_row_without_contact_has_no_error() -> None:
    """The stated error is that of the last row, also if it has no contact."""
    found = scene(**SCENES["penalty"], loading={"deltas": [0.01, -0.01]})
    errors = {doubt.key: doubt.force_error for doubt in found.plan.model_warnings}
    assert errors["penalty"] == 0.0 and "force_error" not in found.plan.prediction


ELASTIC = {"model": "linear_elastic", "E": 1.0, "nu": 0.3}
SERIES = {"prony": [[0.5, 0.1]]}
IN_TIME: dict[str, dict[str, Any]] = {
    "draining": {"flow": {"diffusivity": 1.0}},
    "relaxing in shear": {"relaxation": SERIES | {"of": "shear"}},
    "relaxing as a whole, on the elastic curve": {"relaxation": SERIES | {"of": "all"}},
}


@pytest.mark.parametrize("name", IN_TIME)
@pytest.mark.parametrize("first_depth", [0.01, 0.0025, None], ids=str)
def test_only_rows_are_too_shallow(name: str, first_depth: float | None) -> None:
    """The elements are compared with the contact of the shallowest row, by Hertz, and not with the
    shallower ones of time steps before it. A history without times names no row in advance.
    """
    h, deepest = 0.03, 0.01
    times = {} if first_depth is None else {"times": [first_depth / deepest, 2.0]}
    found = scene(
        body={"shape": "cylinder", "radius": 5.0, "height": 5.0},
        material=ELASTIC | IN_TIME[name],
        mesh={"h_contact": h},
        loading={"history": [[0.0, 0.0], [1.0, deepest], [2.0, deepest]]} | times,
    )
    if found.history_on_curve and first_depth is None:
        pytest.skip("its rows are interpolated between points of the curve")
    said = [warning for warning in found.plan.warnings if "in the smallest one" in warning]
    if first_depth in (None, deepest):
        assert said == []
        return
    (warning,) = said
    elements = float(warning.split("only ")[1].split()[0])
    # Two digits are printed, and the body of the height 5 is not a half-space: a differs by 1 %.
    assert elements == pytest.approx(sqrt(first_depth) / h, rel=0.05)


@pytest.mark.parametrize(
    "tip", [Paraboloid(R=2.0), Cone(half_angle=70.0), Cone(half_angle=70.0, tip_radius=2.0)]
)
def test_the_strain_is_a_fifth_of_the_slope_at_the_edge(tip: Indenter) -> None:
    """The characteristic strain is Tabor's fifth of the tip's slope at the contact edge.

    The slope is a central difference of the height. A rounded apex is taken for its paraboloid,
    which is off by 1.2 % at 0.15 of its radius.
    """
    a, step = 0.3, 1e-6
    slope = (float(tip.height(a + step, 0.0)) - float(tip.height(a - step, 0.0))) / (2 * step)
    assert tip.characteristic_strain(0.01, a)[0] == pytest.approx(0.2 * slope, rel=0.012)


def test_the_strain_under_a_punch_knows_its_depth() -> None:
    assert FlatPunch(radius=0.3).characteristic_strain(0.01, 0.3)[0] == pytest.approx(0.01)


def test_what_a_penalty_costs() -> None:
    """The force loss of a penalty is that of a spring lambda + 2 mu in series with epsilon_n.

    The contact fills the body from wall to wall. The loss is below 1 and, for a stiff penalty,
    proportional to lambda + 2 mu.
    """
    depth, a, little = 0.01, 50.0, {}
    for nu in (0.0, 0.3, 0.45):
        material = LinearElastic(E=1.0, nu=nu)
        losses = [
            penalty_force_loss(Penalty(epsilon_n=stiff), material, None, depth, a)
            for stiff in (1e-3, 1.0, 30.0, 1e5)
        ]
        assert (
            1.0 > losses[0] > 0.99
            and all(more > less for more, less in pairwise(losses))
            and losses[-1] > 0
        )
        lame, mu = nu / ((1 + nu) * (1 - 2 * nu)), 0.5 / (1 + nu)
        little[nu] = losses[-1] / (lame + 2 * mu)
    assert list(little.values()) == pytest.approx([little[0.0]] * 3, rel=1e-12)


def test_without_contact_only_that_is_said() -> None:
    found = scene(loading={"deltas": [-0.1]}, contact={"method": "active_set", "gap": "current"})
    assert [doubt.key for doubt in found.plan.model_warnings] == [
        "no_contact"
    ] and "force_error" not in found.plan.prediction


def test_the_error_budget_has_the_doubt_of_the_finite_body() -> None:
    found = scene(**SCENES["half_space"])
    row = State(1, 0.01, 2.0, 0.1, 0, 0, 0, 1, 0.0)
    bars = ErrorBars(found, CoarserRun(1.6, [row], found))
    bars.add_error_estimate(row)
    (doubt,) = (doubt for doubt in found.plan.model_warnings if doubt.key == "truncation")
    assert bars.budgets[0].truncation == doubt.force_error * row.force
    assert doubt.force_error == found.plan.prediction["truncation_error"]


LAYERS = [
    {"thickness": 0.2, "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.3}},
    {"thickness": 0.8, "material": {"model": "linear_elastic", "E": 10.0, "nu": 0.4}},
]
UNLIKE = {
    "model": "neo_hookean",
    "E": 1000.0,
    "nu": 0.49,
    "formulation": "mixed",
}  # anything read from it would show
OWN = {
    "cylinder": {"shape": "cylinder", "radius": 2.0, "height": 1.0, "layers": LAYERS},
    "theory": {"shape": "half_space", "layers": [LAYERS[0], {"material": LAYERS[1]["material"]}]},
    "mesh": {
        "shape": "mesh",
        "file": "gel.msh",
        "kinematics": "axisymmetric",
        "surfaces": {"contact": "top", "base": "bottom"},
        "regions": {"gel": LAYERS[0]["material"]},
    },
}


@pytest.mark.parametrize("body", OWN)
def test_a_material_that_nothing_has_is_named_and_read_by_nothing(
    body: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An unused material is warned of, and changes neither the scene nor the record of the run."""
    write(tmp_path / "gel.msh", section())
    monkeypatch.chdir(tmp_path)
    lacking, having = (
        config_from_mapping(document(body=OWN[body], material=material))
        for material in (None, UNLIKE)
    )
    expected, found = resolve(lacking), resolve(having)
    region_kind = "region" if body == "mesh" else "layer"
    said = f"the section `material` is not used: every {region_kind} has its own material"
    assert found.plan.warnings == (said, *expected.plan.warnings)
    assert (
        found.plan.choices == expected.plan.choices
        and found.plan.prediction == expected.plan.prediction
    )
    assert (found.sizes, found.solver) == (expected.sizes, expected.solver)
    assert to_mapping(explicit_config(having, found)) == to_mapping(
        explicit_config(lacking, expected)
    )
