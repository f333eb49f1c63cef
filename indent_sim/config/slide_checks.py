"""Checks of a tip that slides."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

from indent_sim.config.scene_sections import SceneSections
from indent_sim.model.body import Cylinder
from indent_sim.model.gel import Gel
from indent_sim.model.loading import Slide
from indent_sim.model.tips import Plate
from indent_sim.model.walled_bodies import Box, Strip
from indent_sim.process.errors import ConfigError

KEY = "loading.slide"
HISTORY_KEY = "loading.slide_history"


def slide_errors(config: SceneSections) -> Iterator[ConfigError]:
    """Yield errors of a tip that slides: its direction, and parts that exclude a slide."""
    slide = config.loading.slide
    if slide is not None:
        yield from _direction_errors(config, slide)
        yield from _first_error(KEY, _path_rejections(config))
    points = config.loading.slide_history
    if points is not None:
        yield from _point_errors(config, points)
        yield from _first_error(HISTORY_KEY, _history_rejections(config))
    if config.loading.slides:
        key = HISTORY_KEY if slide is None else KEY
        yield from _first_error(key, _rejections(config))


# Whether a slide is rejected, with the text of the problem and the remedy.
Rejection = tuple[bool, str, str]


def _first_error(key: str, rejections: Iterator[Rejection]) -> Iterator[ConfigError]:
    """Yield the error of the first rejection that applies."""
    for applies, problem, remedy in rejections:
        if applies:
            yield ConfigError(key, problem, remedy)
            return


def _direction_errors(config: SceneSections, slide: Slide) -> Iterator[ConfigError]:
    """Yield errors in direction and displacements of a slide without time."""
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
            "has a part without motion: a displacement equals the previous one, or the first one "
            "is 0, where the slide begins",
            "leave this displacement out",
        )


def _point_errors(
    config: SceneSections, points: tuple[tuple[float, ...], ...]
) -> Iterator[ConfigError]:
    """Yield errors in the points of a slide in time."""
    if points[0][1] != 0:
        yield ConfigError(
            f"{HISTORY_KEY}[0]",
            f"begins at x = {points[0][1]:g}, but the tip is pressed in at x = 0",
            "let the first point have x = 0",
        )
    for k, ((before, _), (t, _)) in enumerate(pairwise(points), start=1):
        if t <= before:
            yield ConfigError(
                f"{HISTORY_KEY}[{k}]", "is not later than the point before it", "use later times"
            )
            return
    if all(x == 0 for _, x in points):
        yield ConfigError(HISTORY_KEY, "has no motion", "leave it out")
    history = config.loading.history or config.loading.force_history
    if history and not history[0][0] <= points[0][0] < points[-1][0] <= history[-1][0]:
        yield ConfigError(
            HISTORY_KEY,
            "lies outside the history of the depth or force",
            f"use times from {history[0][0]:g} to {history[-1][0]:g}",
        )


def _history_rejections(config: SceneSections) -> Iterator[Rejection]:
    """Yield the conditions under which a slide prescribed in time is rejected."""
    loading = config.loading
    yield (loading.slide is not None, "is given beside loading.slide", "give one of them")
    yield (
        loading.prescribed_history is None,
        "is a motion in time, but the scene has no history",
        (
            "give loading.history or loading.force_history, or loading.slide in place of "
            "slide_history"
        ),
    )
    laws = [material for _, material in config.materials()]
    relaxes_as_a_whole = any(law.relaxation and law.relaxation.of == "all" for law in laws)
    yield (
        relaxes_as_a_whole,
        "cannot be combined with material.relaxation of all moduli, which is computed from the "
        "curve of force over depth",
        "use material.relaxation with of: shear",
    )
    yield (
        not any(law.is_time_dependent for law in laws),
        "is a motion in time, but the body does not depend on time",
        "give the material a relaxation with of: shear, or a flow; or use loading.slide",
    )
    yield (
        any(isinstance(law, Gel) and law.flow for law in laws),
        "is not verified together with swelling",
        "leave the flow of the gel or loading.slide_history out",
    )


def _path_rejections(config: SceneSections) -> Iterator[Rejection]:
    """Yield the conditions under which a slide at a held depth or force is rejected."""
    loading = config.loading
    yield (
        loading.prescribed_history is not None,
        "follows the last of the prescribed depths or forces, but the scene has a history in time",
        "give loading.delta, deltas, force or forces in place of the history, or slide_history in "
        "place of slide",
    )
    last_value = (loading.deltas or loading.forces or (1.0,))[-1]
    yield (
        last_value <= 0,
        "begins at the last depth or force, which is not above 0",
        "let the depths or forces end above 0",
    )


def _rejections(config: SceneSections) -> Iterator[Rejection]:
    """Yield the conditions under which any slide is rejected."""
    body = config.body
    yield (
        not isinstance(body, Strip | Box | Cylinder),
        f"is not possible on this body: the model of a {body.shape} has the tip on its axis",
        "use a strip (plane strain), a box or a cylinder",
    )
    yield (
        isinstance(config.indenter, Plate),
        (
            "is not possible with a plate, which covers the whole top, so that the contact cannot "
            "move"
        ),
        "use another tip",
    )
    yield (
        getattr(config.indenter, "material", None) is not None,
        "is not possible with a soft tip, whose model is axisymmetric",
        "leave indenter.material or the slide out",
    )
    yield (
        config.experiment is not None,
        (
            "cannot be combined with the section experiment, which is computed from the curve of "
            "force over depth"
        ),
        "leave experiment or the slide out",
    )
    yield (
        config.contact.adhesion is not None,
        "is not verified together with adhesion, by which the tip may snap in or off as it slides",
        "leave contact.adhesion or the slide out",
    )
    yield (
        config.map is not None,
        "cannot be combined with the section map, whose curves are forces over the depth",
        "leave the slide out",
    )
    yield (
        config.yields,
        "is not verified together with plasticity, where the tip ploughs a groove",
        "leave plasticity or the slide out",
    )
