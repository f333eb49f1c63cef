"""Other models: what else may make a curve, and whether the scene's own model is refuted by one of
them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from indent_sim.config.scene_file import from_mapping, to_mapping, varied
from indent_sim.config.schema import Config
from indent_sim.fitting.inference.estimate import Estimate, Model, averaged_at, rebased
from indent_sim.fitting.inference.noise import f_test
from indent_sim.fitting.scene_curve.lattice import NoTable
from indent_sim.fitting.scene_curve.parameters import WORK
from indent_sim.fitting.scene_curve.scene_forces import SceneForces, Tables
from indent_sim.process.errors import IndentSimError

Name = Literal["thickness", "adhesion", "relaxation", "tip"]
# block means on which, and rounds for which the starts of a model are followed
EXPLORED = 300
EXPLORING = 15
THINNEST = 1.15  # depths that a free thickness must have
FREE_HEIGHTS = (0.5, 1.5, 4.0)  # contact radii, where free thicknesses begin
WORKS = (
    0.01,
    0.05,
    0.2,
)  # of the largest force over the contact radius, where works of adhesion begin
# What a scene may not have of its own where a model is tried
UNKNOWN_WITH: dict[str, set[str]] = {
    "tip": {"adhesion"},
    "thickness": set(),
    "adhesion": {"adhesion", "relaxation"},
    "relaxation": {"adhesion", "relaxation"},
}
# of a Prony term, its time in durations of the contact
FRACTIONS = (0.3,)
PRONY_TIMES = (0.1, 0.4, 1.5)
CHANGES = (-0.2, 0.0, 0.2)  # of the depth's exponent, where it begins


@dataclass(frozen=True)
class Other:
    """Another model on the same curve: its name, the probability p of gaining as much by accident,
    its estimate, the keys that it fits beside the scene's, and their values.
    """

    name: Name
    p: float
    estimate: Estimate
    added: dict[str, float]


def others(estimate: Estimate, config: Config, tables: Tables) -> list[Other]:
    """The models that may stand beside a scene's own, each fitted from several starts in its own
    noise.

    tables: those that are known. A model that the scene has already, or that cannot be computed for
    it, is left out.
    """
    found = (
        _fitted(name, estimate, config, tables)
        for name in ("thickness", "adhesion", "relaxation", "tip")
    )
    return sorted((one for one in found if one is not None), key=lambda one: one.p)


def _fitted(name: Name, estimate: Estimate, config: Config, tables: Tables) -> Other | None:
    try:
        best = _best(estimate, list(_candidates(name, estimate, config, tables)))
    except (IndentSimError, NoTable, ValueError, ArithmeticError, np.linalg.LinAlgError):
        return None
    if best is None:
        return None
    p = refuted(estimate, best)
    added = {
        one.key: one.value(float(x))
        for one, x in zip(best.model.forces.parameters, best.theta, strict=True)
    }
    return Other(
        name,
        p,
        best,
        {key: value for key, value in added.items() if key not in estimate.model.forces.keys},
    )


def _best(
    estimate: Estimate, candidates: Sequence[tuple[SceneForces, np.ndarray]]
) -> Estimate | None:
    """The candidate that leaves least, its noise beside it; found on fewer samples, and ended on
    all.
    """
    own = estimate.model
    few = Model(own.forces, own.samples.means(EXPLORED), own.origin)
    rest = rebased(own, few, estimate.ordinary)[own.size :]
    best: tuple[float, Model, np.ndarray] | None = None
    for forces, theta in candidates:
        model = Model(forces, few.samples, own.origin)
        try:
            p, size = model.fitted(np.array([*theta, *rest]), rounds=EXPLORING)
        except (NoTable, ValueError, np.linalg.LinAlgError):
            continue
        if best is None or size < best[0]:
            best = size, model, p
    if best is None:
        return None
    model = Model(best[1].forces, own.samples, own.origin)
    p, _ = model.fitted(rebased(best[1], model, best[2]))
    return Estimate(model, p, p, averaged_at(model, p))


def refuted(scene: Estimate, richer: Estimate) -> float:
    """The probability that a richer model gains as much by accident: an F test in the noise beside
    the richer one.
    """
    noise = richer.found.likeliest
    left, best = (
        float(r @ noise.whitened(r)[0])
        for r in (scene.model.residual(_again(scene, noise)), _own(richer))
    )
    m = len(richer.p) - len(scene.p)
    return f_test(max(left - best, 0.0), m, best, len(richer.model.samples) - len(richer.p))


def _again(scene: Estimate, noise: Any) -> np.ndarray:
    return scene.model.fitted(scene.ordinary, noise, rounds=10)[0]


def _own(richer: Estimate) -> np.ndarray:
    p, _ = richer.model.fitted(richer.p, richer.found.likeliest, rounds=10)
    return richer.model.residual(p)


def _candidates(
    name: Name, estimate: Estimate, config: Config, tables: Tables
) -> Iterator[tuple[SceneForces, np.ndarray]]:
    """The model's forces and the coordinates from which it is fitted."""
    forces = estimate.model.forces
    theta = estimate.ordinary[: estimate.model.size]
    if forces.effects & UNKNOWN_WITH[name]:
        return
    match name:
        case "tip":
            compliance = forces.experiment.compliance
            free = forces.with_free_power(
                max(estimate.depth - compliance * estimate.rise, 1e-3 * estimate.depth)
            )
            yield from ((free, np.array([*theta, q])) for q in CHANGES)
        case "thickness":
            yield from _thickness(forces, theta, config, tables)
        case "adhesion":
            radius = forces.lattice.first.radius
            held = with_experiment(config, adhesion={"work": WORKS[0] * _deepest(forces) / radius})
            other = tables.forces(held, (*forces.keys, WORK), forces.deepest)
            yield from (
                (other, np.array([*theta, math.log(share * estimate.rise / radius)]))
                for share in WORKS
            )
        case "relaxation":
            yield from _relaxing(estimate, theta, config, tables)


