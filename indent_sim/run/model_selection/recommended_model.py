"""Requirements of a scene: the effects on its force, and the simplest model within a tolerance."""

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
from indent_sim.process.errors import ConfigError
from indent_sim.run.model_selection import variants
from indent_sim.run.model_selection.effect_table import EFFECT_ROWS
from indent_sim.run.model_selection.effects import Effect, EffectRow
from indent_sim.run.model_selection.time_dependence import (
    ElasticLimit,
    TimeDependentEffects,
    elastic_limits,
)
from indent_sim.run.model_selection.variant_solver import VariantSolver
from indent_sim.run.model_selection.variants import Document, replace_sections
from indent_sim.scene.regions import remove_unused_material
from indent_sim.scene.scene import Scene, resolve

# Simpler bodies, from the simplest on.
BODY_VARIANTS = {
    "half_space": variants.half_space_variant,
    "layer": variants.layer_variant,
    "no inclusions": variants.remove_inclusions,
}
# Names of those without a mesh in texts.
UNBOUNDED_NAMES = {"half_space": "a half-space", "layer": "an infinitely wide layer"}
BATH_TEXT = "a bath swells or shrinks the body, so that no elastic body has the same force"
# Effects that only the scene itself can have, and no model that is chosen here.
SCENE_ONLY_EFFECTS = ("rate", "adhesion", "cantilever", "calibration")
# Parts of a history on the elastic curve that cause an effect.
EXPERIMENT_PARTS = {
    "adhesion": ("adhesion",),
    "rate": ("relaxation",),
    "cantilever": ("cantilever", "frame"),
}


