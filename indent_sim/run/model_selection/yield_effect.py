"""Effect of yield on the force of a scene, with and without plasticity."""

from __future__ import annotations

from math import inf, nan, sqrt

import numpy as np

from indent_sim.config.schema import Config
from indent_sim.model.loading import Loading
from indent_sim.model.tips import max_radius
from indent_sim.process.errors import ConfigError
from indent_sim.run.model_selection import variants
from indent_sim.run.model_selection.effects import Effect
from indent_sim.run.model_selection.scene_variants import SceneVariants
from indent_sim.run.model_selection.variant_solver import VariantSolver
from indent_sim.scene.reference_theory import relative_tip
from indent_sim.scene.scene import Scene
from indent_sim.scene.yielding_contact import MAX_ONSET_RADIUS
from indent_sim.theory.solution import Solution
from indent_sim.theory.yielding import YieldingSolid, onset_pressure

NAME = "plasticity"
# Depth over that at the onset of yield under a sphere, and the loss of force there [-], at small
# strain without hardening and E/sigma_y = 1000. Checked: tests/physics/test_yielding_contact.py.
DEPTH_RATIOS = (1.0, 2.0, 3.0, 5.0, 8.0, 12.0)
FORCE_LOSSES = (0.0, 0.01, 0.03, 0.09, 0.15, 0.21)


def elastic_variant(config: Config) -> Config:
    """Return the scene without plasticity, pressed in a single step to its largest depth."""
    if config.loading.given_path_keys[:1] not in (("delta",), ("deltas",)):
        raise ConfigError(
            "loading",
            "prescribes no depth; a body that yields is compared with an elastic one at the same "
            "depth",
            "give delta or deltas",
        )
    delta = max(config.loading.path().values)
    loading = Loading(delta=delta, steps=1)
    return variants.change_materials(config, variants.elastic_law, loading=loading, accuracy=None)


def yield_effect(config: Config, scene: Scene, elastic: Config) -> Effect:
    """Return the change of the force at the largest depth because the body yields.

    Parameters
    ----------
    config
        The scene file.
    scene
        The scene of the config, in which a material may yield.
    elastic
        The scene without plasticity.
    """
    contact = scene.plan.yielding
    onset = contact.onset if contact else None
    scales = scene.physics.scales
    beginning = "" if onset is None else "; it yields from the first contact on"
    if onset and onset.delta > 0:
        depth = f"{onset.delta * scales.depth:.4g}"
        beginning = f"; it yields from the depth {depth} on (Hertz and von Mises)"
    if any(warning.key == "no_yield" for warning in scene.plan.model_warnings):
        return Effect(NAME, 0.0, 0.0, 0.0, f"the path ends before yield{beginning}")
    values = config.loading.path().values
    deepest = values.index(max(values))
    loading = Loading(deltas=values[: deepest + 1])
    solver = VariantSolver()
    yielding = solver.force(variants.replace_sections(config, loading=loading, accuracy=None))
    percent = 100 * (yielding / solver.force(elastic) - 1)
    source = f"with and without plasticity, on meshes{beginning}"
    return Effect(NAME, percent, percent, percent, source)


def onset_yield_stress(v: SceneVariants) -> float:
    """Return the yield stress at which yield begins at the largest depth [pressure].

    The yield stress follows from the largest contact pressure of the reference theory, as in a
    Hertzian contact. The result is NaN without a theory and in thin layers, and infinite or NaN
    under a sharp tip.
    """
    scene = v.scene
    solution = _local_solution(v)
    if solution is None:
        return nan
    ratio = onset_pressure(scene.physics.material.constants.nu)
    return solution.largest_pressure() * scene.physics.scales.pressure / ratio


def _local_solution(v: SceneVariants) -> Solution | None:
    """Return the contact at the largest depth if the stress below it is that of a half-space.

    None without a theory, under a plate, and if the first of several layers is not thick.
    """
    physics = v.scene.physics
    solution = v.scene.theory_solution(max(physics.deltas))
    if solution is None or physics.is_compressed:
        return None
    layers = v.config.layers
    if len(layers) > 1:
        thickness = (layers[0].thickness or inf) / physics.scales.length
        is_local = solution.a <= MAX_ONSET_RADIUS * thickness
        return solution if is_local else None
    return solution


def significant_yield_stress(v: SceneVariants) -> float:
    """Return the yield stress at which yield changes the force by the tolerance [pressure].

    Under a round tip the yield stress follows from the onset of yield, under a sharp tip from the
    estimate of `YieldingSolid`. The result is NaN if it is not known.
    """
    onset = onset_yield_stress(v)
    if onset == onset:
        depth_ratio = float(np.interp(v.tolerance, FORCE_LOSSES, DEPTH_RATIOS))
        return onset / sqrt(depth_ratio)
    physics = v.scene.physics
    solution = _local_solution(v)
    tip = relative_tip(physics.indenter, physics.body)
    if solution is None or solution.a >= max_radius(tip):
        return nan
    if tip.radius_scale(solution.a) is not None:
        return nan
    slope = 5 * float(tip.characteristic_strain(physics.max_depth, solution.a)[0])
    E, nu = physics.material.constants

    def force_ratio(yield_stress: float) -> float:
        """Return the estimated force divided by the force of the elastic body."""
        solid = YieldingSolid(E, nu, lambda alpha: yield_stress, lambda alpha: 0.0)
        rise = solid.contact_height(slope, is_round=False) / solid.contact_height(
            1e-12, is_round=False
        )
        elastic_pressure = solid.E_star * slope / 2
        return solid.mean_pressure(slope) * rise**2 / elastic_pressure

    # The ratio falls with the strain ratio from 3 on, and is above 1 below.
    low = 1e-6 * E * slope
    high = E * slope / 2
    for _ in range(60):
        middle = sqrt(low * high)
        if force_ratio(middle) < 1 - v.tolerance:
            low = middle
        else:
            high = middle
    return high * physics.scales.pressure


def yield_needs(v: SceneVariants) -> str:
    """Return text on the yield stress below which the force changes by the tolerance."""
    yield_stress = significant_yield_stress(v)
    return f"above {v.percent:g} % from {_yield_stress_key(v)} = {yield_stress:.2g} or less"


def yielding_scene_needs(v: SceneVariants) -> str:
    """Return text on the scene that computes the effect where it is not estimated."""
    return f"not estimated; a scene with {_yield_stress_key(v)} computes it"


def _yield_stress_key(v: SceneVariants) -> str:
    """Return the key of the yield stress of the material below the tip."""
    return f"{v.config.material_key(0)}.plasticity.yield_stress"


def yield_source(v: SceneVariants) -> str:
    """Return, as text, how the yield stress was estimated below which yielding matters."""
    onset = onset_yield_stress(v)
    if onset == onset:
        return f"Hertz and von Mises: yield begins on this path at a yield stress of {onset:.2g}"
    return (
        "estimate by Johnson's model of an expanding cavity; under a sharp tip the body "
        "yields from the first contact on"
    )
