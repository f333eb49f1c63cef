"""Twenty scenes, and the size of every effect on them, found by runs with and without it.

The reference is the force of the scene with the effect over that without it. Both are solved on
meshes finer than automatic ones, never by the theory that `require` prefers; adhesion, rate and
spring are found by the scene's experiment on a condensed body.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from json import dumps, loads
from math import hypot, inf, log
from typing import Any

from scenes import placed
from scipy.optimize import brentq

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.process.errors import ConfigError
from indent_sim.run import pipeline
from indent_sim.run.history_on_curve import evaluate_with_units
from indent_sim.run.model_selection.effects import Effect
from indent_sim.run.model_selection.recommended_model import Requirements, require
from indent_sim.scene.scene import Scene, resolve

Document = dict[str, Any]

WITHIN = 0.01
TELLING = 0.5  # per cent; smaller effects need no right size
FACTOR = 1.5  # between what is said and what is so
NOISE = 0.15  # per cent that two meshes and a path of twenty steps cost a ratio of forces
FINER = 0.6  # element sizes of references, of automatic ones
STEPS = 40  # of references with friction or adhesion

SOLID = {"model": "linear_elastic", "E": 1.0, "nu": 0.3}
PARABOLOID, SPHERE = ({"shape": shape, "R": 1.0} for shape in ("paraboloid", "sphere"))
CYLINDER = {"shape": "cylinder", "radius": 1.0, "height": 1.0}


def scene(
    body: Document, tip: Document, delta: float, material: Document | None = SOLID, **more: Any
) -> Document:
    """A scene that goes to a depth in four steps."""
    matter = {"material": material} if material else {}
    return {
        "body": body,
        **matter,
        "indenter": tip,
        "loading": {"delta": delta, "steps": 4},
        **more,
    }


def film(thickness: float, *materials: Document) -> Document:
    """A film on a half-space."""
    top, below = materials
    return {
        "shape": "half_space",
        "layers": [{"thickness": thickness, "material": top}, {"material": below}],
    }


SCENES: dict[str, Document] = {
    "soft layer": scene({"shape": "layer", "height": 0.3}, PARABOLOID, 0.03, SOLID | {"nu": 0.45}),
    "thin, nearly incompressible": scene(
        {"shape": "layer", "height": 0.1}, PARABOLOID, 0.01, SOLID | {"nu": 0.49}
    ),
    "free cylinder": scene(CYLINDER, PARABOLOID, 0.1),
    "tight roller walls": scene(CYLINDER | {"radius": 0.5, "sides": "roller"}, PARABOLOID, 0.05),
    "glued walls": scene(CYLINDER | {"radius": 0.6, "height": 0.8, "sides": "fixed"}, SPHERE, 0.04),
    "stiff film": scene(film(0.2, SOLID | {"E": 10.0}, SOLID), PARABOLOID, 0.02, None),
    "soft film": scene(film(0.2, SOLID, SOLID | {"E": 5.0, "nu": 0.2}), SPHERE, 0.02, None),
    "deep sphere": scene({"shape": "half_space"}, PARABOLOID, 0.4),
    "blunted cone": scene(
        {"shape": "layer", "height": 1.0},
        {"shape": "cone", "half_angle": 70.0, "tip_radius": 0.2},
        0.05,
    ),
    "sharp cone": scene(
        {"shape": "layer", "height": 1.0}, {"shape": "cone", "half_angle": 80.0}, 0.05
    ),
    "rounded punch": scene(
        {"shape": "layer", "height": 1.0},
        {"shape": "flat_punch", "radius": 0.3, "edge_radius": 0.1},
        0.01,
    ),
    "sticky (JKR)": scene(
        {"shape": "layer", "height": 0.5},
        PARABOLOID,
        0.008,
        SOLID | {"nu": 0.45},
        experiment={"adhesion": {"work": 1e-4, "range": 1e-6}},
    ),
    "viscous": scene(
        {"shape": "layer", "height": 1.0},
        PARABOLOID,
        0.02,
        SOLID | {"nu": 0.45},
        experiment={
            "relaxation": {"prony": [[0.4, 0.1], [0.3, 1.0]]},
            "history": [[0, 0], [1, 0.02], [2, 0]],
        },
    ),
    "soft cantilever": scene(
        {"shape": "half_space"},
        SPHERE,
        0.01,
        experiment={
            "cantilever": {"stiffness": 0.3},
            "history": [[0, 0], [1, 0.01]],
            "calibration": {"stiffness": 0.1, "R": 0.05},
        },
    ),
    "cell, in SI units": scene(
        {"shape": "cylinder", "radius": 15e-6, "height": 5e-6},
        SPHERE | {"R": 2.5e-6},
        0.8e-6,
        {"model": "neo_hookean", "E": 1e3, "nu": 0.4999},
        units={"length": "m", "force": "N"},
    ),
    "plane strain, friction": scene(
        {"shape": "strip", "width": 2.0, "height": 0.5},
        PARABOLOID,
        0.02,
        SOLID | {"nu": 0.2},
        contact={"friction": 0.3},
    ),
    "rubber": scene(
        CYLINDER | {"radius": 2.0, "height": 1.5},
        SPHERE,
        0.3,
        {"model": "mooney_rivlin", "C10": 0.3, "C01": 0.05, "nu": 0.49},
    ),
    "stick on a thin gel": scene(
        CYLINDER | {"radius": 3.0, "height": 0.1, "sides": "roller"},
        PARABOLOID,
        0.01,
        SOLID | {"nu": 0.49},
        contact={"friction": "stick"},
    ),
    "attraction with a range": scene(
        CYLINDER | {"radius": 1.5},
        PARABOLOID,
        0.02,
        SOLID | {"nu": 0.45},
        contact={"adhesion": {"work": 1e-3, "range": 0.02}},
    ),
    "block, off centre": scene(
        {"shape": "box", "size": [2.0, 2.0, 1.0]},
        PARABOLOID | {"center": [1.2, 1.1]},
        0.03,
        mesh={"h_contact": 0.05},
    ),
}


@dataclass(frozen=True)
class Row:
    """An effect stated by `require` beside its known size, in per cent.

    For a threshold, `said` is 1 %, the effect that the threshold stands for.
    """

    name: str
    said: float | None
    low: float | None
    high: float | None
    known: float

    @property
    def is_right(self) -> bool:
        """Whether the sign is right, and the size of a large effect within the factor.

        A range must hold the effect.
        """
        if self.said is None:
            return (
                self.low is not None
                and self.high is not None
                and (self.low - NOISE <= self.known <= self.high + NOISE)
            )
        if max(abs(self.said), abs(self.known)) <= TELLING:
            return abs(self.said - self.known) <= TELLING
        return self.known / FACTOR <= self.said <= self.known * FACTOR or (
            self.known * FACTOR <= self.said <= self.known / FACTOR
        )


@cache
def required(name: str) -> Requirements:
    """What `require` says of a scene."""
    return require(config_from_mapping(placed(SCENES[name])), WITHIN)


def rows(name: str) -> Iterator[Row]:
    """The stated effects and thresholds of a scene, each beside its known size."""
    return beside(SCENES[name], required(name))


def beside(document: Document, found: Requirements) -> Iterator[Row]:
    """The stated effects and thresholds of a mapping, each beside its known size.

    Effects too small to matter are left out.
    """
    reference = Reference(document)
    for effect in found.effects:
        if " = " in effect.needs and effect.percent is None:
            known = reference.at_threshold(effect)
            if known is not None:
                yield Row(
                    f"{effect.name}: {effect.needs.split(' from ', 1)[1]}",
                    100 * WITHIN,
                    None,
                    None,
                    abs(known),
                )
        elif effect.max_change > TELLING and (effect.percent or effect.low or effect.high):
            yield Row(
                effect.name, effect.percent, effect.low, effect.high, reference.of(effect.name)
            )


def off(name: str) -> float:
    """Difference in per cent between the recommended model's force and that of the full model."""
    own = SCENES[name]
    whole = own | _finite(own)
    if own["indenter"]["shape"] == "paraboloid":
        whole["indenter"] = own["indenter"] | {"shape": "sphere"}
    if "friction" in own.get("contact", {}) or "adhesion" in own.get("contact", {}):
        whole["contact"] = own["contact"]
        whole["loading"] = own["loading"] | {"steps": STEPS}
    whole.pop("experiment", None)
    found = loads(dumps(required(name).config))
    found.pop("experiment", None)
    if "history" in found["loading"]:  # the elastic model under it
        found["loading"] = own["loading"]
        found["material"].pop("relaxation", None)
    return 100 * (force(found, 1.0) / force(whole) - 1)


