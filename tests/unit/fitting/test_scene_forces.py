"""Forward model of a scene, against theory at other depths and parameters."""

from __future__ import annotations

import math

import numpy as np
import pytest
from measurements import HALF_SPACE, LAYER, relaxing, scene

from indent_sim.config.quantities import pressure_keys
from indent_sim.fitting.forward_model.elastic_load_curve import plan_elastic_run
from indent_sim.fitting.forward_model.forward_model import APPROACH, RETRACT, ForwardModel
from indent_sim.fitting.forward_model.forward_model_cache import ForwardModelCache
from indent_sim.fitting.forward_model.parameter_grid import ForwardModelUnavailable
from indent_sim.fitting.forward_model.parameters import (
    ADHESION_WORK_KEY,
    RETRACT_WORK_KEY,
    number_at,
    parameters_of,
)
from indent_sim.process.errors import ConfigError
from indent_sim.run.solvers.elastic_curve import is_self_similar
from indent_sim.theory.adhesion import Jkr
from indent_sim.theory.elastic_curve import ElasticCurve
from indent_sim.theory.lee_radok_ting import LeeRadokTing
from indent_sim.theory.punches import LayerPunches
from indent_sim.theory.relaxation_function import ShearRelaxation

DEEPEST = 0.13
DEPTHS = np.array([1e-4, 0.001, 0.01, 0.03, 0.1, 0.13])


def by_theory(config, depths=DEPTHS) -> np.ndarray:  # type: ignore[no-untyped-def]
    """Theory's forces in the units of the scene."""
    given = plan_elastic_run(config, DEEPEST).scene
    scales = given.physics.scales
    curve = given.plan.theory.contact.solutions_at_depths(
        [float(delta / scales.depth) for delta in depths]
    )
    return np.array([one.force for one in curve]) * scales.force


@pytest.mark.parametrize("body", [LAYER, HALF_SPACE])
@pytest.mark.parametrize(
    "tip",
    [
        {"shape": "paraboloid", "R": 1.0},
        {"shape": "cone", "half_angle": 60.0},
        {"shape": "sphere", "R": 0.8},
        {"shape": "flat_punch", "radius": 0.3},
    ],
)
def test_tables_are_theory_at_other_depths(body, tip):
    config = scene(body, tip=tip)
    forces = ForwardModel(config, ["material.E"], DEEPEST)(np.array([math.log(2.5)]), DEPTHS)
    np.testing.assert_allclose(
        forces, 2.5 * by_theory(config), rtol=1e-6
    )  # 5e-11 as a rule, a sphere's edge the worst


def test_no_contact_no_force_and_beyond_the_table_a_power():
    forces = ForwardModel(scene(HALF_SPACE), [], DEEPEST)
    got = forces(np.array([]), np.array([-1.0, 0.0, 2 * DEEPEST]))
    assert got[0] == got[1] == 0.0
    np.testing.assert_allclose(
        got[2], by_theory(scene(HALF_SPACE), [2 * DEEPEST])[0], rtol=1e-6
    )  # Hertz is a power


@pytest.mark.parametrize(
    "key, values", [("body.height", (0.3, 0.77, 5.0)), ("material.nu", (0.0, 0.31, 0.5))]
)
def test_parameters_of_shape_are_interpolated(key, values):
    forces = ForwardModel(scene(), ["material.E", key], DEEPEST)
    for value in values:
        theta = np.array([0.0, forces.parameters[1].theta(value)])
        changed = (
            scene({"shape": "layer", "height": value}) if key == "body.height" else scene(nu=value)
        )
        np.testing.assert_allclose(
            forces(theta, DEPTHS), by_theory(changed), rtol=2e-5
        )  # 2e-6 away from bounds


def test_a_body_thinner_than_the_depth_has_no_table():
    forces = ForwardModel(scene(), ["body.height"], DEEPEST)
    assert forces.bounds[0][0] == pytest.approx(math.log(1.15 * DEEPEST))
    forces(forces.bounds[0], DEPTHS)  # its nodes all lie above
    with pytest.raises((ForwardModelUnavailable, ConfigError)):
        ForwardModel(scene({"shape": "layer", "height": 0.1}), ["material.E"], DEEPEST)


