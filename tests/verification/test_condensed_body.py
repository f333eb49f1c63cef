"""One factorisation, many tips: the condensed body as a notebook uses it."""

import pytest
from scenes import PARABOLOID, WALLED, scene

from indent_sim.errors import ConfigError
from indent_sim.model.indenters import Paraboloid, Sphere
from indent_sim.run import condense, states


def test_another_tip_on_the_same_compliance_is_a_run_of_its_own():
    """Same mesh, same equations: only round-off may differ from a scene that was built with the tip."""
    base = scene(WALLED, "mesh.h_contact=0.02")
    body = condense(base)
    for tip, section in ((Sphere(1.0), {"shape": "sphere", "R": 1.0}), (Paraboloid(1.0), PARABOLOID)):
        alone = scene(WALLED, "mesh.h_contact=0.02", indenter=section)
        (expected,) = states(type(alone)(**{**vars(alone), "sizes": base.sizes}))
        (found,) = body.states(tip)
        assert found.force == pytest.approx(expected.force, rel=1e-10)
        assert found.a == pytest.approx(expected.a, rel=1e-8)


def test_depths_come_in_the_order_asked_for_and_one_factorisation_serves_them_all():
    body = condense(scene(WALLED, "mesh.h_contact=0.02"))
    compliance = body.compliance
    deep, shallow = body.states(deltas=[0.01, 0.005])
    assert (deep.delta, shallow.delta) == (0.01, 0.005)
    assert deep.force > shallow.force > 0
    assert body.walk.under(body.scene).contact.compliance is compliance


def test_a_scene_that_does_not_condense_is_refused():
    with pytest.raises(ConfigError, match="does not condense"):
        condense(scene(WALLED, contact={"method": "nitsche"}))
