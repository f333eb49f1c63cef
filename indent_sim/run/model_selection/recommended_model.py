"""Model requirements of a scene: effects on its force, and the simplest sufficient model."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product
from math import inf

import numpy as np

from indent_sim.config.scene_file import locate_error
from indent_sim.config.scene_sections import MeshSettings, SolverSettings
from indent_sim.config.schema import Config
from indent_sim.model.body import Cylinder
from indent_sim.model.contact import AutoContact
from indent_sim.model.experiment import Experiment
from indent_sim.model.tips import Paraboloid, Sphere
from indent_sim.model.unbounded_bodies import HalfSpace, UnboundedBody
from indent_sim.model.walled_bodies import Box
from indent_sim.process.errors import ConfigError, NotConverged, SolverMissing
from indent_sim.process.installation import missing_solver_text
from indent_sim.run.model_selection import variants
from indent_sim.run.model_selection.effect_table import EFFECTS
from indent_sim.run.model_selection.effects import Effect, find_effect
from indent_sim.run.model_selection.scene_variants import SceneVariants
from indent_sim.run.model_selection.time_dependence import TransientVariants, limiting_case_changes
from indent_sim.run.model_selection.variant_solver import NEEDS_MESH
from indent_sim.run.model_selection.variants import Document, replace_sections
from indent_sim.run.model_selection.yield_effect import elastic_variant, yield_effect
from indent_sim.scene.regions import remove_unused_material
from indent_sim.scene.scene import Scene, resolve

ConfigChange = Callable[[Config], Config]
# Names of simpler bodies, which need no mesh, in sentences.
UNBOUNDED_NAMES = {"half_space": "a half-space", "layer": "an infinitely wide layer"}
# Simpler bodies, from the simplest on, each with the effects that it neglects. Unbounded bodies
# keep the layers. The last one is the body of the scene.
BODY_MODELS: dict[str, tuple[ConfigChange | None, tuple[str, ...]]] = {
    "half_space": (variants.half_space_variant, ("inclusions", "thickness", "side_walls")),
    "layer": (variants.layer_variant, ("inclusions", "side_walls")),
    "no inclusions": (variants.remove_inclusions, ("inclusions",)),
    "": (None, ()),
}
BATH_TEXT = "a bath swells or shrinks the body, so that no elastic body has the same force"
# Parts of a history on the elastic curve that cause an effect.
EXPERIMENT_PARTS = {
    "adhesion": ("adhesion",),
    "rate": ("relaxation",),
    "cantilever": ("cantilever", "frame"),
}


@dataclass(frozen=True)
class Requirements:
    """Effects on the force of a scene, and the recommended model.

    Attributes
    ----------
    effects
        Effects on the force of the scene.
    config
        Recommended model: the simplest one within the tolerance, as a scene.
    percent
        Deviation of the recommended model's force from the force of the model with all possible
        effects [per cent]; None if only a range is known.
    words
        Sentences on the recommended model.
    """

    effects: tuple[Effect, ...]
    config: Document
    percent: float | None
    words: str

    def as_json(self) -> Document:
        """Return the requirements as a JSON object."""
        effects = [dataclasses.asdict(effect) for effect in self.effects]
        recommended = {"config": self.config, "percent": self.percent}
        return {"effects": effects, "recommended": recommended, "words": self.words}


def require(config: Config, within: float = 0.01) -> Requirements:
    """Find the simplest model of a scene whose force is within a tolerance; writes no files.

    Parameters
    ----------
    config
        The scene.
    within
        Relative tolerance of the force.

    Returns
    -------
    Requirements
        The effects on the force, and the recommended model.

    Raises
    ------
    ConfigError
        If the scene cannot be run, or the tip never touches the body.
    SolverMissing
        If even the force of the scene needs a mesh, and the solver is not installed. If only some
        effects need the solver, they are unknown and nothing is raised.
    """
    try:
        requirements = _requirements(config, within)
    except ConfigError as error:
        raise locate_error(config, error) from None
    except NotConverged as error:
        if NEEDS_MESH in str(error):
            raise SolverMissing(missing_solver_text()) from None
        raise
    if any(NEEDS_MESH in effect.source for effect in requirements.effects):
        hint = f"Some effects are unknown because {missing_solver_text()}"
        return replace(requirements, words=f"{requirements.words} {hint}")
    return requirements


def _requirements(config: Config, within: float) -> Requirements:
    """Return the requirements of a scene; see `require`."""
    if config.loading.slide_history is not None:
        raise ConfigError(
            "loading.slide_history",
            "has a side force in time, but models are compared by their force at one depth",
            "leave it out to find the simplest model for the force alone",
        )
    scene = resolve(config)
    if scene.physics.yields:
        return _yielding_requirements(config, scene, within)
    config = variants.set_gel_stretch(remove_unused_material(config, scene.physics.domain))
    if scene.physics.is_time_dependent:
        return _transient_requirements(TransientVariants(config, scene, within))
    effects = _elastic_effects(SceneVariants(config, scene, within), tuple(EFFECTS))
    model, variant = _simplest_model(config, effects, (), within)
    text = _recommendation_text(model, variant, effects, within)
    return Requirements(
        tuple(effects.values()), variants.minimal_document(variant), model.percent, text
    )


def _yielding_requirements(config: Config, scene: Scene, within: float) -> Requirements:
    """Return the requirements of a scene with a material that may yield.

    If the elastic body has the same force within the tolerance, the requirements are those of the
    elastic body; otherwise no simpler model is compared.
    """
    if scene.physics.is_time_dependent:
        raise ConfigError(
            "material.plasticity.creep",
            "has a force that depends on time, which is not compared with elastic bodies",
            "leave it out",
        )
    elastic = elastic_variant(config)
    effect = yield_effect(config, scene, elastic)
    assert effect.percent is not None
    if abs(effect.percent) > 100 * within:
        text = (
            f"Model the scene as it is: yield changes the force by {effect.percent:+.3g} % of that "
            "of the elastic body. Simpler models of a body that yields are not compared."
        )
        document = variants.minimal_document(config)
        return Requirements((effect,), document, 0.0, text)
    elastic_requirements = _requirements(elastic, within)
    text = f"Leave out plasticity: {effect.source}. {elastic_requirements.words}"
    return replace(
        elastic_requirements, effects=(effect, *elastic_requirements.effects), words=text
    )


def _elastic_effects(v: SceneVariants, names: tuple[str, ...]) -> dict[str, Effect]:
    """Return the effects on the force of an elastic body.

    Raises
    ------
    ConfigError
        If the tip never touches the body.
    """
    if v.delta <= 0:
        problem = "never presses the tip into the body, so that there is no force to compare"
        raise ConfigError("loading", problem, "give a depth > 0")
    return {name: find_effect(name, EFFECTS[name], v) for name in names}


def _transient_requirements(v: TransientVariants) -> Requirements:
    """Return the requirements of a scene whose body drains, swells or relaxes in shear.

    All effects other than drainage and rate are computed for the nearest elastic limiting cases. If
    no elastic model is within the tolerance, the scene itself is recommended.
    """
    limit_effects = _limit_effects(v)
    ordered = dict.fromkeys(EFFECTS) | limit_effects | v.time_effects
    effects = tuple(effect for effect in ordered.values() if effect)
    if not v.has_bath:
        neglected = tuple(v.nearest_limits.values())
        model, variant = _simplest_model(v.elastic_variant, limit_effects, neglected, v.tolerance)
        if model.is_within(v.tolerance):
            text = (
                f"{_recommendation_text(model, variant, limit_effects, v.tolerance)} "
                f"{_limit_sentence(v)}"
            )
            return Requirements(effects, variants.minimal_document(variant), model.percent, text)
    neglects_effect = {
        "paraboloid": isinstance(v.config.indenter, Paraboloid),
        "small_strain": any(law.is_small_strain for law in v.materials),
    }
    model = _Model(
        tuple(
            limit_effects[name]
            for name, is_neglected in neglects_effect.items()
            if is_neglected and limit_effects[name].is_possible
        )
    )
    deviation = f": {_deviation_text(model)}" if model.neglected_effects else ""
    text = f"Model the scene as it is, in time{deviation}. {_limit_sentence(v)}"
    return Requirements(effects, variants.minimal_document(v.config), model.percent, text)


def _limit_effects(v: TransientVariants) -> dict[str, Effect]:
    """Return the effects on the nearest limiting cases at the depth of the largest force."""
    names = tuple(name for name in EFFECTS if name not in v.time_effects)
    if v.has_bath:
        source = f"not solved: {BATH_TEXT}"
        return {name: Effect(name, None, None, None, source) for name in names}
    config = v.variant_at_depth
    limit = SceneVariants(config, resolve(config), v.tolerance, v.solver)
    limit_names = ", ".join(v.nearest_limits)
    return {
        name: replace(effect, source=f"{effect.source}; for the {limit_names} elastic body")
        for name, effect in _elastic_effects(limit, names).items()
    }


def _limit_sentence(v: TransientVariants) -> str:
    """Return a sentence on the deviations of the elastic limiting cases from the scene."""
    if v.has_bath:
        return f"{BATH_TEXT[0].upper()}{BATH_TEXT[1:]}."
    deviations = [
        f"the {name} body {_limit_deviation_text(change)}"
        for effect in v.time_effects.values()
        for name, change in limiting_case_changes(effect).items()
    ]
    return f"Elastic bodies deviate from the force of the scene: {', '.join(deviations)}."


def _limit_deviation_text(change: float | None) -> str:
    """Return the deviation of the force of an elastic limiting case as text, such as "by +5 %"."""
    if change is None or change <= -100:
        return "by an unknown amount"
    return f"by {100 * (100 / (100 + change) - 1):+.2g} %"


def _simplest_model(
    config: Config, effects: Mapping[str, Effect], neglected: tuple[Effect, ...], tolerance: float
) -> tuple[_Model, Config]:
    """Return the simplest model within the tolerance, and its scene.

    If no model is within the tolerance, the model with the most effects that can be run is
    returned. `neglected` are the effects that the scene itself neglects.
    """
    model = _Model(neglected_effects=neglected)
    model_scene = config
    for candidate in _candidate_models(config, effects, neglected):
        if variant := candidate.apply(config):
            model = candidate
            model_scene = variant
            if candidate.is_within(tolerance):
                break
    return model, model_scene


@dataclass(frozen=True)
class _Model:
    """Model of a scene that neglects some effects.

    Attributes
    ----------
    neglected_effects
        The effects that the model neglects.
    changes
        Sections of the config that are changed to obtain the model.
    body
        Key of BODY_MODELS.
    """

    neglected_effects: tuple[Effect, ...]
    changes: tuple[ConfigChange, ...] = ()
    body: str = ""

    @property
    def percent(self) -> float | None:
        """Deviation of the model's force from the force with the neglected effects [per cent].

        The effects are multiplied: F_model/F is the product of 1/(1 + effect). The deviation is
        None if only a range of an effect is known.
        """
        if any(effect.percent is None for effect in self.neglected_effects):
            return None
        factors = [1 / (1 + (effect.percent or 0.0) / 100) for effect in self.neglected_effects]
        return float(100 * (np.prod(factors) - 1))

    def is_within(self, tolerance: float) -> bool:
        """True if the neglected effects, each and all together, are within a relative tolerance."""
        changes = [effect.max_change for effect in self.neglected_effects]
        if self.percent is None:
            return sum(changes) <= 100 * tolerance
        # Two large effects that cancel are not negligible.
        return abs(self.percent) <= 100 * tolerance and max(changes, default=0.0) <= 100 * tolerance

    def apply(self, config: Config) -> Config | None:
        """Return the scene with this model; None if the scene cannot be run."""
        with suppress(ConfigError):
            for change in self.changes:
                config = change(config)
            resolve(config)
            return config
        return None


def _remove_mesh(config: Config) -> Config:
    """Return the scene without mesh settings, so that it can be solved by theory."""
    return replace_sections(
        config,
        solver=SolverSettings(),
        mesh=MeshSettings(),
        contact=AutoContact(),
        accuracy=None,
        output=replace(config.output, fields="auto"),
    )


def _use_sphere(config: Config) -> Config:
    """Return the scene with a sphere in place of a paraboloid."""
    assert isinstance(config.indenter, Paraboloid)
    return replace_sections(config, indenter=Sphere(config.indenter.R))


def _use_plain_contact(config: Config) -> Config:
    """Return the scene without friction and adhesion of the contact law."""
    return replace_sections(config, contact=AutoContact())


def _candidate_models(
    config: Config, effects: Mapping[str, Effect], neglected: tuple[Effect, ...]
) -> Iterator[_Model]:
    """Yield the models of a scene in the order of their cost.

    The last model has every effect that a model can have, except those that the scene itself
    neglects.
    """
    is_finite = not all(layer.material.is_small_strain for layer in config.layers if layer.material)
    contact_extra = config.contact.path_key
    knows_finite = is_finite or effects["small_strain"].percent is not None
    # These effects can be computed only from the elastic load curve at small strain.
    curve_effects = [
        effects[name]
        for name in _effects_on_curve(config, tuple(EXPERIMENT_PARTS))
        if effects[name].max_change > 0
    ]
    must_be_linear = any(
        effect.max_change >= effects["small_strain"].max_change for effect in curve_effects
    )
    strains = (False, True) if knows_finite and not must_be_linear else (False,)
    bodies = [body for body in BODY_MODELS if not body or _is_simpler_body(body, config)]
    # A tilt changes the force of a paraboloid, and not that of a sphere.
    may_be_sphere = isinstance(config.indenter, Paraboloid) and not config.tilt
    tips = (False, True) if may_be_sphere else (False,)
    contacts = (True, False) if contact_extra else (True,)
    if contact_extra and config.loading.slide:
        # The force hardly depends on friction, on which the side force of a slide depends.
        contacts = (False,)
    for is_finite_variant, body, has_sphere, is_plain in product(strains, bodies, tips, contacts):
        # Theory solves unbounded bodies at small strain without friction and adhesion only.
        if body in UNBOUNDED_NAMES and (is_finite_variant or not is_plain):
            continue
        changes: list[ConfigChange] = []
        change_body, body_effects = BODY_MODELS[body]
        geometry_effects = [
            effects[name]
            for name in body_effects
            if not (name == "side_walls" and isinstance(config.body, UnboundedBody))
        ]
        neglected_effects: list[Effect] = []
        if change_body:
            changes.append(change_body)
        if body in UNBOUNDED_NAMES:
            changes.append(_remove_mesh)
        if has_sphere:
            changes.append(_use_sphere)
        elif isinstance(config.indenter, Paraboloid):
            geometry_effects.append(effects["paraboloid"])
        if is_plain and contact_extra:
            changes.append(_use_plain_contact)
        if is_finite_variant != is_finite:
            changes.append(
                variants.finite_strain_variant
                if is_finite_variant
                else variants.small_strain_variant
            )
        if is_finite_variant:
            neglected_effects += curve_effects
        elif knows_finite:
            neglected_effects.append(effects["small_strain"])
        # Effects are relative to the force without adhesion, which may be much larger than the
        # force with adhesion.
        force_fraction = 1.0
        if contact_extra == "adhesion" and not is_plain:
            force_fraction = abs(1 + (effects["adhesion"].percent or 0.0) / 100)
        gain = 1 / force_fraction if force_fraction else inf
        neglected_effects += [effect.scaled(gain) for effect in geometry_effects]
        if contact_extra and is_plain:
            neglected_effects.append(effects[contact_extra])
        possible_effects = [effect for effect in neglected_effects if effect.is_possible]
        yield _Model((*neglected, *possible_effects), tuple(changes), body)


def _effects_on_curve(config: Config, names: tuple[str, ...]) -> list[str]:
    """Return which of the named effects the scene has on its elastic load curve."""
    parts = {name for name, value in vars(config.experiment or Experiment()).items() if value}
    if any(material.relaxation for _, material in config.materials()):
        parts.add("relaxation")
    return [name for name in names if parts & {*EXPERIMENT_PARTS.get(name, ())}]


def _is_simpler_body(body: str, config: Config) -> bool:
    """Return whether a variant of the body is simpler than the scene's body and can replace it."""
    if body == "no inclusions" or (
        isinstance(config.body, UnboundedBody) and body == config.body.shape
    ):
        return bool(config.body.inclusions)
    is_layer = body == "layer" and isinstance(config.body, HalfSpace)
    return isinstance(config.body, Cylinder | Box | UnboundedBody) and not is_layer


