"""The table of requirements: what a model may leave out, each row a scene with it and one without."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from math import hypot, inf, log
from typing import Any

from indent_sim.config.schema import Config
from indent_sim.model.body import (
    Cylinder,
    Endless,
    HalfSpace,
    InfiniteLayer,
    MeshFromFile,
    Strip,
    StripSides,
    Support,
)
from indent_sim.model.body import Layer as BodyLayer
from indent_sim.model.contact import Friction
from indent_sim.model.loading import History
from indent_sim.model.materials import LinearElastic, Relaxation
from indent_sim.model.tips import (
    FlatPunch,
    Hyperboloid,
    Indenter,
    Paraboloid,
    Plate,
    Profile,
    Sphere,
)
from indent_sim.run.requirements import variations
from indent_sim.run.requirements.bench import Bench, history_of
from indent_sim.run.requirements.effects import (
    Known,
    Pair,
    Requirement,
    Said,
    Start,
    Unknown,
    absent,
)
from indent_sim.run.requirements.variations import on_half_space, varied, with_matter
from indent_sim.scene.problem_setup import remaining_modulus_fraction
from indent_sim.theory.layer import Layer
from indent_sim.theory.roots import increasing_root
from indent_sim.theory.surface.adhesion import Jkr
from indent_sim.theory.surface.punches import LayerPunches

FRICTIONS: tuple[Friction, ...] = (
    0.1,
    0.3,
    "stick",
)  # that tell what may come of friction where a scene has none
# Of a punch's radius: as near as a wall is followed, for at the punch itself the body is
# compressed, another problem
WALL_ROOM = 1.01
RANGE_MARGIN = 1e-3  # of the force, by which a range is wider than half of itself to either side
RADIUS_CHANGE = 0.02  # relative change of R that says how the force grows with it
# Of a contact with adhesion, where its search begins; of the depth, instead of one below 0
TINY_TENSION = 0.01  # of E* delta, where the search for a surface tension that matters begins
WIDER = 1e-3
TINY_DEPTH = 1e-6
# Of a flat punch's radius: that of its edge where it is too sharp to solve at finite strain, whose
# effect hangs little on it: at nu = 0.3, delta/a = 0.1 it is 1.18 to 1.23 % for edges of 0.005 to
# 0.1, 1.6 % for a sharp one
ROUNDED = 0.05
SOFTEST = (
    1e3  # times the modulus of a film, of the substrate from which on a softer one is followed
)
BELOW = 0.3  # Poisson's ratio of that substrate


def _paraboloid(bench: Bench, within: float) -> Said:
    tip = bench.config.indenter
    if not isinstance(tip, Paraboloid | Sphere):
        return absent(f"a {tip.shape.replace('_', ' ')} is no sphere")
    return Pair(
        bench.under(Sphere(tip.R)),
        bench.under(Paraboloid(tip.R)),
        f"a sphere over a paraboloid{bench.how}",
    )


def _blunt_tip(bench: Bench, within: float) -> Said:
    tip: Any = bench.tip
    key = "edge_radius" if isinstance(tip, FlatPunch) else "tip_radius"
    if not hasattr(tip, key):
        return absent(f"a {tip.shape} has neither apex nor edge")
    sharp = replace(tip, **{key: 0.0})
    if getattr(tip, key) > 0:
        return Pair(
            bench.plain, bench.under(sharp), f"the rounded tip over the sharp one{bench.how}"
        )
    if (
        isinstance(tip, Profile)
        or bench.known_body is None
        or (bench.is_dome and isinstance(tip, FlatPunch))
    ):
        return Unknown("no theory of this tip and body")
    known = varied(bench.known_body, indenter=sharp)
    change = bench.over(known, lambda radius: varied(known, indenter=replace(tip, **{key: radius})))
    end = 0.999 * tip.radius if isinstance(tip, FlatPunch) else inf
    return Start(
        f"indenter.{key}", change, min(0.1 * bench.delta, end / 2), f"theory{bench.how}", end=end
    )


def _thickness(bench: Bench, within: float) -> Said:
    body = bench.config.body
    layer = bench.without_sides
    if body.dim == 2:
        return Unknown("in plane strain a half-space has no depth: the thickness always decides")
    if isinstance(body, HalfSpace):
        return _height_of_half_space(bench)
    if layer is None:
        assert bench.flat is not None
        change = bench.own / bench.force(bench.flat) - 1
        return Known(change, change, f"the body as it is over a half-space{bench.how}", change)
    words = f"theory of a layer over that of a half-space{bench.how}"
    return Pair(
        layer, on_half_space(layer), words if bench.is_isotropic else "a layer over a half-space"
    )


def _height_of_half_space(bench: Bench) -> Said:
    if bench.config.body.layers:
        return absent("the last layer is a half-space")
    scales = bench.scene.physics.scales
    a = bench.scene.physics.indenter.radius_at(bench.delta / scales.depth) * scales.length
    change = bench.over(bench.plain, lambda x: varied(bench.plain, body=InfiniteLayer(1 / x)))
    return Start(
        "body.height",
        change,
        0.05 / a,
        "theory of a layer on a rigid base",
        lambda x: 1 / x,
        " down",
    )


def _side_walls(bench: Bench, within: float) -> Said:
    body = bench.config.body
    layer = bench.without_sides
    if isinstance(body, HalfSpace):
        return absent("a half-space has no sides")
    if isinstance(body, Endless):
        return _walls_of_layer(bench)
    if isinstance(body, Strip):
        far: Any = bench.plain.body
        far = replace(
            far, width=2 * body.width + 20 * body.height, sides=StripSides("roller", "roller")
        )
        alone = varied(bench.plain, body=far, center=None)
        return Pair(bench.plain, alone, "the strip over one with its walls far away")
    if layer is None:
        return absent("in the row of the thickness, which takes the body as it is")
    changes = [_walled(bench, sides) for sides in bench.walls]
    if not bench.is_stood_for:
        return Known(
            changes[0],
            changes[0],
            f"the body with its sides over a layer without{bench.how}",
            changes[0],
        )
    words = (
        f"between none and {' or '.join(bench.walls)} sides all around at the distance of "
        "the nearest"
    )
    return Known(min(0.0, *changes), max(0.0, *changes), words)


def _walled(bench: Bench, sides: Support) -> float:
    """Relative change of the force by sides: by theory for rollers, from which others differ on one
    mesh.
    """
    body: Any = bench.plain.body
    held, rollers = (
        varied(bench.plain, body=replace(body, sides=one)) for one in (sides, "roller")
    )
    beside = 1.0 if sides == "roller" else bench.ratio(bench.meshed(held), bench.meshed(rollers))
    return bench.ratio(rollers, bench.without_sides) * beside - 1  # type: ignore[arg-type]


def _walls_of_layer(bench: Bench) -> Said:
    own: Any = bench.plain.body
    walled = partial(Cylinder, height=own.height, base=own.base, sides="roller", layers=own.layers)
    change = bench.over(bench.plain, lambda x: varied(bench.plain, body=walled(1 / x)))
    key = "a frictionless wall at radius"
    tip = bench.tip
    nearest = WALL_ROOM * tip.radius if isinstance(tip, FlatPunch) else 0.0
    end = 1 / nearest if nearest else inf
    first = min(0.3 / own.height, end)
    return Start(key, change, first, "theory of both", lambda x: 1 / x, " or nearer", end)


def _substrate(bench: Bench, within: float) -> Said:
    body: Any = bench.config.body
    layer = bench.without_sides
    if isinstance(body, HalfSpace) and not body.layers:
        return absent("there is nothing below a half-space")
    if layer is None:
        return absent(
            "this body stands on something rigid; what it is made of is in the row of the layers"
        )
    if len(layer.layers) > 1:
        first = layer.layers[0].material
        alone = varied(layer, body=HalfSpace(), material=first)
        return Pair(
            layer, alone, f"theory of all layers over that of the first as a half-space{bench.how}"
        )
    if not bench.is_isotropic or body.base != "fixed":
        return Unknown("theory knows no half-space below such a layer")
    film = layer.layers[0].material
    (E, _) = bench.materials[0].constants

    def above(x: float) -> Config:
        plies = (
            BodyLayer(body.height, film),
            BodyLayer(None, LinearElastic(E=SOFTEST / x * E, nu=BELOW)),
        )
        return varied(layer, body=HalfSpace(layers=plies), material=None)

    source = f"theory of a film on a half-space of nu = {BELOW:g}"
    return Start(
        "a substrate of E",
        bench.over(layer, above),
        1.0,
        source,
        lambda x: SOFTEST / x * E,
        " down",
    )


def _layers(bench: Bench, within: float) -> Said:
    if len(bench.config.layers) < 2 and not getattr(bench.config.body, "regions", None):
        return absent("the body is of one piece")
    is_meshed = isinstance(bench.config.body, MeshFromFile)
    touched = bench.touched if is_meshed else variations.linear(bench.config.layers[0].material)  # type: ignore[arg-type]
    alone = with_matter(bench.plain, lambda own: touched)
    return Pair(
        bench.plain, alone, f"the body with its layers over one of what the tip touches{bench.how}"
    )


def _inclusions(bench: Bench, within: float) -> Said:
    if not bench.config.body.inclusions:
        return absent("the body has none")
    if bench.whole.body.inclusions:
        own = bench.meshed(bench.whole)
        how = bench.how
    else:
        own = varied(with_matter(bench.own_body, variations.linear), mesh=bench.config.mesh)
        how = ", in three dimensions"
    words = f"the body with its inclusions over one without, on one mesh{how}"
    return Pair(own, variations.without_contrast(own), words)


def _anisotropy(bench: Bench, within: float) -> Said:
    if bench.is_isotropic:
        return absent("the material is isotropic")
    words = f"over an isotropic material with its E and nu, those across the axis{bench.how}"
    return Pair(bench.whole, with_matter(bench.whole, variations.isotropic), words)


def _small_strain(bench: Bench, within: float) -> Said:
    if not bench.is_isotropic:
        return Unknown("no law of finite strain is anisotropic")
    tip, edge = _rounded(bench.tip)
    law = "its own law" if not bench.scene.physics.small_strain else "neo-Hookean"
    small, finite = (varied(one, indenter=tip) for one in (bench.whole, bench.finite))
    words = f"{law}, gap: current, over small strain, gap: reference, on one mesh{edge}{bench.how}"
    with_it = bench.meshed(finite, gap="current", **bench.in_contact)
    return Pair(with_it, bench.meshed(small, **bench.in_contact), words)


def _rounded(tip: Indenter) -> tuple[Indenter, str]:
    """A tip with the edge of a sharp flat punch rounded, as finite strain needs it, and that in
    words.
    """
    if not isinstance(tip, FlatPunch) or tip.edge_radius >= ROUNDED * tip.radius:
        return tip, ""
    words = f", the punch's edge rounded by {ROUNDED:g} of its radius in both"
    return replace(tip, edge_radius=ROUNDED * tip.radius), words


def _incompressible(bench: Bench, within: float) -> Said:
    if not bench.is_isotropic:
        return Unknown("the material is not isotropic")
    if any(material.constants.nu != 0.5 for material in bench.materials):
        alike = with_matter(bench.whole, variations.incompressible)
        return Pair(alike, bench.whole, f"nu = 0.5 at the same E{bench.how}")
    known = bench.known_body
    if known is None:
        return Unknown("no theory of this body")
    change = bench.over(
        known, lambda x: with_matter(known, partial(variations.incompressible, less=x))
    )
    return Start(
        "nu", change, 0.01, f"theory{bench.how}", lambda x: 0.5 - x, " down", end=0.5, digits=4
    )


def _surface_tension(bench: Bench, within: float) -> Said:
    own: Any = bench.config.body
    if isinstance(own, MeshFromFile) or own.dim == 2:
        return absent(
            "a mesh from a file has none"
            if own.dim == 3
            else "there is no theory of it in plane strain"
        )
    if own.surface_tension:
        without = varied(bench.plain, body=replace(bench.plain.body, surface_tension=0.0))  # type: ignore[arg-type]
        return Pair(
            bench.plain, without, f"the body with its surface tension over one without{bench.how}"
        )
    known = bench.without_sides or bench.flat
    if known is None:
        return Unknown("no theory of this tip and body")
    start = (
        TINY_TENSION
        * bench.scene.physics.material.E_star
        * bench.scene.physics.scales.pressure
        * bench.delta
    )

    def tensed(gamma: float) -> Config:
        return varied(known, body=replace(known.body, surface_tension=gamma))  # type: ignore[union-attr, arg-type]

    return Start("body.surface_tension", bench.over(known, tensed), start, f"theory{bench.how}")


def _friction(bench: Bench, within: float) -> Said:
    rough = bench.in_contact.get("friction")
    known = bench.scene.plan.friction
    if not rough:
        return absent("the scene has none")
    if known:
        change = known.force - 1
        return Known(change, change, f"friction {rough} over none: half-space, exact", change)
    return Pair(*_rough(bench, rough), f"friction {rough} over none, on one mesh{bench.how}")


def _rough(bench: Bench, friction: Friction) -> tuple[Config, Config]:
    return bench.meshed(bench.whole, friction=friction), bench.meshed(bench.whole)


def _stick(bench: Bench, within: float) -> Said:
    """No slip, and where the scene has no friction what may come of any."""
    source = f"on one mesh{bench.how}"
    if bench.in_contact.get("friction"):
        return Pair(*_rough(bench, "stick"), f"no slip over no friction, {source}")
    changes = [bench.ratio(*_rough(bench, friction)) - 1 for friction in FRICTIONS]
    wider = (max(changes) - min(changes)) / 2 + RANGE_MARGIN
    number = changes[-1]
    exact = bench.scene.plan.stick
    if exact is not None and exact.percent is not None:  # exact
        number = exact.percent / 100
        source = exact.source
    words = f"no slip: {source}; the range holds friction from {FRICTIONS[0]:g} on"
    return Known(min(number, *changes) - wider, max(number, *changes) + wider, words, number)


def _adhesion(bench: Bench, within: float) -> Said:
    own = bench.in_contact.get("adhesion")
    if own:
        words = f"the contact law with its range over the one without, on one mesh{bench.how}"
        return Pair(bench.meshed(bench.whole, adhesion=own), bench.meshed(bench.whole), words)
    experiment = bench.config.experiment
    if bench.config.body.surface_tension:
        return Unknown("not known together with a surface tension")
    if experiment and experiment.adhesion:
        with_it = history_of(bench, "adhesion")
        said = bench.findings(with_it).report["adhesion"]
        words = (
            f", pull-off {said['pull_off']['force_control']['force'] / bench.own:.2g} of this force"
        )
        words += f", Tabor number {said['tabor']:.2g}" if "tabor" in said else ""
        return Pair(with_it, history_of(bench), f"the JKR limit{words}{bench.how}")
    if isinstance(bench.tip, FlatPunch | Plate) and not bench.is_dome:
        return absent("a flat punch touches the same disc with adhesion as without")
    return _work(bench, within)


def _work(bench: Bench, within: float) -> Said:
    contact = bench.theory.contact if bench.theory else None
    if bench.known is None or not isinstance(contact, Layer):
        return Unknown("the JKR limit is that of a disc")
    scales = bench.known.physics.scales
    punches = LayerPunches(contact)
    delta = bench.known.physics.deltas[-1]
    unit = scales.pressure * scales.length
    alone = contact.curve([delta])[0]

    def pulled(work: float) -> float:
        jkr = Jkr(punches, work / unit)  # the stable contact is the one wider than without adhesion
        begin = alone.a * (1 + WIDER)
        wider = increasing_root(
            lambda a: max(jkr.at(a).delta, TINY_DEPTH * delta), delta, begin, punches.largest
        )
        return jkr.at(wider).force / alone.force

    return Start(
        "work", pulled, 0.01 * within * alone.force * unit / alone.a, f"the JKR limit{bench.how}"
    )


def _rate(bench: Bench, within: float) -> Said:
    law = next((material.relaxation for _, material in bench.config.materials()), None)
    if bench.config.body.surface_tension:
        return Unknown("a surface tension does not relax")
    if law is None:
        needs = (
            f"above {100 * within:g} % from a fraction of the modulus that relaxes before the "
            "deepest point"
        )
        return Unknown(
            "Lee & Radok: the force falls by that fraction at most", f"{needs} = {within:.2g}"
        )
    if history := bench.config.loading.in_time:
        words = f"the history over that of an elastic body{_deborah(history, law)}{bench.how}"
        return Pair(history_of(bench, "relaxation"), history_of(bench), words)
    if law.power_law is not None:
        return Unknown("a power law has no modulus without a time")
    return Known(
        remaining_modulus_fraction(law, None) - 1,
        0.0,
        "between the instantaneous and the last modulus",
    )


def _deborah(history: History, law: Relaxation) -> str:
    """The relaxation's mean time over that of the way in, in words."""
    points = history.points
    t = max(points, key=lambda point: (point[1], -point[0]))[0] - points[0][0]
    total = sum(fraction for fraction, _ in law.prony or ())
    return (
        f", Deborah number {sum(f * tau for f, tau in law.prony or ()) / total / t:.2g}"
        if total and t > 0
        else ""
    )


