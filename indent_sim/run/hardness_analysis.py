"""Hardness and modulus of a measured or simulated loading and unloading curve (ISO 14577-1)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from math import inf, isfinite, nan
from pathlib import Path
from typing import Any

import numpy as np

from indent_sim.config.key_types import join_words
from indent_sim.config.quantities import convert_quantity, si_factor
from indent_sim.config.schema import Config
from indent_sim.model.gel import Gel
from indent_sim.model.tips import Berkovich, Vickers
from indent_sim.model.work import Work
from indent_sim.process.errors import ConfigError, UsageError
from indent_sim.results.csv_table import header_of
from indent_sim.results.measured.curve_file import read_curves
from indent_sim.results.measured.indentation_cycle import (
    MAX_LAST_FORCE,
    CreepRate,
    IndentationCycle,
    creep_rate,
    indentation_cycle,
    low_force_hold,
)
from indent_sim.results.measured.measurement import MeasuredCurve
from indent_sim.results.reader import Results, read
from indent_sim.results.result_scene import contacts_per_body, scene_of
from indent_sim.run.area_function import AreaFunction, area_from_text, area_of_tip
from indent_sim.theory import oliver_pharr
from indent_sim.theory.half_space import check_nu
from indent_sim.theory.oliver_pharr import UnloadingFit

# Quantities in the order of their output: unit, and meaning.
QUANTITIES = {
    "H_IT": ("pressure", "indentation hardness F_max/A_p"),
    "E_IT": ("pressure", "indentation modulus of the sample"),
    "E_r": ("pressure", "reduced modulus of sample and tip"),
    "eta_IT": ("%", "elastic part of the work of indentation"),
    "C_IT": ("%", "creep: relative increase of the depth in the hold"),
    "dh_dt": ("rate", "rate of the depth in the last third of the hold"),
    "S": ("stiffness", "contact stiffness dF/dh at the beginning of unloading"),
    "F_max": ("force", "force at the beginning of unloading"),
    "h_max": ("length", "depth at the beginning of unloading"),
    "h_c": ("length", "contact depth h_max - epsilon F_max/S"),
    "A_p": ("area", "projected contact area by the area function at h_c"),
    "h_r": ("length", "depth at which the tangent of slope S vanishes"),
    "h_p": ("length", "permanent depth: where the force of unloading vanishes"),
    "h_f": ("length", "depth at which the fitted power law vanishes"),
    "m": ("", "exponent of the power law F = B (h - h_f)^m"),
    "W_total": ("work", "work of loading and hold"),
    "W_elast": ("work", "work that unloading returns"),
}
# The part of unloading that is fitted: from 98 % of the largest force, below which the transition
# from hold to unloading is over, down to 40 %, above which the contact changes so little that the
# curve is a power law. This is the usual choice for tests by ISO 14577-1; 20 % is also common.
DEFAULT_TOP = (0.98, 0.40)
# The same for a run with few rows of unloading.
RUN_TOP = (1.0, 0.05)
# Poisson's ratio of a sample of unknown material; the modulus is 5.5 % larger for 0.2 and 7.7 %
# smaller for 0.4.
ASSUMED_NU = 0.3
# Exponents of unloading curves lie between those of a flat punch (1) and of a tip sharper than a
# cone (2).
EXPONENT_RANGE = (1.0, 2.5)
# Range of the depths and forces of a test, in any unit; powers of numbers beyond it may overflow.
SMALLEST_NUMBER = 1e-30
LARGEST_NUMBER = 1e30
UNITS_REMEDY = "give the units of the file with --units, for example --units length=nm,force=mN"


@dataclass(frozen=True)
class HardnessOptions:
    """Settings of the analysis; texts are quantities, or numbers in the units of the curve.

    Attributes
    ----------
    scene
        Scene with the tip, Poisson's ratio and frame of a measured curve.
    epsilon
        Factor of the contact depth; "m" for the value that belongs to the fitted exponent.
    beta
        Factor of the stiffness of a contact that is not circular.
    top
        Fractions of the largest force between which unloading is fitted.
    area
        Tip, half angle or file of the area function.
    nu
        Poisson's ratio of the sample.
    tip
        "diamond", "rigid", or Young's modulus and Poisson's ratio of the tip, "E,NU".
    frame_compliance
        Compliance of the instrument's frame.
    drift
        Rate of the depth due to thermal drift; "hold" for that of the hold at low force.
    columns, units
        Columns of a text file, and units if it has none.
    """

    scene: Config | None = None
    epsilon: str = "0.75"
    beta: float = 1.0
    top: tuple[float, float] = DEFAULT_TOP
    area: str | None = None
    nu: float | None = None
    tip: str | None = None
    frame_compliance: str | None = None
    drift: str | None = None
    columns: Sequence[str] = ()
    units: Mapping[str, str] | None = None


OPTIONS = tuple(item.name for item in fields(HardnessOptions) if item.name != "scene")


@dataclass(frozen=True)
class Hardness:
    """Result of the analysis of one curve.

    Attributes
    ----------
    curve
        Name of the curve.
    values
        Value of every quantity of QUANTITIES; None if the curve does not determine it.
    errors
        Half-widths of the 95 % intervals due to the scatter of the curve, and integration errors of
        works; None for unknown values.
    units
        Units of the quantities; "" without one.
    assumptions
        Assumptions on which the values rest, by name.
    warnings
        Reasons to distrust a value.
    truth
        For a simulated curve, by quantity: the exact value from the run, and the ratio of the
        formula's value to it.
    formula_error
        For a simulated curve, a text on the errors of the formulas for this material; otherwise "".
    """

    curve: str
    values: dict[str, float | None]
    errors: dict[str, float | None]
    units: dict[str, str]
    assumptions: dict[str, str]
    warnings: tuple[str, ...]
    truth: dict[str, dict[str, float]] = field(default_factory=dict)
    formula_error: str = ""

    def as_json(self) -> dict[str, Any]:
        """Return all attributes by their names."""
        return dict(vars(self))


@dataclass(frozen=True)
class _TestCurve:
    """Curve to be analysed, with what is known about it.

    Attributes
    ----------
    name, h, F, t
        Name, depths, forces, and times or None.
    units
        Units of length and force; "" without units.
    results
        The results, if the curve is simulated.
    scene
        The scene of the results, or that of the user.
    notes
        Sentences about assumptions that were made when the file was read.
    """

    name: str
    h: np.ndarray
    F: np.ndarray
    t: np.ndarray | None
    units: Mapping[str, str]
    results: Results | None = None
    scene: Config | None = None
    notes: tuple[str, ...] = ()

    @property
    def has_units(self) -> bool:
        """Whether the units of length and force are known."""
        return _has_units(self.units)

    def unit_of_scene(self, kind: str) -> float:
        """Return the ratio of the scene's unit to the curve's; 1 if one of them is unknown."""
        scene_unit = vars(self.scene.units).get(kind) if self.scene else ""
        if not scene_unit or not self.units[kind]:
            return 1.0
        return si_factor(scene_unit, kind) / si_factor(self.units[kind], kind)


@dataclass(frozen=True)
class _PressureUnit:
    """Unit of pressures, and its size in units of force per length^2 of the curve."""

    name: str
    size: float


@dataclass(frozen=True)
class _Contact:
    """Formulas of the contact at the beginning of unloading, with their settings.

    Attributes
    ----------
    area
        Area function of the tip.
    epsilon, beta
        Factors of contact depth and stiffness.
    nu
        Poisson's ratio of the sample.
    tip_E_star
        Plane-strain modulus of the tip; None if it is unknown.
    pressure
        Unit of the results.
    """

    area: AreaFunction
    epsilon: float
    beta: float
    nu: float
    tip_E_star: float | None
    pressure: _PressureUnit

    def __call__(self, S: float, F_max: float, h_max: float) -> dict[str, float]:
        """Return the quantities that follow from stiffness, force and depth."""
        h_c = oliver_pharr.contact_depth(h_max, F_max, S, self.epsilon)
        A_p = self.area(h_c)
        E_r = oliver_pharr.reduced_modulus(S, A_p, self.beta)
        values = {
            "H_IT": F_max / A_p / self.pressure.size,
            "E_r": E_r / self.pressure.size,
            "h_c": h_c,
            "A_p": A_p,
            "h_r": h_max - F_max / S,
        }
        if self.tip_E_star is not None:
            E_IT = _modulus(E_r, self.nu, self.tip_E_star, self.pressure)
            values["E_IT"] = E_IT / self.pressure.size
        return values


def analyse(path: Path, options: HardnessOptions) -> Hardness:
    """Analyse a curve by the method of Oliver and Pharr.

    Parameters
    ----------
    path
        File of a measured curve, or result folder or force table of a simulated curve.
    options
        Settings of the analysis.

    Raises
    ------
    UsageError
        If the curve cannot be analysed; the message gives the reason.
    ConfigError
        If an option is not valid.
    """
    _check_factors(options)
    curve = _read(path, options)
    pressure = _pressure_unit(curve.units)
    depth, corrections = _corrected_depth(curve, options)
    _check_range(depth, curve.F)
    cycle = indentation_cycle(depth, curve.F, curve.results is None)
    top = _fitted_part(curve, cycle, options.top)
    fit = _fit(cycle, top)
    epsilon, epsilon_words = _epsilon(options.epsilon, fit.exponent)
    area = _area_function(curve, options)
    nu, nu_words = _poisson_ratio(curve, options)
    tip_E_star, tip_words = _tip_modulus(curve, options, pressure)
    contact = _Contact(area, epsilon, options.beta, nu, tip_E_star, pressure)
    works, work_warnings = _works(cycle, fit)
    values, errors = _values_with_errors(cycle, fit, contact, works)
    creep = None
    if curve.t is not None:
        creep = creep_rate(cycle, curve.t, cycle.upper_part(top[1], top[0]))
    if creep is not None:
        values["dh_dt"] = creep.value
        errors["dh_dt"] = creep.error
    warnings = [
        *curve.notes,
        *cycle.notes,
        *([f"nu: {nu_words}"] if "is assumed" in nu_words else []),
        *([tip_words] if tip_E_star is None else []),
        *work_warnings,
        *_contact_warnings(cycle),
        *_fit_warnings(cycle, fit),
        *_creep_warnings(creep, fit),
        *_pile_up_warnings(fit),
        *_tip_rounding_warnings(curve, area, values["h_c"] or nan),
    ]
    high, low = top
    assumptions = {
        "area": area.words,
        "nu": nu_words,
        "tip": tip_words,
        "epsilon": epsilon_words,
        "beta": f"{options.beta:g}",
        "fit": f"{fit.samples} samples of unloading from {high:.0%} to {low:.0%} of F_max",
    } | corrections
    truth = {} if curve.results is None else _truth(curve, values, pressure)
    units = _unit_names(curve.units, pressure.name)
    return Hardness(
        curve.name,
        values,
        errors,
        units,
        assumptions,
        tuple(warnings),
        truth,
        _formula_error(truth, is_layered=curve.scene is not None and len(curve.scene.layers) > 1),
    )


def _check_factors(options: HardnessOptions) -> None:
    """Raise ConfigError if beta or the fitted part of unloading is impossible."""
    high, low = options.top
    if not 0 < low < high <= 1:
        raise ConfigError(
            "top", f"must be two fractions, the larger one first, got {high:g} and {low:g}"
        )
    if not 0.5 <= options.beta <= 2:
        raise ConfigError("beta", f"must lie between 0.5 and 2, got {options.beta:g}")


def _read(path: Path, options: HardnessOptions) -> _TestCurve:
    """Read a measured or a simulated curve."""
    if path.is_dir() or "step" in header_of(path):
        return _simulated_curve(path, options)
    curves = read_curves(path, options.columns or None, options.units)
    curve = curves[0]
    notes = list(curve.notes)
    if len(curves) > 1:
        notes.append(f"{path} has {len(curves)} curves, of which the first is analysed")
    units = {kind: curve.units.get(kind, "") for kind in ("length", "force")}
    curve = curve.convert_units(units)
    if not all(units.values()):
        notes.append(f"the unit of depth or force is unknown; {UNITS_REMEDY}")
        units = dict.fromkeys(units, "")
    depth = _depth_of(curve, path)
    if curve.delta is None:
        notes.append("the file's displacement is taken as the depth from first contact")
    return _TestCurve(
        curve.name, depth, curve.force, curve.t, units, None, options.scene, tuple(notes)
    )


def _check_range(h: np.ndarray, F: np.ndarray) -> None:
    """Raise UsageError if depths or forces are outside the range of the arithmetic."""
    for name, values in (("depth", h), ("force", F)):
        largest = float(np.abs(values).max(initial=0.0))
        if not (largest == 0 or SMALLEST_NUMBER <= largest <= LARGEST_NUMBER):
            raise UsageError(
                f"the largest {name} is {largest:.3g}, outside the range from "
                f"{SMALLEST_NUMBER:g} to {LARGEST_NUMBER:g}",
                "check the units and the columns of the file",
            )


def _depth_of(curve: MeasuredCurve, path: Path) -> np.ndarray:
    """Return the depths of a measured curve; raise UsageError for a curve of a cantilever."""
    if curve.delta is None and curve.stiffness is not None:
        raise UsageError(
            f"{path} has the displacement of a cantilever's base, but no depth",
            "fit a scene to it by `indent-sim fit`, or name the columns of depth and force with "
            "--columns",
            str(path),
        )
    return curve.abscissa_values(curve.available_abscissa("delta"))


def _simulated_curve(path: Path, options: HardnessOptions) -> _TestCurve:
    """Read the curve of a result.

    Raises UsageError for a result in plane strain, whose contact has no area, with two contacts or
    with incomplete rows, and if the options give columns or units.
    """
    if options.columns or options.units:
        raise UsageError(
            "--columns and --units are for text files only, since a result states both"
        )
    results = read(path)
    folder = path if path.is_dir() else path.parent
    scene = scene_of(folder) or options.scene
    choices = results.report.get("plan", {}).get("choices", [])
    kinematics = {choice["value"] for choice in choices if choice.get("key") == "kinematics"}
    if "plane_strain" in kinematics:
        raise UsageError(f"{path} is in plane strain, and its contact has no area", "", str(path))
    if scene is not None and contacts_per_body(scene.body) > 1:
        raise UsageError(
            f"the depth of {path} is that of two contacts", "analyse a single contact", str(path)
        )
    units = results.report.get("units") or {}
    known = {kind: str(units.get(kind) or "") for kind in ("length", "force")}
    F = results["force"]
    h = results["delta"]
    t = results.table.get("t")
    if not (len(h) and (np.isfinite(h) & np.isfinite(F)).all()):
        raise UsageError(f"{path} has no rows, or rows without depth or force", "", str(path))
    if h[0] > 0:  # Loading begins at first contact.
        h = np.concatenate([[0.0], h])
        F = np.concatenate([[0.0], F])
        t = None if t is None else np.concatenate([[0.0], t])
    name = folder.name if path.is_dir() else path.stem
    return _TestCurve(name, h, F, t, known, results, scene)


def _corrected_depth(
    curve: _TestCurve, options: HardnessOptions
) -> tuple[np.ndarray, dict[str, str]]:
    """Return the depths without frame deflection and thermal drift, and texts on both."""
    h = curve.h
    words = {}
    compliance = _frame_compliance(curve, options)
    if compliance:
        h = h - compliance * curve.F
        unit = _ratio_text(curve.units["length"], curve.units["force"])
        words["frame compliance"] = f"{compliance:.4g} {unit}".rstrip()
    if options.drift is not None:
        unit = _ratio_text(curve.units["length"], "s")
        if curve.t is None:
            raise UsageError(
                "--drift needs the times of the samples, which the curve does not have",
                "name the columns with --columns DEPTH,FORCE,TIME",
            )
        if options.drift == "hold":
            hold = low_force_hold(curve.t, h, curve.F)
            rate = hold.rate
            words["drift"] = (
                f"{rate:.4g} ± {hold.error:.1g} {unit}".rstrip()
                + f", of the hold of {hold.duration:.4g} s at {hold.force_fraction:.0%} of the "
                "largest force"
            )
        else:
            rate = _number("--drift", options.drift, "length/time", curve.units)
            words["drift"] = f"{rate:.4g} {unit}".rstrip()
        first_contact = int(np.argmax(curve.h >= 0))
        h = h - rate * (curve.t - curve.t[first_contact])
    return h, words


def _frame_compliance(curve: _TestCurve, options: HardnessOptions) -> float:
    """Return the compliance of the frame from the option or the scene [length/force]."""
    if options.frame_compliance is not None:
        compliance = _number(
            "--frame-compliance", options.frame_compliance, "length/force", curve.units
        )
        if compliance < 0:
            raise ConfigError("--frame-compliance", f"must not be negative, got {compliance:g}")
        return compliance
    # The depth of a result is that of the tip, without its frame.
    if curve.results is not None or curve.scene is None or curve.scene.experiment is None:
        return 0.0
    frame = curve.scene.experiment.frame
    unit = curve.unit_of_scene("length") / curve.unit_of_scene("force")
    return frame.compliance * unit if frame else 0.0


def _number(key: str, text: str, dimension: str, units: Mapping[str, str]) -> float:
    """Return the value of an option as a number in the units of the curve."""
    value = convert_quantity(key, text, dimension, units if _has_units(units) else {})
    if not isfinite(value):
        raise ConfigError(key, f"'{text}' is not a finite number")
    return value


def _fitted_part(
    curve: _TestCurve, cycle: IndentationCycle, top: tuple[float, float]
) -> tuple[float, float]:
    """Return the fractions of the largest force between which unloading is fitted.

    They are those of the options, or a wider range for a run with few rows, because the rows of a
    run have no noise and no transition from a hold to unloading.
    """
    has_few_rows = len(cycle.h[cycle.upper_part(top[1], top[0])]) < oliver_pharr.MIN_SAMPLES
    return RUN_TOP if curve.results and top == DEFAULT_TOP and has_few_rows else top


def _fit(cycle: IndentationCycle, top: tuple[float, float]) -> UnloadingFit:
    """Fit the power law to the upper part of unloading; raise UsageError if this is impossible."""
    high, low = top
    rows = cycle.upper_part(low, high)
    h = cycle.h[rows]
    F = cycle.F[rows]
    if len(h) < oliver_pharr.MIN_SAMPLES:
        raise UsageError(
            f"unloading has {len(h)} samples between {high:.0%} and {low:.0%} of the largest "
            f"force, and at least {oliver_pharr.MIN_SAMPLES} are needed",
            "measure more samples in unloading, or fit a larger part with --top, for example "
            "--top 100:20",
        )
    try:
        fit = oliver_pharr.fit_unloading(h, F, cycle.h_max, cycle.F_noise, cycle.h_noise)
    except ValueError as error:
        raise UsageError(f"unloading is not a power law: {error}") from None
    lower, upper = EXPONENT_RANGE
    # Largest distance of the exponent beyond a limit that its scatter may explain.
    tolerance = min(_exponent_error(fit), 0.05) + 1e-4
    if not lower - tolerance <= fit.exponent <= upper + tolerance:
        raise UsageError(
            f"the exponent of unloading is m = {fit.exponent:.3g}, but an elastic contact has m "
            f"between {lower:g} and {upper:g}",
            "check for creep, drift, a wrong point of first contact or a wrong frame compliance, "
            "or fit another part with --top",
        )
    S_error = fit.coverage_factor * float(fit.covariance[1, 1]) ** 0.5
    # A stiffness with a larger relative error determines neither hardness nor modulus.
    largest_error = 0.5
    if S_error > largest_error * fit.stiffness:
        raise UsageError(
            f"the stiffness {fit.stiffness:.3g} of unloading has an error of {S_error:.2g}: force "
            "or depth are not far enough above their noise",
            "fit a larger part with --top, or measure a deeper indentation",
        )
    return fit


def _exponent_error(fit: UnloadingFit) -> float:
    """Return the half-width of the 95 % interval of the exponent."""
    return fit.coverage_factor * float(fit.covariance[2, 2]) ** 0.5


def _epsilon(text: str, m: float) -> tuple[float, str]:
    """Return the factor epsilon of the Oliver-Pharr method, and its description."""
    if text == "m":
        epsilon = oliver_pharr.epsilon_of_exponent(max(m, 1.0))
        return epsilon, f"{epsilon:.4g}, of the exponent m"
    epsilon = convert_quantity("--epsilon", text, "1", {})
    if not 0 <= epsilon <= 1:
        raise ConfigError(
            "--epsilon", f"must lie between 0 and 1, got {text}", "the usual value is 0.75"
        )
    return epsilon, f"{epsilon:g}"


def _area_function(curve: _TestCurve, options: HardnessOptions) -> AreaFunction:
    """Return the area function of the option, of the scene's tip, or of an ideal Berkovich tip."""
    if options.area is not None:
        return area_from_text(options.area, curve.units)
    if curve.scene is None:
        return area_from_text("berkovich", curve.units)
    if not curve.scene.tip.is_axisymmetric and curve.scene.tilt:
        problem = "the area function is that of an upright tip"
        raise ConfigError("indenter.tilt", problem, "give --area, or leave the tilt out")
    return area_of_tip(curve.scene.indenter.scaled(curve.unit_of_scene("length")))


