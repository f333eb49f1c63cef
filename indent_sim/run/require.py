"""What a scene requires: every effect that a model may leave out in per cent of the force, and the cheapest model.

An effect is 100 (force with it / force without it - 1) at the deepest row, both at one depth and both forces of scenes
that this program solves: by theory where it is exact, else on one mesh, whose error is in both. What the scene has no
parameter of is said as the value from which on it matters.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import atan, degrees, hypot, inf, isfinite, log, nan, radians, tan
from typing import Any

import numpy as np

from indent_sim.config.file import from_mapping, located, to_mapping, varied
from indent_sim.config.schema import Config, Source
from indent_sim.model.body import Ball, Box, Cap, Cylinder, Endless, HalfSpace, MeshFromFile, Strip
from indent_sim.model.tips import Cone, FlatPunch, Indenter, Paraboloid, Plate, Profile, RegularPyramid, Sphere
from indent_sim.process.errors import BackendError, ConfigError, IndentSimError
from indent_sim.run.chain import states
from indent_sim.run.experiment import modulus_of
from indent_sim.run.readings import hertz_force
from indent_sim.scene.given import remaining
from indent_sim.scene.scene import Scene, resolve
from indent_sim.scene.theories import relative_tip
from indent_sim.theory.layer import Layer
from indent_sim.theory.roots import increasing_root
from indent_sim.theory.surface.adhesion import Jkr, tabor
from indent_sim.theory.surface.punches import LayerPunches
from indent_sim.theory.surface.relaxation import ElasticCurve, OneCycle

Document = dict[str, Any]  # a scene as nested mappings, shaped like its file

FARTHEST = 1e6  # times where a search for a threshold begins
ENOUGH_STEPS = 20  # of a path with friction: its force is good to 0.1 % then
MARGIN = 0.1  # per cent by which a range is wider than half of itself to either side
NEAR = 0.9  # of the deepest depth: where a second force says how steep the curve is
VARIED = 0.02  # relative change of R that says how the force grows with it
WIDER, TINY = 1e-3, 1e-6  # of a contact with adhesion, where its search begins; of the depth, instead of one below 0
SAMPLES = 60  # of an elastic curve
DEFAULTED = ("units", "contact", "mesh", "solver", "output")  # sections left out of a scene where all is as usual
ANY_SCENE: Document = {"body": {"shape": "half_space"}, "material": {"model": "linear_elastic", "E": 1.0, "nu": 0.0},
                       "indenter": {"shape": "sphere", "R": 1.0}, "loading": {"delta": 0.1}}  # fmt: skip
OF_A_MESH = {"solver", "mesh", "contact", "accuracy"}  # sections that a scene without a mesh does without


@dataclass(frozen=True)
class Effect:
    """What an effect does to the force [per cent]: between low and high, and the number itself where it is one.

    source: where that comes from; needs: the value of a parameter that the scene lacks from which on it matters.
    """

    name: str
    percent: float | None
    low: float | None
    high: float | None
    source: str
    needs: str = ""

    @property
    def size(self) -> float:
        """The largest change that is possible [per cent]; infinite where nothing is known."""
        known = [abs(one) for one in (self.percent, self.low, self.high) if one is not None]
        return max(known) if known else 0.0 if self.needs else inf

    @property
    def applies(self) -> bool:
        """Whether the scene could have the effect at all."""
        return bool(self.percent != 0.0 or self.needs or self.low or self.high)


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
        bench = _Bench(config, resolve(config))
    except ConfigError as error:
        raise located(config, error) from None
    with np.errstate(all="ignore"):  # theories try depths beyond a tip's end
        effects = _Effects(bench, within).all()
    found = {effect.name: effect for effect in effects}
    model, document = _Model(dropped=()), _usual(to_mapping(config))
    for candidate in _models(config, found):
        if runs := candidate.document(bench):  # the last one that does is the best there is
            model, document = candidate, runs
            if candidate.is_within(within):
                break
    return Requirements(tuple(effects), document, model.percent, _sentence(model, document, found, within))


class _Bench:
    """The forces of a scene and of its variations at the deepest row, in the user's units.

    `plain` is the scene without friction, at small strain and on a round body where its own would have to be meshed in
    three dimensions; each variation changes sections of it.
    """

    def __init__(self, config: Config, scene: Scene):
        self.config, self.scene = config, scene
        self.delta = max(scene.physics.deltas[-1], *scene.physics.deltas, scene.asked) * scene.physics.scales.depth
        if self.delta <= 0:
            raise ConfigError("loading", "never presses the tip into the body: no force depends on anything",
                              "give a depth > 0")  # fmt: skip
        self.tip, self.is_cone = _round_tip(config.indenter)
        self._forces: dict[str, float | None] = {}

    @cached_property
    def materials(self) -> list[Any]:
        """The materials of the layers from the top."""
        return [layer.material.canonical() for layer in self.config.layers if layer.material]

    @property
    def is_isotropic(self) -> bool:
        return bool(self.materials) and all(material.is_isotropic for material in self.materials)

    @cached_property
    def walls(self) -> tuple[str, ...]:
        """How the sides of the body, or of its round stand-ins, are held; empty where there are none."""
        match self.config.body:
            case Cylinder(sides=sides):
                return (sides,) if sides != "roller" or not self.is_stood_for else ("free", "fixed")
            case Box(sides=sides):
                held = {sides.x_min, sides.x_max, sides.y_min, sides.y_max}
                return (held.pop(),) if held in ({"free"}, {"fixed"}) else ("free", "fixed")
        return ()

    @property
    def is_stood_for(self) -> bool:
        """Whether a cylinder up to its nearest side stands for the body."""
        body = self.config.body
        return isinstance(body, Box) or (isinstance(body, Cylinder) and any(self.config.center or ()))

    @cached_property
    def is_solvable(self) -> bool:
        """Whether the body, or its stand-in, is solved in the plane."""
        return not (isinstance(self.config.body, MeshFromFile) and self.config.body.kinematics == "3d")

    @cached_property
    def plain(self) -> Document:
        document = to_mapping(self.config)
        body = self.body(self.walls[0] if self.walls else "")
        tip = _as_section(self.tip)
        if isinstance(self.config.body, Strip | MeshFromFile) and self.config.center is not None:
            tip["center"] = list(self.config.center)
        found = {"body": body, "indenter": tip, "loading": {"delta": self.delta, "steps": 1}}
        if "material" in document:
            found["material"] = _small(document["material"])
        return found

    def body(self, sides: str = "", **changes: Any) -> Document:
        """The body's section; one that only a mesh in three dimensions has is a cylinder up to its nearest side."""
        body = self.config.body
        own: Document = to_mapping(self.config)["body"]
        if isinstance(body, Box | Cylinder):
            rim = body.rim_distance(self.config.center or body.center)
            kept = {key: own[key] for key in ("base", "layers", "inclusions") if own.get(key)}
            height = body.height
            own = {"shape": "cylinder", "radius": rim, "height": height, "sides": sides, **kept}
            if self.is_stood_for:  # inclusions have their place in the whole
                own.pop("inclusions", None)
        return {key: value for key, value in _each_small(own | changes).items() if value is not None}

    def without_sides(self) -> Document | None:
        """The layer that the body is without its sides; None for one that is no layer."""
        own = self.plain["body"]
        if isinstance(self.config.body, HalfSpace):
            return _half_space(own)
        if "height" not in own or own["shape"] not in ("cylinder", "layer"):
            return None
        return {"shape": "layer"} | {key: own[key] for key in ("height", "base", "layers") if own.get(key)}

    # ---- forces --------------------------------------------------------------------------------------------------

    def force(self, **changes: Any) -> float | None:
        """Force of the plain scene with some sections replaced; None where there is none."""
        if not self.is_solvable and (changes.get("body") or self.plain["body"])["shape"] == "mesh":
            return None
        document = {key: value for key, value in (self.plain | changes).items() if value is not None}
        name = json.dumps(document, sort_keys=True)
        if name not in self._forces:
            self._forces[name] = self._solved(document)
        return self._forces[name]

    def _solved(self, document: Document) -> float | None:
        try:
            *_, last = states(self.resolved(document), with_surface=False)
        except BackendError:
            raise
        except (IndentSimError, ArithmeticError, ValueError):
            return None
        return last.force if last.converged and last.force > 0 else None

    def resolved(self, document: Document) -> Scene:
        """The scene of a document, its theory used wherever that is exact."""
        if not {"mesh", "contact"} & document.keys():
            with suppress(ConfigError):
                return resolve(self.beside(document | {"solver": {"method": "theory"}}))
        return resolve(self.beside(document))

    def beside(self, document: Document) -> Config:
        """The config of a document that stands where the scene's file does."""
        return varied(document, Source(self.config.source.name), ())

    @cached_property
    def own(self) -> float:
        """Force of the plain scene."""
        found = self.force()
        if found is None:
            return nan
        return found

    @cached_property
    def on_mesh(self) -> Document:
        """Sections that have a variation solved on one mesh, whatever theory knows."""
        document = self.plain | {"contact": {"method": "augmented_lagrangian"}}
        scene = resolve(self.beside(document))
        h = scene.sizes.h_contact * scene.physics.scales.length
        if isinstance(self.config.body, MeshFromFile):
            return {"contact": document["contact"]}
        return {"contact": document["contact"], "mesh": {"h_contact": h}}

    def ratio(self, with_it: Document, without: Document | None = None) -> float | None:
        """Force with some sections replaced over that with others."""
        above, below = self.force(**with_it), self.force(**(without or {}))
        return above / below if above and below else None

    @cached_property
    def known(self) -> Scene | None:
        """The scene nearest to this one whose contact is theory's."""
        for body in (self.plain["body"], self.without_sides(), _half_space(self.plain["body"])):
            if body is None:
                continue
            with suppress(ConfigError):
                scene = self.resolved(self.plain | {"body": body})
                if scene.plan.theory is not None:
                    return scene
        return None

    @cached_property
    def power(self) -> float:
        """d ln F/d ln delta at the deepest row."""
        before = self.force(loading={"delta": NEAR * self.delta, "steps": 1})
        return log(self.own / before) / -log(NEAR) if before else nan

    def along(self, delta: float) -> float:
        """Force at a depth: theory's curve, drawn through the deepest force; a power law where there is none."""
        if self.known is not None and self.known.plan.theory is not None:
            unit, theory = self.known.physics.scales.depth, self.known.plan.theory
            here, deep = theory.at(delta / unit), theory.at(self.delta / unit)
            if here and deep:
                return self.own * here.force / deep.force
        return float(self.own * (delta / self.delta) ** self.power)


