"""Random scenes: what `require` says of their effects beside runs with and without each effect.

The runs are made here, on other meshes.
"""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise
from math import exp, log
from random import Random
from typing import Any

import pytest
from known_effects import SOLID, STEPS, TELLING, WITHIN, Document, Reference, Row, force
from scenes import placed
from scipy.optimize import brentq

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.run.model_selection.recommended_model import require

FINER = 0.8  # element sizes of references, of automatic ones
MOMENTS = 60  # of a history on its way in
THRESHOLDS = ("a frictionless wall", "a substrate", "body.height")
Pairs = dict[str, tuple[Document, Document]]


class Drawn:
    """A random scene, and for each of its effects the two scenes with and without it."""

    def __init__(self, seed: int):
        self.draw, self.seed = Random(seed), seed
        self.height = self.draw.choice([0.2, 0.5, 1.0])
        self.delta = self.height * self.draw.uniform(0.02, 0.08)
        self.matter = self._matter()
        self.body = self._body()
        self.tip = self._tip()
        self.contact: Document = {}
        self.experiment: Document = {}
        self._beside()

    def _is(self, share: float) -> bool:
        return self.draw.random() < share

    def _matter(self, E: float = 1.0) -> Document:
        nu = round(self.draw.choice([0.0, 0.3, 0.45, 0.49]), 3)
        kind = self.draw.choice(["linear", "linear", "linear", "neo_hookean", "anisotropic"])
        if kind == "anisotropic":
            stiff = self.draw.choice([0.4, 2.5])
            return {
                "model": "transversely_isotropic",
                "E": E,
                "E_z": stiff * E,
                "nu": 0.3,
                "nu_z": 0.2,
                "G_z": 0.4 * E * self.draw.choice([0.6, 1.5]),
            }
        return {"model": "linear_elastic" if kind == "linear" else kind, "E": E, "nu": nu}

    def _body(self) -> Document:
        shape, h = (
            self.draw.choice(["cylinder", "cylinder", "layer", "half_space", "strip", "cap"]),
            self.height,
        )
        sides = self.draw.choice(["free", "fixed", "roller"])
        body: Document = {
            "cylinder": {
                "shape": shape,
                "radius": h * self.draw.uniform(0.7, 2.0),
                "height": h,
                "sides": sides,
            },
            "layer": {"shape": shape, "height": h, "base": self.draw.choice(["fixed", "roller"])},
            "half_space": {"shape": shape},
            "strip": {"shape": shape, "width": 2.5 * h, "height": h, "sides": sides},
            "cap": {"shape": shape, "base_radius": h, "height": 0.8 * h},
        }[shape]
        if shape != "cap" and self._is(0.35):
            top = h * self.draw.uniform(0.15, 0.5)
            first, second = SOLID | {"E": self.draw.choice([0.3, 3.0])}, SOLID
            rest = {} if shape == "half_space" else {"thickness": h - top}
            body["layers"] = [{"thickness": top, "material": first}, {**rest, "material": second}]
            self.matter = SOLID
        elif self._is(0.4):
            radius = 0.12 * h
            x = 1.25 * h if shape == "strip" else 0.0
            stiff = SOLID | {"E": self.draw.choice([0.05, 20.0])}
            body["inclusions"] = [
                {
                    "shape": "ball",
                    "center": [x, 0.0, -self.draw.uniform(0.25, 0.4) * h],
                    "radius": radius,
                    "material": stiff,
                }
            ]
        return body

    def _tip(self) -> Document:
        R = self.height * self.draw.uniform(0.8, 2.0)
        tips = [{"shape": "paraboloid", "R": R}, {"shape": "sphere", "R": R}]
        if self.body["shape"] not in ("cap", "strip"):
            tips += [
                {"shape": "cone", "half_angle": 75.0, "tip_radius": 0.1 * R},
                {
                    "shape": "flat_punch",
                    "radius": 0.2 * self.height,
                    "edge_radius": 0.03 * self.height,
                },
            ]
        return self.draw.choice(tips)

    def _beside(self) -> None:
        """Draw friction, adhesion or an experiment of a linear body."""
        kind, is_round = self.draw.random(), self.tip["shape"] in ("paraboloid", "sphere")
        if kind < 0.3:
            self.contact = {"friction": self.draw.choice([0.1, 0.4, "stick"])}
        elif (
            kind < 0.4
            and is_round
            and self.body["shape"] in ("cylinder", "layer")
            and not self._is_finite
        ):
            work = 0.1 * self.delta**2 / self.height
            self.contact = {"adhesion": {"work": work, "range": 0.4 * self.delta}}
        elif kind < 0.75 and not self._is_finite:
            top = [[0, 0], [1, self.delta]]
            history = self.draw.choice([top, [*top, [2, self.delta]], [*top, [1.5, 0.0]]])
            if self._is(0.6):
                self.experiment = {
                    "relaxation": {"prony": [[0.3, 0.2], [0.2, 2.0]]},
                    "history": history,
                }
            else:
                self.experiment = {
                    "cantilever": {"stiffness": 3.0 * self.height},
                    "history": history,
                }

    @property
    def _is_finite(self) -> bool:
        return self.matter["model"] == "neo_hookean"

    @property
    def is_isotropic(self) -> bool:
        """Whether the material is isotropic."""
        return self.matter["model"] != "transversely_isotropic"

    def document(self) -> Document:
        """The scene as a mapping."""
        matter = {} if "layers" in self.body else {"material": self.matter}
        found = {
            "body": self.body,
            **matter,
            "indenter": self.tip,
            "loading": {"delta": self.delta, "steps": 4},
        }
        return found | {
            name: part for name in ("contact", "experiment") if (part := getattr(self, name))
        }

    # ---- both models of an effect

    def plain(self, **changes: Any) -> Document:
        """The scene at small strain, with some sections replaced.

        It has no friction, adhesion or experiment.
        """
        linear = self.matter | {"model": "linear_elastic"} if self._is_finite else self.matter
        found = {
            "body": self.body,
            "material": linear,
            "indenter": self.tip,
            "loading": changes.get("loading") or {"delta": self.reached, "steps": 1},
            "contact": {"method": "augmented_lagrangian"},
        } | changes
        if found["body"].get("layers"):
            del found["material"]
        return found

    def pairs(self) -> Pairs:
        """The scenes with and without an effect, by its name."""
        body, own, found = self.body, self.plain(), {}
        whole = {key: part for key, part in body.items() if key != "inclusions"}
        even = self.plain(body=whole)
        if "inclusions" in body:
            found["inclusions"] = own, even
        if "layers" in body:
            one = {key: part for key, part in whole.items() if key != "layers"}
            found["layers"] = even, self.plain(body=one, material=body["layers"][0]["material"])
        if not self.is_isotropic:
            found["anisotropy"] = (
                own,
                self.plain(material=SOLID | {"E": self.matter["E"], "nu": self.matter["nu"]}),
            )
        if body["shape"] == "cylinder":
            layer = {"shape": "layer"} | {
                key: part for key, part in whole.items() if key in ("height", "layers")
            }
            found["side_walls"] = even, self.plain(body=layer)
        if body["shape"] == "layer" and "layers" not in body and self.is_isotropic:
            found["thickness"] = even, self.plain(body={"shape": "half_space"})
        if self.tip["shape"] in ("paraboloid", "sphere"):
            found["paraboloid"] = tuple(
                self.plain(indenter=self.tip | {"shape": shape})
                for shape in ("sphere", "paraboloid")
            )
        return found | self._of_contact(own) | self._of_matter(own)

    def _of_contact(self, own: Document) -> Pairs:
        steps = {"loading": {"delta": self.reached, "steps": STEPS}}
        names = [name for name in ("friction", "adhesion") if name in self.contact]
        return {
            name: (own | {"contact": own["contact"] | self.contact} | steps, own) for name in names
        }

    def _of_matter(self, own: Document) -> Pairs:
        if (
            not self.is_isotropic or self.contact or self.seed % 3
        ):  # a third of them: they cost most
            return {}

        def changed(change: Any) -> Document:
            body = dict(self.body)
            for name in {"layers", "inclusions"} & body.keys():
                body[name] = [part | {"material": change(part["material"])} for part in body[name]]
            return self.plain(body=body, material=change(self.matter))

        finite = changed(lambda own: own | {"model": "neo_hookean"})
        finite |= {"contact": own["contact"] | {"gap": "current"}}
        incompressible = changed(
            lambda own: own | {"model": "linear_elastic", "nu": 0.5}
        )  # at small strain, as `own`
        return {"small_strain": (finite, own), "incompressible": (incompressible, own)}

    def known(self) -> dict[str, float]:
        """The effects in per cent, from runs."""
        found = {
            name: 100 * (force(one, FINER) / force(other, FINER) - 1)
            for name, (one, other) in self.pairs().items()
        }
        if "relaxation" in self.experiment:
            found["rate"] = self._relaxed()
        if "cantilever" in self.experiment:
            found["cantilever"] = self._held()
        return found

    def _curve(self, depth: float) -> float:
        return force(self.plain(loading={"delta": depth, "steps": 1}), FINER)

    @cached_property
    def _exponent(self) -> float:
        """Exponent of the power law through the forces at 0.9 and at all of the depth."""
        return log(self._curve(0.9 * self.delta) / self._curve(self.delta)) / log(0.9)

    def _relaxed(self) -> float:
        """Effect of relaxation on the force at the end of the way in, in per cent.

        F(1) = integral of E(1 - s) dF(delta(s)), where F is a power law through two forces. A thin
        body or one in plane strain is close to it near its deepest point, where most of the force
        comes from.
        """
        power = self._exponent
        times = [(k / MOMENTS) for k in range(MOMENTS + 1)]
        parts = self.experiment["relaxation"]["prony"]
        total = 0.0
        for before, after in pairwise(times):
            age = 1 - (before + after) / 2
            modulus = 1 - sum(g * (1 - exp(-age / tau)) for g, tau in parts)
            total += modulus * (after**power - before**power)
        return 100 * (total - 1)

    def _held(self) -> float:
        """Effect of the cantilever in per cent.

        The force at the depth that is reached is compared with that at the way of the base.
        """
        return 100 * ((self.reached / self.delta) ** self._exponent - 1)

    @cached_property
    def reached(self) -> float:
        """The depth of the row.

        With a spring it is the d at which d + F(d)/k is the way of the base, by the same power law.
        """
        if "cantilever" not in self.experiment:
            return self.delta
        top, k = self._curve(self.delta), self.experiment["cantilever"]["stiffness"]
        return self.delta * brentq(
            lambda x: x + top * x**self._exponent / (k * self.delta) - 1, 0.0, 1.0
        )