def _poisson_ratio(curve: _TestCurve, options: HardnessOptions) -> tuple[float, str]:
    """Return Poisson's ratio of the sample from the option, the scene or an assumption."""
    if options.nu is not None:
        try:
            check_nu(options.nu)
        except ValueError as error:
            raise ConfigError("--nu", str(error)) from None
        return options.nu, f"{options.nu:g}, given"
    if material := _material_below_tip(curve.scene):
        nu = float(material.constants.nu)
        return nu, f"{nu:g}, of the scene"
    change = "E_IT would be 5.5 % larger with nu = 0.2 and 7.7 % smaller with nu = 0.4"
    return ASSUMED_NU, f"{ASSUMED_NU:g} is assumed; give --nu or --scene ({change})"


def _material_below_tip(scene: Config | None) -> Any:
    """Return the material that the tip touches; None if it is unknown."""
    if scene is None:
        return None
    layers = scene.body.layers
    return layers[0].material if layers and layers[0].material else scene.material


def _tip_modulus(
    curve: _TestCurve, options: HardnessOptions, pressure: _PressureUnit
) -> tuple[float | None, str]:
    """Return E_i* of the tip in units of the curve, and its description; None if unknown."""
    lens = curve.scene.indenter.elastic_part if curve.scene else None
    if options.tip is None and lens is not None:
        unit = curve.unit_of_scene("force") / curve.unit_of_scene("length") ** 2
        return lens.material.E_star * unit, "the soft tip of the scene"
    tip = options.tip or ("diamond" if curve.results is None else "rigid")
    return _modulus_of_tip(tip, curve.units, pressure)