class _Effects:
    """The effects on one scene."""

    def __init__(self, bench: _Bench, within: float):
        self.bench, self.within = bench, within
        self.from_percent = f"above {100 * within:g} % from"

    def all(self) -> list[Effect]:
        """All of them, by name."""
        return [getattr(self, f"_{name}")(name) for name in NAMES]

    # ---- ways to say an effect -----------------------------------------------------------------------------------

    def _by(self, name: str, ratio: float | None, source: str, needs: str = "") -> Effect:
        if ratio is None or not isfinite(ratio):
            return Effect(name, None, None, None, f"not solved: {source}", needs)
        percent = 100 * (ratio - 1)
        return Effect(name, percent, percent, percent, source, needs)

    def _none(self, name: str, why: str) -> Effect:
        return Effect(name, 0.0, 0.0, 0.0, why)

    def _from(self, name: str, key: str, value: float | None, source: str, side: str = "", digits: int = 2) -> Effect:
        """That only a parameter is known, from which on the effect is telling."""
        if value is None or not isfinite(value):
            return Effect(name, None, None, None, source, f"{key}: below {100 * self.within:g} % whatever it is")
        return Effect(name, None, None, None, source, f"{self.from_percent} {key} = {value:.{digits}g}{side}")

    def _threshold(self, change: Callable[[float], float | None], start: float) -> float | None:
        """The parameter at which a change that grows with it is as large as the tolerance."""

        def size(x: float) -> float:
            ratio = change(x)
            if ratio is None:
                raise ArithmeticError
            return max(abs(ratio - 1), 1e-300)

        with suppress(ValueError, ArithmeticError), np.errstate(all="ignore"):
            return increasing_root(lambda x: size(x) / self.within, 1.0, start, FARTHEST * start)
        return None

    @property
    def _how(self) -> str:
        """What stands for the scene, in words."""
        stands = [*(["a cylinder up to the nearest side"] if self.bench.is_stood_for else []),
                  *(["the cone of equal sections"] if self.bench.is_cone else [])]  # fmt: skip
        return f" ({', '.join(stands)} for it)" if stands else ""

    # ---- the tip -------------------------------------------------------------------------------------------------

    def _paraboloid(self, name: str) -> Effect:
        tip = self.bench.config.indenter
        if not isinstance(tip, Paraboloid | Sphere):
            return self._none(name, f"a {tip.shape.replace('_', ' ')} is no sphere")
        ball, parabola = ({"indenter": self._tip(shape=shape, R=tip.R)} for shape in ("sphere", "paraboloid"))
        return self._by(name, self.bench.ratio(ball, parabola), f"a sphere over a paraboloid{self._how}")

    def _tip(self, **fields: Any) -> Document:
        center = self.bench.plain["indenter"].get("center")
        return fields | ({"center": center} if center is not None else {})

    def _blunt_tip(self, name: str) -> Effect:
        tip = self.bench.tip
        key = "edge_radius" if isinstance(tip, FlatPunch) else "tip_radius"
        if not hasattr(tip, key):
            return self._none(name, f"a {tip.shape} has neither apex nor edge")
        sharp = self._with_radius(tip, key, 0.0)
        if getattr(tip, key) > 0:
            return self._by(name, self.bench.ratio({}, sharp), f"the rounded tip over the sharp one{self._how}")
        body = self._theory_body
        if isinstance(tip, Profile) or body is None:
            return Effect(name, None, None, None, "no theory of this tip and body")
        found = self._threshold(lambda x: self.bench.ratio(self._with_radius(tip, key, x) | body, sharp | body),
                                0.1 * self.bench.delta)  # fmt: skip
        return self._from(name, f"indenter.{key}", found, f"theory{self._how}")

    def _with_radius(self, tip: Indenter, key: str, radius: float) -> Document:
        return {"indenter": self._tip(**_as_section(tip) | {key: radius})}

    @property
    def _theory_body(self) -> Document | None:
        """The body of the nearest scene that theory solves."""
        for body in (self.bench.plain["body"], self.bench.without_sides(), _half_space(self.bench.plain["body"])):
            with suppress(ConfigError):
                if body and not self.bench.resolved(self.bench.plain | {"body": body}).is_meshed:
                    return {"body": body}
        return None

    # ---- the body ------------------------------------------------------------------------------------------------

    def _thickness(self, name: str) -> Effect:
        bench, body = self.bench, self.bench.config.body
        if isinstance(body, Strip) or bench.scene.physics.scales.dim == 2:
            words = "in plane strain a half-space has no depth: the thickness always decides"
            return Effect(name, None, None, None, words)
        if isinstance(body, HalfSpace):
            return self._thickness_from(name)
        layer = bench.without_sides()
        if layer is None:
            return self._by(name, self._over_half_space(), f"the body as it is over a half-space{self._how}")
        return self._by(name, bench.ratio({"body": layer}, {"body": _half_space(layer)}),
                        f"theory of a layer over that of a half-space{self._how}")  # fmt: skip

    def _over_half_space(self) -> float | None:
        scene = self.bench.resolved(self.bench.plain) if self.bench.is_solvable else self.bench.scene
        if isinstance(self.bench.config.body, Cap | Ball | MeshFromFile) and isfinite(self.bench.own):
            closed = hertz_force(scene, self.bench.delta / scene.physics.scales.depth)
            return self.bench.own / (closed * scene.physics.scales.force) if closed else None
        return None

    def _thickness_from(self, name: str) -> Effect:
        bench = self.bench
        if bench.config.body.layers:
            return self._none(name, "the last layer is a half-space")
        whole = {"body": _half_space(bench.plain["body"])}
        unit = bench.scene.physics.indenter.radius_at(1.0 * bench.scene.physics.deltas[-1])
        a = unit * bench.scene.physics.scales.length
        layer = lambda h: {"body": {"shape": "layer", "height": h, "base": "fixed"}}  # noqa: E731
        found = self._threshold(lambda x: bench.ratio(layer(1 / x), whole), 0.05 / a)
        return self._from(name, "body.height", found and 1 / found, "theory of a layer on a rigid base", " down")

    def _side_walls(self, name: str) -> Effect:
        bench, body = self.bench, self.bench.config.body
        if isinstance(body, HalfSpace):
            return self._none(name, "a half-space has no sides")
        if isinstance(body, Endless):
            return self._walls_from(name)
        if isinstance(body, Strip):
            return self._walls_of_strip(name)
        layer = bench.without_sides()
        if layer is None:
            return self._none(name, "in the row of the thickness, which takes the body as it is")
        found = [self._walled(sides, layer) for sides in bench.walls]
        if any(ratio is None for ratio in found):
            return Effect(name, None, None, None, "the body with its sides was not solved")
        if not bench.is_stood_for:
            return self._by(name, found[0], f"the body with its sides over a layer without{self._how}")
        low, high = (100 * (f(1.0, *filter(None, found)) - 1) for f in (min, max))
        words = f"between none and {' or '.join(bench.walls)} sides all around at the distance of the nearest"
        return Effect(name, None, low, high, words)

    def _walled(self, sides: str, layer: Document) -> float | None:
        """Force with sides over that without: by theory for rollers, from which others differ on one mesh."""
        bench = self.bench
        with_them, rollers = ({"body": bench.body(one, inclusions=None)} for one in (sides, "roller"))
        same = bench.ratio(rollers, {"body": layer})
        if sides == "roller" or same is None:
            return same
        other = bench.ratio(with_them | bench.on_mesh, rollers | bench.on_mesh)
        return same * other if other else None

    def _walls_from(self, name: str) -> Effect:
        bench = self.bench
        own = bench.plain["body"]
        kept = {key: own[key] for key in ("height", "base", "layers") if own.get(key)}
        walled = lambda W: {"body": {"shape": "cylinder", "radius": W, "sides": "roller"} | kept}  # noqa: E731
        found = self._threshold(lambda x: bench.ratio(walled(1 / x), {"body": own}), 0.3 / own["height"])
        return self._from(name, "a frictionless wall at radius", found and 1 / found, "theory of both", " or nearer")

    def _walls_of_strip(self, name: str) -> Effect:
        bench = self.bench
        own = dict(bench.plain["body"])
        wide = own | {"width": 2 * own["width"] + 20 * own["height"], "sides": "roller"}
        wide.pop("inclusions", None)
        middle = {"indenter": {k: v for k, v in bench.plain["indenter"].items() if k != "center"}}
        return self._by(name, bench.ratio({}, {"body": wide} | middle), "the strip over one with its walls far away")

    def _substrate(self, name: str) -> Effect:
        bench, body = self.bench, self.bench.config.body
        layer = bench.without_sides()
        if isinstance(body, HalfSpace) and not body.layers:
            return self._none(name, "there is nothing below a half-space")
        if layer is None or bench.scene.physics.scales.dim == 2:
            return self._none(name, "this body stands on something rigid; theory knows none that gives way")
        if len(bench.materials) > 1:
            alone = {"shape": "half_space", "layers": [{"material": _small(_as_section(bench.materials[0]))}]}
            return self._by(name, bench.ratio({"body": layer}, {"body": alone, "material": None}),
                            f"theory of all layers over that of the first as a half-space{self._how}")  # fmt: skip
        return self._substrate_from(name, layer)

    def _substrate_from(self, name: str, layer: Document) -> Effect:
        """How soft what carries a layer must be to be felt; with the layer's own Poisson ratio."""
        bench, (E, nu) = self.bench, self.bench.materials[0].constants
        if not bench.is_isotropic or layer.get("base", "fixed") != "fixed":
            return self._none(name, "theory knows no half-space below such a layer")
        film = {"model": "linear_elastic", "E": E, "nu": nu}

        def on(stiffness: float) -> Document:
            below = {"model": "linear_elastic", "E": stiffness * E, "nu": 0.3}
            thickness = layer["height"]
            plies = [{"thickness": thickness, "material": film}, {"material": below}]
            return {"body": {"shape": "half_space", "layers": plies}, "material": None}

        found = self._threshold(lambda x: bench.ratio(on(1e3 / x), {"body": layer}), 1.0)
        value = found and 1e3 / found * E
        return self._from(name, "a substrate of E", value, "theory of a film on a half-space of nu = 0.3", " down")

    # ---- the material --------------------------------------------------------------------------------------------

    def _small_strain(self, name: str) -> Effect:
        bench = self.bench
        if not bench.is_isotropic:
            return Effect(name, None, None, None, "no law of finite strain is anisotropic")
        if not bench.is_solvable:
            return Effect(name, None, None, None, "nothing solved in the plane stands for it")
        finite = _with_matter(bench, _finite)
        with_it = finite | bench.on_mesh | {"contact": bench.on_mesh["contact"] | {"gap": "current"}}
        law = "its own law" if not bench.scene.physics.small_strain else "neo-Hookean"
        source = f"{law}, gap: current, over small strain, gap: reference, on one mesh{self._how}"
        return self._by(name, bench.ratio(with_it, bench.on_mesh), source)

    def _incompressible(self, name: str) -> Effect:
        bench = self.bench
        if not bench.is_isotropic:
            return Effect(name, None, None, None, "the material is not isotropic")
        if all(material.constants.nu == 0.5 for material in bench.materials):
            body = self._theory_body
            if body is None:
                return Effect(name, None, None, None, "no theory of this body")
            small = lambda x: _with_matter(bench, lambda own: own | {"nu": 0.5 - x}, body["body"])  # noqa: E731
            found = self._threshold(lambda x: bench.ratio(body, small(min(x, 0.5))), 0.01)
            return self._from(name, "nu", found and 0.5 - found, f"theory{self._how}", " down", digits=4)
        still = _with_matter(bench, lambda own: own | {"nu": 0.5})
        return self._by(name, bench.ratio(still), f"nu = 0.5 at the same E{self._how}")

    # ---- the contact ---------------------------------------------------------------------------------------------

    def _stick(self, name: str) -> Effect:
        bench = self.bench
        friction = getattr(bench.config.contact, "friction", 0.0) or "stick"
        words = "no slip" if friction == "stick" else f"friction {friction:g}"
        if known := bench.scene.plan.friction:
            percent = 100 * (known.force - 1)
            return Effect(name, percent, percent, percent, f"{words}: half-space, exact")
        said = bench.scene.plan.stick if friction == "stick" else None
        if said and said.percent is not None:
            return Effect(name, said.percent, said.low, said.high, f"no slip: {said.source}")
        if said:
            wider = (said.high - said.low) / 2 + MARGIN
            return Effect(name, None, said.low - wider, said.high + wider, f"no slip: {said.source}")
        if not bench.is_solvable:
            return Effect(name, None, None, None, "nothing solved in the plane stands for it")
        rough = {"contact": bench.on_mesh["contact"] | {"friction": friction},
                 "loading": {"delta": bench.delta, "steps": ENOUGH_STEPS}}  # fmt: skip
        return self._by(name, bench.ratio(bench.on_mesh | rough, bench.on_mesh), f"{words} on one mesh{self._how}")

    def _adhesion(self, name: str) -> Effect:
        bench, scene = self.bench, self.bench.known
        if isinstance(bench.tip, FlatPunch | Plate) and not isinstance(bench.config.body, Cap | Ball):
            return self._none(name, "a flat punch touches the same disc with adhesion as without")
        contact = scene.plan.theory.contact if scene is not None and scene.plan.theory else None
        if scene is None or not isinstance(contact, Layer):
            return Effect(name, None, None, None, "the JKR limit is that of a disc")
        scales, punches = scene.physics.scales, LayerPunches(contact)
        unit, delta = scales.pressure * scales.length, bench.delta / scales.depth
        alone = contact.curve([delta])[0].force

        def pulled(work: float) -> float | None:
            jkr, a = Jkr(punches, work / unit), contact.curve([delta])[0].a
            with suppress(ValueError, ArithmeticError):  # the stable contact is the one wider than without adhesion
                wider = increasing_root(lambda x: max(jkr.at(x).delta, TINY * delta), delta, a * (1 + WIDER),
                                        punches.largest)  # fmt: skip
                return jkr.at(wider).force / alone
            return None

        given = bench.config.experiment.adhesion if bench.config.experiment else None
        if given is None:
            start = 0.01 * self.within * alone * unit / contact.curve([delta])[0].a
            return self._from(name, "work", self._threshold(pulled, start), f"the JKR limit{self._how}")
        beside = self._pull_off(given, punches, unit, alone)
        return self._by(name, pulled(given.work), f"the JKR limit{beside}{self._how}")

    def _pull_off(self, given: Any, punches: LayerPunches, unit: float, alone: float) -> str:
        """Pull-off over the largest force, and the Tabor number, in words."""
        words = ""
        with suppress(ValueError, ArithmeticError):
            words = f", pull-off {Jkr(punches, given.work / unit).pull_off(inf).force / alone:.2g} of this force"
        tip = relative_tip(self.bench.config.indenter, self.bench.scene.physics.body)
        if given.range is not None and hasattr(tip, "R"):
            number = tabor(given.work, given.range, tip.R, self.bench.materials[0].E_star)
            words += f", Tabor number {number:.2g}"
        return words

    # ---- time and instrument -------------------------------------------------------------------------------------

    def _rate(self, name: str) -> Effect:
        experiment = self.bench.config.experiment
        law = experiment.relaxation if experiment else None
        if experiment is None or law is None:
            needs = "a fraction of the modulus that relaxes before the deepest point"
            return self._from(name, needs, self.within, "Lee & Radok: the force falls by that fraction at most")
        if not experiment.history or experiment.is_stepped:
            least = -100 * (1 - remaining(experiment)) if experiment.points or law.prony else None
            return Effect(name, None, least, 0.0, "between the instantaneous and the last modulus")
        t, top = max(experiment.history, key=lambda point: (point[1], -point[0]))
        depths = np.geomspace(1e-4, 1.001, SAMPLES) * top
        forces = np.array([self.bench.along(float(depth)) for depth in depths])
        curve = ElasticCurve(depths, forces, np.sqrt(depths))
        points = experiment.history if experiment.history[0][1] <= 0 else ((experiment.history[0][0], 0.0),
                                                                         *experiment.history)  # fmt: skip
        times, values = zip(*points, strict=True)
        with suppress(ValueError, ArithmeticError):
            found = OneCycle(modulus_of(law), times, values, curve).at(t)
            return self._by(name, found.force / float(curve.force(np.array(top))), f"Lee & Radok{_deborah(law, t)}")
        return self._by(name, None, "this history")

    def _cantilever(self, name: str) -> Effect:
        bench, experiment = self.bench, self.bench.config.experiment
        force = bench.own
        if experiment is not None and experiment.compliance > 0:
            soft = experiment.compliance
            depth = increasing_root(lambda d: d + soft * bench.along(d), bench.delta, 0.5 * bench.delta,
                                    1.01 * bench.delta)  # fmt: skip
            return self._by(name, bench.along(depth) / force, "the way of the base taken for the depth")
        if not isfinite(force):
            return Effect(name, None, None, None, "the scene was not solved")
        depth = self._depth_of(1 - self.within)
        stiffness = (1 - self.within) * force / (bench.delta - depth)
        return self._from(name, "stiffness", stiffness, "the way of the base taken for the depth", " down")

    def _contact_point(self, name: str) -> Effect:
        if not isfinite(self.bench.own):
            return Effect(name, None, None, None, "the scene was not solved")
        offset = self.bench.delta - self._depth_of(1 - self.within)
        return self._from(name, "an error of the depth", offset, "the curve's own slope")

    def _depth_of(self, share: float) -> float:
        """The depth at which the force is a share of the deepest one."""
        bench = self.bench
        start = bench.delta * share ** (2 / 3)
        return increasing_root(lambda d: bench.along(d) / bench.own, share, start, 1.01 * bench.delta)

    def _calibration(self, name: str) -> Effect:
        experiment = self.bench.config.experiment
        given = experiment.calibration if experiment else None
        steep, source = self._of_radius()
        if given is None:
            R = f" or R = {self.within / steep:.2g}" if steep else ""
            needs = f"{self.from_percent} calibration.stiffness = {self.within:.2g}{R}"
            return Effect(name, None, None, None, source, needs)
        percent = 100 * hypot(given.stiffness, steep * given.R)
        return Effect(name, None, -percent, percent, source)

    def _of_radius(self) -> tuple[float, str]:
        """d ln F/d ln R of a tip that has one, and what the force owes to an uncertain instrument."""
        tip, words = self.bench.tip, "an error of the spring is one of the force"
        if not isinstance(tip, Paraboloid | Sphere) or not isfinite(self.bench.own):
            return 0.0, words
        ratio = self.bench.ratio({"indenter": self._tip(shape=tip.shape, R=(1 + VARIED) * tip.R)})
        steep = log(ratio) / log(1 + VARIED) if ratio else 0.5
        return steep, f"{words}; force ~ R^{steep:.2g}"


