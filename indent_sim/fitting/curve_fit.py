"""Curve fit: one measured curve and one scene -> parameters with intervals, or the reason why there
are none.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from indent_sim.config.quantities import kind_at, pressures, size_of
from indent_sim.config.scene_file import from_mapping, to_mapping
from indent_sim.config.schema import Config
from indent_sim.config.strict_yaml import key_path
from indent_sim.fitting.inference import models
from indent_sim.fitting.inference.estimate import (
    Estimate,
    Model,
    Origin,
    Refused,
    Samples,
    beginnings,
    far_level,
    fit,
    refuse_hopeless,
)
from indent_sim.fitting.inference.models import Other, with_experiment
from indent_sim.fitting.inference.profile_likelihood import profiled
from indent_sim.fitting.inference.verdict import (
    Interval,
    Verdict,
    baseline_of,
    bends_of,
    half_widths,
    is_suspect,
    tied,
)
from indent_sim.fitting.inference.windows import windows
from indent_sim.fitting.scene_curve.elastic_table import at_once, elastic_prospect, solved
from indent_sim.fitting.scene_curve.history_table import remembers, touched, way_of
from indent_sim.fitting.scene_curve.lattice import NUMBERS, NoTable
from indent_sim.fitting.scene_curve.parameters import SPRINGS, number_at, with_numbers
from indent_sim.fitting.scene_curve.scene_forces import SceneForces, Tables, is_in_time
from indent_sim.process.errors import ConfigError
from indent_sim.results.measured.measurement import CurvePart, MeasuredCurve, NoCurve
from indent_sim.results.pictures.axes import scaled_axis
from indent_sim.results.reader import Results
from indent_sim.run.solvers.elastic_curve import half_space_modulus

CONTACT_RISE = 0.02  # of the rise: where the contact begins at the latest
BLURRED = 4.0  # medians of the change between samples: by less a depth behind a spring is noise
WAY_IN = 0.01  # of the way: where a hold begins at the latest
# of the depth, as which a diffusivity goes: another way; how often it is followed
SAME_WAY = 0.002
MOST_FOLLOWED = 4
SOLVED_WIDTHS = 1.3  # times the width of the contact: what is solved
BARELY_DEEPER = 1.01  # times the width, where the body has no more
GRADES = 1.25  # ratio of the depths of tables, so that curves share them
LEAST_DEPTH = 0.05  # of the width of a contact on a soft spring
MEANS = 200
HERTZ_POINTS = 200
R_VARIATION = 0.05  # for the exponent of the force
STEEP_BASELINE = 0.5  # of the rise, along the samples: more is hardly a baseline
IN_CONTACT = (
    "a curve that begins in contact has none, and its modulus is wrong; --no-slope, "
    "--contact-point say what is known"
)
# of numbers in words
DIGITS = 4
MOST_DIGITS = 10
ENDS = ("value", "low", "high")  # of an interval in fit.json
Models = Literal["needed", "all"]


@dataclass(frozen=True)
class Request:
    """What a fit asks of every curve: scene, keys, part of the curve, what is known, which models
    are tried.
    """

    config: Config
    keys: tuple[str, ...]
    part: CurvePart = "approach"
    origin: Origin = field(default_factory=Origin)
    models: Models = "needed"


@dataclass(frozen=True)
class Drawn:
    """What a picture and the curve's table show: depth, force off the baseline and the fit, each
    (n,); `named`: the fits of other models by name; t: times from first touch on [s], where the
    scene's force depends on them.
    """

    delta: np.ndarray
    force: np.ndarray
    fit: np.ndarray
    named: dict[str, np.ndarray] = field(default_factory=dict)
    t: np.ndarray | None = None


@dataclass(frozen=True)
class CurveFit:
    """What one curve came to: its entry of fit.json, and what is drawn of it."""

    entry: dict[str, Any]
    drawn: Drawn | None = None

    @property
    def name(self) -> str:
        """The curve's name."""
        return str(self.entry["curve"])

    @property
    def is_done(self) -> bool:
        """Whether the parameters are known."""
        return bool(self.entry["status"] == "done")


def refused(name: str, reason: str, seconds: float = 0.0) -> CurveFit:
    """A curve without parameters."""
    return CurveFit({"curve": name, "status": "refused", "reason": reason, "seconds": seconds})