def _modulus_of_tip(
    tip: str, units: Mapping[str, str], pressure: _PressureUnit
) -> tuple[float | None, str]:
    """Return E_i* of a tip by its name or constants, and a description; None without units."""
    if tip == "rigid":
        return inf, "rigid"
    if tip == "diamond":
        E = oliver_pharr.DIAMOND_E
        nu = oliver_pharr.DIAMOND_NU
        if not _has_units(units):
            return None, (
                "E_IT is not known: the modulus of the diamond tip is 1141 GPa, and the curve has "
                f"no units; {UNITS_REMEDY}, or --tip rigid"
            )
        SI_pressure = si_factor(units["force"], "force")
        SI_pressure /= si_factor(units["length"], "length") ** 2
        return E / SI_pressure / (1 - nu**2), f"diamond, E = {E / 1e9:g} GPa, nu = {nu:g}"
    E, nu = _elastic_constants("--tip", tip, units, "diamond, rigid, or ")
    return E / (1 - nu**2), f"E = {E / pressure.size:.4g} {pressure.name}, nu = {nu:g}"


def _elastic_constants(
    option: str, text: str, units: Mapping[str, str], other_words: str = ""
) -> tuple[float, float]:
    """Return Young's modulus in units of the curve and Poisson's ratio of a text "E,NU"."""
    modulus_text, comma, nu_text = text.rpartition(",")
    if not comma:
        raise ConfigError(
            option,
            f"'{text}' is not a {option.removeprefix('--')}",
            f"give {other_words}E,NU such as '400 GPa,0.25'",
        )
    E = _number(option, modulus_text, "pressure", units)
    nu = convert_quantity(option, nu_text, "1", {})
    if not (E > 0 and -1 < nu <= 0.5):
        raise ConfigError(option, f"needs E > 0 and -1 < nu <= 0.5, got '{text}'")
    return E, nu


