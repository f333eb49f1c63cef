"""Force of a pyramid on a half-space that yields, on several meshes.

`python scripts/bench/yielding_pyramids.py vickers 0.813 0.575 0.407` prints a line for each element
size: CPU time, and the forces of the second half of eight rows to the depth 1, at
E/yield_stress = 100. The tip is `vickers`, `berkovich`, or `cone` of the cross-sections of a
Vickers pyramid.
"""

from __future__ import annotations

import sys
import time

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.run import pipeline
from indent_sim.scene.scene import resolve


def main(shape: str, sizes: list[float]) -> None:
    """Print the forces of a tip for each element size."""
    tip = {"shape": "cone", "half_angle": 70.2996} if shape == "cone" else {"shape": shape}
    for h in sizes:
        document = {
            "body": {"shape": "half_space"},
            "material": {
                "model": "hencky",
                "E": 100.0,
                "nu": 0.3,
                "plasticity": {"yield_stress": 1.0},
            },
            "indenter": tip,
            "loading": {"delta": 1.0, "steps": 8},
            "mesh": {"h_contact": h},
        }
        start = time.process_time()
        base = resolve(config_from_mapping(document))
        rows = list(pipeline.states(base, with_surface=False))
        forces = "  ".join(f"{row.force:.3f}" for row in rows[4:])
        print(f"h {h:g}  CPU {time.process_time() - start:.0f} s  F {forces}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1], [float(size) for size in sys.argv[2:]])
