"""What a scene requires: its effects, and the cheapest model of it within a tolerance."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product
from math import inf

import numpy as np

from indent_sim.config.scene_file import locate_error
from indent_sim.config.schema import Config, MeshSettings, SolverSettings
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

BODY_VARIANTS = {"half_space": variants.half_space_variant, "layer": variants.layer_variant}
BODY_VARIANTS |= {"no inclusions": variants.remove_inclusions}
UNBOUNDED_NAMES = {
    "half_space": "a half-space",
    "layer": "an infinitely wide layer",
}  # of them, in words
BATH_TEXT = "fluid from a bath swells or shrinks it, and no elastic body has its force"
SCENE_ONLY_EFFECTS = (
    "rate",
    "adhesion",
    "cantilever",
    "calibration",
)  # effects that no model here has, but the scene's own
EXPERIMENT_PARTS = {
    "adhesion": ("adhesion",),
    "rate": ("relaxation",),
    "cantilever": ("cantilever", "frame"),
}


@dataclass(frozen=True)
class Requirements:
    """The effects, and the cheapest model that is within a tolerance: its config, and by how many
    per cent its force is off that with all effects it could have; None where only a range is
    known.
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
    """What a scene requires for a force within a relative tolerance; nothing is written.

    Raises ConfigError for a scene that cannot be run or never touches the body, BackendError
    without a solver.
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
    solver = VariantSolver(config, scene)
    if solver.delta <= 0:
        problem = "never presses the tip into the body: no force depends on anything"
        raise ConfigError("loading", problem, "give a depth > 0")
    return solver


def _elastic_requirements(config: Config, solver: VariantSolver, tolerance: float) -> Requirements:
    """What a scene requires whose body does not change with time."""
    effects = {
        requirement.name: requirement.effect(solver, tolerance) for requirement in EFFECT_ROWS
    }
    model, best = _cheapest_model(config, effects, (), tolerance)
    sentence = _recommendation_text(model, best, effects, tolerance)
    return Requirements(
        tuple(effects.values()), variants.minimal_document(best), model.percent, sentence
    )


def _transient_requirements(
    config: Config, time_dependence: TimeDependentEffects, tolerance: float
) -> Requirements:
    """What a scene requires whose body changes with time: what that does to the force, and the
    other rows of the elastic body that is nearest; the scene itself where no elastic body is
    within the tolerance.
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
        waived = tuple(limit.neglected_effect for limit in time_dependence.nearest_limits)
        model, best = _cheapest_model(
            time_dependence.elastic_variant, limit_effects, waived, tolerance
        )
        if model.is_within(tolerance):
            sentence = f"{_recommendation_text(model, best, limit_effects, tolerance)} {_limit_sentence(time_dependence)}"
            return Requirements(effects, variants.minimal_document(best), model.percent, sentence)
    is_small = any(law.is_small_strain for law in variants.materials(config))
    lacking = {"paraboloid": isinstance(config.indenter, Paraboloid), "small_strain": is_small}
    model = _Model(
        tuple(
            limit_effects[name]
            for name, lacks in lacking.items()
            if lacks and limit_effects[name].is_possible
        )
    )
    deviation = f": {_deviation_text(model)}" if model.neglected_effects else ""
    sentence = f"Model the scene as it is, in time{deviation}. {_limit_sentence(time_dependence)}"
    return Requirements(effects, variants.minimal_document(config), model.percent, sentence)


def _limit_body_effects(
    time_dependence: TimeDependentEffects, rows: Mapping[str, EffectRow], tolerance: float
) -> dict[str, Effect]:
    """Other effects of an evolving scene: those of its nearest elastic body, at the depth of its
    largest force.
    """
    if time_dependence.has_bath:
        return {name: Effect(name, None, None, None, f"not solved: {BATH_TEXT}") for name in rows}
    config = time_dependence.variant_at_depth
    names = ", ".join(limit.name for limit in time_dependence.nearest_limits)
    solver = _variant_solver(config, resolve(config))
    limit_effects = {name: row.effect(solver, tolerance) for name, row in rows.items()}
    return {
        name: replace(effect, source=f"{effect.source}; of the {names} body, elastic")
        for name, effect in limit_effects.items()
    }