NAMES = ("paraboloid", "thickness", "side_walls", "substrate", "small_strain", "incompressible", "blunt_tip", "stick",
         "adhesion", "rate", "cantilever", "contact_point", "calibration")  # fmt: skip


# ---- the cheapest model ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Model:
    """A model: what it changes of the scene, and the effects that it does without."""

    dropped: tuple[Effect, ...]
    body: str = ""  # half_space | layer; empty: the scene's own
    is_finite: bool | None = None  # None: as the scene is
    is_sphere: bool = False
    is_smooth: bool = False

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

    def document(self, bench: _Bench) -> Document | None:
        """The scene with this model; None where it cannot be run."""
        config = bench.config
        found = to_mapping(config)
        if self.body:
            found["body"] = bench.without_sides() if self.body == "layer" else _half_space(found["body"])
            found["indenter"].pop("center", None)
            found = {key: value for key, value in found.items() if key not in OF_A_MESH}
            found["output"]["fields"] = "auto"
        if self.is_sphere:
            found["indenter"]["shape"] = "sphere"
        if self.is_smooth:
            found["contact"] = {"method": "auto"}
        if self.is_finite is not None:
            found = _of_strain(found, self.is_finite)
        document = _usual(found)
        with suppress(ConfigError):
            resolve(bench.beside(document))
            return document
        return None