def _relaxing(
    estimate: Estimate, theta: np.ndarray, config: Config, tables: Tables
) -> Iterator[tuple[SceneForces, np.ndarray]]:
    """Matter that relaxes by one term; a curve without times does not tell."""
    forces = estimate.model.forces
    t = estimate.model.samples.t
    x = estimate.model.samples.x
    if t is None:
        return
    span = float(np.ptp(t[x > estimate.contact_point]))
    key, held = _with_relaxation(config, forces.deepest)
    other = tables.forces(held, (*forces.keys, f"{key}[0][0]", f"{key}[0][1]"), forces.deepest)
    instantaneous = _harder(theta, forces.scaling, 1.0 / (1.0 - 0.5 * FRACTIONS[0]))
    for share in PRONY_TIMES:
        yield other, np.array([*instantaneous, math.log(FRACTIONS[0]), math.log(share * span)])


def _deepest(forces: SceneForces) -> float:
    """The largest force of the scene as it stands."""
    return float(forces.lattice.first.force(np.array([forces.deepest]))[0])


def _harder(theta: np.ndarray, scaling: int | None, factor: float) -> np.ndarray:
    moved = theta.copy()
    if scaling is not None:
        moved[scaling] += math.log(factor)
    return moved


def _thickness(
    forces: SceneForces, theta: np.ndarray, config: Config, tables: Tables
) -> Iterator[tuple[SceneForces, np.ndarray]]:
    """A homogeneous body of free height; one whose height is fitted already has none."""
    body = config.body
    key = "body.height"
    radius = forces.lattice.first.radius
    if (
        key in forces.keys
        or body.shape not in ("half_space", "layer")
        or body.layers
        or body.inclusions
    ):
        return
    least = THINNEST * forces.deepest
    base = config
    if body.shape != "layer":
        layer = {"shape": "layer", "height": max(4.0 * radius, 2.0 * least)}
        base = from_mapping(to_mapping(config) | {"body": layer})
    other = tables.forces(base, (*forces.keys, key), forces.deepest)
    for share in FREE_HEIGHTS:
        yield other, np.array([*theta, math.log(max(share * radius, 1.1 * least))])


def _with_relaxation(config: Config, deepest: float) -> tuple[str, Config]:
    """The scene of matter that relaxes by one term, and the key of its terms in the first material."""
    keys = [f"{key}.relaxation" for key, _ in config.materials()]
    settings: list[tuple[str, Any]] = [(key, {"prony": [[FRACTIONS[0], 1.0]]}) for key in keys]
    settings.append(
        ("loading", {"history": [[0.0, 0.0], [1.0, deepest]]})
    )  # relaxation needs a time
    return f"{keys[0]}.prony", varied(
        to_mapping(config), config.source, [(*one, ("--models", None)) for one in settings]
    )


def with_experiment(config: Config, **parts: Any) -> Config:
    """The scene with a part added to its experiment; ConfigError where that cannot be."""
    document = to_mapping(config)
    document["experiment"] = {**document.get("experiment", {}), **parts}
    return from_mapping(document)