def _limit_sentence(time_dependence: TimeDependentEffects) -> str:
    """How far the elastic limits are off the scene, in words."""
    deviations = [
        f"the {limit.name} body {_limit_deviation_text(limit)}"
        for effect in time_dependence.effects
        for limit in elastic_limits(effect)
    ]
    return (
        f"{BATH_TEXT[0].upper()}{BATH_TEXT[1:]}."
        if time_dependence.has_bath
        else f"Off the scene's force: {', '.join(deviations)}."
    )


def _limit_deviation_text(limit: ElasticLimit) -> str:
    if limit.percent is None or limit.percent <= -100:
        return "by an unknown part"
    return f"by {100 * (100 / (100 + limit.percent) - 1):+.2g} %"


def _cheapest_model(
    config: Config, effects: Mapping[str, Effect], waived: tuple[Effect, ...], tolerance: float
) -> tuple[_Model, Config]:
    """The cheapest model within the tolerance, and its scene, else the last that can be run, which
    is the best there is; passed: what the config has left out of the scene.
    """
    model = _Model(neglected_effects=waived)
    best = config
    for candidate in _candidate_models(config, effects, waived):
        if variant := candidate.apply(config):
            model = candidate
            best = variant
            if candidate.is_within(tolerance):
                break
    return model, best


@dataclass(frozen=True)
class _Model:
    """A model: what it changes of the scene, and the effects that it does without."""

    neglected_effects: tuple[Effect, ...]
    body: str = ""  # one of BODIES; empty: the scene's own
    change_strain: Callable[[Config], Config] | None = (
        None  # that makes it finite or small; None: as the scene is
    )
    has_sphere: bool = False
    is_plain_contact: bool = False  # without the friction or the adhesion of the contact law

    @property
    def percent(self) -> float | None:
        """Its force over that with all that it drops, in per cent; None where only a range is
        known.
        """
        if any(effect.percent is None for effect in self.neglected_effects):
            return None
        return float(
            100
            * (
                np.prod(
                    [1 / (1 + (effect.percent or 0.0) / 100) for effect in self.neglected_effects]
                )
                - 1
            )
        )

    def is_within(self, tolerance: float) -> bool:
        """Whether what it drops is less than a relative tolerance, however it adds up where only
        ranges are known.
        """
        sizes = [effect.max_change for effect in self.neglected_effects]
        if self.percent is not None:  # none of them made good by another alone
            return (
                abs(self.percent) <= 100 * tolerance and max(sizes, default=0.0) <= 100 * tolerance
            )
        return sum(sizes) <= 100 * tolerance

    def apply(self, config: Config) -> Config | None:
        """The scene with this model; None where it cannot be run."""
        with suppress(ConfigError):
            config = BODY_VARIANTS[self.body](config) if self.body else config
            if self.body in UNBOUNDED_NAMES:  # whose theory has no mesh
                output = dataclasses.replace(config.output, fields="auto")
                default_sections = {
                    "solver": SolverSettings(),
                    "mesh": MeshSettings(),
                    "contact": AutoContact(),
                }
                config = replace_sections(config, **default_sections, accuracy=None, output=output)
            if self.has_sphere and isinstance(config.indenter, Paraboloid):
                config = replace_sections(config, indenter=Sphere(config.indenter.R))
            config = (
                replace_sections(config, contact=AutoContact()) if self.is_plain_contact else config
            )
            config = self.change_strain(config) if self.change_strain else config
            resolve(config)
            return config
        return None


