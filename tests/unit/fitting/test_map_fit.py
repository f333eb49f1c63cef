"""Maps: curves of one scene that are fitted together, and the noise that they share."""

from __future__ import annotations

import numpy as np
import pytest
from measurements import HALF_SPACE, drawn, scene
from scipy.linalg import toeplitz

from indent_sim.fitting import map_fit
from indent_sim.fitting.curve_fit import FitRequest
from indent_sim.fitting.forward_model.forward_model import ForwardModel
from indent_sim.fitting.inference.estimate import OriginOptions, Samples, fit_model
from indent_sim.fitting.inference.noise import Noise
from indent_sim.fitting.inference.pooled_noise import (
    NoiseComponent,
    PooledNoise,
    estimate_pooled_noise,
)
from indent_sim.fitting.map_fit import REASONS, MapFitter, MapModel, PixelFits
from indent_sim.fitting.map_scene import MapScene, largest_depth
from indent_sim.fitting.map_thickness import Thickness, parse_thickness, thickness_of_scene
from indent_sim.process.errors import ConfigError, UsageError
from indent_sim.results.measured.measured_map import MeasuredMap
from indent_sim.results.measured.measurement import MeasuredCurve, NoCurve

MAX_DEPTH = 0.14
N = 300
X = np.linspace(-0.1, 0.113, N)
SPRING = {"cantilever": {"stiffness": 0.5}}