class Reference:
    """The effects on a scene by runs with and without them."""

    def __init__(self, scene: Document):
        self.scene = scene
        kept = ("body", "indenter", "mesh", "units")
        self.plain = {key: self.scene[key] for key in kept if key in self.scene} | _linear(
            self.scene
        )
        self.plain |= {"contact": {"method": "augmented_lagrangian"}}
        self.delta = self._reached(self.scene["loading"]["delta"])
        self.plain |= self._steps(1)

    def of(self, row: str) -> float:
        """The effect of a row in per cent."""
        if row == "calibration":
            given = self.scene["experiment"]["calibration"]
            return 100 * hypot(given["stiffness"], self._power("R") * given["R"])
        if row in ("adhesion", "rate", "cantilever") and "experiment" in self.scene:
            return self._by_experiment(self.scene["experiment"])
        return self._change(*getattr(self, f"_{row}")())

    def at_threshold(self, effect: Effect) -> float | None:
        """The effect in per cent at a threshold, or None where it is so by definition."""
        key, value = effect.needs.split(" from ", 1)[1].split(" = ", 1)
        x = float(value.split()[0])
        E_nu = {"E": x, "nu": 0.3}
        match key:
            case "work" if self.plain["body"]["shape"] != "box":
                return self._by_experiment({"adhesion": {"work": x}})
            case "stiffness":
                return self._by_experiment(
                    {"cantilever": {"stiffness": x}, "history": [[0, 0], [1, self.delta]]}
                )
            case "an error of the depth":
                return self._change({"loading": {"delta": self.delta - x, "steps": 1}})
            case "body.height":
                return self._change({"body": {"shape": "layer", "height": x}})
            case "a frictionless wall at radius":
                return self._change(
                    {
                        "body": self.plain["body"]
                        | {"shape": "cylinder", "radius": x, "sides": "roller"}
                    }
                )
            case "a substrate of E":
                layers = film(self._layer()["height"], self.plain["material"], SOLID | E_nu)
                return self._change({"body": layers}, {"body": self._layer()})
            case "body.surface_tension" if self.plain["body"]["shape"] in ("half_space", "layer"):
                return self._change({"body": self.plain["body"] | {"surface_tension": x}})
            case "indenter.tip_radius":
                return self._change({"indenter": self.plain["indenter"] | {"tip_radius": x}})
        return None

    # ---- pairs of scenes, with and without

    def _paraboloid(self) -> tuple[Document, ...]:
        tip = self.plain["indenter"]
        return {"indenter": tip | {"shape": "sphere"}}, {"indenter": tip | {"shape": "paraboloid"}}

    def _thickness(self) -> tuple[Document, ...]:
        return {"body": self._layer()}, {"body": {"shape": "half_space"}}

    def _side_walls(self) -> tuple[Document, ...]:
        body = self.plain["body"]
        if body["shape"] == "strip":
            return {}, {"body": body | {"width": 10 * body["width"], "sides": "roller"}}
        return {}, {"body": self._layer()}

    def _substrate(self) -> tuple[Document, ...]:
        top = self.plain["body"]["layers"][0]["material"]
        return {}, {"body": {"shape": "half_space"}, "material": top}

    def _small_strain(self) -> tuple[Document, ...]:
        contact = self.plain["contact"] | self.scene.get(
            "contact", {}
        )  # friction and adhesion stay as they are
        finite = _finite(self.scene) | {"contact": contact | {"gap": "current"}}
        return finite | self._steps(8), {"contact": contact} | self._steps(8)

    def _incompressible(self) -> tuple[Document, ...]:
        layers = [
            part | {"material": part["material"] | {"nu": 0.5}}
            for part in self.plain["body"].get("layers", [])
        ]
        body = {"body": self.plain["body"] | {"layers": layers}} if layers else {}
        return (body or {"material": self.plain["material"] | {"nu": 0.5}},)

    def _blunt_tip(self) -> tuple[Document, ...]:
        key = "edge_radius" if self.plain["indenter"]["shape"] == "flat_punch" else "tip_radius"
        return {}, {"indenter": self.plain["indenter"] | {key: 0.0}}

    def _friction(self) -> tuple[Document, ...]:
        return self._rough(self.scene["contact"]["friction"])

    def _stick(self) -> tuple[Document, ...]:
        return self._rough("stick")

    def _rough(self, friction: Any) -> tuple[Document, ...]:
        return {"contact": self.plain["contact"] | {"friction": friction}} | self._steps(STEPS), {}

    def _layers(self) -> tuple[Document, ...]:
        first, layers = self.plain["body"]["layers"][0]["material"], self.plain["body"]["layers"]
        return {}, {
            "body": self.plain["body"]
            | {"layers": [layer | {"material": first} for layer in layers]}
        }

    def _adhesion(self) -> tuple[Document, ...]:
        return {"contact": self.plain["contact"] | self.scene["contact"]} | self._steps(STEPS), {}

    # ---- how

    def _reached(self, way: float) -> float:
        """The depth that a tip reaches when its base goes a way.

        It is less by F(d)/k, where F is a power law through two forces.
        """
        k = self.scene.get("experiment", {}).get("cantilever", {}).get("stiffness", inf)
        if k == inf:
            return way
        whole, less = (
            force(self.plain | {"loading": {"delta": x * way, "steps": 1}}) for x in (1.0, 0.9)
        )
        power = log(less / whole) / log(0.9)
        return way * brentq(lambda x: x * way + whole * x**power / k - way, 0.0, 1.0)

    def _steps(self, steps: int) -> Document:
        return {"loading": {"delta": self.delta, "steps": steps}}

    def _layer(self) -> Document:
        body = self.plain["body"]
        return {
            "shape": "layer",
            "height": body["size"][2] if body["shape"] == "box" else body["height"],
        }

    def _change(self, with_it: Document, without: Document | None = None) -> float:
        above, below = (self.plain | part for part in (with_it, without or {}))
        return 100 * (force(_runnable(above)) / force(_runnable(below)) - 1)

    def _power(self, key: str) -> float:
        """d ln F/d ln of a length of the tip."""
        tip = self.plain["indenter"]
        ends = (
            force(self.plain | {"indenter": tip | {key: factor * tip[key]}})
            for factor in (0.95, 1.05)
        )
        low, high = ends
        return log(high / low) / log(1.05 / 0.95)

    def _by_experiment(self, experiment: Document) -> float:
        """Effect of an experiment on the force at the deepest point of its history or equilibria.

        The force is compared with the elastic curve at this depth, which with a spring is the way
        of its base.
        """
        history = experiment.get("history", [[0, 0], [1, self.delta]])
        given = self.plain | {
            "experiment": {key: part for key, part in experiment.items() if key != "calibration"}
            | {"history": history},
            "contact": {"method": "auto"},
        }
        t, depth = max(history, key=lambda point: (point[1], -point[0]))
        try:
            base = resolve(config_from_mapping(placed(given | {"solver": {"method": "condensed"}})))
        except ConfigError:  # a contact at pull-off that no mesh holds beside the deepest one
            base = resolve(config_from_mapping(placed(given)))
        body = pipeline.condense(base).equilibrium if base.is_meshed else None
        deepest = next(row for row in evaluate_with_units(base, body).rows if row.t == t)
        return 100 * (
            deepest.force / force(self.plain | {"loading": {"delta": depth, "steps": 1}}) - 1
        )