def _models(config: Config, found: Mapping[str, Effect]) -> Iterator[_Model]:
    """The models of a scene, from the cheapest on; the last one has every effect that a model can have."""
    is_finite = not all(layer.material.small_strain for layer in config.layers if layer.material)
    has_friction = bool(getattr(config.contact, "friction", 0.0))
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
        if (finite and not knows_finite and not is_finite) or smooth < (not has_friction):
            continue
        dropped = (
            *(transforms if finite else [found["small_strain"]] if knows_finite or is_finite else []),
            *(_of_body(body, config, found)),
            *([found["paraboloid"]] if is_parabola and not sphere else []),
            *([found["stick"]] if has_friction and smooth else []),
        )
        changes = None if finite == is_finite else finite
        yield _Model(tuple(e for e in dropped if e.applies), body, changes, sphere, smooth and has_friction)


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
    strain = "small strain" if _is_small(document) else "finite strain"
    tip, rough = document["indenter"]["shape"].replace("_", " "), bool(document.get("contact", {}).get("friction"))
    off = "by less than the tolerance" if model.percent is None else f"by {model.percent:+.2g} %"
    words = f"Model {body} under a {tip} at {strain}, {'with its' if rough else 'without'} friction"
    if not model.is_within(within):
        words += f": that is off {off}; no model here has all of the effects at once."
    else:
        words += f": that is off {off}." if model.dropped else ": nothing simpler is within the tolerance."
    unknown = [name for name in ("stick", "rate", "adhesion", "cantilever", "calibration")
               if found[name].size > 100 * within and (found[name].low or found[name].high)
               and not (name == "stick" and rough)]  # fmt: skip
    if unknown:
        words += f" Beside it, more than {100 * within:g} % may come of {', '.join(unknown).replace('_', ' ')}."
    return words