def test_roles_and_numbers_of_keys():
    layers = {
        "shape": "layer",
        "height": 1.4,
        "layers": [
            {"thickness": 0.4},
            {"thickness": 1.0, "material": {"model": "linear_elastic", "E": 5.0, "nu": 0.3}},
        ],
    }
    config = scene(layers, experiment={"adhesion": {"work": 0.01}})
    keys = [
        "material.E",
        "body.layers[1].material.nu",
        "body.layers[0].thickness",
        ADHESION_WORK_KEY,
    ]
    assert [one.role for one in parameters_of(config, keys, DEEPEST)] == [
        "shape",
        "shape",
        "shape",
        "work",
    ]
    assert pressure_keys(scene()) == ["material.E"] and len(pressure_keys(config)) == 2
    assert number_at(config, "body.layers[1].material.E") == 5.0
    for key, problem in [
        ("material.Q", "is not a number of the scene"),
        ("body.shape", "is 'layer', not a number"),
        ("body.layers[7].thickness", "is not a number of the scene"),
    ]:
        with pytest.raises(ConfigError, match=problem):
            parameters_of(config, [key], DEEPEST)
    with pytest.raises(ConfigError, match="twice"):
        parameters_of(config, ["material.E"] * 2, DEEPEST)


def test_two_layers_move_by_their_own_moduli():
    """F(E_1, E_2) of two layers is homogeneous of degree one and agrees with theory."""

    def two(top, below):  # type: ignore[no-untyped-def]
        part = {"model": "linear_elastic", "nu": 0.4}
        return scene(
            {
                "shape": "layer",
                "height": 1.2,
                "layers": [
                    {"thickness": t, "material": part | {"E": E}}
                    for t, E in ((0.4, top), (0.8, below))
                ],
            }
        )

    forces = ForwardModel(
        two(1.0, 3.0), ["body.layers[0].material.E", "body.layers[1].material.E"], DEEPEST
    )
    theta = np.log([1.3, 4.4])
    np.testing.assert_allclose(forces(theta, DEPTHS), by_theory(two(1.3, 4.4)), rtol=2e-5)
    np.testing.assert_allclose(
        forces(theta + 0.7, DEPTHS), math.exp(0.7) * forces(theta, DEPTHS), rtol=2e-5
    )


@pytest.mark.parametrize(
    "held", [{"cantilever": {"stiffness": 0.5}}, {"frame": {"compliance": 2.0}}]
)
def test_a_spring_gives_way_by_its_force(held):
    """The motion of a base over a spring is z = delta + F/k at the same force."""
    rigid, soft = (
        ForwardModel(scene(experiment=more), [], DEEPEST)
        for more in ({"frame": {"compliance": 0.0}}, held)
    )
    force = rigid(np.array([]), DEPTHS)
    np.testing.assert_allclose(
        soft(np.array([]), DEPTHS + 2.0 * force), force, rtol=1e-4
    )  # of 1500 depths, linear


@pytest.mark.parametrize("compliance", [0.0, 3.0])
def test_adhesion_is_that_of_theory(compliance):
    held = {"frame": {"compliance": compliance}}
    config, work, E = scene(experiment={"adhesion": {"work": 0.002}, **held}), 0.0033, 1.7
    forces = ForwardModel(config, ["material.E", ADHESION_WORK_KEY], DEEPEST)
    given = plan_elastic_run(config, DEEPEST).scene
    L, F = given.physics.scales.length, given.physics.scales.force
    jkr = Jkr(LayerPunches(given.plan.theory.contact), work / E / given.physics.scales.pressure / L)
    ways = [0.0, 0.003, 0.02, 0.09]
    known = [E * F * jkr.stable_equilibrium(z / L, compliance * E * F / L).force for z in ways]
    got = forces(np.log([E, work]), np.array(ways))
    np.testing.assert_allclose(
        got, known, rtol=2e-4, atol=2e-5 * max(known)
    )  # 1500 radii, joined by lines
    assert not forces(np.log([E, work]), np.array([-0.01, -0.001])).any()  # not yet touched
    back = forces(np.log([E, work]), np.array([0.05, -1e-4, -0.5]))
    assert back[1] < 0 and back[2] == 0  # it holds on, until it comes off


@pytest.mark.parametrize("body", [LAYER, HALF_SPACE])
def test_derivatives_of_adhesive_forces_are_those_of_differences(body):
    """All parameters that a fit of an adhesive tip may vary, on both branches.

    The force consists of lines between contacts, whose slopes differ by up to 0.5 % of the largest
    derivative; a central difference is the mean of those that it crosses.
    """
    held = {"cantilever": {"stiffness": 0.5}, "frame": {"compliance": 0.3}}
    config = scene(body, experiment={"adhesion": {"work": 0.004}, **held})
    keys = [
        "material.E",
        ADHESION_WORK_KEY,
        RETRACT_WORK_KEY,
        "experiment.cantilever.stiffness",
        "experiment.frame.compliance",
        *(["body.height"] if body is LAYER else []),
    ]
    forces = ForwardModel(config, keys, 0.3).add_work_exponent()
    way = np.linspace(0.002, 0.12, 40)
    x, branch = np.concatenate([way, way[::-1]]), np.repeat([APPROACH, RETRACT], 40)
    theta = forces.initial_coordinates + 0.05
    got, derivatives = forces.linearize(theta, x, None, branch)
    np.testing.assert_array_equal(got, forces(theta, x, None, branch))
    for k, row in enumerate(derivatives):
        step, shift = np.zeros(len(theta)), 0.0
        if k < len(theta):
            step[k] = 1e-3
        else:
            shift = 1e-3 * way[-1]
        low, high = (
            forces(theta + sign * step, x - sign * shift, None, branch) for sign in (-1, 1)
        )
        known = (high - low) / (2.0 * (shift or 1e-3))
        np.testing.assert_allclose(row, known, atol=1e-2 * abs(known).max())


