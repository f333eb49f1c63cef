"""Random loops of bodies that yield: materials, tips and depths."""

from __future__ import annotations

from math import pi, radians, tan
from typing import Any

import numpy as np

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.config.schema import Config
from indent_sim.scene.scene import resolve


def random_loop(seed: int, rows: int, *, has_layers: bool = False, **sections: Any) -> Config:
    """A loop of loading and unloading with a cone of 50 to 80 degrees or a sphere.

    E/sigma_y is from 10 to 1000 and n from 0 to 0.5. With layers, a third of the bodies are films
    of half to two contact radii on a substrate that yields at another stress.
    """
    rng = np.random.default_rng(seed)
    E = float(10 ** rng.uniform(1, 3))
    n = float(rng.uniform(0, 0.5) * (rng.random() < 0.7))
    is_cone = bool(rng.random() < 0.6)
    angle = float(rng.uniform(50, 80))
    material = {
        "model": "hencky",
        "E": E,
        "nu": float(rng.uniform(0.2, 0.4)),
        "plasticity": {"yield_stress": 1.0} | ({"n": n} if n else {}),
    }
    tip = {"shape": "cone", "half_angle": angle} if is_cone else {"shape": "sphere", "R": 1.0}
    depth = 1.0 if is_cone else float(10 ** rng.uniform(-2.5, -1.2))
    base: dict[str, Any] = {
        "body": {"shape": "half_space"},
        "material": material,
        "indenter": tip,
        "loading": {"delta": depth, "steps": 1},
    }
    if has_layers and rng.random() < 1 / 3:
        a = tan(radians(angle)) if is_cone else (2 * depth) ** 0.5
        other = material | {"plasticity": {"yield_stress": float(10 ** rng.uniform(-0.5, 0.5))}}
        film = {"thickness": a * float(rng.uniform(0.5, 2)), "material": material}
        base["body"]["layers"] = [film, {"material": other}]
    expected = resolve(config_from_mapping(base)).plan.prediction
    # The force of a film that bends into its substrate is not predicted; 3 is the hardness
    force = expected.get("force", 3 * pi * expected["a"] ** 2)
    E_star = E / (1 - material["nu"] ** 2)
    # Depth over which an elastic contact of the expected radius loses the expected force.
    recovery = min(force / (2 * E_star * expected["a"]), 0.9 * depth)
    loading = [depth * k / rows for k in range(1, rows + 1)]
    unloading = [depth - fraction * recovery for fraction in (0.3, 0.6, 0.9)]
    return config_from_mapping(base | {"loading": {"deltas": [*loading, *unloading]}} | sections)
