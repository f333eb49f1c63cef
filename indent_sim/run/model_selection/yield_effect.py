"""Effect of yield on the force of a scene."""

from __future__ import annotations

from indent_sim.config.schema import Config
from indent_sim.model.loading import Loading
from indent_sim.process.errors import ConfigError
from indent_sim.run.model_selection import variants
from indent_sim.run.model_selection.effects import Effect
from indent_sim.run.model_selection.variant_solver import VariantSolver
from indent_sim.scene.scene import Scene

NAME = "plasticity"


def elastic_variant(config: Config) -> Config:
    """Return the scene without plasticity, pressed in a single step to its largest depth."""
    if config.loading.given_path_keys[:1] not in (("delta",), ("deltas",)):
        raise ConfigError(
            "loading",
            "prescribes no depth, at which a body that yields is compared with an elastic one",
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
        Its scene, in which a material may yield.
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
