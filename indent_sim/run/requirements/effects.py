"""Effects that a model may leave out, in per cent of the force.

An effect is 100 (force with it / force without it - 1) at the deepest row, both at one depth and both forces of scenes
that this program solves: by theory where it is exact, else on one mesh, whose error is in both. What the scene has no
parameter of is said as the value from which on it matters.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from math import hypot, inf, isfinite, log
from typing import Any

import numpy as np

from indent_sim.model.body import Ball, Cap, Endless, HalfSpace, MeshFromFile, Strip
from indent_sim.model.experiment import Experiment, Relaxation
from indent_sim.model.tips import FlatPunch, Indenter, Paraboloid, Plate, Profile, Sphere
from indent_sim.process.errors import ConfigError
from indent_sim.run.experiment import modulus_of
from indent_sim.run.readings import hertz_force
from indent_sim.run.requirements.bench import Bench
from indent_sim.run.requirements.sections import (
    Document,
    finite_strain_law,
    half_space_of,
    section_of,
    small_strain_law,
)  # fmt: skip
from indent_sim.scene.given import remaining
from indent_sim.scene.theories import relative_tip
from indent_sim.theory.layer import Layer
from indent_sim.theory.roots import increasing_root
from indent_sim.theory.surface.adhesion import Jkr, tabor
from indent_sim.theory.surface.punches import LayerPunches
from indent_sim.theory.surface.relaxation import ElasticCurve, OneCycle

ENOUGH_STEPS = 20  # of a path with friction: its force is good to 0.1 % then
FARTHEST = 1e6  # times where a search for a threshold begins
FRICTIONS = (0.1, 0.3, "stick")  # that tell what may come of friction where a scene has none
MARGIN = 0.1  # per cent by which a range is wider than half of itself to either side
VARIED = 0.02  # relative change of R that says how the force grows with it
WIDER, TINY = 1e-3, 1e-6  # of a contact with adhesion, where its search begins; of the depth, instead of one below 0
ROUNDED = 0.05  # of a flat punch's radius: that of its edge where it is too sharp to solve at finite strain
SAMPLES = 60  # of an elastic curve
NAMES = ("paraboloid", "thickness", "side_walls", "substrate", "small_strain", "incompressible", "blunt_tip", "stick",
         "adhesion", "rate", "cantilever", "contact_point", "calibration")  # fmt: skip


@dataclass(frozen=True)
class Effect:
    """What an effect does to the force [per cent]: between low and high, None where that side has no bound, and the
    number itself where it is one.

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
        if self.percent is None and (self.low is None or self.high is None):
            return 0.0 if self.needs else inf
        return max(abs(one) for one in (self.percent, self.low, self.high) if one is not None)

    def times(self, gain: float) -> Effect:
        """The effect on a force that is smaller by this factor."""
        return replace(self, **{name: gain * value for name in ("percent", "low", "high")
                                if (value := getattr(self, name)) is not None})  # fmt: skip

    @property
    def applies(self) -> bool:
        """Whether the scene could have the effect at all."""
        return bool(self.percent != 0.0 or self.needs or self.low or self.high)