@pytest.mark.verify
@pytest.mark.parametrize("seed", range(10))
def test_every_effect_has_a_row(seed: int) -> None:
    """Every effect above 0.5 % has a row of the right sign, and of its size within a factor of 1.5.

    A range holds the effect, a threshold changes the force by the tolerance within that factor, and
    no other row is said to be unsolved.
    """
    drawn = Drawn(seed)
    found = require(config_from_mapping(placed(drawn.document())), WITHIN)
    effects = {effect.name: effect for effect in found.effects}
    unsolved = {name for name, effect in effects.items() if effect.source.startswith("not solved")}
    assert unsolved <= (set() if drawn.is_isotropic else {"side_walls", "surface_tension"})
    rows = [
        Row(name, effects[name].percent, effects[name].low, effects[name].high, known)
        for name, known in drawn.known().items()
    ]
    assert not [row for row in rows if not row.is_right]
    assert all(effects[row.name].is_possible for row in rows if abs(row.known) > TELLING)
    if drawn.is_isotropic and not {"layers", "inclusions"} & drawn.body.keys():
        assert not [row for row in thresholds(drawn, found) if not row.is_right]


def thresholds(drawn: Drawn, found: Any) -> list[Row]:
    """Thresholds of walls, substrate and thickness that the scene lacks.

    Each is given beside the effect that such a wall, substrate or thickness has.
    """
    keys = [
        effect for effect in found.effects if any(f" {key}" in effect.needs for key in THRESHOLDS)
    ]
    scene = drawn.plain() | {"loading": {"delta": drawn.reached}}
    return [
        Row(effect.name, 100 * WITHIN, None, None, abs(known))
        for effect in keys
        if (known := Reference(scene).at_threshold(effect)) is not None
    ]