def fit_curve(curve: MeasuredCurve, request: Request, tables: Tables) -> CurveFit:
    """Fit one curve, in units of its own; ConfigError where the scene or a key is wrong whatever
    the curve.
    """
    began = time.process_time()
    try:
        with np.errstate(all="ignore"):
            return _fitted(
                in_scene_units(curve, request.config).part(request.part), request, tables, began
            )
    except (Refused, NoTable) as error:
        return refused(curve.name, str(error), time.process_time() - began)
    except NoCurve as error:
        return refused(curve.name, error.problem, time.process_time() - began)
    except NUMBERS as error:
        why = (
            f"not a curve: its numbers are beyond arithmetic ({' '.join(str(error).split())[:120]})"
        )
        return refused(curve.name, why, time.process_time() - began)


def in_scene_units(curve: MeasuredCurve, config: Config) -> MeasuredCurve:
    """The curve in the units of a scene."""
    return curve.convert_units(_units(config))


def newtons_per_metre(config: Config) -> float | None:
    """The stiffness of the scene's cantilever, for AFM files that lack it; None where it has none,
    or no units.
    """
    held = config.experiment.cantilever if config.experiment else None
    if held is None or not (config.units.length and config.units.force):
        return None
    return (
        held.stiffness
        * size_of(config.units.force, "force")
        / size_of(config.units.length, "length")
    )


def _units(config: Config) -> dict[str, str]:
    return {"length": config.units.length, "force": config.units.force}


def _fitted(curve: MeasuredCurve, request: Request, tables: Tables, began: float) -> CurveFit:
    config, samples, notes = _prepared(curve, request)
    refuse_hopeless(samples)
    if is_in_time(config) and samples.t is None:
        raise NoCurve("no column of time, which a scene that relaxes or drains needs")
    follow = _followed if remembers(config) else _estimated
    estimate = follow(config, request, samples, tables)
    verdict = _judged(profiled(estimate), config, request.models, tables)
    return CurveFit(
        _entry(curve.name, verdict, config, (*curve.notes, *notes), began), _drawn(verdict)
    )


def _estimated(config: Config, request: Request, samples: Samples, tables: Tables) -> Estimate:
    """The estimate of a scene, solved as deep as the curve turns out to be."""
    forces = _forces(config, request.keys, samples, tables)
    estimate = fit(forces, samples, request.origin)
    deep = _depth_of(estimate)
    if deep > forces.deepest:
        estimate = fit(
            tables.forces(config, request.keys, SOLVED_WIDTHS * deep), samples, request.origin
        )
    return estimate


def _followed(config: Config, request: Request, samples: Samples, tables: Tables) -> Estimate:
    """The estimate of a scene with a memory, run along the measured way from first touch on: that
    of an elastic body first, and again where the fit has moved it.
    """
    assert samples.t is not None
    compliance = config.experiment.compliance if config.experiment else 0.0
    force = samples.force - far_level(samples)
    blur = (
        BLURRED * compliance * float(np.median(np.abs(np.diff(force))))
    )  # of depths behind a spring
    depth = samples.x - compliance * force
    way_in = samples.where(
        np.arange(len(samples)) <= int(np.argmax(depth > depth.max() - WAY_IN * np.ptp(depth)))
    )
    c = _first_touch(config, request, way_in, tables)
    estimate = None
    for _ in range(MOST_FOLLOWED):
        way = way_of(samples.t, depth - c, blur)
        forces = tables.forces(config, request.keys, SOLVED_WIDTHS * way.deepest, way)
        estimate = fit(forces, samples, request.origin, near=estimate)
        moved = abs(estimate.contact_point - c)
        c = estimate.contact_point
        if moved < SAME_WAY * way.deepest and not blur:
            break
        if compliance:  # the spring gives by the force that was fitted, which has no noise
            depth = samples.x - compliance * forces(estimate.theta, samples.x - c, samples.t)
            blur = 0.0
    assert estimate is not None
    return estimate


def _first_touch(config: Config, request: Request, way_in: Samples, tables: Tables) -> float:
    """The contact point of an elastic body on the way in, of a free first modulus; Refused where
    there is none.
    """
    if request.origin.contact_point is not None:
        return request.origin.contact_point
    elastic = _forces(
        _elastic(config, _width(way_in, config)), (pressures(config)[0],), way_in, tables
    )
    starts = beginnings(elastic, way_in, request.origin)
    if not starts:
        raise Refused("no contact: the force does not rise with the depth")
    p, _ = Model(elastic, way_in, request.origin).fitted(starts[0])
    return float(p[-3])


def _elastic(config: Config, depth: float) -> Config:
    """The same scene of matter without a memory, behind the same spring, pressed to a depth."""
    held = to_mapping(config).get("experiment")
    document = to_mapping(at_once(config, depth))
    return from_mapping(document | ({"experiment": held} if held else {}))