@dataclass(frozen=True)
class Requirements:
    """Requirements of a scene.

    Attributes
    ----------
    effects
        Effects on its force.
    config
        Recommended model: the simplest one within the tolerance, as a scene.
    percent
        Deviation of its force from that with all effects that a model can have [per cent]; None if
        only a range is known.
    words
        Sentences on the recommended model.
    """

    effects: tuple[Effect, ...]
    config: Document
    percent: float | None
    words: str

    def as_json(self) -> Document:
        """The requirements as one JSON object."""
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
    BackendError
        If a solver is required that is not installed.
    """
    try:
        scene = resolve(config)
        config = variants.set_gel_stretch(remove_unused_material(config, scene.physics.domain))
        if scene.physics.is_time_dependent:
            return _transient_requirements(config, TimeDependentEffects(config, scene), within)
        return _elastic_requirements(config, _variant_solver(config, scene), within)
    except ConfigError as error:
        raise locate_error(config, error) from None


def _variant_solver(config: Config, scene: Scene) -> VariantSolver:
    """Solver of the variants of a scene; ConfigError if the tip never touches the body."""
    solver = VariantSolver(config, scene)
    if solver.delta <= 0:
        problem = "never presses the tip into the body, so that there is no force to compare"
        raise ConfigError("loading", problem, "give a depth > 0")
    return solver


def _elastic_requirements(config: Config, solver: VariantSolver, tolerance: float) -> Requirements:
    """Requirements of a scene whose body does not depend on time."""
    effects = {row.name: row.effect(solver, tolerance) for row in EFFECT_ROWS}
    model, variant = _simplest_model(config, effects, (), tolerance)
    text = _recommendation_text(model, variant, effects, tolerance)
    return Requirements(
        tuple(effects.values()), variants.minimal_document(variant), model.percent, text
    )


def _transient_requirements(
    config: Config, time_dependence: TimeDependentEffects, tolerance: float
) -> Requirements:
    """Requirements of a scene whose body drains, swells or relaxes in shear.

    Effects that do not concern time are those of the nearest elastic limits. If no elastic model is
    within the tolerance, the scene itself is recommended.
    """
    time_effects = {effect.name: effect for effect in time_dependence.effects}
    limit_effects = _limit_body_effects(
        time_dependence,
        {row.name: row for row in EFFECT_ROWS if row.name not in time_effects},
        tolerance,
    )
    effects = tuple(time_effects.get(row.name) or limit_effects[row.name] for row in EFFECT_ROWS)
    effects += tuple(effect for name, effect in time_effects.items() if name == "drainage")
    if not time_dependence.has_bath:
        neglected = tuple(limit.neglected_effect for limit in time_dependence.nearest_limits)
        model, variant = _simplest_model(
            time_dependence.elastic_variant, limit_effects, neglected, tolerance
        )
        if model.is_within(tolerance):
            text = (
                f"{_recommendation_text(model, variant, limit_effects, tolerance)} "
                f"{_limit_sentence(time_dependence)}"
            )
            return Requirements(effects, variants.minimal_document(variant), model.percent, text)
    is_small_strain = any(law.is_small_strain for law in variants.materials(config))
    neglects_effect = {
        "paraboloid": isinstance(config.indenter, Paraboloid),
        "small_strain": is_small_strain,
    }
    model = _Model(
        tuple(
            limit_effects[name]
            for name, is_neglected in neglects_effect.items()
            if is_neglected and limit_effects[name].is_possible
        )
    )
    deviation = f": {_deviation_text(model)}" if model.neglected_effects else ""
    text = f"Model the scene as it is, in time{deviation}. {_limit_sentence(time_dependence)}"
    return Requirements(effects, variants.minimal_document(config), model.percent, text)


def _limit_body_effects(
    time_dependence: TimeDependentEffects, rows: Mapping[str, EffectRow], tolerance: float
) -> dict[str, Effect]:
    """Effects on the nearest elastic limit of a scene, at the depth of its largest force."""
    if time_dependence.has_bath:
        return {name: Effect(name, None, None, None, f"not solved: {BATH_TEXT}") for name in rows}
    config = time_dependence.variant_at_depth
    names = ", ".join(limit.name for limit in time_dependence.nearest_limits)
    solver = _variant_solver(config, resolve(config))
    limit_effects = {name: row.effect(solver, tolerance) for name, row in rows.items()}
    return {
        name: replace(effect, source=f"{effect.source}; for the {names} elastic body")
        for name, effect in limit_effects.items()
    }


def _limit_sentence(time_dependence: TimeDependentEffects) -> str:
    """Sentence on the deviations of the elastic limits from the scene."""
    if time_dependence.has_bath:
        return f"{BATH_TEXT[0].upper()}{BATH_TEXT[1:]}."
    deviations = [
        f"the {limit.name} body {_limit_deviation_text(limit)}"
        for effect in time_dependence.effects
        for limit in elastic_limits(effect)
    ]
    return f"Elastic bodies deviate from the force of the scene: {', '.join(deviations)}."


def _limit_deviation_text(limit: ElasticLimit) -> str:
    """Deviation of the force of an elastic limit from that of the scene, such as "by +5 %"."""
    if limit.percent is None or limit.percent <= -100:
        return "by an unknown amount"
    return f"by {100 * (100 / (100 + limit.percent) - 1):+.2g} %"


def _simplest_model(
    config: Config, effects: Mapping[str, Effect], neglected: tuple[Effect, ...], tolerance: float
) -> tuple[_Model, Config]:
    """The simplest model within the tolerance, and its scene.

    If no model is within the tolerance, it is the one with most effects that can be run.

    Parameters
    ----------
    config
        The scene.
    effects
        Effects on its force by name.
    neglected
        Effects that the scene itself already neglects.
    tolerance
        Relative tolerance of the force.
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
    """A model of a scene.

    Attributes
    ----------
    neglected_effects
        The effects that it neglects.
    body
        Key of BODY_VARIANTS; empty for the body of the scene.
    change_strain
        Changes the scene to finite or small strain; None if it stays as it is.
    has_sphere
        A sphere replaces a paraboloid.
    is_plain_contact
        The contact law has neither friction nor adhesion.
    """

    neglected_effects: tuple[Effect, ...]
    body: str = ""
    change_strain: Callable[[Config], Config] | None = None
    has_sphere: bool = False
    is_plain_contact: bool = False

    @property
    def percent(self) -> float | None:
        """Deviation of its force from that with all neglected effects [per cent].

        Effects are multiplied, F_model/F = prod 1/(1 + effect). It is None if only a range of one
        of them is known.
        """
        if any(effect.percent is None for effect in self.neglected_effects):
            return None
        factors = [1 / (1 + (effect.percent or 0.0) / 100) for effect in self.neglected_effects]
        return float(100 * (np.prod(factors) - 1))

    def is_within(self, tolerance: float) -> bool:
        """True if the neglected effects are below a relative tolerance, each and all together."""
        changes = [effect.max_change for effect in self.neglected_effects]
        if self.percent is None:
            return sum(changes) <= 100 * tolerance
        # Two large effects that cancel are not negligible.
        return abs(self.percent) <= 100 * tolerance and max(changes, default=0.0) <= 100 * tolerance

    def apply(self, config: Config) -> Config | None:
        """The scene with this model; None if it cannot be run."""
        with suppress(ConfigError):
            if self.body:
                config = BODY_VARIANTS[self.body](config)
            # Unbounded bodies are solved by theory, without a mesh.
            if self.body in UNBOUNDED_NAMES:
                output = dataclasses.replace(config.output, fields="auto")
                default_sections = {
                    "solver": SolverSettings(),
                    "mesh": MeshSettings(),
                    "contact": AutoContact(),
                }
                config = replace_sections(config, **default_sections, accuracy=None, output=output)
            if self.has_sphere and isinstance(config.indenter, Paraboloid):
                config = replace_sections(config, indenter=Sphere(config.indenter.R))
            if self.is_plain_contact:
                config = replace_sections(config, contact=AutoContact())
            if self.change_strain:
                config = self.change_strain(config)
            resolve(config)
            return config
        return None


