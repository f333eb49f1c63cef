"""Surface tension of any size, down to the smallest."""

from __future__ import annotations

import math
from typing import Any

import pytest

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.scene.scene import resolve
from indent_sim.theory import surface_tension as tension_theory


def force_and_radius(surface_tension: float, delta: float = 0.01) -> tuple[float, float]:
    """Force and contact radius of a paraboloid R = 1 on a half-space with E = 1 and nu = 0.3."""
    given: dict[str, Any] = {
        "body": {"shape": "half_space", "surface_tension": surface_tension},
        "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.3},
        "indenter": {"shape": "paraboloid", "R": 1.0},
        "loading": {"delta": delta, "steps": 1},
    }
    theory = resolve(config_from_mapping(given)).plan.theory
    assert theory is not None
    found = theory.solution_at_depth(delta)
    return found.force, found.a


@pytest.mark.parametrize("surface_tension", [4e-8, 1e-30])
def test_a_tension_too_small_to_matter(
    surface_tension: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A tiny surface tension raises the force by 2.70 b/a with b = 2 gamma/E*.

    2.70 is the limit of the exact curve: 2.6953 at b/a = 1.8e-3, 2.7004 at 1.8e-4. 4e-8 is a
    hydrogel's 40 mN/m on 1 GPa under a ball of 1 mm; there the kernel is narrower than the spacing
    of two nodes has digits. 40 functions instead of 100 find the radius within 4e-4 and the force,
    which is stationary in it, within 1e-7.
    """
    monkeypatch.setattr(tension_theory, "MAX_FUNCTIONS", 40)
    force, a = force_and_radius(surface_tension)
    plain, radius = force_and_radius(0.0)
    width = 2.0 * surface_tension * (1.0 - 0.3**2) / math.sqrt(0.01)
    assert force / plain - 1.0 == pytest.approx(2.70 * width, abs=2e-7)
    assert a == pytest.approx(radius, rel=1e-3)