def _prepared(curve: MeasuredCurve, request: Request) -> tuple[Config, Samples, list[str]]:
    """The scene as this curve needs it, its samples, and what was assumed."""
    config = request.config
    notes = []
    is_held = config.experiment is not None and config.experiment.compliance > 0
    stiffness = curve.stiffness
    if not is_held and stiffness and curve.z is not None:
        config = with_experiment(config, cantilever={"stiffness": stiffness})
        is_held = True
    along = curve.available_abscissa("z" if is_held else "delta")
    if is_held and along == "delta":
        config = _rigid(config)
        notes.append("the curve has depths: the scene's spring is not used")
    if not is_held and along == "z":
        notes.append("no spring is known: the way of the base is taken for the depth")
    t = None if curve.t is None else curve.t - curve.t[0]
    return config, Samples(curve.abscissa_values(along), curve.force, t), notes


def _rigid(config: Config) -> Config:
    parts = config.experiment
    assert parts is not None
    return config.model_copy(update={"experiment": replace(parts, cantilever=None, frame=None)})


def _forces(config: Config, keys: tuple[str, ...], samples: Samples, tables: Tables) -> SceneForces:
    """The scene's forces to the depth that the curve may have, one that other curves are given too
    where it exists.
    """
    width = _width(samples, config)
    graded = GRADES ** math.ceil(math.log(SOLVED_WIDTHS * width) / math.log(GRADES))
    try:
        return tables.forces(config, keys, graded)
    except (ConfigError, NoTable):
        return tables.forces(config, keys, BARELY_DEEPER * width)


def _width(samples: Samples, config: Config) -> float:
    """The depth of the part that lies above the baseline, at most [length]."""
    few = samples.means(MEANS)
    order = np.argsort(few.x, kind="stable")  # a retraction begins at its deepest
    x = few.x[order]
    force = few.force[order]
    level = far_level(few)
    top = int(np.argmax(force))
    rise = float(force[top]) - level
    below = np.flatnonzero(force[: top + 1] < level + CONTACT_RISE * rise)
    width = float(samples.x.max() - x[below[-1] if len(below) else 0])
    compliance = config.experiment.compliance if config.experiment else 0.0
    return max(width - compliance * rise, LEAST_DEPTH * width)


def _depth_of(estimate: Estimate) -> float:
    """The depth of the deepest sample behind the spring [length]."""
    return estimate.depth - estimate.model.forces.experiment.compliance * estimate.rise


def _judged(estimate: Estimate, config: Config, wanted: Models, tables: Tables) -> Verdict:
    forces = estimate.model.forces
    seen = windows(estimate)
    bends = bends_of(estimate)
    baseline = baseline_of(estimate)
    found: list[Other] = []
    if wanted == "all" or is_suspect(seen, bends, baseline):
        found = models.others(estimate, config, tables)
    uncertain = half_widths(estimate, forces.error, relative_calibration(config, forces))
    return Verdict(estimate, seen, bends.shape, baseline, found, uncertain)


def relative_calibration(config: Config, forces: SceneForces) -> float:
    """Relative uncertainty of a modulus by those of the cantilever's stiffness and the tip's
    radius.
    """
    given = config.experiment.calibration if config.experiment else None
    return (
        math.hypot(given.stiffness, _of_R(config, forces.deepest) * given.R if given.R else 0.0)
        if given
        else 0.0
    )


def _of_R(config: Config, deepest: float) -> float:
    """The exponent of the tip's radius in the deepest force."""
    R = number_at(config, "indenter.R")
    at = np.array([deepest])
    sizes = (1.0 - R_VARIATION, 1.0 + R_VARIATION)
    scenes = (with_numbers(config, {"indenter.R": size * R}) for size in sizes)
    less, more = (float(solved(scene, deepest).force(at)[0]) for scene in scenes)
    return math.log(more / less) / math.log(sizes[1] / sizes[0])


# ---- what is said of it
# ------------------------------------------------------------------------------------


