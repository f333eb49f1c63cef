"""Checks of a tip that slides."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

from indent_sim.config.scene_sections import SceneSections
from indent_sim.model.body import Cylinder
from indent_sim.model.tips import Plate
from indent_sim.model.walled_bodies import Box, Strip
from indent_sim.process.errors import ConfigError

KEY = "loading.slide"


def slide_errors(config: SceneSections) -> Iterator[ConfigError]:
    """Yield errors of a tip that slides: its direction, and what it cannot be combined with."""
    slide = config.loading.slide
    if slide is None:
        return
    if slide.along not in (0.0, 90.0):
        yield ConfigError(
            f"{KEY}.along",
            f"is {slide.along:g} degrees, but the tip can slide along x or y only",
            "use 0 (x) or 90 (y)",
        )
    elif slide.axis == 1 and isinstance(config.body, Strip):
        yield ConfigError(
            f"{KEY}.along", "is 90 degrees, but a strip is infinitely long along y", "use 0"
        )
    if any(begin == end for begin, end in pairwise((0.0, *slide.ends))):
        yield ConfigError(
            f"{KEY}.to",
            "has a stretch without motion: a displacement equals the one before it, or the first "
            "is 0, where the tip is pressed in",
            "leave this displacement out",
        )
    for applies, problem, remedy in _obstacles(config):
        if applies:
            yield ConfigError(KEY, problem, remedy)
            return


def _obstacles(config: SceneSections) -> Iterator[tuple[bool, str, str]]:
    """Yield whether an obstacle to a slide applies, with the text of the problem and the remedy."""
    loading = config.loading
    body = config.body
    yield (
        loading.prescribed_history is not None,
        "follows the last of the prescribed depths or forces, but the scene has a history in time",
        "give loading.delta, deltas, force or forces in place of the history",
    )
    yield (
        not isinstance(body, Strip | Box | Cylinder),
        f"is not possible on this body: the model of a {body.shape} has the tip on its axis",
        "use a strip (plane strain), a box or a cylinder",
    )
    yield (
        isinstance(config.indenter, Plate),
        "does not fit a plate, which covers the whole top and has no contact that moves",
        "use another tip",
    )
    yield (
        getattr(config.indenter, "material", None) is not None,
        "does not fit a soft tip, whose model is axisymmetric",
        "leave indenter.material or loading.slide out",
    )
    yield (
        config.experiment is not None,
        "does not fit an experiment, which is evaluated on the curve of force over depth",
        "leave experiment or loading.slide out",
    )
    yield (
        config.contact.adhesion is not None,
        "is not verified together with adhesion, by which the tip may snap in or off as it slides",
        "leave contact.adhesion or loading.slide out",
    )
    yield (
        config.map is not None,
        "does not fit a map, whose curves are forces over the depth",
        "leave loading.slide out",
    )
    yield (
        any(material.plasticity for _, material in config.materials()),
        "is not verified together with plasticity: a groove that the tip ploughs",
        "leave plasticity or loading.slide out",
    )
    last_value = (loading.deltas or loading.forces or (1.0,))[-1]
    yield (
        last_value <= 0,
        "begins at the last depth or force, which is not above 0",
        "let the depths or forces end above 0",
    )
