"""What a scene requires: its effects, and the cheapest model of it within a tolerance."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from itertools import product
from math import inf

import numpy as np

from indent_sim.config.file import located, to_mapping
from indent_sim.config.schema import Config
from indent_sim.model.body import Box, Cylinder, Endless, HalfSpace
from indent_sim.model.tips import Paraboloid
from indent_sim.process.errors import ConfigError
from indent_sim.run.requirements.bench import Bench
from indent_sim.run.requirements.effects import Effect, Effects
from indent_sim.run.requirements.sections import Document, half_space_of, is_small, of_strain, usual
from indent_sim.scene.given import with_used_material
from indent_sim.scene.scene import resolve

OF_A_MESH = {"solver", "mesh", "contact", "accuracy"}  # sections that a scene without a mesh does without
OF_EXPERIMENT = {"adhesion": {"adhesion"}, "rate": {"relaxation"}, "cantilever": {"cantilever", "frame"}}


@dataclass(frozen=True)
class Requirements:
    """The effects, and the cheapest model that is within a tolerance: its config, and by how many per cent its force is
    off that with all effects it could have; None where only a range is known."""

    effects: tuple[Effect, ...]
    config: Document
    percent: float | None
    words: str

    def as_json(self) -> Document:
        """The requirements as one JSON object."""
        effects = [dataclasses.asdict(effect) for effect in self.effects]
        return {"effects": effects, "recommended": {"config": self.config, "percent": self.percent},
                "words": self.words}  # fmt: skip


def require(config: Config, within: float = 0.01) -> Requirements:
    """What a scene requires for a force within a relative tolerance; nothing is written.

    Raises ConfigError for a scene that cannot be run or never touches the body, BackendError without a solver.
    """
    try:
        scene = resolve(config)
        config = with_used_material(config, scene.physics.part)
        bench = Bench(config, scene)
    except ConfigError as error:
        raise located(config, error) from None
    with np.errstate(all="ignore"):  # theories try depths beyond a tip's end
        effects = Effects(bench, within).all()
    found = {effect.name: effect for effect in effects}
    model, document = _Model(dropped=()), usual(to_mapping(config))
    for candidate in _models(config, found):
        if runs := candidate.document(bench):  # the last one that does is the best there is
            model, document = candidate, runs
            if candidate.is_within(within):
                break
    return Requirements(tuple(effects), document, model.percent, _sentence(model, document, found, within))


@dataclass(frozen=True)
class _Model:
    """A model: what it changes of the scene, and the effects that it does without."""

    dropped: tuple[Effect, ...]
    body: str = ""  # half_space | layer; empty: the scene's own
    is_finite: bool | None = None  # None: as the scene is
    is_sphere: bool = False
    is_smooth: bool = False  # without the friction or the adhesion of the contact law

    @property
    def percent(self) -> float | None:
        """Its force over that with all that it drops, in per cent; None where only a range is known."""
        if any(effect.percent is None for effect in self.dropped):
            return None
        return float(100 * (np.prod([1 / (1 + (effect.percent or 0.0) / 100) for effect in self.dropped]) - 1))

    def is_within(self, tolerance: float) -> bool:
        """Whether what it drops is less than a relative tolerance, however it adds up where only ranges are known."""
        sizes = [effect.size for effect in self.dropped]
        if self.percent is not None:  # none of them made good by another alone
            return abs(self.percent) <= 100 * tolerance and max(sizes, default=0.0) <= 100 * tolerance
        return sum(sizes) <= 100 * tolerance

    def document(self, bench: Bench) -> Document | None:
        """The scene with this model; None where it cannot be run."""
        config = bench.config
        found = to_mapping(config)
        if self.body:
            found["body"] = bench.without_sides() if self.body == "layer" else half_space_of(found["body"])
            found["indenter"].pop("center", None)
            found = {key: value for key, value in found.items() if key not in OF_A_MESH}
            found["output"]["fields"] = "auto"
        if self.is_sphere:
            found["indenter"]["shape"] = "sphere"
        if self.is_smooth:
            found["contact"] = {"method": "auto"}
        if self.is_finite is not None:
            found = of_strain(found, self.is_finite)
        document = usual(found)
        with suppress(ConfigError):
            resolve(bench.beside(document))
            return document
        return None


def _models(config: Config, found: Mapping[str, Effect]) -> Iterator[_Model]:
    """The models of a scene, from the cheapest on; the last one has every effect that a model can have."""
    is_finite = not all(layer.material.small_strain for layer in config.layers if layer.material)
    contact = "stick" if getattr(config.contact, "friction", 0.0) else "adhesion" if config.contact.adhesion else ""
    knows_finite = found["small_strain"].percent is not None
    is_parabola = isinstance(config.indenter, Paraboloid)
    names = ("adhesion", "rate", "cantilever") if config.experiment else ()
    transforms = [found[name] for name in names if found[name].size > 0]
    must_be_linear = any(effect.size >= found["small_strain"].size for effect in transforms)
    bodies, no_yes = ("half_space", "layer", ""), (False, True)
    for finite, body, sphere, smooth in product(no_yes, bodies, no_yes, (True, False)):
        if (body and (finite or not smooth or not _has(body, config))) or (sphere and not is_parabola):
            continue
        if finite and must_be_linear:  # no curve at finite strain determines an experiment
            continue
        if (finite and not knows_finite and not is_finite) or not (smooth or contact):
            continue
        without = [*_of_body(body, config, found), *([found["paraboloid"]] if is_parabola and not sphere else [])]
        dropped = (
            *(transforms if finite else [found["small_strain"]] if knows_finite or is_finite else []),
            *(effect.times(_gain(found) if contact == "adhesion" and not smooth else 1.0) for effect in without),
            *([found[contact]] if contact and smooth else []),
        )
        changes = None if finite == is_finite else finite
        yield _Model(tuple(e for e in dropped if e.applies), body, changes, sphere, bool(smooth and contact))


def _gain(found: Mapping[str, Effect]) -> float:
    """The force without adhesion over that with it: what is small beside the one may not be beside the other."""
    kept = abs(1 + (found["adhesion"].percent or 0.0) / 100)
    return 1 / kept if kept else inf


def _has(body: str, config: Config) -> bool:
    """Whether a scene can be that of an endless body."""
    if config.body.inclusions or not isinstance(config.body, Cylinder | Box | Endless):
        return False
    if isinstance(config.body, Endless) and body == config.body.shape:
        return False
    return not (body == "layer" and isinstance(config.body, HalfSpace))


def _of_body(body: str, config: Config, found: Mapping[str, Effect]) -> list[Effect]:
    """The effects that an endless body does without: its layers it keeps."""
    sides = [] if isinstance(config.body, Endless) else [found["side_walls"]]
    return [*([found["thickness"]] if body == "half_space" else []), *sides] if body else []


def _sentence(model: _Model, document: Document, found: Mapping[str, Effect], within: float) -> str:
    """What to model, in a sentence, and what no model here can tell."""
    body = {"half_space": "a half-space", "layer": "an infinitely wide layer"}.get(document["body"]["shape"],
                                                                                 "the body as it is")  # fmt: skip
    strain = "small strain" if is_small(document) else "finite strain"
    tip = document["indenter"]["shape"].replace("_", " ")
    kept = [name for name in ("friction", "adhesion") if document.get("contact", {}).get(name)]
    off = "by less than the tolerance" if model.percent is None else f"by {model.percent:+.2g} %"
    words = f"Model {body} under a {tip} at {strain}, {f'with its {kept[0]}' if kept else 'without friction'}"
    if not model.is_within(within):
        words += f": that is off {off}; no model here has all of the effects at once."
    else:
        words += f": that is off {off}." if model.dropped else ": nothing simpler is within the tolerance."
    held = {"stick" if name == "friction" else name for name in kept}
    beside = [name for name in ("stick", "rate", "adhesion", "cantilever", "calibration") if name not in held
              and found[name].size > 100 * within and (found[name].low or found[name].high)]  # fmt: skip
    computed = [name for name in beside if OF_EXPERIMENT.get(name, set()) & (document.get("experiment") or {}).keys()]
    if computed:
        words += f" Its experiment adds {_listed(computed)}."
    if unknown := [name for name in beside if name not in computed]:
        words += f" Beside it, more than {100 * within:g} % may come of {_listed(unknown)}."
    return words


def _listed(names: list[str]) -> str:
    return ", ".join(names).replace("_", " ")