def _entry(
    name: str, verdict: Verdict, config: Config, notes: tuple[str, ...], began: float
) -> dict[str, Any]:
    """The curve's entry of fit.json."""
    estimate = verdict.estimate
    forces = verdict.estimate.model.forces
    parameters = forces.parameters
    k = len(forces.parameters)
    stated = {one.key: verdict.stated(i) for i, one in enumerate(parameters)}
    numbers = {
        one.key: vars(stated[one.key])
        | {"statistical": [one.value(end) for end in verdict.statistical(i)]}
        for i, one in enumerate(parameters)
    }
    half = 1.96 * float(estimate.sd[k])
    place = {"value": estimate.contact_point, "low": estimate.contact_point - half}
    shared = {one.key: ratio for one, ratio in zip(parameters, tied(estimate), strict=True)}
    rise = estimate.rise
    n = len(estimate.model.samples)
    noise = estimate.found.likeliest
    residual: dict[str, Any] = {"rms": estimate.rms, "percent": 100 * estimate.rms / rise, "n": n}
    residual |= {"n_effective": n / noise.samples, "correlation": noise.tau}
    residual |= {"p_shape": verdict.p_shape, "p_baseline": verdict.p_baseline}
    span = max(float(np.ptp(estimate.model.samples.x)), 1e-300)
    found = {
        "curve": name,
        "status": "done",
        "reason": "",
        "explained": verdict.explained,
        "cause": verdict.cause,
    }
    found |= {"parameters": numbers, "fixed": _fixed(config, forces)}
    found |= {"contact_point": place | {"high": estimate.contact_point + half}}
    found |= {"baseline": {"force": float(estimate.p[-2]), "slope": float(estimate.p[-1]) / span}}
    found |= {"force_max": rise, "depth": _depth_of(estimate), "residual": residual}
    found |= {
        "window": _windows(verdict),
        "models": [_model(one, parameters) for one in verdict.others],
    }
    found |= {
        "identifiable": verdict.identifiable,
        "tied": shared,
        "words": _words(verdict, config),
    }
    found |= {"hertz": _hertz(verdict, config), "model_error": forces.error}
    return found | {
        "warnings": [*notes, *_warnings(verdict)],
        "seconds": time.process_time() - began,
    }


def _fixed(config: Config, forces: SceneForces) -> dict[str, float]:
    """Numbers of the scene on which a modulus leans, and which the fit did not touch."""
    known = {}
    for key in (
        "material.E",
        "material.nu",
        "indenter.R",
        "indenter.half_angle",
        "body.height",
        *SPRINGS,
    ):
        if key not in forces.keys:
            try:
                known[key] = number_at(config, key)
            except ConfigError:
                continue
    return known


def _windows(verdict: Verdict) -> list[dict[str, float]]:
    """Values and intervals of every window, the whole curve the last."""
    parameters = verdict.estimate.model.forces.parameters

    def row(
        upper: float, theta: np.ndarray, interval: Callable[[int], tuple[float, float]]
    ) -> dict[str, float]:
        found = {"upper": upper}
        for k, one in enumerate(parameters):
            low, high = map(one.value, interval(k))
            found |= {
                one.key: one.value(float(theta[k])),
                f"{one.key}_low": low,
                f"{one.key}_high": high,
            }
        return found

    rows = [row(window.upper, window.theta, window.interval) for window in verdict.windows]
    return [*rows, row(1.0, verdict.estimate.theta, verdict.statistical)]


def _model(other: Other, parameters: tuple[Any, ...]) -> dict[str, Any]:
    """Another model: what it adds, and the first varied key that it would give."""
    first = parameters[0] if parameters else None
    found: dict[str, Any] = {"name": other.name, "p": other.p, "parameters": other.added}
    if first is None:
        return found
    low, high = other.estimate.interval(0)
    value = first.value(float(other.estimate.theta[0]))
    return found | {"value": value, "low": first.value(low), "high": first.value(high)}


def _hertz(verdict: Verdict, config: Config) -> dict[str, float] | None:
    """The modulus of a half-space fit from the same contact point, and by how many per cent it is
    off the scene's.
    """
    estimate = verdict.estimate
    forces = verdict.estimate.model.forces
    prospect = elastic_prospect(config, forces.deepest)
    samples = estimate.model.samples.means(HERTZ_POINTS)
    off = estimate.model.samples.force - estimate.model.baseline(estimate.p)
    force = Samples(estimate.model.samples.x, off).means(HERTZ_POINTS).force
    delta = samples.x - estimate.contact_point - forces.experiment.compliance * force
    E = half_space_modulus(prospect, delta, force)
    if E is None:
        return None
    fitted = zip(forces.parameters, estimate.theta, strict=True)
    moduli = [one.value(float(x)) for one, x in fitted if one.key == "material.E"]
    own = moduli[0] if moduli else prospect.modulus
    return {"E": E, "percent": 100 * (E / own - 1)}


