"""Bodies under a flat punch that covers them, whose uniform strain is known exactly."""

from __future__ import annotations

import dataclasses
from math import hypot, pi
from typing import Any

from scenes import PENALTY, scene

from indent_sim.model.tips import FlatPunch
from indent_sim.scene.scene import Scene

E, NU, H, DELTA, EPSILON_N = 3.0, 0.3, 2.0, 0.05, 7.0
EXACT = 1e-9
CYLINDER = {"shape": "cylinder", "radius": 1.5, "height": H}
STRIP = {"shape": "strip", "width": 3.0, "height": H}
BOX = {"shape": "box", "size": [3.0, 2.0, H]}
AREA = {"cylinder": pi * 1.5**2, "strip": 3.0, "box": 6.0}
MATERIAL = {"model": "linear_elastic", "E": E, "nu": NU}


def covered(
    body: dict[str, Any],
    symmetry: str = "auto",
    method: str = "penalty",
    material: Any = MATERIAL,
    loading: Any = None,
    **contact: Any,
) -> Scene:
    """A body under a punch that reaches beyond its rim, which no config may ask for.

    No element is smaller at the rim, because the solution has no singularity there.
    """
    width = {"cylinder": 3.0, "strip": 3.0, "box": 2.0}[body["shape"]]
    base = scene(
        body,
        material=material,
        indenter={"shape": "flat_punch", "radius": width / 2},
        contact=(PENALTY | {"epsilon_n": EPSILON_N} if method == "penalty" else {"method": method})
        | contact,
        loading=loading or {"delta": DELTA, "steps": 1},
        mesh={"h_contact": 0.5, "symmetry": symmetry},
    )
    beyond = FlatPunch(radius=1.1 * hypot(3.0, 2.0) / 2 / base.physics.scales.length)
    sizes = dataclasses.replace(base.sizes, punch_edge=None, h_edge=None)
    return dataclasses.replace(base.replace_physics(indenter=beyond), sizes=sizes)
