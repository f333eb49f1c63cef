"""Experimental design: predicted intervals are the spread of fits to synthetic curves."""

from __future__ import annotations

import numpy as np
import pytest
from measurements import HALF_SPACE, relaxing, scene

from indent_sim.config.schema import Config
from indent_sim.fitting.design import Design, _plan_measurement, design_measurement
from indent_sim.fitting.forward_model.forward_model_cache import ForwardModelCache
from indent_sim.fitting.inference.estimate import OriginOptions, Samples, fit_model
from indent_sim.fitting.inference.noise import NORMAL_95
from indent_sim.process.errors import ConfigError

SLS, TERM = [[0.5, 0.6]], "material.relaxation.prony[0]"
HELD = {"loading": {"history": [[0, 0], [1, 0.1], [2, 0.1]]}}
HELD_BODY = scene(HALF_SPACE, material=relaxing(SLS).material, **HELD)


def half_width(found: Design, key: str) -> float:
    """Half the width of an interval, relative to its value."""
    stated = found.parameters[key]
    return 0.5 * (stated.high - stated.low) / stated.value


def spread(config: Config, found: Design, fits: int) -> np.ndarray:
    """1.96 standard deviations of the coordinates (k,) in fits to the designed curve with noise."""
    measurement = _plan_measurement(config, tuple(found.parameters), ForwardModelCache())
    made, draw = (
        measurement.expected_estimate(found.points, found.noise).model.samples,
        np.random.default_rng(1),
    )
    noisy = (made.force + found.noise * draw.standard_normal(len(made)) for _ in range(fits))
    thetas = [
        fit_model(measurement.forward_model, Samples(made.x, force, made.t), OriginOptions()).theta
        for force in noisy
    ]
    return NORMAL_95 * np.std(thetas, axis=0)


def test_the_expected_interval_is_the_spread_of_forty_fits():
    """The predicted interval of the modulus is the spread of 40 fits.

    The tolerance of 30 % is 2.3 deviations of the spread of 40.
    """
    found = design_measurement(scene(), ["material.E"], 0.01, 300)
    assert half_width(found, "material.E") == pytest.approx(spread(scene(), found, 40)[0], rel=0.3)


@pytest.mark.verify
@pytest.mark.parametrize(
    "config, keys",
    [
        (scene(), ["material.E"]),
        (scene(experiment={"cantilever": {"stiffness": 0.3}}), ["material.E"]),
        (HELD_BODY, ["material.E", f"{TERM}[0]", f"{TERM}[1]"]),
    ],
    ids=["E", "cantilever", "relaxation"],
)
def test_expected_intervals_are_the_spread_of_a_hundred_fits(config, keys):
    """The predicted intervals are the spread of 100 fits.

    A factor of 1.3 is four deviations of the spread of 100; 0.95 to 1.08 were measured.
    """
    found = design_measurement(config, keys, 0.005, 300)
    measurement = _plan_measurement(config, tuple(keys), ForwardModelCache())
    for parameter, wide in zip(
        measurement.forward_model.parameters, spread(config, found, 100), strict=True
    ):
        stated = found.parameters[parameter.key]
        expected = 0.5 * (parameter.theta(stated.high) - parameter.theta(stated.low))
        assert 1 / 1.3 < expected / wide < 1.3, parameter.key


def test_half_the_noise_or_four_times_the_points_halve_an_interval():
    """Half the noise or four times the points halve an interval.

    This holds for small intervals, up to their square and to 1/N of the samples.
    """
    one, quiet, many = (
        design_measurement(scene(), ["material.E"], *how)
        for how in ((0.01, 300), (0.005, 300), (0.01, 1200))
    )
    half = half_width(one, "material.E")
    assert half_width(quiet, "material.E") == pytest.approx(half / 2, rel=1e-3)
    assert half_width(many, "material.E") == pytest.approx(half / 2, rel=1e-2)