def _recommendation_text(
    model: _Model, config: Config, effects: Mapping[str, Effect], tolerance: float
) -> str:
    """Return sentences on the recommended model, its deviation, and effects that it neglects.

    `config` is the scene of the model; `effects` are the effects on the original scene.
    """
    body = UNBOUNDED_NAMES.get(config.body.shape, "the body as it is")
    if model.body == "no inclusions":
        body += " without its inclusions"
    is_small_strain = all(law.is_small_strain for _, law in config.materials())
    strain = "small strain" if is_small_strain else "finite strain"
    tip = config.indenter.shape.replace("_", " ")
    contact_extra = config.contact.path_key
    contact = f"with its {contact_extra}" if contact_extra else "without friction"
    text = f"Model {body} under a {tip} at {strain}, {contact}: "
    if not model.is_within(tolerance):
        text += f"{_deviation_text(model)}; no available model has all of the effects at once."
    elif model.neglected_effects:
        text += f"{_deviation_text(model)}."
    else:
        text += "nothing simpler is within the tolerance."
    if config.loading.slide and contact_extra:
        text += (
            " The model of the side force needs friction, even if the model of the force does not."
        )
    # The row "stick" tells the effect of any friction only if the scene has none.
    slip_effect = "friction" if effects["friction"].is_possible else "stick"
    # Effects that the scene can have, but none of the candidate models.
    scene_only_effects = ("rate", "adhesion", "cantilever", "calibration")
    names = [
        name
        for name in (slip_effect, *scene_only_effects)
        if name != contact_extra and name in effects
    ]
    significant = [
        name
        for name in names
        if effects[name].max_change > 100 * tolerance and (effects[name].low or effects[name].high)
    ]
    computed = _effects_on_curve(config, tuple(significant))
    if computed:
        text += f" The experiment section adds the effects of {_joined_names(computed)}."
    if unknown := [name for name in significant if name not in computed]:
        text += (
            " Effects that the model neglects may exceed "
            f"{100 * tolerance:g} %: {_joined_names(unknown)}."
        )
    return text


def _deviation_text(model: _Model) -> str:
    """Return the deviation of the force of a model as text."""
    if model.percent is None:
        return "its force deviates by less than the tolerance"
    return f"its force deviates by {model.percent:+.2g} %"


def _joined_names(names: list[str]) -> str:
    """Return the names of effects joined for a sentence."""
    return ", ".join(names).replace("_", " ")