def _candidate_models(
    config: Config, effects: Mapping[str, Effect], neglected: tuple[Effect, ...]
) -> Iterator[_Model]:
    """The models of a scene in the order of their cost.

    The last one has every effect that a model can have, except those that the scene itself
    neglects.
    """
    is_finite = not all(layer.material.is_small_strain for layer in config.layers if layer.material)
    contact_extra = config.contact.path_key
    knows_finite = effects["small_strain"].percent is not None
    is_paraboloid = isinstance(config.indenter, Paraboloid)
    scene_parts = curve_parts(config)
    # Only the elastic load curve of small strain has these effects.
    curve_effects = [
        effects[name]
        for name, part_names in EXPERIMENT_PARTS.items()
        if scene_parts & {*part_names} and effects[name].max_change > 0
    ]
    must_be_linear = any(
        effect.max_change >= effects["small_strain"].max_change for effect in curve_effects
    )
    bodies = (*BODY_VARIANTS, "")
    choices = (False, True)
    walls = () if isinstance(config.body, UnboundedBody) else ("side_walls",)
    # Unbounded bodies keep the layers.
    body_effects = {
        "half_space": ("inclusions", "thickness", *walls),
        "layer": ("inclusions", *walls),
        "no inclusions": ("inclusions",),
        "": (),
    }
    for is_finite_variant, body, has_sphere, plain_contact in product(
        choices, bodies, choices, (True, False)
    ):
        # Theory solves unbounded bodies at small strain without friction and adhesion only.
        is_without_theory = body in UNBOUNDED_NAMES and (is_finite_variant or not plain_contact)
        is_inapplicable = (
            (body and not _is_simpler_body(body, config))
            or (has_sphere and not is_paraboloid)
            or not (plain_contact or contact_extra)
        )
        is_unknown = is_finite_variant and not (knows_finite or is_finite)
        lacks_curve = is_finite_variant and must_be_linear
        if is_without_theory or is_inapplicable or is_unknown or lacks_curve:
            continue
        geometry_effects = [effects[name] for name in body_effects[body]]
        if is_paraboloid and not has_sphere:
            geometry_effects.append(effects["paraboloid"])
        neglected_effects: list[Effect] = []
        if is_finite_variant:
            neglected_effects += curve_effects
        elif knows_finite or is_finite:
            neglected_effects.append(effects["small_strain"])
        # Effects are relative to the force without adhesion, which may be much larger than the
        # force with adhesion.
        force_fraction = 1.0
        if contact_extra == "adhesion" and not plain_contact:
            force_fraction = abs(1 + (effects["adhesion"].percent or 0.0) / 100)
        gain = 1 / force_fraction if force_fraction else inf
        neglected_effects += [effect.scaled(gain) for effect in geometry_effects]
        if contact_extra and plain_contact:
            neglected_effects.append(effects[contact_extra])
        change_strain = (
            variants.finite_strain_variant if is_finite_variant else variants.small_strain_variant
        )
        possible_effects = tuple(effect for effect in neglected_effects if effect.is_possible)
        yield _Model(
            (*neglected, *possible_effects),
            body,
            None if is_finite_variant == is_finite else change_strain,
            has_sphere,
            bool(plain_contact and contact_extra),
        )


