"""What a scene requires: its effects, and the cheapest model of it within a tolerance."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product
from math import inf

import numpy as np

from indent_sim.config.scene_file import located
from indent_sim.config.schema import Config, MeshSettings, SolverSettings
from indent_sim.model.body import Box, Cylinder, Endless, HalfSpace
from indent_sim.model.contact import AutoContact
from indent_sim.model.experiment import Experiment
from indent_sim.model.tips import Paraboloid, Sphere
from indent_sim.process.errors import ConfigError
from indent_sim.run.requirements import variations
from indent_sim.run.requirements.bench import Bench
from indent_sim.run.requirements.effects import Effect, Requirement
from indent_sim.run.requirements.evolution import Evolution, Limit, limits_of
from indent_sim.run.requirements.table import REQUIREMENTS
from indent_sim.run.requirements.variations import Document, varied
from indent_sim.scene.problem_setup import remove_unused_material
from indent_sim.scene.scene import Scene, resolve

BODIES = {"half_space": variations.on_half_space, "layer": variations.on_layer}
BODIES |= {"no inclusions": variations.without_inclusions}
ENDLESS = {"half_space": "a half-space", "layer": "an infinitely wide layer"}  # of them, in words
BATHED = "fluid from a bath swells or shrinks it, and no elastic body has its force"
BESIDE_IT = (
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
        config = variations.with_swollen_gels(remove_unused_material(config, scene.physics.domain))
        if scene.physics.is_time_dependent:
            return _of_evolution(config, Evolution(config, scene), within)
        return _of_elastic(config, _bench(config, scene), within)
    except ConfigError as error:
        raise located(config, error) from None


def _bench(config: Config, scene: Scene) -> Bench:
    bench = Bench(config, scene)
    if bench.delta <= 0:
        problem = "never presses the tip into the body: no force depends on anything"
        raise ConfigError("loading", problem, "give a depth > 0")
    return bench


def _of_elastic(config: Config, bench: Bench, within: float) -> Requirements:
    """What a scene requires whose body does not change with time."""
    effects = {requirement.name: requirement.effect(bench, within) for requirement in REQUIREMENTS}
    model, best = _cheapest(config, effects, (), within)
    words = _sentence(model, best, effects, within)
    return Requirements(tuple(effects.values()), variations.shown(best), model.percent, words)


def _of_evolution(config: Config, evolution: Evolution, within: float) -> Requirements:
    """What a scene requires whose body changes with time: what that does to the force, and the
    other rows of the elastic body that is nearest; the scene itself where no elastic body is
    within the tolerance.
    """
    own = {effect.name: effect for effect in evolution.effects}
    beside = _beside(
        evolution, {one.name: one for one in REQUIREMENTS if one.name not in own}, within
    )
    effects = tuple(own.get(one.name) or beside[one.name] for one in REQUIREMENTS)
    effects += tuple(effect for name, effect in own.items() if name == "drainage")
    if not evolution.is_bathed:
        passed = tuple(limit.dropped for limit in evolution.nearest)
        model, best = _cheapest(evolution.elastic, beside, passed, within)
        if model.is_within(within):
            words = f"{_sentence(model, best, beside, within)} {_passed(evolution)}"
            return Requirements(effects, variations.shown(best), model.percent, words)
    is_small = any(law.small_strain for law in variations.matter(config))
    lacking = {"paraboloid": isinstance(config.indenter, Paraboloid), "small_strain": is_small}
    model = _Model(
        tuple(beside[name] for name, lacks in lacking.items() if lacks and beside[name].applies)
    )
    lost = f": {_off(model)}" if model.dropped else ""
    words = f"Model the scene as it is, in time{lost}. {_passed(evolution)}"
    return Requirements(effects, variations.shown(config), model.percent, words)


def _beside(
    evolution: Evolution, rows: Mapping[str, Requirement], within: float
) -> dict[str, Effect]:
    """Other effects of an evolving scene: those of its nearest elastic body, at the depth of its
    largest force.
    """
    if evolution.is_bathed:
        return {name: Effect(name, None, None, None, f"not solved: {BATHED}") for name in rows}
    config = evolution.at_its_depth
    names = ", ".join(limit.name for limit in evolution.nearest)
    bench = _bench(config, resolve(config))
    found = {name: row.effect(bench, within) for name, row in rows.items()}
    return {
        name: replace(one, source=f"{one.source}; of the {names} body, elastic")
        for name, one in found.items()
    }


def _passed(evolution: Evolution) -> str:
    """How far the elastic limits are off the scene, in words."""
    said = [
        f"the {limit.name} body {_beyond(limit)}"
        for effect in evolution.effects
        for limit in limits_of(effect)
    ]
    return (
        f"{BATHED[0].upper()}{BATHED[1:]}."
        if evolution.is_bathed
        else f"Off the scene's force: {', '.join(said)}."
    )


def _beyond(limit: Limit) -> str:
    if limit.percent is None or limit.percent <= -100:
        return "by an unknown part"
    return f"by {100 * (100 / (100 + limit.percent) - 1):+.2g} %"


def _cheapest(
    config: Config, effects: Mapping[str, Effect], passed: tuple[Effect, ...], within: float
) -> tuple[_Model, Config]:
    """The cheapest model within the tolerance, and its scene, else the last that can be run, which
    is the best there is; passed: what the config has left out of the scene.
    """
    model = _Model(dropped=passed)
    best = config
    for candidate in _models(config, effects, passed):
        if runs := candidate.of(config):
            model = candidate
            best = runs
            if candidate.is_within(within):
                break
    return model, best


@dataclass(frozen=True)
class _Model:
    """A model: what it changes of the scene, and the effects that it does without."""

    dropped: tuple[Effect, ...]
    body: str = ""  # one of BODIES; empty: the scene's own
    strain: Callable[[Config], Config] | None = (
        None  # that makes it finite or small; None: as the scene is
    )
    is_sphere: bool = False
    is_smooth: bool = False  # without the friction or the adhesion of the contact law

    @property
    def percent(self) -> float | None:
        """Its force over that with all that it drops, in per cent; None where only a range is
        known.
        """
        if any(effect.percent is None for effect in self.dropped):
            return None
        return float(
            100
            * (np.prod([1 / (1 + (effect.percent or 0.0) / 100) for effect in self.dropped]) - 1)
        )

    def is_within(self, tolerance: float) -> bool:
        """Whether what it drops is less than a relative tolerance, however it adds up where only
        ranges are known.
        """
        sizes = [effect.size for effect in self.dropped]
        if self.percent is not None:  # none of them made good by another alone
            return (
                abs(self.percent) <= 100 * tolerance and max(sizes, default=0.0) <= 100 * tolerance
            )
        return sum(sizes) <= 100 * tolerance

    def of(self, config: Config) -> Config | None:
        """The scene with this model; None where it cannot be run."""
        with suppress(ConfigError):
            config = BODIES[self.body](config) if self.body else config
            if self.body in ENDLESS:  # whose theory has no mesh
                output = dataclasses.replace(config.output, fields="auto")
                usual = {
                    "solver": SolverSettings(),
                    "mesh": MeshSettings(),
                    "contact": AutoContact(),
                }
                config = varied(config, **usual, accuracy=None, output=output)
            if self.is_sphere and isinstance(config.indenter, Paraboloid):
                config = varied(config, indenter=Sphere(config.indenter.R))
            config = varied(config, contact=AutoContact()) if self.is_smooth else config
            config = self.strain(config) if self.strain else config
            resolve(config)
            return config
        return None


def _models(
    config: Config, effects: Mapping[str, Effect], passed: tuple[Effect, ...]
) -> Iterator[_Model]:
    """The models of a scene, from the cheapest on; the last one has every effect that a model can
    have but those that the scene has `passed` over.
    """
    is_finite = not all(layer.material.small_strain for layer in config.layers if layer.material)
    rough = config.contact.path_key
    knows_finite = effects["small_strain"].percent is not None
    is_parabola = isinstance(config.indenter, Paraboloid)
    parts = own_parts(config)
    transforms = [
        effects[name]
        for name, of in EXPERIMENT_PARTS.items()
        if parts & {*of} and effects[name].size > 0
    ]
    must_be_linear = any(effect.size >= effects["small_strain"].size for effect in transforms)
    bodies = (*BODIES, "")
    no_yes = (False, True)
    walls = () if isinstance(config.body, Endless) else ("side_walls",)
    lost = {
        "half_space": ("inclusions", "thickness", *walls),
        "layer": ("inclusions", *walls),
    }  # layers are kept
    for finite, body, sphere, smooth in product(no_yes, bodies, no_yes, (True, False)):
        is_endless = body in ENDLESS and (finite or not smooth)
        is_of_others = (
            (body and not _has(body, config))
            or (sphere and not is_parabola)
            or not (smooth or rough)
        )
        is_unknown = finite and not (knows_finite or is_finite)
        if (
            is_endless or is_of_others or is_unknown or (finite and must_be_linear)
        ):  # as an experiment's curve is
            continue
        names = lost.get(body, ("inclusions",) if body else ())
        without = [
            effects[name]
            for name in (*names, *(["paraboloid"] if is_parabola and not sphere else []))
        ]
        strain = (
            transforms if finite else [effects["small_strain"]] if knows_finite or is_finite else []
        )
        kept = (
            abs(1 + (effects["adhesion"].percent or 0.0) / 100)
            if rough == "adhesion" and not smooth
            else 1.0
        )
        gain = (
            1 / kept if kept else inf
        )  # what is small beside the force with adhesion may not be beside that without
        dropped = [*strain, *(effect.times(gain) for effect in without)]
        dropped += [effects[rough]] if rough and smooth else []
        change = variations.of_finite_strain if finite else variations.of_small_strain
        applying = tuple(effect for effect in dropped if effect.applies)
        yield _Model(
            (*passed, *applying),
            body,
            None if finite == is_finite else change,
            sphere,
            bool(smooth and rough),
        )


def own_parts(config: Config) -> set[str]:
    """What of a scene is made of its curve: parts of its experiment, and its relaxation."""
    parts = {name for name, part in vars(config.experiment or Experiment()).items() if part}
    return parts | {"relaxation" for _, material in config.materials() if material.relaxation}


def _has(body: str, config: Config) -> bool:
    if body == "no inclusions" or (isinstance(config.body, Endless) and body == config.body.shape):
        return bool(config.body.inclusions)
    is_layer = body == "layer" and isinstance(config.body, HalfSpace)
    return isinstance(config.body, Cylinder | Box | Endless) and not is_layer


def _sentence(model: _Model, config: Config, effects: Mapping[str, Effect], within: float) -> str:
    """What to model, in a sentence, and what no model here can tell."""
    body = ENDLESS.get(config.body.shape, "the body as it is")
    body += " without its inclusions" if model.body == "no inclusions" else ""
    strain = (
        "small strain"
        if all(one.small_strain for one in variations.matter(config))
        else "finite strain"
    )
    tip = config.indenter.shape.replace("_", " ")
    kept = config.contact.path_key
    words = f"Model {body} under a {tip} at {strain}, " + (
        f"with its {kept}" if kept else "without friction"
    )
    if not model.is_within(within):
        words += f": {_off(model)}; no model here has all of the effects at once."
    else:
        words += (
            f": {_off(model)}." if model.dropped else ": nothing simpler is within the tolerance."
        )
    own = (
        "friction" if effects["friction"].applies else "stick"
    )  # what may come of any only where there is none
    several = [name for name in (own, *BESIDE_IT) if name != kept and name in effects]
    felt = [
        name
        for name in several
        if effects[name].size > 100 * within and (effects[name].low or effects[name].high)
    ]
    parts = own_parts(config)
    computed = [name for name in felt if parts & set(EXPERIMENT_PARTS.get(name, ()))]
    if computed:
        words += f" Its experiment adds {_listed(computed)}."
    if unknown := [name for name in felt if name not in computed]:
        words += f" Beside it, more than {100 * within:g} % may come of {_listed(unknown)}."
    return words


def _off(model: _Model) -> str:
    """How far a model is off, in words."""
    return (
        "that is off by less than the tolerance"
        if model.percent is None
        else f"that is off by {model.percent:+.2g} %"
    )


def _listed(names: list[str]) -> str:
    return ", ".join(names).replace("_", " ")