# ---- sections of a scene -----------------------------------------------------------------------------------------


def _half_space(body: Document) -> Document:
    """The half-space of a body's matter: the last of its layers goes on without end."""
    layers = [dict(layer) for layer in body.get("layers") or []]
    for layer in layers[-1:]:
        layer.pop("thickness", None)
    return {"shape": "half_space"} | ({"layers": layers} if layers else {})


def _as_section(item: Any) -> Document:
    fields = {f.name: getattr(item, f.name) for f in dataclasses.fields(item)}
    tag = next((name for name in ("shape", "model") if name in fields), "")
    return {tag: fields[tag]} | {name: list(map(list, value)) if name == "points" else value
                                 for name, value in fields.items() if name != tag and value is not None}  # fmt: skip


def _round_tip(tip: Indenter) -> tuple[Indenter, bool]:
    """The tip, a pyramid as the cone of equal sections, and whether it is that."""
    if not isinstance(tip, RegularPyramid):
        return tip, False
    return Cone(degrees(atan(tip.roundness * tan(radians(tip.half_angle)))), tip.tip_radius), True


def _matter_of(section: Document) -> Any:
    """The material of a section, by its small-strain constants."""
    return from_mapping(ANY_SCENE | {"material": section}).material.canonical()  # type: ignore[union-attr]