def curve_parts(config: Config) -> set[str]:
    """Parts of a scene that act on its elastic load curve: those of the experiment, relaxation."""
    names = {name for name, value in vars(config.experiment or Experiment()).items() if value}
    return names | {"relaxation" for _, material in config.materials() if material.relaxation}


def _is_simpler_body(body: str, config: Config) -> bool:
    """True if a body of BODY_VARIANTS is simpler than that of the scene, and can replace it."""
    if body == "no inclusions" or (
        isinstance(config.body, UnboundedBody) and body == config.body.shape
    ):
        return bool(config.body.inclusions)
    is_layer = body == "layer" and isinstance(config.body, HalfSpace)
    return isinstance(config.body, Cylinder | Box | UnboundedBody) and not is_layer


def _recommendation_text(
    model: _Model, config: Config, effects: Mapping[str, Effect], tolerance: float
) -> str:
    """Sentences on the recommended model, its deviation, and effects that no model has.

    Parameters
    ----------
    model
        The model.
    config
        Its scene.
    effects
        Effects on the force of the original scene by name.
    tolerance
        Relative tolerance of the force.
    """
    body = UNBOUNDED_NAMES.get(config.body.shape, "the body as it is")
    if model.body == "no inclusions":
        body += " without its inclusions"
    is_small_strain = all(law.is_small_strain for law in variants.materials(config))
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
    # The row "stick" tells the effect of any friction only if the scene has none.
    slip_effect = "friction" if effects["friction"].is_possible else "stick"
    names = [
        name
        for name in (slip_effect, *SCENE_ONLY_EFFECTS)
        if name != contact_extra and name in effects
    ]
    significant = [
        name
        for name in names
        if effects[name].max_change > 100 * tolerance and (effects[name].low or effects[name].high)
    ]
    scene_parts = curve_parts(config)
    computed = [name for name in significant if scene_parts & set(EXPERIMENT_PARTS.get(name, ()))]
    if computed:
        text += f" Its experiment adds the effects of {_joined_names(computed)}."
    if unknown := [name for name in significant if name not in computed]:
        text += (
            f" Effects that it does not have may exceed {100 * tolerance:g} %: "
            f"{_joined_names(unknown)}."
        )
    return text


def _deviation_text(model: _Model) -> str:
    """Deviation of the force of a model as text."""
    if model.percent is None:
        return "its force is off by less than the tolerance"
    return f"its force is off by {model.percent:+.2g} %"


def _joined_names(names: list[str]) -> str:
    """Names of effects in a sentence."""
    return ", ".join(names).replace("_", " ")