def reference_modulus(sample: str, tip: str, units: Mapping[str, str]) -> tuple[float, str, str]:
    """Return the reduced modulus of a sample of known modulus and a tip, with descriptions.

    Parameters
    ----------
    sample
        Young's modulus and Poisson's ratio of the sample, "E,NU".
    tip
        "diamond", "rigid" or "E,NU".
    units
        Units of length and force of the curve, from which the unit of the modulus follows.
    """
    pressure = _pressure_unit(units)
    E, nu = _elastic_constants("--sample", sample, units)
    tip_E_star, tip_words = _modulus_of_tip(tip, units, pressure)
    if tip_E_star is None:
        raise UsageError(
            "the modulus of the diamond tip is in GPa, and the curve has no units",
            f"{UNITS_REMEDY}, or the tip in the units of the curve with --tip",
        )
    E_r = 1 / ((1 - nu**2) / E + 1 / tip_E_star)
    return E_r, f"E = {E / pressure.size:.4g} {pressure.name}, nu = {nu:g}", tip_words


def _modulus(E_r: float, nu: float, tip_E_star: float, pressure: _PressureUnit) -> float:
    """Return E_IT; raise UsageError if sample and tip together are stiffer than the tip."""
    try:
        return oliver_pharr.indentation_modulus(E_r, nu, tip_E_star)
    except ValueError:
        raise UsageError(
            f"the reduced modulus {E_r / pressure.size:.4g} {pressure.name} is not below the "
            f"modulus {tip_E_star / pressure.size:.4g} {pressure.name} of the tip alone",
            "check the units of the curve, the area function and the frame compliance",
        ) from None