def test_relaxation_while_the_contact_grows_is_lee_and_radok():
    terms = [[0.4, 0.3], [0.2, 2.0]]
    config = relaxing(terms)
    t = np.linspace(0, 1, 400)
    got = ForwardModel(config, [], DEEPEST)(np.array([]), 0.1 * t, t)
    depths = np.geomspace(1e-5, 0.1001, 80)
    elastic = ElasticCurve(depths, by_theory(config, depths), np.sqrt(depths))
    cycle = LeeRadokTing(ShearRelaxation((0.4, 0.2), (0.3, 2.0)), [0.0, 1.0], [0.0, 0.1], elastic)
    known = [cycle.response_at(float(time)).force for time in t[[50, 200, 399]]]
    np.testing.assert_allclose(
        got[[50, 200, 399]], known, rtol=1e-4
    )  # F_el is taken as straight between 400 times


def test_a_linear_rise_relaxes_exactly_at_any_times():
    """A linear elastic force relaxes exactly: F = (1 - g) t + g tau (1 - exp(-t/tau))."""
    law, t = ShearRelaxation((0.7,), (0.4,)), np.array([0.0, 0.1, 0.15, 0.9, 3.0])
    exact = 0.3 * t + 0.7 * 0.4 * -np.expm1(-t / 0.4)
    np.testing.assert_allclose(law.force_relaxation(t)(t), exact, rtol=1e-12)
    even = np.linspace(0, 3, 7)
    np.testing.assert_allclose(
        law.force_relaxation(even)(even), 0.3 * even + 0.28 * -np.expm1(-even / 0.4), rtol=1e-12
    )


def test_a_spring_on_a_relaxing_body_balances():
    """Over a spring on a relaxing body z = delta + F/k holds at every time."""
    terms = [[0.5, 0.2]]
    soft = ForwardModel(relaxing(terms, experiment={"cantilever": {"stiffness": 1.0}}), [], DEEPEST)
    rigid = ForwardModel(relaxing(terms), [], DEEPEST)
    t = np.linspace(0, 1, 200)
    force = soft(np.array([]), 0.1 * t, t)
    np.testing.assert_allclose(
        rigid(np.array([]), 0.1 * t - force, t), force, rtol=1e-6, atol=1e-12
    )


def test_force_of_a_sharp_pyramid_needs_no_solution():
    """F = C E* tan(beta) delta^2 with the constant of a boundary-element solution, at any depth."""
    pyramid = {"shape": "vickers"}
    models = ForwardModelCache()
    shallow, deep = (
        models.forward_model(scene(HALF_SPACE, tip=pyramid), ("material.E",), depth)
        for depth in (0.01, 0.1)
    )
    delta = np.array([0.003, 0.01])
    E_star = 1.0 / (1.0 - 0.45**2)
    expected = 0.73762 * E_star * np.tan(np.radians(68.0)) * delta**2
    # A Chebyshev series of one coefficient, in tables of cubic polynomials.
    for model in (shallow, deep):
        np.testing.assert_allclose(model(np.zeros(1), delta), expected, rtol=1e-9)
        assert model.relative_error == pytest.approx(3e-5)
    assert (shallow.max_depth, deep.max_depth) == (0.01, 0.1)
    assert deep.elastic_curves.scene_curve.contact_radius == pytest.approx(
        10.0 * shallow.elastic_curves.scene_curve.contact_radius
    )


@pytest.mark.parametrize(
    ("tip", "body"),
    [
        ({"shape": "vickers", "tip_radius": 0.1}, HALF_SPACE),
        ({"shape": "vickers"}, LAYER),
        ({"shape": "cone", "half_angle": 70.0}, HALF_SPACE),
    ],
    ids=["rounded", "layer", "cone, by theory"],
)
def test_other_scenes_are_not_self_similar(tip, body):
    assert not is_self_similar(scene(body, tip=tip))
