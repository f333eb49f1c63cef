"""Forces of a scene and of its variations at the deepest row."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from math import atan, degrees, inf, isfinite, log, radians, tan
from typing import Any, TypeVar

from indent_sim.config.schema import Config, MeshSettings, Source
from indent_sim.model.body import (
    Ball,
    Box,
    Cap,
    Cylinder,
    HalfSpace,
    InfiniteLayer,
    MeshFromFile,
    Strip,
    Support,
)
from indent_sim.model.contact import AugmentedLagrangian, AutoContact
from indent_sim.model.experiment import Experiment
from indent_sim.model.loading import Loading
from indent_sim.model.materials import LinearElastic
from indent_sim.model.tips import Cone, Indenter, RegularPyramid
from indent_sim.process.errors import BackendError, ConfigError, IndentSimError, NotConverged
from indent_sim.run.chain import condense, states
from indent_sim.run.experiment import Findings, conduct
from indent_sim.run.requirements import variations
from indent_sim.run.requirements.variations import on_half_space, varied, with_matter
from indent_sim.scene.reference_theory import relative_tip
from indent_sim.scene.scene import Scene, resolve
from indent_sim.theory.solution import UNSOLVED
from indent_sim.theory.theory import Theory

T = TypeVar("T")
NEAR_DEPTH = 0.9  # of the deepest depth: where a second force says how steep the curve is
# Of a path with friction, whose force is good to 0.1 % then; with adhesion: good for the ratio of
# two, and it does not remember
PATH_STEPS = {"friction": 20, "adhesion": 2}


class Bench:
    """The forces of a scene and of its variations at the deepest row, in the user's units.

    `whole` is the scene without friction and adhesion, at small strain and on a round body where
    its own would have to be meshed in three dimensions, its inclusions then left out; `plain` has
    none. Variations change sections of either.
    """

    def __init__(self, config: Config, scene: Scene):
        self.config = config
        self.scene = scene
        self.delta = max(scene.physics.deltas) * scene.physics.scales.depth
        tip: Any = config.indenter
        is_aside = isinstance(config.body, Cylinder) and any(config.center or ())
        self.is_stood_for = (
            isinstance(config.body, Box) or is_aside
        )  # by a cylinder up to its nearest side
        self.is_from_file = isinstance(config.body, MeshFromFile)
        self.is_dome = isinstance(config.body, Cap | Ball)
        self.is_cone = isinstance(tip, RegularPyramid)  # of equal sections, for the pyramid
        half_angle = (
            degrees(atan(tip.roundness * tan(radians(tip.half_angle)))) if self.is_cone else 0.0
        )
        self.tip: Indenter = Cone(half_angle, tip.tip_radius) if self.is_cone else tip
        self.materials = variations.matter(config)
        self.is_isotropic = all(material.is_isotropic for material in self.materials)
        self._known: dict[str, Any] = {}

    @cached_property
    def how(self) -> str:
        """What stands for the scene, in words."""
        words = {
            "a cylinder up to the nearest side": self.is_stood_for,
            "the cone of equal sections": self.is_cone,
        }
        stands = [what for what, does in words.items() if does]
        return f" ({', '.join(stands)} for it)" if stands else ""

    @cached_property
    def walls(self) -> tuple[Support, ...]:
        """How the sides of the body, or of its round stand-ins, are held; empty where there are
        none.
        """
        match self.config.body:
            case Cylinder(sides=sides):
                return (sides,) if sides != "roller" or not self.is_stood_for else ("free", "fixed")
            case Box(sides=sides):
                held = {sides.x_min, sides.x_max, sides.y_min, sides.y_max}
                return (held.pop(),) if held in ({"free"}, {"fixed"}) else ("free", "fixed")
        return ()

    @cached_property
    def own_body(self) -> Config:
        """The scene to its deepest row in one step, all but its body, tip and place as usual."""
        own = self.config
        way = Loading(delta=self.delta, steps=1)
        own = with_matter(own, variations.elastic, loading=way, experiment=None)
        scene = Config(
            body=own.body, material=own.material, indenter=self.tip, center=own.center, loading=way
        )
        scene._source = Source(own.source.name)
        return scene

    @cached_property
    def _given(self) -> Config:
        """That scene on the body that stands for its own."""
        return self.stand_in(self.own_body)

    def stand_in(self, own: Config) -> Config:
        """A scene of this body; one that only a mesh in three dimensions has is a cylinder up to
        its nearest side.
        """
        body = own.body
        is_round = all(inclusion.is_about((0.0, 0.0)) for inclusion in body.inclusions or ())
        if isinstance(body, Box | Cylinder):
            kept = (
                body.inclusions if is_round and not self.is_stood_for else None
            )  # they have their place in the whole
            cylinder = Cylinder(
                body.rim_distance(self.config.center or body.center), body.height, base=body.base
            )
            cylinder = replace(cylinder, sides=self.walls[0], layers=body.layers, inclusions=kept)
            cylinder = replace(cylinder, surface_tension=body.surface_tension)
            return varied(own, body=cylinder, center=None)
        center = own.center if isinstance(body, Strip | MeshFromFile) else None
        if not is_round and body.dim == 3:
            body = replace(body, inclusions=None)  # type: ignore[arg-type]
        return varied(own, body=body, center=center)

    @cached_property
    def whole(self) -> Config:
        """The scene at small strain, its contact the usual one."""
        return with_matter(self._given, variations.linear)

    @cached_property
    def plain(self) -> Config:
        """The same without inclusions."""
        return variations.without_inclusions(self.whole)

    @cached_property
    def finite(self) -> Config:
        """The same as `whole` with laws of finite strain: its own, or neo-Hookean."""
        return with_matter(self._given, variations.hyperelastic)

    @cached_property
    def without_sides(self) -> Config | None:
        """The plain scene on the layer that its body is without its sides; None where it is no
        layer.
        """
        if isinstance(self.plain.body, HalfSpace):
            return on_half_space(self.plain)
        return (
            variations.on_layer(self.plain)
            if isinstance(self.plain.body, Cylinder | InfiniteLayer)
            else None
        )

    def under(self, tip: Indenter) -> Config:
        """The plain scene under another tip."""
        return varied(self.plain, indenter=tip)

    def meshed(self, config: Config, **contact: Any) -> Config:
        """A variation on the mesh of all of them, whatever theory knows; under friction or adhesion
        in steps.
        """
        steps = max((count for name, count in PATH_STEPS.items() if contact.get(name)), default=1)
        way = {"loading": Loading(delta=self.delta, steps=steps)} if steps > 1 else {}
        mesh = (
            {}
            if isinstance(self.config.body, MeshFromFile)
            else {"mesh": MeshSettings(h_contact=self._h_contact)}
        )
        return varied(config, contact=AugmentedLagrangian(**contact), **mesh, **way)

    @cached_property
    def in_contact(self) -> dict[str, Any]:
        """The friction or the adhesion of the scene, as keys of its contact law."""
        return {
            name: value
            for name in PATH_STEPS
            if (value := getattr(self.config.contact, name, None))
        }

    @cached_property
    def _h_contact(self) -> float:
        contact = AugmentedLagrangian(adhesion=self.config.contact.adhesion)
        scene = resolve(varied(self.whole, contact=contact))
        return scene.sizes.h_contact * scene.physics.scales.length

    def ratio(self, with_it: Config, without: Config) -> float:
        """Force of a variation over that of another: both by theory where that is exact, else both
        on one mesh; with a history at the row of the largest force. NotConverged, with the
        reason, where there is none.
        """
        if with_it.loading.in_time:
            return self._of_history(with_it, without)
        if any(self._by_theory(one) is None for one in (with_it, without)):
            with_it, without = (
                self.meshed(one) if _is_free(one) else one for one in (with_it, without)
            )
        return _over(self.force(with_it), self.force(without))

    def over(self, known: Config, with_it: Callable[[float], Config]) -> Callable[[float], float]:
        """The ratio, as a function of a parameter, of a variation with it over one that theory
        knows: what is followed far costs no mesh, but for a stretch of it.
        """

        def ratio(x: float) -> float:
            config = with_it(x)
            if self._by_theory(known) is None:
                raise NotConverged("no theory of such a body")
            return self.ratio(config, known)

        return ratio

    def force(self, config: Config) -> float:
        """Force of a variation: by theory where that is exact, else on a mesh."""
        return self._once(f"force {config!r}", lambda: self._solved(config))

    def _once(self, name: str, find: Callable[[], T]) -> T:
        """What was found before, or fails as it did; any failure of a variation is a NotConverged
        that says why.
        """
        if name not in self._known:
            try:
                self._known[name] = find()
            except BackendError:
                raise
            except (IndentSimError, *UNSOLVED) as error:
                self._known[name] = NotConverged(
                    " ".join(str(error).split()) or type(error).__name__
                )
        known: T | NotConverged = self._known[name]
        if isinstance(known, NotConverged):
            raise NotConverged(str(known))
        return known

    def _solved(self, config: Config) -> float:
        if isinstance(config.body, MeshFromFile) and config.body.kinematics == "3d":
            raise NotConverged("nothing solved in the plane stands for it")
        scene = self._by_theory(config) or resolve(config)
        seconds = scene.plan.prediction.get("seconds", 0.0)
        if scene.is_meshed and scene.physics.domain.dim == 3 and seconds > 120.0:
            raise NotConverged(
                f"a run in three dimensions, about {seconds:.2g} s: `run` the scene with it and "
                "without"
            )
        *_, last = states(scene, with_surface=False)
        if not last.converged:
            raise NotConverged("did not converge")
        return last.force

    def _by_theory(self, config: Config) -> Scene | None:
        """The scene of a variation that theory solves exactly."""
        if not _is_free(config):
            return None

        def known() -> Scene | None:
            with suppress(ConfigError):
                return resolve(varied(config, solver=replace(config.solver, method="theory")))
            return None

        return self._once(f"theory {config!r}", known)

    def findings(self, config: Config) -> Findings:
        """What the history of a variation comes to."""

        def conducted() -> Findings:
            scene = self._by_theory(config) or resolve(config)
            return conduct(scene, condense(scene).equilibrium if scene.is_meshed else None)

        return self._once(f"history {config!r}", conducted)

    def _of_history(self, with_it: Config, without: Config) -> float:
        """At the row of the largest force; where forces are prescribed, over the elastic force at
        the depth there.
        """
        rows = self.findings(with_it).rows
        top = max(rows, key=lambda row: row.force)
        if not (top.force > 0 and top.a > 0):  # it pulls all the way
            top = max(rows, key=lambda row: row.delta)
        if with_it.loading.force_history:
            return _over(
                top.force, self.force(varied(self.whole, loading=Loading(delta=top.delta, steps=1)))
            )
        same = min(self.findings(without).rows, key=lambda row: (abs(row.t - top.t), -row.force))
        return _over(top.force, same.force)

    @cached_property
    def own(self) -> float:
        """Force of the whole scene."""
        force = self.force(self.whole)
        if not 0 < force < inf:
            raise NotConverged("the tip does not push")
        return force

    @cached_property
    def flat(self) -> Config | None:
        """The half-space of what the tip touches, under the tip relative to the body's curvature;
        None in the plane.
        """
        body = self.config.body
        tip = self.tip
        pieces = 1
        if body.dim == 2:
            return None
        if isinstance(body, Cap | Ball):
            tip = relative_tip(tip, body.dome)
            pieces = body.dome.pieces
        elif not isinstance(body, MeshFromFile):
            return on_half_space(self.plain)
        way = Loading(delta=self.delta / pieces, steps=1)
        below = HalfSpace(surface_tension=self.plain.body.surface_tension)
        return varied(
            self.plain, body=below, material=self.touched, indenter=tip, center=None, loading=way
        )

    @property
    def touched(self) -> LinearElastic:
        """What the tip touches at small strain."""
        physics = self.scene.physics
        E, nu = physics.material.constants
        return LinearElastic(E=float(f"{E * physics.scales.pressure:.12g}"), nu=nu)

    @cached_property
    def known_body(self) -> Config | None:
        """The plain scene on the body nearest to its own that theory solves."""
        bodies = (self.plain, self.without_sides, self.flat)
        return next(
            (one for one in bodies if one is not None and self._by_theory(one) is not None), None
        )

    @cached_property
    def known(self) -> Scene | None:
        """That scene."""
        return self._by_theory(self.known_body) if self.known_body is not None else None

    @property
    def theory(self) -> Theory | None:
        """Its theory."""
        return self.known.plan.theory if self.known is not None else None

    def along(self, delta: float) -> float:
        """Force at a depth: theory's curve, drawn through the deepest force; a power law where
        there is none.
        """
        if self.known is not None and self.theory is not None:
            deepest = self.known.physics.deltas[-1]
            here = self.theory.at(delta / self.delta * deepest)
            deep = self.theory.at(deepest)
            if here and deep:
                return self.own * here.force / deep.force
        near = self.force(
            varied(self.whole, loading=Loading(delta=NEAR_DEPTH * self.delta, steps=1))
        )
        return float(self.own * (delta / self.delta) ** (log(near / self.own) / log(NEAR_DEPTH)))


def _is_free(config: Config) -> bool:
    """Whether contact law and mesh are left to the program."""
    return isinstance(config.contact, AutoContact) and config.mesh == MeshSettings()


def _over(above: float, below: float) -> float:
    if not (isfinite(above) and 0 < below < inf):
        raise NotConverged("without it the tip does not push")
    return above / below


def history_of(bench: Bench, *parts: str) -> Config:
    """The whole scene along its history with these parts of the experiment, or the relaxation,
    alone; without a history it goes straight to the deepest row.
    """
    own = bench.config.loading
    experiment = bench.config.experiment
    straight = Loading(history=((0.0, 0.0), (1.0, bench.delta)))
    kept = {name: part for name in parts if (part := getattr(experiment, name, None))}
    sections = {"loading": replace(own, times="auto") if own.in_time else straight}
    law = next((material.relaxation for _, material in bench.config.materials()), None)
    relaxing = law if "relaxation" in parts else None
    return with_matter(
        bench.whole,
        lambda material: replace(material, relaxation=relaxing),
        **sections,
        experiment=Experiment(**kept) if kept else None,
    )