def _values_with_errors(
    cycle: IndentationCycle,
    fit: UnloadingFit,
    contact: _Contact,
    works: Mapping[str, Work | None],
) -> tuple[dict[str, float | None], dict[str, float | None]]:
    """Return the values of all quantities, and their errors; None if they are unknown."""
    values: dict[str, float | None] = dict.fromkeys(QUANTITIES)
    errors: dict[str, float | None] = dict.fromkeys(QUANTITIES)
    point = (fit.stiffness, cycle.F_max, cycle.h_max)
    deviations = _standard_deviations(cycle, fit)
    S_error, F_error, h_error = (fit.coverage_factor * deviation for deviation in deviations)
    values |= contact(*point)
    errors |= {
        name: fit.coverage_factor * deviation
        for name, deviation in _propagate(contact, point, deviations).items()
    }
    values |= {
        "S": fit.stiffness,
        "F_max": cycle.F_max,
        "h_max": cycle.h_max,
        "h_p": cycle.h_p,
        "h_f": fit.h_f,
        "m": fit.exponent,
    }
    errors |= {
        "S": S_error,
        "F_max": F_error,
        "h_max": h_error,
        "h_p": None if cycle.h_p is None else h_error,
        "h_f": fit.coverage_factor * fit.h_f_deviation,
        "m": _exponent_error(fit),
    }
    if cycle.creep is not None:
        values["C_IT"] = 100 * cycle.creep
        errors["C_IT"] = 100 * 2**0.5 * h_error / cycle.h_max
    for name, work in works.items():
        values[name] = work.value if work else None
        errors[name] = work.error if work else None
    return values, errors


