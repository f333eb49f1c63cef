"""Estimates of synthetic curves: coverage of the truth, detection of wrong models, refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from measurements import HALF_SPACE, LAYER, NOISES, N, drawn, measured, relaxing, scene
from scipy.stats import binom

from indent_sim.fitting.forward_model.forward_model import ForwardModel
from indent_sim.fitting.forward_model.forward_model_cache import ForwardModelCache
from indent_sim.fitting.forward_model.parameters import ADHESION_WORK_KEY
from indent_sim.fitting.inference import alternative_models, profile_likelihood
from indent_sim.fitting.inference.depth_range_fits import fit_depth_ranges
from indent_sim.fitting.inference.estimate import (
    Estimate,
    FitRejected,
    OriginOptions,
    Samples,
    fit_model,
    reject_without_signal,
)
from indent_sim.fitting.inference.model_assessment import (
    ModelAssessment,
    baseline_noise_probability,
    find_residual_trend,
    is_suspect,
    systematic_half_widths,
    width_inflation_factors,
)
from indent_sim.fitting.inference.noise import NORMAL_95, WHITE

DEEPEST, C = 0.13, 0.013
TABLES = ForwardModelCache()
X, T = np.linspace(-0.1, 0.1, N), np.linspace(0, 2, N)


def judged(estimate: Estimate, config) -> ModelAssessment:  # type: ignore[no-untyped-def]
    """Assessment of an estimate, with alternative models where something contradicts the scene."""
    seen, bends, baseline = (
        fit_depth_ranges(estimate),
        find_residual_trend(estimate),
        baseline_noise_probability(estimate),
    )
    is_asked = is_suspect(seen, bends, baseline)
    others = alternative_models.fit_alternatives(estimate, config, TABLES) if is_asked else []
    return ModelAssessment(estimate, seen, bends.shape, baseline, others)


def test_twenty_white_curves_hold_their_modulus_and_their_contact_point():
    """At least 15 of 20 intervals of 95 % contain the modulus, and as many the contact point.

    Fewer than 15 happen once in 3000 by chance.
    """
    forces, draw, inside, near = (
        ForwardModel(scene(), ["material.E"], DEEPEST),
        np.random.default_rng(1),
        0,
        0,
    )
    for _ in range(20):
        force = measured(forces, [math.log(3)], X, drawn(WHITE, N, draw))
        found = fit_model(forces, Samples(X, force), OriginOptions())
        low, high = found.interval(0)
        inside += low < math.log(3) < high
        near += abs(found.contact_point - C) < NORMAL_95 * found.sd[1]
    assert inside >= 15 and near >= 15
    assert binom.cdf(14, 20, 0.95) < 1 / 2_900
    assert 0.004 < found.sd[0] < 0.012  # of Cramer and Rao 0.6 %


def test_without_noise_the_truth_comes_back():
    forces = ForwardModel(scene(), ["material.E", "body.height"], DEEPEST)
    theta = [math.log(3), math.log(0.4)]
    force = measured(forces, theta, X, np.zeros(N))
    found = fit_model(forces, Samples(X, force), OriginOptions())
    np.testing.assert_allclose(
        found.theta, theta, atol=1e-4
    )  # of rounds that end at 1e-6 of the squares
    assert found.contact_point == pytest.approx(C, abs=1e-6)
    assert all(
        ratio > 3 for ratio in width_inflation_factors(found)
    )  # modulus and height: known together, hardly apart


def test_a_profile_of_a_parabola_is_its_interval(monkeypatch):
    """The profile interval of one modulus is the linear one to 5 %.

    The profile is nearly a parabola, interpolated linearly between seven values on each side.
    """
    monkeypatch.setattr(profile_likelihood, "WIDE_HALF_WIDTH", 0.0)
    forces = ForwardModel(scene(), ["material.E"], DEEPEST)
    found = fit_model(
        forces,
        Samples(X, measured(forces, [0.3], X, drawn(WHITE, N, np.random.default_rng(11)))),
        OriginOptions(),
    )
    by_profile = (
        np.array(profile_likelihood.add_profile_intervals(found).interval(0)) - found.theta[0]
    )
    np.testing.assert_allclose(by_profile, np.array(found.interval(0)) - found.theta[0], rtol=0.05)


def test_a_wide_interval_follows_its_profile_and_ends_at_a_bound():
    """The profile interval of nu ends at 1/2, and that of E is narrower than the linear one.

    Modulus and Poisson ratio of a layer are nearly indistinguishable in its force.
    """
    forces = ForwardModel(scene(), ["material.E", "material.nu"], DEEPEST)
    force = measured(forces, [0.3, 0.45], X, 2 * drawn(WHITE, N, np.random.default_rng(12)))
    plain = fit_model(forces, Samples(X, force), OriginOptions())
    found = profile_likelihood.add_profile_intervals(plain)
    assert found.interval(1)[1] == 0.5 and found.interval(0)[0] < 0.3 < found.interval(0)[1]
    assert np.ptp(found.interval(0)) < 0.9 * np.ptp(plain.interval(0))


def test_what_is_known_is_not_fitted():
    forces = ForwardModel(scene(), ["material.E"], DEEPEST)
    force = measured(forces, [0.0], X, drawn(WHITE, N, np.random.default_rng(2)))
    free, held = (
        fit_model(forces, Samples(X, force), known) for known in (OriginOptions(), OriginOptions(C))
    )
    assert held.contact_point == C and held.sd[1] == 0 and held.sd[0] < 0.8 * free.sd[0]
    assert fit_model(forces, Samples(X, force), OriginOptions(has_slope=False)).p[-1] == 0


def test_a_cantilever_is_fitted_in_its_way():
    config = scene(experiment={"cantilever": {"stiffness": 0.3}})
    forces, draw = ForwardModel(config, ["material.E"], DEEPEST), np.random.default_rng(3)
    z = np.linspace(-0.15, 0.3, N)
    force = measured(forces, [0.4], z, drawn(WHITE, N, draw))
    low, high = fit_model(forces, Samples(z, force), OriginOptions()).interval(0)
    assert low < 0.4 < high and high - low < 0.2


def test_adhesion_and_modulus_together():
    config = scene(HALF_SPACE, experiment={"adhesion": {"work": 0.001}})
    forces, draw = (
        ForwardModel(config, ["material.E", ADHESION_WORK_KEY], DEEPEST),
        np.random.default_rng(4),
    )
    theta = np.array([0.3, math.log(0.002)])
    found = fit_model(
        forces, Samples(X, measured(forces, theta, X, drawn(WHITE, N, draw))), OriginOptions()
    )
    assert (np.abs(found.theta - theta) < 4 * found.sd[:2]).all() and found.sd[0] < 0.05


def test_a_clear_snap_in_tells_the_contact_point_to_a_sample():
    """A clear snap-in determines the contact point to a uniform distribution between two samples.

    Its standard deviation is 1/sqrt(12) of their distance. The truth lies in the middle between two
    samples; the rest of the curve alone would give a full sample.
    """
    config = scene(HALF_SPACE, experiment={"adhesion": {"work": 0.002}})
    forces, x = (
        ForwardModel(config, ["material.E", ADHESION_WORK_KEY], DEEPEST),
        np.linspace(-0.1, 0.1, 1000),
    )
    force = forces(forces.initial_coordinates, x) + 2.5e-4 * np.random.default_rng(
        3
    ).standard_normal(1000)
    found = fit_model(forces, Samples(x, force), OriginOptions())
    spacing = x[1] - x[0]
    assert abs(found.contact_point) <= 0.501 * spacing
    assert 0.2 < found.sd[2] / spacing < 1 / math.sqrt(12)


def test_the_interval_of_a_correlated_curve_is_wide():
    """Strongly correlated noise widens the interval by more than 2.5.

    Intervals for white noise contain the truth in only a third of such curves and would have to be
    four times as wide.
    """
    forces, draw = ForwardModel(scene(), ["material.E"], DEEPEST), np.random.default_rng(5)
    sd = [
        fit_model(
            forces, Samples(X, measured(forces, [0.0], X, drawn(noise, N, draw))), OriginOptions()
        ).sd[0]
        for noise in (WHITE, NOISES["AR 10"])
    ]
    assert sd[1] > 2.5 * sd[0]


@pytest.mark.parametrize(
    "name, truth",
    [
        ("thickness", scene({"shape": "layer", "height": 0.46})),
        ("adhesion", scene(HALF_SPACE, experiment={"adhesion": {"work": 0.0012}})),
        ("relaxation", relaxing([[0.6, 0.3]], HALF_SPACE)),
    ],
)
def test_a_wrong_model_is_named_and_its_interval_spans_the_truth(name, truth):
    config, draw = scene(HALF_SPACE), np.random.default_rng(6)
    forces, made = (
        ForwardModel(config, ["material.E"], DEEPEST),
        ForwardModel(truth, ["material.E"], DEEPEST),
    )
    force = measured(made, [0.0], X, drawn(WHITE, N, draw), t=T)
    verdict = judged(fit_model(forces, Samples(X, force, T), OriginOptions()), config)
    low, high = verdict.coordinate_interval(0)
    assert name in verdict.misfit_causes and not verdict.is_adequate and low < 0 < high


def test_a_snap_in_slow_noise_is_asked_about():
    """A pull-off of 20 % in slow noise is noticed, and slow noise alone is not.

    The pull-off falls by nine deviations of the changes of the noise, whose own falls are noticed
    once in 1000 curves.
    """
    truth, draw = (
        scene(HALF_SPACE, experiment={"adhesion": {"work": 0.0018}}),
        np.random.default_rng(7),
    )
    config = scene(HALF_SPACE)
    forces = {
        name: ForwardModel(one, ["material.E"], DEEPEST)
        for name, one in (("jkr", truth), ("own", config))
    }
    asked = {"jkr": 0, "own": 0}
    for name, made in forces.items():
        for _ in range(10):
            force = measured(made, [0.0], X, drawn(NOISES["AR 10"], N, draw))
            asked[name] += (
                find_residual_trend(
                    fit_model(forces["own"], Samples(X, force), OriginOptions())
                ).snap
                < 1e-3
            )
    assert asked["jkr"] >= 9 and asked["own"] <= 1, asked


def test_another_tip_is_named_by_its_exponent():
    config, cone = scene(HALF_SPACE), scene(HALF_SPACE, tip={"shape": "cone", "half_angle": 60.0})
    forces, made = (
        ForwardModel(config, ["material.E"], DEEPEST),
        ForwardModel(cone, ["material.E"], DEEPEST),
    )
    force = measured(made, [0.0], X, drawn(WHITE, N, np.random.default_rng(7)))
    verdict = judged(fit_model(forces, Samples(X, force), OriginOptions()), config)
    tip = next(one for one in verdict.better_models if one.name == "tip")
    assert tip.added_values["exponent"] == pytest.approx(
        0.5, abs=0.1
    )  # delta^2 in place of delta^1.5
    low, high = verdict.coordinate_interval(0)
    assert all(low <= float(window.theta[0]) <= high for window in verdict.depth_range_fits)


def test_an_error_of_the_force_moves_a_modulus_by_as_much():
    forces = ForwardModel(scene(), ["material.E"], DEEPEST)
    force = measured(forces, [0.0], X, drawn(WHITE, N, np.random.default_rng(8)))
    found = fit_model(forces, Samples(X, force), OriginOptions())
    assert systematic_half_widths(found, 0.02, 0.0)[0] == pytest.approx(0.02, rel=0.01)
    assert systematic_half_widths(found, 0.0, 0.02)[0] == pytest.approx(0.02 * NORMAL_95, rel=0.01)
    certain, wide = (
        ModelAssessment(found, [], 1.0, None, [], uncertain) for uncertain in ((), (0.02,))
    )
    half = 0.5 * (certain.coordinate_interval(0)[1] - certain.coordinate_interval(0)[0])
    assert wide.coordinate_interval(0)[1] - found.theta[0] == pytest.approx(math.hypot(half, 0.02))


def hopeless() -> dict[str, tuple[np.ndarray, str]]:
    """Forces from which nothing can be learned, with the reason."""
    draw = np.random.default_rng(9)
    noise, rise = draw.standard_normal(N), np.maximum(X, 0) ** 1.5
    return {
        "noise": (noise, "no contact: the force does not rise above its noise"),
        "constant": (np.full(N, 2.0), "no contact: the force does not change"),
        "saturated": (
            np.minimum(rise, 0.6 * rise.max()),
            "saturated: .* points at the largest force",
        ),
    }


@pytest.mark.parametrize("force, reason", hopeless().values(), ids=hopeless())
def test_hopeless_curves_are_refused(force, reason):
    with pytest.raises(FitRejected, match=reason):
        reject_without_signal(Samples(X, force))
    with pytest.raises(FitRejected, match=r"^3 points$"):
        reject_without_signal(Samples(X[:3], force[:3]))


def test_a_contact_of_few_points_is_refused():
    forces = ForwardModel(scene(), ["material.E"], DEEPEST)
    force = measured(forces, [0.0], X, 0.01 * drawn(WHITE, N, np.random.default_rng(10)), c=0.095)
    with pytest.raises(FitRejected, match=r"no contact: \d+ points in contact"):
        fit_model(forces, Samples(X, force), OriginOptions())


def test_a_force_that_is_counted_the_other_way_is_said_so():
    forces = ForwardModel(scene(), ["material.E"], DEEPEST)
    force = measured(forces, [0.0], X, drawn(WHITE, N, np.random.default_rng(15)))
    with pytest.raises(FitRejected, match=r"does not rise with the depth .it falls"):
        fit_model(forces, Samples(X, -force), OriginOptions())


def test_a_layer_of_a_thickness_that_waves_hardly_see_is_named():
    """A thickness of 1.4 at a contact radius of 0.3 is named as cause, and E is covered.

    Without the test for another exponent no model was tried, and E was 25 % too large.
    """
    config, made = (
        scene(HALF_SPACE),
        ForwardModel(scene({"shape": "layer", "height": 1.4}), ["material.E"], DEEPEST),
    )
    forces = ForwardModel(config, ["material.E"], DEEPEST)
    force = measured(made, [0.0], X, drawn(WHITE, N, np.random.default_rng(18)))
    verdict = judged(fit_model(forces, Samples(X, force), OriginOptions()), config)
    low, high = verdict.coordinate_interval(0)
    assert "thickness" in verdict.misfit_causes and low < 0 < high


def test_a_modulus_known_to_a_large_factor_is_refused():
    """The first tenth of a contact in noise of half its force is refused."""
    forces = ForwardModel(scene(), ["material.E"], DEEPEST)
    x = np.linspace(-0.1, 0.03, 120)
    force = measured(forces, [0.0], x, 8 * drawn(NOISES["AR 10"], 120, np.random.default_rng(14)))
    with pytest.raises(FitRejected, match=r"material.E is known to a factor of|no contact"):
        fit_model(forces, Samples(x, force), OriginOptions())


def test_means_of_blocks_keep_equal_times_and_the_deepest_samples():
    few = Samples(np.arange(1003.0), np.arange(1003.0), np.arange(1003.0)).block_means(100)
    assert len(few) <= 100 and few.x[-1] > 995 and len(set(np.diff(few.t))) == 1


FAMILIES = {
    "layer .45": (scene(LAYER), 0.1),
    "layer .5": (scene(LAYER, nu=0.5), 0.1),
    "half-space": (scene(HALF_SPACE, nu=0.3), 0.1),
    "cone": (scene(HALF_SPACE, nu=0.3, tip={"shape": "cone", "half_angle": 60.0}), 0.1),
    "sphere": (scene(LAYER, nu=0.5, tip={"shape": "sphere", "R": 1.0}), 0.1),
    "roller": (scene({"shape": "layer", "height": 0.7, "base": "roller"}, nu=0.4), 0.1),
}


@pytest.mark.verify
def test_coverage_of_three_hundred_curves():
    """Intervals of 95 % contain the truth in 92 to 98 % of 300 curves of six scenes.

    A few per cent of the curves are refused or wrongly not explained. Half of them have white
    noise, a quarter each AR 3 and half-and-half AR 10.
    """
    draw, inside, unexplained, refused = np.random.default_rng(20), 0, 0, 0
    kinds = [NOISES["white"], NOISES["AR 3"], NOISES["white"], NOISES["mixed 10"]]
    for config, _ in FAMILIES.values():
        forces = ForwardModel(config, ["material.E"], DEEPEST)
        for k in range(50):
            truth = draw.uniform(-1, 1)
            force = measured(
                forces, [truth], X, drawn(kinds[k % 4], N, draw), c=draw.uniform(-0.02, 0.02)
            )
            try:
                found = fit_model(forces, Samples(X, force), OriginOptions())
            except FitRejected:
                refused += 1
                continue
            low, high = found.interval(0)
            inside += low < truth < high
            unexplained += not judged(found, config).is_adequate
    assert refused <= 6 and unexplained <= 18 and 276 <= inside <= 297, (
        inside,
        unexplained,
        refused,
    )


@pytest.mark.verify
def test_coverage_of_adhesion_and_of_known_relaxation():
    """At least 33 of 40 intervals of 95 % contain the truth for adhesion and known relaxation.

    Fewer happen once in 400 by chance. The third case has a clear snap-in.
    """
    adhering = scene(HALF_SPACE, experiment={"adhesion": {"work": 0.001}})
    known = relaxing([[0.6, 0.3]], HALF_SPACE)
    draw = np.random.default_rng(30)
    both, weak, strong = (
        ["material.E", ADHESION_WORK_KEY],
        np.array([0.3, math.log(0.002)]),
        np.array([0.3, math.log(0.004)]),
    )
    cases = (
        (adhering, both, weak, N),
        (known, both[:1], weak[:1], N),
        (adhering, both, strong, 1000),
    )
    for config, keys, truth, n in cases:
        forces, inside = ForwardModel(config, keys, DEEPEST), np.zeros(len(keys))
        x, t = np.linspace(-0.1, 0.1, n), np.linspace(0, 2, n)
        for _ in range(40):
            force = measured(forces, truth, x, drawn(WHITE, n, draw), draw.uniform(-0.01, 0.01), t)
            found = fit_model(forces, Samples(x, force, t), OriginOptions())
            inside += [
                low < value < high
                for value, (low, high) in zip(
                    truth, map(found.interval, range(len(keys))), strict=False
                )
            ]
        assert (inside >= 33).all(), inside


WRONG = {
    "thickness": [scene({"shape": "layer", "height": height}) for height in (0.46, 1.4)],
    "adhesion": [
        scene(HALF_SPACE, experiment={"adhesion": {"work": work}}) for work in (0.0012, 0.003)
    ],
    "relaxation": [relaxing([[g, 0.3]], HALF_SPACE) for g in (0.3, 0.6)],
}


@pytest.mark.verify
def test_wrong_models_that_leave_seven_deviations_are_seen():
    """Wrong models are covered or detected in 90 %, and the right one is named in half.

    Hertz's model is fitted to layers, adhesion and relaxation. Counted are cases in which the best
    wrong fit to the curve without noise leaves sqrt(r'V^-1 r) of seven deviations.
    """
    config, draw = scene(HALF_SPACE), np.random.default_rng(40)
    forces, counted, fair, named = ForwardModel(config, ["material.E"], DEEPEST), 0, 0, 0
    for name, truths in WRONG.items():
        for truth in truths:
            made = ForwardModel(truth, ["material.E"], DEEPEST)
            pure = made(np.array([0.0]), X - C, T)
            for noise in (NOISES["white"], NOISES["AR 10"]):
                left = fit_model(forces, Samples(X, pure, T), OriginOptions()).residual / (
                    0.01 * pure.max()
                )
                if noise.squares(left) < 49:
                    continue
                for _ in range(6):
                    force = measured(made, [0.0], X, drawn(noise, N, draw), t=T)
                    verdict = judged(
                        fit_model(forces, Samples(X, force, T), OriginOptions()), config
                    )
                    low, high = verdict.coordinate_interval(0)
                    counted += 1
                    fair += low < 0 < high or not verdict.is_adequate
                    named += name in verdict.misfit_causes
    assert counted >= 36 and fair >= 0.9 * counted and named >= 0.5 * counted, (
        counted,
        fair,
        named,
    )
