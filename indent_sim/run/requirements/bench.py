"""Forces of a scene and of its variations at the deepest row."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from contextlib import suppress
from functools import cached_property
from math import atan, degrees, log, nan, radians, tan
from typing import Any

from indent_sim.config.file import to_mapping, varied
from indent_sim.config.schema import Config, Source
from indent_sim.model.body import Box, Cylinder, HalfSpace, MeshFromFile, Strip
from indent_sim.model.tips import Cone, Indenter, RegularPyramid
from indent_sim.process.errors import BackendError, ConfigError, IndentSimError
from indent_sim.run.chain import states
from indent_sim.run.requirements.sections import (
    Document,
    at_small_strain,
    changed,
    finite_strain_law,
    half_space_of,
    section_of,
    small_strain_law,
)  # fmt: skip
from indent_sim.scene.scene import Scene, resolve

NEAR = 0.9  # of the deepest depth: where a second force says how steep the curve is
FEW_STEPS = 2  # of a path with friction or adhesion: good for the ratio of two, and adhesion does not remember


class Bench:
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
        """Whether all materials are."""
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
        """The scene without friction and adhesion, at small strain, to its deepest row in one step."""
        document = to_mapping(self.config)
        body = self.body(self.walls[0] if self.walls else "")
        tip = section_of(self.tip)
        if isinstance(self.config.body, Strip | MeshFromFile) and self.config.center is not None:
            tip["center"] = list(self.config.center)
        found = {"body": body, "indenter": tip, "loading": {"delta": self.delta, "steps": 1}}
        if "material" in document:
            found["material"] = small_strain_law(document["material"])
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
        return {key: value for key, value in at_small_strain(own | changes).items() if value is not None}

    def without_sides(self) -> Document | None:
        """The layer that the body is without its sides; None for one that is no layer."""
        own = self.plain["body"]
        if isinstance(self.config.body, HalfSpace):
            return half_space_of(own)
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
        return last.force if last.converged else None

    def resolved(self, document: Document) -> Scene:
        """The scene of a document, its theory used wherever that is exact."""
        if not {"mesh", "contact"} & document.keys():
            with suppress(ConfigError):
                return resolve(self.beside(document | {"solver": {"method": "theory"}}))
        return resolve(self.beside(document))

    def beside(self, document: Document) -> Config:
        """The config of a document that stands where the scene's file does."""
        return varied(document, Source(self.config.source.name), ())

    def by(self, steps: int) -> Document:
        """The way to the deepest row, where the force depends on it."""
        return {"delta": self.delta, "steps": steps}

    @cached_property
    def as_in_contact(self) -> Document:
        """The mesh of all variations, under the friction or the adhesion of the scene, in a few steps."""
        friction = getattr(self.config.contact, "friction", 0.0)
        held = self.attraction | ({"friction": friction} if friction else {})
        if not held:
            return self.on_mesh
        return self.on_mesh | {"contact": self.on_mesh["contact"] | held, "loading": self.by(FEW_STEPS)}

    @cached_property
    def own(self) -> float:
        """Force of the plain scene."""
        found = self.force()
        return found if found is not None and found > 0 else nan

    @cached_property
    def on_mesh(self) -> Document:
        """Sections that have a variation solved on one mesh, whatever theory knows."""
        contact = {"method": "augmented_lagrangian"}
        if isinstance(self.config.body, MeshFromFile):
            return {"contact": contact}
        scene = resolve(self.beside(self.plain | {"contact": contact | self.attraction}))
        return {"contact": contact, "mesh": {"h_contact": scene.sizes.h_contact * scene.physics.scales.length}}

    @property
    def attraction(self) -> Document:
        """The key `adhesion` of the contact law; nothing without one."""
        found = self.config.contact.adhesion
        return {"adhesion": dataclasses.asdict(found)} if found else {}

    def ratio(self, with_it: Document, without: Document | None = None) -> float | None:
        """Force with some sections replaced over that with others."""
        above, below = self.force(**with_it), self.force(**(without or {}))
        return above / below if above is not None and below is not None and below > 0 else None

    def with_materials(self, change: Callable[[Document], Document], body: Document | None = None) -> Document:
        """The sections of the plain scene, each material changed; a law of finite strain is the scene's own."""
        of_scene = to_mapping(self.config)
        own = of_scene if change is finite_strain_law else self.plain
        found = {"body": changed(body or self.plain["body"], change)}
        if change is finite_strain_law:
            for name in ("layers", "inclusions", "regions"):
                if found["body"].get(name):
                    found["body"][name] = changed(of_scene["body"], change)[name]
        return found | ({"material": change(own["material"])} if own.get("material") else {})

    @cached_property
    def known(self) -> Scene | None:
        """The scene nearest to this one whose contact is theory's."""
        for body in (self.plain["body"], self.without_sides(), half_space_of(self.plain["body"])):
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
        return log(self.own / before) / -log(NEAR) if before is not None and before > 0 else nan

    def along(self, delta: float) -> float:
        """Force at a depth: theory's curve, drawn through the deepest force; a power law where there is none."""
        if self.known is not None and self.known.plan.theory is not None:
            unit, theory = self.known.physics.scales.depth, self.known.plan.theory
            here, deep = theory.at(delta / unit), theory.at(self.delta / unit)
            if here and deep:
                return self.own * here.force / deep.force
        return float(self.own * (delta / self.delta) ** self.power)


def _round_tip(tip: Indenter) -> tuple[Indenter, bool]:
    """The tip, a pyramid as the cone of equal sections, and whether it is that."""
    if not isinstance(tip, RegularPyramid):
        return tip, False
    return Cone(degrees(atan(tip.roundness * tan(radians(tip.half_angle)))), tip.tip_radius), True