def _standard_deviations(cycle: IndentationCycle, fit: UnloadingFit) -> tuple[float, float, float]:
    """Return the standard deviations of contact stiffness, largest force and largest depth."""
    # The largest of several forces with scatter is above their mean; a hold has no such bias.
    selection = 1.0 if cycle.hold_start is not None else 2.0
    # The scatter from row to row does not contain the part that is correlated over several rows,
    # but the residuals of the fit do.
    white = float(np.hypot(cycle.F_noise, fit.stiffness * cycle.h_noise))
    correlated = max(1.0, fit.residual / white) if white > 0 else 1.0
    return (
        float(fit.covariance[1, 1]) ** 0.5,
        selection * correlated * cycle.F_noise,
        correlated * cycle.h_noise,
    )


def _propagate(
    function: Any, point: tuple[float, ...], deviations: tuple[float, ...]
) -> dict[str, float]:
    """Return the standard deviations of a function's results by linear error propagation."""
    center = function(*point)
    squares = dict.fromkeys(center, 0.0)
    for k, deviation in enumerate(deviations):
        # A small step stays inside the range of an area function.
        fraction = 0.01
        step = fraction * deviation
        if step <= 1e-12 * abs(point[k]):
            continue
        shifted = function(*point[:k], point[k] + step, *point[k + 1 :])
        for name in squares:
            squares[name] += ((shifted[name] - center[name]) / fraction) ** 2
    return {name: square**0.5 for name, square in squares.items()}