def force(document: Document, size: float = FINER) -> float:
    """Force of a scene at its deepest row, on elements of `size` automatic ones."""
    return _force(dumps(document), size)


@cache
def _force(text: str, size: float) -> float:
    document = loads(text)
    base = _meshed(document)
    if size != 1.0 and "mesh" not in document:
        h = size * base.sizes.h_contact * base.physics.scales.length
        base = _meshed(document | {"mesh": {"h_contact": h}})
    *_, last = pipeline.states(base, with_surface=False)
    assert last.converged
    return last.force


def _runnable(document: Document) -> Document:
    """The scene without keys that a changed body does not use.

    They are the place of the tip, and the material where all layers have their own.
    """
    body = document["body"]
    left_out = {"material"} if body.get("layers") else set()
    if body["shape"] != "box" and "center" in document["indenter"]:
        left_out.add("mesh")
        document = document | {
            "indenter": {k: v for k, v in document["indenter"].items() if k != "center"}
        }
    return {key: part for key, part in document.items() if key not in left_out}


def _meshed(document: Document) -> Scene:
    base = resolve(config_from_mapping(document))
    return (
        base
        if base.is_meshed
        else resolve(config_from_mapping(document | {"solver": {"method": "condensed"}}))
    )


def _material(section: Document, model: str) -> Document:
    """A linear elastic or neo-Hookean material of the same small-strain constants.

    Another law of finite strain stays as it is in a model of finite strain.
    """
    if model == "neo_hookean" and section["model"] != "linear_elastic":
        return section
    if section["model"] == "mooney_rivlin":  # mu = 2 (C10 + C01)
        E = 4 * (section["C10"] + section["C01"]) * (1 + section["nu"])
        return {"model": model, "E": E, "nu": section["nu"]}
    return section | {"model": model}


def _linear(document: Document) -> Document:
    return _of_model(document, "linear_elastic")


def _finite(document: Document) -> Document:
    return _of_model(document, "neo_hookean")


def _of_model(document: Document, model: str) -> Document:
    """The sections of a scene with materials, in the given model."""
    found: Document = {"body": dict(document["body"])}
    if "layers" in found["body"]:
        found["body"]["layers"] = [
            part | {"material": _material(part["material"], model)}
            for part in found["body"]["layers"]
        ]
    return found | (
        {"material": _material(document["material"], model)} if "material" in document else {}
    )