def _small(section: Document) -> Document:
    """The linear elastic material of equal constants."""
    matter = _matter_of(section)
    if matter.small_strain and not matter.is_isotropic:
        return section
    return {"model": "linear_elastic"} | _constants(matter)


def _finite(section: Document) -> Document:
    """The finite-strain law of a material: its own, or neo-Hookean with the same constants."""
    matter = _matter_of(section)
    if not matter.small_strain:
        return section
    return {"model": "neo_hookean"} | _constants(matter)


def _constants(matter: Any) -> Document:
    """E and nu to twelve digits, as what came of other constants has no more."""
    return {name: float(f"{value:.12g}") for name, value in zip(("E", "nu"), matter.constants, strict=True)}


def _changed(body: Document, change: Callable[[Document], Document]) -> Document:
    """A body with its materials changed, those of layers, regions and inclusions."""
    found = dict(body)
    for name in ("layers", "inclusions"):
        if found.get(name):
            found[name] = [part | ({"material": change(part["material"])} if part.get("material") else {})
                           for part in found[name]]  # fmt: skip
    if found.get("regions"):
        found["regions"] = {name: change(part) for name, part in found["regions"].items()}
    return found


def _each_small(body: Document) -> Document:
    return _changed(body, _small)


def _with_matter(bench: _Bench, change: Callable[[Document], Document], body: Document | None = None) -> Document:
    """The sections of the plain scene, each material changed; a law of finite strain is the scene's own."""
    of_scene = to_mapping(bench.config)
    own = of_scene if change is _finite else bench.plain
    found = {"body": _changed(body or bench.plain["body"], change)}
    if change is _finite:
        for name in ("layers", "inclusions", "regions"):
            if found["body"].get(name):
                found["body"][name] = _changed(of_scene["body"], change)[name]
    return found | ({"material": change(own["material"])} if own.get("material") else {})