def _works(cycle: IndentationCycle, fit: UnloadingFit) -> tuple[dict[str, Work | None], list[str]]:
    """Return W_total, W_elast and eta_IT with their errors, and warnings about unknown works."""
    total = cycle.total_work
    elastic: Work | None = cycle.unloading_work
    warnings = []
    last = cycle.last_force / cycle.F_max
    # The work below a smaller force is less than 1e-4 of the whole.
    negligible_force = 1e-3
    if last > MAX_LAST_FORCE:
        elastic = None
        warnings.append(
            f"W_elast and eta_IT are not known: unloading ends at {last:.0%} of the largest force"
        )
    elif last > negligible_force:
        below = fit.work_below(cycle.last_force)
        # The error of the work below is unknown; half of this work is taken as its bound.
        elastic = Work(cycle.unloading_work.value + below, cycle.unloading_work.error + 0.5 * below)
        warnings.append(
            f"unloading ends at {last:.1%} of the largest force; the work below this force is "
            "computed from the power law"
        )
    if total is None:
        warnings.append("W_total and eta_IT are not known: the curve does not begin at zero force")
    eta = None
    if total is not None and elastic is not None and total.value > 0:
        share = 100 * elastic.value / total.value
        eta = Work(share, share * (elastic.error / elastic.value + total.error / total.value))
    return {"W_total": total, "W_elast": elastic, "eta_IT": eta}, warnings


def _contact_warnings(cycle: IndentationCycle) -> list[str]:
    """Return warnings if the force does not begin at the depth zero."""
    loading = slice(0, cycle.start + 1)
    h = cycle.h[loading]
    F = cycle.F[loading]
    outside = F[h < -3 * cycle.h_noise]
    # Smallest force out of contact and smallest depth without a force, relative to the largest
    # ones, that get a warning: they change the hardness by some per cent.
    wrong_force = 0.02
    wrong_depth = 0.1
    if len(outside) and abs(float(np.mean(outside))) > wrong_force * cycle.F_max:
        return [
            f"the force before first contact is {np.mean(outside):.3g} on average, not zero: "
            "subtract the baseline"
        ]
    no_force = max(1e-3 * cycle.F_max, 3 * cycle.F_noise)
    free = h[no_force >= F]
    if len(free) and float(free.max()) > wrong_depth * cycle.h_max:
        return [
            f"there is no force up to the depth {free.max():.3g}: the depth is not counted from "
            "first contact, and h_max is too large"
        ]
    return []


def _fit_warnings(cycle: IndentationCycle, fit: UnloadingFit) -> list[str]:
    """Return a warning if the power law deviates from the samples by more than their noise."""
    noise = float(np.hypot(cycle.F_noise, fit.stiffness * cycle.h_noise))
    # Largest misfit of a power law to samples of an elastic contact, relative to the largest
    # force.
    largest_misfit = 0.01
    if fit.residual > largest_misfit * cycle.F_max and fit.residual > 2 * noise:
        return [
            "the power law differs from the samples of unloading by "
            f"{fit.residual / cycle.F_max:.1%} of the largest force: S and all that follows from "
            "it are doubtful"
        ]
    return []


def _creep_warnings(creep: CreepRate | None, fit: UnloadingFit) -> list[str]:
    """Return a warning if creep at the end of the hold makes the measured stiffness too large.

    If the creep continues in unloading, 1/S = 1/S_elastic - (dh/dt)/|dF/dt|: Feng & Ngan (2002),
    J. Mater. Res. 17, 660.
    """
    change = 0.0 if creep is None else creep.relative_stiffness * fit.stiffness
    # A smaller change is below the accuracy of the method.
    negligible_change = 0.01
    if change <= negligible_change:
        return []
    return [
        "the depth still grows at the end of the hold; if it goes on in unloading, S is "
        f"{100 * change:.1f} % too large (Feng & Ngan 2002): hold longer or unload faster"
    ]


def _pile_up_warnings(fit: UnloadingFit) -> list[str]:
    """Return a warning if the material may pile up around the tip."""
    # Above this ratio materials that do not harden pile up: Bolshakov & Pharr (1998),
    # J. Mater. Res. 13, 1049.
    pile_up_ratio = 0.7
    ratio = fit.h_f / fit.h_max
    if ratio <= pile_up_ratio:
        return []
    return [
        f"h_f/h_max = {ratio:.2f} is above 0.7: a material that does not harden piles up around "
        "the tip; the area is then larger than A_p, and H_IT and E_IT are smaller than stated"
    ]