def _candidate_models(
    config: Config, effects: Mapping[str, Effect], waived: tuple[Effect, ...]
) -> Iterator[_Model]:
    """The models of a scene, from the cheapest on; the last one has every effect that a model can
    have but those that the scene has `waived` over.
    """
    is_finite = not all(layer.material.is_small_strain for layer in config.layers if layer.material)
    contact_extra = config.contact.path_key
    knows_finite = effects["small_strain"].percent is not None
    is_parabola = isinstance(config.indenter, Paraboloid)
    curve_sources = curve_parts(config)
    transforms = [
        effects[name]
        for name, part_names in EXPERIMENT_PARTS.items()
        if curve_sources & {*part_names} and effects[name].max_change > 0
    ]
    must_be_linear = any(
        effect.max_change >= effects["small_strain"].max_change for effect in transforms
    )
    bodies = (*BODY_VARIANTS, "")
    choices = (False, True)
    walls = () if isinstance(config.body, UnboundedBody) else ("side_walls",)
    lost_effects = {
        "half_space": ("inclusions", "thickness", *walls),
        "layer": ("inclusions", *walls),
    }  # layers are kept
    for is_finite_variant, body, has_sphere, plain_contact in product(
        choices, bodies, choices, (True, False)
    ):
        is_endless = body in UNBOUNDED_NAMES and (is_finite_variant or not plain_contact)
        is_inapplicable = (
            (body and not _can_become(body, config))
            or (has_sphere and not is_parabola)
            or not (plain_contact or contact_extra)
        )
        is_unknown = is_finite_variant and not (knows_finite or is_finite)
        if (
            is_endless or is_inapplicable or is_unknown or (is_finite_variant and must_be_linear)
        ):  # as an experiment's curve is
            continue
        names = lost_effects.get(body, ("inclusions",) if body else ())
        dropped_effects = [
            effects[name]
            for name in (*names, *(["paraboloid"] if is_parabola and not has_sphere else []))
        ]
        strain_effects = (
            transforms
            if is_finite_variant
            else [effects["small_strain"]]
            if knows_finite or is_finite
            else []
        )
        kept_fraction = (
            abs(1 + (effects["adhesion"].percent or 0.0) / 100)
            if contact_extra == "adhesion" and not plain_contact
            else 1.0
        )
        gain = (
            1 / kept_fraction if kept_fraction else inf
        )  # what is small beside the force with adhesion may not be beside that without
        dropped = [*strain_effects, *(effect.scaled(gain) for effect in dropped_effects)]
        dropped += [effects[contact_extra]] if contact_extra and plain_contact else []
        change_strain = (
            variants.finite_strain_variant if is_finite_variant else variants.small_strain_variant
        )
        possible_effects = tuple(effect for effect in dropped if effect.is_possible)
        yield _Model(
            (*waived, *possible_effects),
            body,
            None if is_finite_variant == is_finite else change_strain,
            has_sphere,
            bool(plain_contact and contact_extra),
        )


def curve_parts(config: Config) -> set[str]:
    """What of a scene is made of its curve: parts of its experiment, and its relaxation."""
    names = {name for name, value in vars(config.experiment or Experiment()).items() if value}
    return names | {"relaxation" for _, material in config.materials() if material.relaxation}


def _can_become(body: str, config: Config) -> bool:
    if body == "no inclusions" or (
        isinstance(config.body, UnboundedBody) and body == config.body.shape
    ):
        return bool(config.body.inclusions)
    is_layer = body == "layer" and isinstance(config.body, HalfSpace)
    return isinstance(config.body, Cylinder | Box | UnboundedBody) and not is_layer


def _recommendation_text(
    model: _Model, config: Config, effects: Mapping[str, Effect], tolerance: float
) -> str:
    """What to model, in a sentence, and what no model here can tell."""
    body = UNBOUNDED_NAMES.get(config.body.shape, "the body as it is")
    body += " without its inclusions" if model.body == "no inclusions" else ""
    strain = (
        "small strain"
        if all(law.is_small_strain for law in variants.materials(config))
        else "finite strain"
    )
    tip = config.indenter.shape.replace("_", " ")
    contact_extra = config.contact.path_key
    sentence = f"Model {body} under a {tip} at {strain}, " + (
        f"with its {contact_extra}" if contact_extra else "without friction"
    )
    if not model.is_within(tolerance):
        sentence += f": {_deviation_text(model)}; no model here has all of the effects at once."
    else:
        sentence += (
            f": {_deviation_text(model)}."
            if model.neglected_effects
            else ": nothing simpler is within the tolerance."
        )
    slip_effect = (
        "friction" if effects["friction"].is_possible else "stick"
    )  # what may come of any only where there is none
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
    curve_sources = curve_parts(config)
    computed = [name for name in significant if curve_sources & set(EXPERIMENT_PARTS.get(name, ()))]
    if computed:
        sentence += f" Its experiment adds {_joined_names(computed)}."
    if unknown := [name for name in significant if name not in computed]:
        sentence += (
            f" Beside it, more than {100 * tolerance:g} % may come of {_joined_names(unknown)}."
        )
    return sentence


def _deviation_text(model: _Model) -> str:
    """How far a model is off, in words."""
    return (
        "that is off by less than the tolerance"
        if model.percent is None
        else f"that is off by {model.percent:+.2g} %"
    )


def _joined_names(names: list[str]) -> str:
    return ", ".join(names).replace("_", " ")