def test_what_is_tied_is_wider_by_as_much_as_is_said():
    alone, both = (
        design_measurement(scene(), keys, 1e-4, 300)
        for keys in (["material.E"], ["material.E", "body.height"])
    )
    ratio = half_width(both, "material.E") / half_width(alone, "material.E")
    assert alone.tied == {"material.E": 1.0} and both.tied["material.E"] == pytest.approx(
        ratio, rel=1e-3
    )
    assert (
        ratio > 5
        and "If the other parameters were known, the interval of material.E would be" in both.words
    )


def test_keys_that_no_curve_tells_apart_are_not_identifiable():
    """Modulus and radius on a half-space are reported as not identifiable together.

    The force is E/(1 - nu^2) sqrt(R) times a function of the depth.
    """
    found = design_measurement(scene(HALF_SPACE), ["material.E", "indenter.R"], 0.01, 300)
    assert not found.identifiable and found.words.startswith(
        "Not identifiable: material.E and indenter.R"
    )
    assert found.parameters["material.E"].high / found.parameters["material.E"].low > 100
    assert design_measurement(scene(HALF_SPACE), ["material.E"], 0.01, 300).identifiable


def test_what_helps_is_solved_with_the_noise_of_the_same_instrument():
    """A change that multiplies the force narrows the interval by the same factor, at equal noise.

    For a paraboloid on a half-space, twice the depth gives 2^1.5 times the force, and twice the
    radius 2^0.5 times.
    """
    found = design_measurement(scene(HALF_SPACE), ["material.E"], 0.01, 300)
    assert [one.change for one in found.helps] == [
        {"loading.delta": 0.2},
        {"indenter.R": 0.5},
        {"indenter.R": 2.0},
    ]
    half = half_width(found, "material.E")
    for one, gain in zip(found.helps, (2**1.5, 0.5**0.5, 2**0.5), strict=True):
        stated = one.parameters["material.E"]
        assert 0.5 * (stated.high - stated.low) == pytest.approx(half / gain, rel=1e-2)


def test_a_hold_tells_of_relaxation_and_a_change_that_cannot_be_says_why():
    config = relaxing(SLS, HALF_SPACE)
    found = design_measurement(config, ["material.E", f"{TERM}[0]"], 0.003, 300)
    hold = next(
        one
        for one in found.helps
        if one.change == {"loading.history": [[0.0, 0.0], [1.0, 0.1], [2.0, 0.1]]}
    )
    key = f"{TERM}[0]"
    assert (
        hold.parameters[key].high - hold.parameters[key].low
        < found.parameters[key].high - found.parameters[key].low
    )
    deep = design_measurement(scene({"shape": "layer", "height": 0.15}), ["material.E"], 0.01, 300)
    assert deep.helps[0].parameters == {} and "beyond the body's thickness" in deep.helps[0].reason


def test_the_baseline_is_as_long_as_it_has_to_be():
    """The proposed baseline is longer than a fifth of the depth and at most 1.5 depths.

    It is the baseline that separates the contact point of a paraboloid from its modulus.
    """
    found = design_measurement(scene(HALF_SPACE), ["material.E"], 0.01, 300)
    assert 0.3 < found.baseline <= 1.5


@pytest.mark.parametrize(
    "keys, problem",
    [
        (["loading.delta"], "cannot be determined from a measured curve"),
        (["material.Q"], "is not a number of the scene"),
        (["contact.epsilon_n"], "is not a number"),
        ([""], "cannot be determined from a measured curve"),
    ],
)
def test_keys_that_tell_nothing_are_refused(keys, problem):
    with pytest.raises(ConfigError, match=problem):
        design_measurement(scene(), keys, 0.01, 300)


def test_a_path_of_forces_in_time_is_refused():
    config = scene(
        HALF_SPACE, material=relaxing(SLS).material, loading={"force_history": [[0, 0], [1, 0.01]]}
    )
    with pytest.raises(ConfigError, match="a design needs prescribed depths"):
        design_measurement(config, ["material.E"], 0.01, 300)
