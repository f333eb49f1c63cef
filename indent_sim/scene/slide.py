"""Checks and choices of a tip that slides."""

from __future__ import annotations

from indent_sim.mesh.sizes import Sizes
from indent_sim.process.errors import ConfigError
from indent_sim.scene.choices import Choice, Choices
from indent_sim.scene.problem_setup import ProblemSetup


def check_slide(setup: ProblemSetup) -> None:
    """Raise ConfigError if the contact leaves the body or a mirror plane during a slide."""
    physics = setup.physics
    track = physics.track
    if track.is_point:
        return
    L = physics.scales.length
    name = "xy"[track.axis]
    own_walls = {f"{name}_min", f"{name}_max", "r_max"} & physics.domain.mirror_walls(
        physics.center
    )
    if own_walls:
        raise ConfigError(
            "loading.slide",
            f"leads away from the roller wall {min(own_walls)}, which is a mirror plane through "
            "the tip",
            "let the tip slide along this wall, or choose a position of the tip away from it",
        )
    wall = physics.domain.wall_radius
    low, high = physics.domain.extent[track.axis]
    if wall:
        low = -wall
        high = wall
    c = track.center[track.axis]
    across = abs(track.center[1 - track.axis]) if wall else 0.0
    room = min(c + track.low - low, high - c - track.high) - across
    if room > setup.a:
        return
    raise ConfigError(
        "loading.slide",
        f"takes the contact, of radius {setup.a * L:.3g}, over the edge of the body: the tip's "
        f"axis comes within {room * L:.3g} of it",
        "use smaller displacements or a wider body",
    )


def check_slide_sizes(setup: ProblemSetup, sizes: Sizes) -> None:
    """Raise ConfigError if the mesh is refined at an edge of a sliding tip, which moves."""
    if setup.physics.slides and sizes.punch_edge is not None:
        raise ConfigError(
            "loading.slide",
            "does not fit a contact that ends at a sharp edge of the tip: the edge would slide "
            "away from the part of the mesh that is refined for it",
            "use a rounder tip (edge_radius of at least half the radius), or another shape",
        )


def slide_choices(setup: ProblemSetup) -> Choices:
    """Return the choice that describes how a slide is solved; empty if the tip does not slide."""
    physics = setup.physics
    track = physics.track
    if not physics.slides:
        return []
    L = physics.scales.length
    held = physics.path.control
    why = (
        f"along {'xy'[track.axis]} from {track.low * L:.4g} to {track.high * L:.4g} at the last "
        f"{held}, which is held; the elements are small along the whole track"
    )
    return [Choice("loading.slide", track.length * L, why)]
