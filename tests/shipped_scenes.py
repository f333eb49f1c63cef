"""Scenes of configs/, with the overrides by which tests run them in seconds."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

CONFIGS = Path(__file__).resolve().parents[1] / "configs"
SCENES = sorted(
    str(path.relative_to(CONFIGS))
    for path in CONFIGS.rglob("*.yaml")
    if "studies" not in path.parts
)


@dataclass(frozen=True)
class Run:
    """Overrides with which a shipped scene is run in tests, and the tolerances of its force."""

    overrides: tuple[str, ...] = ()
    last: float = 0.003  # what `h_contact: auto` promises
    any: float = 0.01  # the first of ten steps has a third of the last one's elements in contact


NOTES = Run(("mesh.h_contact=0.06", "loading.steps=2"), last=0.01, any=0.02)
COARSER = {
    # two elements in the last contact radius and one and a half in the other, instead of three and
    # a half
    "hertz_cube.yaml": Run(("mesh.h_contact=0.05", "loading.steps=2"), last=0.01, any=0.03),
    # three elements in the last contact radius instead of five
    "notes/linear_active_set.yaml": NOTES,
    "notes/linear_augmented_lagrangian.yaml": NOTES,
    "notes/linear_penalty.yaml": NOTES,
    # two elements in the last contact radius
    "notes/linear_penalty_stick.yaml": Run(
        ("mesh.h_contact=0.08", "loading.steps=2"), last=0.015, any=0.03
    ),
    # frictionless: the path does not matter
    "notes/hyperelastic_augmented_lagrangian.yaml": Run(
        ("mesh.h_contact=0.07", "loading.steps=1"), last=0.01
    ),
    "nucleus.yaml": Run(("loading.steps=1",)),
    # the nucleus and what lies far away, which move little, by elements of three quarters and twice
    # the size
    "cell_with_cortex.yaml": Run(
        ("mesh.h_contact=0.1", "mesh.h_far=2.0", "mesh.h_inclusions=[0.6]", "loading.steps=1"),
    ),
    # five elements in the contact radius instead of eight, which the edge of a box asks for
    "off_axis.yaml": Run(("mesh.h_contact=0.05", "loading.steps=1")),
    # an element as long as the attraction reaches, and a path that snaps in, is pushed, is pulled
    # and comes off
    "sticky_sphere.yaml": Run(("mesh.h_contact=0.16", "loading.deltas=[-0.2, 0.25, -0.25, -0.5]")),
    # a cone's contact grows with the depth, not with its root: a single element at the first of ten
    # steps
    "rubber_block.yaml": Run(any=0.02),
    # the force of a body that yields jumps by a per cent where node after node comes into contact
    "aluminium_cone.yaml": Run(last=0.02, any=0.06),
    "hard_film_on_aluminium.yaml": Run(last=0.02, any=0.06),
    "fused_silica_cone.yaml": Run(last=0.02, any=0.06),
    "sphere_through_yield.yaml": Run(last=0.02, any=0.06),
    # the pressure is singular at the punch's edge, and what is asked for there is 1 %
    "flat_punch.yaml": Run(last=0.01),
}