def _cantilever(bench: Bench, within: float) -> Said:
    experiment = bench.config.experiment
    if experiment is not None and experiment.compliance > 0:
        if bench.config.loading.force_history:
            return absent("the force is prescribed, whatever holds the tip")
        words = f"the way of the base taken for the depth{bench.how}"
        return Pair(history_of(bench, "cantilever", "frame"), history_of(bench), words)
    stiffness = (1 - within) * bench.own / (bench.delta - _depth_of(bench, 1 - within))
    needs = f"above {100 * within:g} % from stiffness = {stiffness:.2g} down"
    return Unknown("the way of the base taken for the depth", needs)


def _contact_point(bench: Bench, within: float) -> Said:
    offset = bench.delta - _depth_of(bench, 1 - within)
    return Unknown(
        "the curve's own slope",
        f"above {100 * within:g} % from an error of the depth = {offset:.2g}",
    )


def _depth_of(bench: Bench, share: float) -> float:
    """The depth at which the force is a share of the deepest one."""
    start = bench.delta * share ** (2 / 3)
    return increasing_root(lambda d: bench.along(d) / bench.own, share, start, 1.01 * bench.delta)


def _calibration(bench: Bench, within: float) -> Said:
    given = bench.config.experiment.calibration if bench.config.experiment else None
    steep, source = _of_radius(bench)
    if given is None:
        R = f" or R = {within / steep:.2g}" if steep else ""
        return Unknown(
            source, f"above {100 * within:g} % from calibration.stiffness = {within:.2g}{R}"
        )
    share = hypot(given.stiffness, steep * given.R)
    return Known(-share, share, source)


def _of_radius(bench: Bench) -> tuple[float, str]:
    """d ln F/d ln R of a tip that has one, and what the force owes to an uncertain instrument."""
    tip = bench.tip
    words = "an error of the spring is one of the force"
    if not isinstance(tip, Paraboloid | Sphere | Hyperboloid):
        return 0.0, words
    ratio = bench.ratio(bench.under(replace(tip, R=(1 + RADIUS_CHANGE) * tip.R)), bench.plain)
    steep = log(ratio) / log(1 + RADIUS_CHANGE)
    return steep, f"{words}; force ~ R^{steep:.2g}"


OF_BODY = (
    _paraboloid,
    _thickness,
    _side_walls,
    _substrate,
    _layers,
    _inclusions,
    _anisotropy,
    _small_strain,
)
OF_CONTACT = (_incompressible, _blunt_tip, _surface_tension, _friction, _stick, _adhesion)
ROWS = (*OF_BODY, *OF_CONTACT, _rate, _cantilever, _contact_point, _calibration)
REQUIREMENTS = tuple(Requirement(said.__name__.removeprefix("_"), said) for said in ROWS)