def curves(
    model: ForwardModel, count: int, noise: Noise, x: np.ndarray = X, seed: int = 2
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Forces (count, n) on tilted baselines, with 1 % of noise; moduli and contact points."""
    draw = np.random.default_rng(seed)
    theta = draw.uniform(-0.7, 1.4, count)
    c = 0.013 + 0.005 * draw.uniform(-1.0, 1.0, count)
    force = model(theta[:, None], x - c[:, None])
    scale = force.max(axis=-1, keepdims=True)
    noises = np.array([drawn(noise, len(x), draw) for _ in range(count)])
    return force + scale * (0.01 * noises + 0.3 + 0.05 * x / x.max()), theta, c


def fitted(model: ForwardModel, force: np.ndarray, x: np.ndarray = X) -> PixelFits:
    """Fits of the curves (count, n) of a map."""
    fitter = MapFitter(lambda k: Samples(x, force[k]), len(force), MapModel(model))
    fitter.fit_initially()
    noise = fitter.estimate_noise()
    assert noise is not None
    fitter.fit(noise)
    return fitter.fits


@pytest.mark.parametrize(
    ("noise", "spring"),
    [(Noise(), {}), (Noise(10.0, 0.5), {}), (Noise(5.0, 0.0003), {}), (Noise(10.0, 0.5), SPRING)],
    ids=["white", "half AR 10", "AR 5", "half AR 10 behind a spring"],
)
def test_intervals_of_a_map_hold_modulus_and_contact_point(noise, spring):
    """Intervals of 95 % contain the truth, and a right scene is not contradicted.

    Of 256 intervals, fewer than 231 or more than 254 happen once in 1000 by chance, if 95 % hold.
    """
    model = ForwardModel(scene(experiment=spring) if spring else scene(), ["material.E"], MAX_DEPTH)
    x = np.linspace(-0.1, 0.2, N) if spring else X
    force, theta, c = curves(model, 256, noise, x)
    fits = fitted(model, force, x)
    assert fits.is_fitted.all()
    for value, sd, truth in (
        (fits.theta, fits.theta_sd, theta),
        (fits.contact_point, fits.contact_point_sd, c),
    ):
        assert 231 <= np.count_nonzero(abs(value - truth) < 1.96 * sd) <= 254
    # 0.1 % of tests fail by chance.
    assert np.count_nonzero(fits.is_explained) >= 252


def test_a_map_gives_the_values_of_single_curves():
    """The values differ from those of single fits by little more than the noises differ."""
    model = ForwardModel(scene(), ["material.E"], MAX_DEPTH)
    force, _, _ = curves(model, 64, Noise())
    fits = fitted(model, force)
    for k in range(0, 64, 16):
        single = fit_model(model, Samples(X, force[k]), OriginOptions())
        assert abs(single.theta[0] - fits.theta[k]) < 0.2 * fits.theta_sd[k]
        assert single.sd[0] == pytest.approx(fits.theta_sd[k], rel=0.3)


def test_wrong_thickness_is_seen_by_the_map():
    """Curves of a thin layer contradict a half-space."""
    layer = ForwardModel(scene({"shape": "layer", "height": 0.6}), ["material.E"], MAX_DEPTH)
    half_space = ForwardModel(scene(HALF_SPACE), ["material.E"], MAX_DEPTH)
    force, _, _ = curves(layer, 64, Noise())
    fits = fitted(half_space, force)
    assert np.count_nonzero(fits.is_explained) <= 6


def test_curves_without_a_contact_are_rejected_for_their_reasons():
    """Each kind of curve has its own reason, and good curves are not rejected."""
    model = ForwardModel(scene(), ["material.E"], MAX_DEPTH)
    force, _, _ = curves(model, 96, Noise())
    draw = np.random.default_rng(0)
    force[0] = 0.01 * draw.standard_normal(N)
    force[1] = np.minimum(force[1], 0.5 * force[1].max())
    force[2, 7] = np.nan
    force[3] = 1.0
    force[4] = -force[4]
    reasons = fitted(model, force).reason
    expected = [
        map_fit.NOISY,
        map_fit.SATURATED,
        map_fit.INCOMPLETE,
        map_fit.CONSTANT_FORCE,
        map_fit.NOT_RISING,
    ]
    assert [REASONS[k] for k in reasons[:5]] == [REASONS[k] for k in expected]
    assert not reasons[5:].any()


def test_curves_of_different_lengths_and_few_points():
    model = ForwardModel(scene(), ["material.E"], MAX_DEPTH)
    force, theta, _ = curves(model, 80, Noise())
    starts = [0, 17, 60]

    def read(k: int) -> Samples:
        start = 290 if k == 3 else starts[k % 3]
        return Samples(X[start:], force[k, start:])

    fitter = MapFitter(read, 80, MapModel(model))
    fitter.fit_initially()
    noise = fitter.estimate_noise()
    assert noise is not None
    fitter.fit(noise)
    fits = fitter.fits
    assert fits.reason[3] == map_fit.FEW_POINTS and np.count_nonzero(fits.reason) == 1
    inside = abs(fits.theta - theta)[fits.is_fitted] < 1.96 * fits.theta_sd[fits.is_fitted]
    assert np.count_nonzero(inside) >= 70


def test_variance_of_the_pooled_noise_is_that_of_the_dense_covariance():
    components = (NoiseComponent(0.0), NoiseComponent(8.0), NoiseComponent(300.0, 120.0))
    noise = PooledNoise(components, (0.3, 0.5, 0.2))
    rows = np.random.default_rng(1).standard_normal((3, 150))
    V = toeplitz(noise.autocovariance(150))
    # The circulant contains V exactly.
    np.testing.assert_allclose(noise.variances(rows), np.einsum("ki,ij,kj->k", rows, V, rows))
    assert V[0, 0] == pytest.approx(1.0)


def test_metric_of_white_noise_is_the_identity():
    rows = np.random.default_rng(1).standard_normal((2, 64))
    metric = PooledNoise((NoiseComponent(0.0),), (1.0,)).metric(64)
    np.testing.assert_allclose(metric.gram(rows), rows @ rows.T, rtol=1e-12)
    np.testing.assert_allclose(metric.apply(rows), rows, rtol=1e-12)


def test_noise_of_baselines_is_found():
    """Half white and half correlated noise is found in 200 baselines of 128 samples."""
    draw = np.random.default_rng(6)
    line = np.linspace(0.0, 3.0, 128)
    baselines = np.array([5.0 + line + drawn(Noise(10.0, 0.5), 128, draw) for _ in range(200)])
    noise = estimate_pooled_noise(baselines)
    # The likelihood of 25 000 numbers knows the fraction to 0.01 and the time to a tenth.
    assert noise.white_fraction == pytest.approx(0.5, abs=0.05)
    assert noise.correlation_time == pytest.approx(10.0, rel=0.3)
    assert noise.wave_fraction == 0.0


def test_waves_in_baselines_are_found():
    draw = np.random.default_rng(7)
    k = np.arange(128)
    phases = draw.uniform(0.0, 2.0 * np.pi, 200)
    waves = np.array([np.sqrt(2.0) * np.cos(2.0 * np.pi * k / 40.0 + phase) for phase in phases])
    noise = estimate_pooled_noise(waves + draw.standard_normal((200, 128)))
    assert noise.wave_fraction == pytest.approx(0.5, abs=0.1)


def test_what_is_known_of_the_origin_makes_intervals_narrower():
    """Contact point and slope of the baseline can be given for a map, as for a single curve."""
    model = ForwardModel(scene(), ["material.E"], MAX_DEPTH)
    draw = np.random.default_rng(9)
    theta = draw.uniform(-0.7, 1.4, 100)
    force = model(theta[:, None], np.tile(X - 0.013, (100, 1)))
    largest = force.max(axis=-1, keepdims=True)
    force = force + largest * (0.3 + 0.01 * draw.standard_normal(force.shape))
    widths = []
    for origin in (OriginOptions(), OriginOptions(0.013, False)):
        fitter = MapFitter(lambda k: Samples(X, force[k]), 100, MapModel(model, origin))
        fitter.fit_initially()
        noise = fitter.estimate_noise()
        assert noise is not None
        fitter.fit(noise)
        fits = fitter.fits
        assert fits.is_fitted.all()
        # Fewer than 88 of 100 happen once in 500 by chance.
        assert np.count_nonzero(abs(fits.theta - theta) < 1.96 * fits.theta_sd) >= 88
        widths.append(np.median(fits.theta_sd))
    assert widths[1] < 0.5 * widths[0]
    assert (fits.contact_point == 0.013).all() and (fits.contact_point_sd == 0).all()
    assert (fits.slope == 0).all()


@pytest.mark.parametrize("has_image", [False, True])
def test_height_of_the_surface_at_zero_force(has_image):
    """Displacements are absolute, or begin anew for each curve beside an image of the height.

    The surface of the second pixel is 0.3 um higher. The tip turns at the same force, but 0.1 um
    deeper in the soft second pixel.
    """
    travel = np.array([0.5, 0.6])
    image = np.array([[0.0, 0.3 - 0.1]])
    curves = MeasuredMap(
        (1, 2), None, np.array([[0, 0], [0, 1]]), no_curve, 1e-6 * image if has_image else None
    )
    config = scene(units={"length": "um", "force": "nN"})
    request = FitRequest(config, ("material.E",))
    model = ForwardModel(config, ["material.E"], MAX_DEPTH)
    # Without an image the base moves 0.3 um less far to the higher surface.
    contact_points = 2.0 - travel if has_image else np.array([1.5, 1.2])
    map_scene = MapScene(request, request, curves, model, ())
    height = map_scene.surface_height(contact_points, travel)
    assert height[1] - height[0] == pytest.approx(0.3)


def no_curve(index: int) -> MeasuredCurve:
    """Raise the error of a curve that cannot be read."""
    raise NoCurve("no curve")


@pytest.mark.parametrize(
    ("section", "thickness"),
    [
        ({"thickness": "height"}, Thickness(mean=1.0)),
        ({"mean": 2.5}, Thickness(mean=2.5)),
        ({"base": {"plane": "fitted"}}, Thickness()),
        (None, None),
    ],
)
def test_thickness_of_a_map_in_its_scene(section, thickness):
    """The median is body.height, another one, or none above a plane."""
    config = scene(**({"map": section} if section else {}))
    assert thickness_of_scene(config) == thickness


def test_scene_of_a_map_without_a_thickness_is_refused():
    with pytest.raises(ConfigError, match="height"):
        thickness_of_scene(scene(HALF_SPACE, map={"thickness": "height"}))
    with pytest.raises(ConfigError, match="both mean and base"):
        thickness_of_scene(scene(map={"mean": 2.0, "base": {"plane": "fitted"}}))


def test_thicknesses_in_another_unit_are_refused(tmp_path):
    """Numbers in metres for a body whose height is given in micrometres, and the reverse."""
    file = tmp_path / "thickness.csv"
    request = FitRequest(scene(), ("material.E",))
    for factor in (1e-6, 1e6):
        np.savetxt(file, np.full((2, 3), factor), delimiter=",")
        with pytest.raises(UsageError, match="median of its numbers"):
            parse_thickness(str(file), request, (2, 3))
    np.savetxt(file, np.full((2, 3), 1.5), delimiter=",")
    assert (parse_thickness(str(file), request, (2, 3)).values == 1.5).all()


def test_curves_without_contact_do_not_set_the_largest_depth():
    """One curve in a hundred may have any depth; the others count, also up to 1.5 times deeper."""
    depths = np.append(np.full(199, 0.5), 5.0)
    assert largest_depth(depths, 99.0) == 0.75
    assert largest_depth(np.append(np.full(199, 0.5), 0.7), 99.0) == 0.7
    assert largest_depth(np.array([0.2, np.nan, 0.5]), 99.0) == 0.5
