"""What a scene says of a tip that adheres: refusals by name, and elements for the cohesive zone."""

from __future__ import annotations

from math import pi
from typing import Any

import pytest
from scenes import E_STAR, STRIP, WALLED, scene

from indent_sim.config.file import from_mapping
from indent_sim.model.contact import Cohesion
from indent_sim.process.errors import ConfigError
from indent_sim.run.resolved import resolved
from indent_sim.scene.scene import resolve

WORK, RANGE = 1e-3, 1e-2
ZONE = pi / 4 * E_STAR * RANGE**2 / WORK


def sticky(reach: float | None = RANGE, body: Any = WALLED, **more: Any) -> Any:
    adhesion = {"work": WORK} | ({} if reach is None else {"range": reach})
    return scene(body, contact={"adhesion": adhesion}, **more)


@pytest.mark.parametrize("method", ["penalty", "uzawa", "nitsche", "active_set"])
def test_methods_without_adhesion_refuse_it(method: str) -> None:
    with pytest.raises(ConfigError, match=method) as refusal:
        scene(WALLED, contact={"method": method, "adhesion": {"work": WORK, "range": RANGE}})
    assert refusal.value.key == "contact.adhesion"


def test_adhesion_with_friction_is_refused() -> None:
    with pytest.raises(ConfigError, match="together with friction") as refusal:
        scene(WALLED, contact={"friction": 0.3, "adhesion": {"work": WORK, "range": RANGE}})
    assert refusal.value.key == "contact.adhesion"


def test_no_range_points_to_its_limit() -> None:
    with pytest.raises(ConfigError, match="limit") as refusal:
        sticky(0.0)
    assert refusal.value.key == "contact.adhesion.range" and "experiment.adhesion" in (refusal.value.remedy or "")


def test_a_missing_range_names_the_smallest_on_this_mesh() -> None:
    """h = 1.5 l with l = (pi/4) E* range^2/work."""
    with pytest.raises(ConfigError, match="is missing") as refusal:
        sticky(None, mesh={"h_contact": 0.01})
    smallest = (4 / pi * WORK * 0.01 / 1.5 / E_STAR) ** 0.5
    assert f"at least {smallest:.3g}" in (refusal.value.remedy or "")


def test_elements_beyond_one_and_a_half_cohesive_zones_are_refused() -> None:
    h = 1.4 * ZONE
    sticky(mesh={"h_contact": h})
    with pytest.raises(ConfigError, match="do not resolve it") as refusal:
        sticky(mesh={"h_contact": 1.6 * ZONE})
    assert refusal.value.key == "contact.adhesion.range" and "mesh.h_contact" in (refusal.value.remedy or "")


def test_a_range_too_short_for_any_mesh_is_refused() -> None:
    with pytest.raises(ConfigError, match="too short for a mesh") as refusal:
        sticky(1e-5)
    assert "experiment.adhesion" in (refusal.value.remedy or "")


@pytest.mark.parametrize("reach", [0.004, RANGE, 0.05])
def test_two_elements_or_more_in_the_cohesive_zone(reach: float) -> None:
    found = sticky(reach)
    assert found.sizes.h_contact <= ZONE * (reach / RANGE) ** 2 / 2 * (1 + 1e-9)
    assert "cohesive zone" in next(choice.why for choice in found.plan.choices if choice.key == "contact.adhesion")


def test_plane_strain_is_refused() -> None:
    with pytest.raises(ConfigError, match="plane strain") as refusal:
        sticky(body=STRIP)
    assert refusal.value.key == "contact.adhesion"


def test_an_experiment_wants_a_curve_without_adhesion() -> None:
    with pytest.raises(ConfigError, match="without friction and adhesion"):
        sticky(experiment={"adhesion": {"work": WORK}})


def test_theory_knows_no_range() -> None:
    assert sticky(body={"shape": "half_space"}).method == "augmented_lagrangian"
    with pytest.raises(ConfigError, match="no attraction with a range"):
        sticky(solver={"method": "theory"})


def test_a_resolved_scene_is_the_same_scene() -> None:
    given = {"body": WALLED, "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.3},
             "indenter": {"shape": "paraboloid", "R": 1.0}, "loading": {"deltas": [-0.01, 0.01]},
             "contact": {"adhesion": {"work": WORK, "range": RANGE}}}  # fmt: skip
    config = from_mapping(given)
    found = resolve(config)
    again = resolve(resolved(config, found))
    assert again.physics.contact == found.physics.contact and again.sizes == found.sizes
    assert found.physics.has_memory and not found.physics.has_friction and not found.physics.columns


def test_the_attraction_is_the_slope_of_its_energy_and_its_integral_the_work() -> None:
    import numpy as np

    law, g = Cohesion(WORK, RANGE), np.linspace(-0.02, 0.3, 20001)
    slope = np.gradient(law.energy(g), g)
    # of differences over range/600; half of one across the kink at g = 0
    assert slope[1:-1] == pytest.approx(law.pull(g)[1:-1], rel=1e-3, abs=1e-5 * WORK / RANGE)
    assert float(law.energy(30 * RANGE) - law.energy(0.0)) == pytest.approx(WORK, rel=1e-12)