class Effects:
    """The effects on one scene."""

    def __init__(self, bench: Bench, within: float):
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
        return {"indenter": self._tip(**section_of(tip) | {key: radius})}

    @property
    def _theory_body(self) -> Document | None:
        """The body of the nearest scene that theory solves."""
        for body in (self.bench.plain["body"], self.bench.without_sides(), half_space_of(self.bench.plain["body"])):
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
        return self._by(name, bench.ratio({"body": layer}, {"body": half_space_of(layer)}),
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
        whole = {"body": half_space_of(bench.plain["body"])}
        scales = bench.scene.physics.scales
        unit = bench.scene.physics.indenter.radius_at(bench.delta / scales.depth)
        a = unit * scales.length
        layer = {"shape": "layer", "base": "fixed"}
        found = self._threshold(lambda x: bench.ratio({"body": layer | {"height": 1 / x}}, whole), 0.05 / a)
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
        walled = {"shape": "cylinder", "sides": "roller"} | kept
        found = self._threshold(lambda x: bench.ratio({"body": walled | {"radius": 1 / x}}, {"body": own}),
                                0.3 / own["height"])  # fmt: skip
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
            alone = {"shape": "half_space", "layers": [{"material": small_strain_law(section_of(bench.materials[0]))}]}
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
        small = bench.as_in_contact
        small, edge = self._rounded(small)
        finite = small | bench.with_materials(finite_strain_law) | {"contact": small["contact"] | {"gap": "current"}}
        law = "its own law" if not bench.scene.physics.small_strain else "neo-Hookean"
        source = f"{law}, gap: current, over small strain, gap: reference, on one mesh{edge}{self._how}"
        return self._by(name, bench.ratio(finite, small), source)

    def _rounded(self, document: Document) -> tuple[Document, str]:
        """A variation with the edge of a sharp flat punch rounded, and that in words.

        At finite strain a body around a sharp edge is solved in ever smaller steps, or not at all, and what strain does
        to the force hangs less on the edge: at nu = 0.3, delta/a = 0.1 it is 1.18 to 1.23 % for edges of 0.005 to 0.1,
        1.6 % for a sharp one.
        """
        tip = self.bench.tip
        if not isinstance(tip, FlatPunch) or tip.edge_radius >= ROUNDED * tip.radius:
            return document, ""
        words = f", the punch's edge rounded by {ROUNDED:g} of its radius in both"
        return document | self._with_radius(tip, "edge_radius", ROUNDED * tip.radius), words

    def _incompressible(self, name: str) -> Effect:
        bench = self.bench
        if not bench.is_isotropic:
            return Effect(name, None, None, None, "the material is not isotropic")
        if all(material.constants.nu == 0.5 for material in bench.materials):
            body = self._theory_body
            if body is None:
                return Effect(name, None, None, None, "no theory of this body")

            def softer(x: float) -> float | None:
                below = bench.with_materials(lambda own: own | {"nu": 0.5 - min(x, 0.5)}, body["body"])
                return bench.ratio(body, below)

            found = self._threshold(softer, 0.01)
            return self._from(name, "nu", found and 0.5 - found, f"theory{self._how}", " down", digits=4)
        still = bench.with_materials(lambda own: own | {"nu": 0.5})
        return self._by(name, bench.ratio(still), f"nu = 0.5 at the same E{self._how}")

    # ---- the contact ---------------------------------------------------------------------------------------------

    def _stick(self, name: str) -> Effect:
        """No slip, and what may come of any friction: the least and the most of some, wider by half of their spread."""
        friction = getattr(self.bench.config.contact, "friction", 0.0)
        if known := self.bench.scene.plan.friction:
            change = 100 * (known.force - 1)
            return Effect(name, change, change, change, f"friction {friction} over none: half-space, exact")
        if friction:
            return self._by(name, self._rough(friction), f"friction {friction} over none, on one mesh{self._how}")
        if not self.bench.is_solvable:
            return Effect(name, None, None, None, "nothing solved in the plane stands for it")
        tried = [100 * (ratio - 1) for f in FRICTIONS if (ratio := self._rough(f)) is not None]
        if len(tried) < len(FRICTIONS):
            return Effect(name, None, None, None, "a contact with friction was not solved")
        wider = (max(tried) - min(tried)) / 2 + MARGIN
        said, percent, source = self.bench.scene.plan.stick, tried[-1], f"on one mesh{self._how}"
        if said is not None and said.percent is not None:  # exact
            percent, source = said.percent, said.source
        return Effect(name, percent, min(tried) - wider, max(tried) + wider,
                      f"no slip: {source}; the range holds friction from {FRICTIONS[0]:g} on")  # fmt: skip

    def _rough(self, friction: float | str) -> float | None:
        """Force with friction over that without, on one mesh."""
        bench = self.bench
        rough = {"contact": bench.on_mesh["contact"] | {"friction": friction}, "loading": bench.by(ENOUGH_STEPS)}
        return bench.ratio(bench.on_mesh | rough, bench.on_mesh)

    def _adhesion(self, name: str) -> Effect:
        bench, scene = self.bench, self.bench.known
        if bench.attraction:
            return self._adhesion_in_range(name)
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

    def _adhesion_in_range(self, name: str) -> Effect:
        """That of the contact law: the force on the way in, which has jumped where the scene does."""
        bench = self.bench
        if not bench.is_solvable:
            return Effect(name, None, None, None, "nothing solved in the plane stands for it")
        return self._by(name, bench.ratio(bench.as_in_contact, bench.on_mesh),
                        f"the contact law with its range over the one without, on one mesh{self._how}")  # fmt: skip

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
            return self._relaxed(name, experiment, law)
        t, top = max(experiment.history, key=lambda point: (point[1], -point[0]))
        depths = np.geomspace(1e-4, 1.001, SAMPLES) * top
        forces = np.array([self.bench.along(float(depth)) for depth in depths])
        curve = ElasticCurve(depths, forces, np.sqrt(depths))
        points = experiment.history if experiment.history[0][1] <= 0 else ((experiment.history[0][0], 0.0),
                                                                         *experiment.history)  # fmt: skip
        times, values = zip(*points, strict=True)
        with suppress(ValueError, ArithmeticError):
            found = OneCycle(modulus_of(law), times, values, curve).at(t)
            ratio = found.force / float(curve.force(np.array(top)))
            return self._by(name, ratio, f"Lee & Radok{_deborah(law, t - times[0])}")
        return self._by(name, None, "this history")

    def _relaxed(self, name: str, experiment: Experiment, law: Relaxation) -> Effect:
        """Between the moduli that the body has: material.E is the first one, and a power law begins without bound."""
        least = 100 * (remaining(experiment) - 1) if experiment.points or law.prony else None
        if law.power_law is not None:
            return Effect(name, None, least, None, "of the last modulus or more; a power law begins without bound")
        return Effect(name, None, least, 0.0, "between the instantaneous and the last modulus")

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


def _deborah(law: Relaxation, t: float) -> str:
    """The relaxation's mean time over that of the way in, t, in words."""
    if law.prony is None or t <= 0:
        return ""
    total = sum(fraction for fraction, _ in law.prony)
    return f", Deborah number {sum(f * tau for f, tau in law.prony) / total / t:.2g}" if total else ""