def _tip_rounding_warnings(curve: _TestCurve, area: AreaFunction, h_c: float) -> list[str]:
    """Return a warning if the apex of a worn pyramid (150 nm) increases the area by 1 % or more."""
    if not curve.has_units or curve.results is not None or area.tip not in (Berkovich(), Vickers()):
        return []
    # Apex radius [m] of a pyramid that has been used for a while.
    used_tip_radius = 150e-9
    radius = used_tip_radius / si_factor(curve.units["length"], "length")
    rounded = type(area.tip)(tip_radius=radius)
    percent = 100 * (area_of_tip(rounded)(h_c) / area(h_c) - 1)
    # A smaller change is below the accuracy of the method.
    return (
        [
            f"an apex radius of 150 nm would make the area {percent:.1f} % larger at this depth, "
            "and H_IT smaller by the same factor: calibrate the tip and give --area FILE"
        ]
        if percent > 1
        else []
    )


def _truth(
    curve: _TestCurve, values: Mapping[str, float | None], pressure: _PressureUnit
) -> dict[str, dict[str, float]]:
    """Return the true quantities of a simulated contact, and the ratios of the results to them.

    The quantities are area, hardness, stiffness and moduli.
    """
    assert curve.results is not None
    table = curve.results.table
    row = curve.results.unloading_row(values["F_max"] or 0.0)
    known = {"A_p": _entry(table, row, "contact_area", "area")}
    known["H_IT"] = (
        float(table["force"][row]) / known["A_p"] / pressure.size if known["A_p"] > 0 else nan
    )
    known["S"] = _entry(table, row, "unloading_stiffness", "stiffness")
    material = _material_below_tip(curve.scene)
    # A material that drains, relaxes or swells has no single modulus.
    if (
        curve.scene is not None
        and material is not None
        and not isinstance(material, Gel)
        and material.flow is None
        and material.relaxation is None
    ):
        lens = curve.scene.indenter.elastic_part
        tip_compliance = 1 / lens.material.E_star if lens else 0.0
        known["E_r"] = 1 / (1 / material.E_star + tip_compliance) / pressure.size
        known["E_IT"] = float(material.constants.E) / pressure.size
    return {
        name: {"value": true, "ratio": value / true}
        for name, true in known.items()
        if isfinite(true) and true > 0 and (value := values[name]) is not None
    }


def _formula_error(truth: Mapping[str, Mapping[str, float]], *, is_layered: bool) -> str:
    """Return a sentence on the errors of the formulas for area, hardness and modulus, or "".

    In a layered body the modulus is that of the first layer, and its error includes the effect of
    the other layers.
    """
    modulus = "the modulus of the first layer" if is_layered else "the modulus"
    quantities = {"A_p": "the contact area", "H_IT": "the hardness", "E_IT": modulus}
    errors = [
        f"{words} {abs(percent):.1f} % too {'large' if percent > 0 else 'small'}"
        for name, words in quantities.items()
        if name in truth and abs(percent := 100 * (truth[name]["ratio"] - 1)) >= 0.05
    ]
    subject = "layered body" if is_layered else "material"
    return f"for this {subject} the formulas give {join_words(errors, 'and')}" if errors else ""


def _entry(table: Mapping[str, np.ndarray], row: int, *columns: str) -> float:
    """Return the entry of a row in the first given column that exists in the table, or NaN."""
    return next((float(table[name][row]) for name in columns if name in table), nan)


def _has_units(units: Mapping[str, str]) -> bool:
    """Return whether the units of length and force are known."""
    return bool(units["length"] and units["force"])


def _pressure_unit(units: Mapping[str, str]) -> _PressureUnit:
    """Return the unit for pressures.

    The unit is that of force/length^2 if this is Pa, kPa, MPa or GPa, and otherwise GPa.
    """
    if not _has_units(units):
        return _PressureUnit("", 1.0)
    SI = si_factor(units["force"], "force") / si_factor(units["length"], "length") ** 2
    named = {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9}
    name = next((name for name, size in named.items() if abs(SI / size - 1) < 1e-9), "GPa")
    return _PressureUnit(name, named[name] / SI)


def _ratio_text(numerator: str, denominator: str) -> str:
    """Return the text of a ratio of units; "" without a numerator."""
    return f"{numerator}/{denominator}" if numerator else ""


def _unit_names(units: Mapping[str, str], pressure: str) -> dict[str, str]:
    """Return the unit of every quantity; "" for dimensionless quantities."""
    length = units["length"]
    force = units["force"]
    names = {
        "pressure": pressure,
        "length": length,
        "force": force,
        "area": f"{length}^2" if length else "",
        "stiffness": _ratio_text(force, length),
        "rate": _ratio_text(length, "s") if length else "",
        "work": f"{force} {length}".strip(),
        "%": "%",
        "": "",
    }
    return {name: names[kind] for name, (kind, _) in QUANTITIES.items()}