def _of_strain(document: Document, finite: bool) -> Document:
    """A scene whose materials and gap are of finite strain, or of small."""
    change = _finite if finite else _small
    found = document | {"body": _changed(document["body"], change)}
    if found.get("material"):
        found["material"] = change(found["material"])
    if "gap" in found.get("contact", {}):
        found["contact"] = found["contact"] | {"gap": "auto"}
    if finite:  # a nonlinear body is solved whole, and no curve determines its experiment
        found = {key: value for key, value in found.items() if key not in ("solver", "experiment")}
    return found


def _is_small(document: Document) -> bool:
    parts = [document.get("material"), *(layer.get("material") for layer in document["body"].get("layers") or [])]
    return all(_matter_of(part).small_strain for part in parts if part)


def _usual(document: Document) -> Document:
    """A scene without the sections in which all is as usual."""
    usual = to_mapping(from_mapping(ANY_SCENE))
    return {name: part for name, part in document.items()
            if part not in ({}, "") and not (name in DEFAULTED and part == usual.get(name))}  # fmt: skip


def _deborah(law: Any, t: float) -> str:
    """The relaxation's mean time over that of the way in, in words."""
    if law.prony is None or t <= 0:
        return ""
    total = sum(fraction for fraction, _ in law.prony)
    return f", Deborah number {sum(f * tau for f, tau in law.prony) / total / t:.2g}" if total else ""
