"""What a run says of theory: the depth it belongs to, and a force per length in plane strain."""

from __future__ import annotations

from typing import Any

import pytest
from mpi4py import MPI

from indent_sim.cli import terminal
from indent_sim.config.scene_file import config_from_mapping
from indent_sim.results.reader import read
from indent_sim.run.pipeline import Outcome, simulate

WALLED = {"shape": "cylinder", "radius": 2.0, "height": 1.0, "sides": "roller"}


@pytest.fixture
def outcome(tmp_path):
    """A function that runs a coarse scene; `sections` replace whole sections of it."""

    def start(**sections: Any) -> Outcome:
        given: dict[str, Any] = {
            "body": WALLED,
            "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.3},
            "indenter": {"shape": "paraboloid", "R": 1.0},
            "loading": {"delta": 0.01, "steps": 1},
            "mesh": {"h_contact": 0.03, "h_far": 0.5},
            "output": {"plot": False},
        }
        return simulate(
            config_from_mapping(given | sections),
            MPI.COMM_SELF,
            directory=tmp_path / "out",
            overwrite=True,
        )

    return start


def line(outcome: Outcome, word: str) -> str:
    return next(line for line in terminal.conclusion_lines(outcome) if line.startswith(word))


def test_after_unloading_the_depth_is_named(outcome):
    done = outcome(loading={"deltas": [0.01, 0.004]})
    assert "at delta 0.01:" in line(done, "layer theory") and "at delta 0.01:" in line(
        done, "Hertz"
    )


def test_the_other_gap_is_the_reason_for_the_deviation(outcome):
    done = outcome(contact={"gap": "current"})
    said = line(done, "layer theory")
    assert "deformed point" in said and "exact" not in said and "describes this" not in said
    assert done.report["theory"]["why"] in said and not done.report["theory"]["exact"]


def test_other_gap_and_other_body(outcome):
    why = outcome(contact={"gap": "current"}, body=WALLED | {"sides": "free"}).report["theory"][
        "why"
    ]
    assert "deformed point" in why and "infinitely wide" in why


def test_a_contact_that_the_edge_cuts_off_is_not_theorys(outcome):
    """The tip stands on a free edge of a block: half of the contact, and softer than a half."""
    theory = outcome(
        body={"shape": "box", "size": [1.0, 1.0, 0.5]},
        indenter={"shape": "paraboloid", "R": 1.0, "center": [0.5, 0.0]},
        mesh={"h_contact": 0.05, "h_far": 0.3},
    ).report["theory"]
    assert "edge of the body cuts off" in theory["why"] and "infinitely wide" in theory["why"]
    assert theory["force_deviation"] < -0.5 and not theory["exact"]


def test_all_differences_are_named_once(outcome):
    """A tip that leans, on rubber between free sides."""
    why = outcome(
        body={"shape": "strip", "width": 4.0, "height": 1.0},
        material={"model": "neo_hookean", "E": 1.0, "nu": 0.3},
        indenter={"shape": "paraboloid", "R": 1.0, "tilt": 5},
        contact={"gap": "reference"},
    ).report["theory"]["why"]
    assert "upright" in why and "infinitely wide" in why
    assert why.count("small strain") == 1


def test_finite_strain_is_not_theorys(outcome):
    theory = outcome(material={"model": "neo_hookean", "E": 1.0, "nu": 0.3}).report["theory"]
    assert (
        "small strain" in theory["why"]
        and "deformed point" in theory["why"]
        and not theory["exact"]
    )


def test_the_half_space_has_one_percentage(outcome):
    done = outcome()
    closed, force = done.report["theory"]["half_space"], done.states[-1].force
    assert f"{1 - closed['force'] / force:.2%} below this run" in line(done, "Hertz")
    assert closed["deviation"] == pytest.approx(closed["force"] / force - 1)
    assert all("%" not in said for said in done.report["warnings"])


def test_the_axis_is_at_zero(outcome):
    """The surface begins at x = 0 exactly, not at round-off such as 1.5e-18."""
    x = read(outcome().directory).surface["x"]
    assert x.min() == x[0] == 0.0 and not ((x > 0) & (x < 1e-12)).any()


def test_the_force_of_a_strip_is_one_per_length(outcome):
    """The line about theory says force per length for a strip and force for a layer."""
    done = outcome(body={"shape": "strip", "width": 2.0, "height": 1.0, "sides": "roller"})
    assert "at delta 0.01: force per length " in line(done, "layer theory")
    assert "at delta 0.01: force 0." in line(outcome(), "layer theory")