def _warnings(verdict: Verdict) -> list[str]:
    estimate = verdict.estimate
    parameters = estimate.model.forces.parameters
    told = [
        f"{one.key} is at the end of its range"
        for k, one in enumerate(parameters)
        if estimate.at_bound(k)
    ]
    if estimate.p[-1] > STEEP_BASELINE * estimate.rise:
        told.append(
            f"the baseline rises by {100 * estimate.p[-1] / estimate.rise:.0f} % of the "
            f"force: {IN_CONTACT}"
        )
    error = estimate.model.forces.error
    sd = estimate.sd[: len(parameters)]
    if len(sd) and error > 0.65 * float(np.min(sd[sd > 0], initial=np.inf)):  # a third of 1.96 sd
        told.append(
            f"the mesh is off by {100 * error:.2g} %, more than a third of the noise: a finer "
            "mesh tells more"
        )
    return told


def said(key: str, config: Config, value: float, beside: Interval | None = None) -> str:
    """A value of a key with its unit, where the scene has units: of the size of an interval that it
    stands beside, with the digits that tell its ends apart.
    """
    kind = kind_of(config, key)
    digits = _digits(beside) if beside else DIGITS
    if kind is None:
        return f"{value:.{digits}g}"
    runs = [Results(Path(), {}, {"units": _units(config)})]
    return scaled_axis(kind, runs, np.array([beside.value if beside else value]), key).value_text(
        value, digits
    )


def _digits(stated: Interval) -> int:
    """Two of the width of an interval, four at least."""
    width = (stated.high - stated.low) / max(abs(stated.high), abs(stated.low), 1e-300)
    return (
        min(max(DIGITS, 2 - math.floor(math.log10(width))), MOST_DIGITS)
        if 0 < width < math.inf
        else DIGITS
    )


def kind_of(config: Config, key: str) -> str | None:
    """Length, force or pressure, of a key of these dimensions."""
    return kind_at(key_path(key), to_mapping(config))


def _words(verdict: Verdict, config: Config) -> str:
    """The verdict in a few sentences."""
    told = [_sentence(verdict, k, config) for k in range(verdict.estimate.model.size)]
    if verdict.explained:
        return " ".join([*told, "Nothing in the curve stands against the scene."])
    named = ", ".join(one.name for one in verdict.named)
    other = f"{named} would." if named else "no model known here does." if verdict.others else ""
    return " ".join([*told, f"The scene does not explain the curve; {other}".rstrip("; ")])


def in_short(entry: Mapping[str, Any], config: Config) -> str:
    """The intervals, and what stands against the scene, on one line."""
    told = [
        in_words(key, config, Interval(*map(one.get, ENDS)))
        for key, one in entry["parameters"].items()
    ]
    against = f"not explained: {', '.join(entry['cause'])}" if entry["cause"] else "explained"
    return "  ·  ".join([*told, against])


def in_words(key: str, config: Config, stated: Interval) -> str:
    """A key's value and interval with their unit."""
    value, low, high = (
        said(key, config, number, stated) for number in (stated.value, stated.low, stated.high)
    )
    return f"{key.rpartition('.')[2]} = {value}, 95 % in {low} to {high}"


def _sentence(verdict: Verdict, k: int, config: Config) -> str:
    one = verdict.estimate.model.forces.parameters[k]
    text = in_words(one.key, config, verdict.stated(k))
    half = 196 * float(verdict.estimate.sd[k])
    alone = f"statistics alone would say ±{half:.2g} %" if not one.is_linear else ""
    if "window" in verdict.cause and verdict.windows:
        first = said(one.key, config, one.value(float(verdict.windows[0].theta[k])))
        text += (
            f": the fit moves with the window, from {first} at {verdict.windows[0].upper:g} "
            "of the depth"
        )
    return f"{text}; {alone}." if alone and not verdict.explained else f"{text}."


def _drawn(verdict: Verdict) -> Drawn:
    """The curve off its baseline with the fits, over the depth behind the spring that the scene's
    has.
    """
    estimate = verdict.estimate
    model = estimate.model
    baseline = estimate.model.baseline(estimate.p)
    fitted = model.contact(estimate.p)
    delta = model.samples.x - estimate.contact_point - model.forces.experiment.compliance * fitted
    named: dict[str, np.ndarray] = {}
    for one in verdict.named:
        other = one.estimate
        named[one.name] = other.model.contact(other.p) + other.model.baseline(other.p) - baseline
    t = model.samples.t
    from_touch = t - touched(t, delta) if t is not None and model.forces.relaxes else None
    return Drawn(delta, model.samples.force - baseline, fitted, named, from_touch)


def request_words(request: Request) -> Mapping[str, Any]:
    """What tells one request from another, for the folder that goes on with it."""
    known = {"scene": to_mapping(request.config), "vary": list(request.keys), "part": request.part}
    return known | {"origin": vars(request.origin), "models": request.models}
