"""Calibration in the header of a text file: spring constant and sensitivity of the deflection."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from indent_sim.config.quantities import si_factor
from indent_sim.process.errors import ConfigError
from indent_sim.results.measured.column_titles import SIGNAL_UNITS

NUMBER = r"[-+]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][-+]?\d+)?"
RATIO = r"[^\W\d_]{1,2}\s*/\s*[^\W\d_]{1,2}"
# Such as `# springConstant: 0.05`, `k (N/m)	0.019`, `Force Constant, nN/nm: 1.0`.
SPRING_CONSTANT = re.compile(
    rf"(?:spring[\s_]*const(?:ant)?|force[\s_]*constant|cantilever[\s_]*stiffness|^\W*k(?=\W))"
    rf"\W*(?P<key_unit>{RATIO})?[\W_]*?(?P<value>{NUMBER})\s*(?P<unit>{RATIO})?",
    re.IGNORECASE,
)
# Such as `\@Sens. DeflSens: V 36.35 nm/V`, `# sensitivity: 7.4e-8`, `InvOLS: 5e-8`.
SENSITIVITY = re.compile(
    rf"(?:sens\. deflsens|(?:deflection[\s_]*|^\W*)sensitivity|inv[\s_]*ols)"
    rf"\W*(?P<key_unit>{RATIO})?[\W_]*?(?:\bV\s+)?(?P<value>{NUMBER})\s*(?P<unit>{RATIO})?",
    re.IGNORECASE,
)
# Keys of formats whose spring constants are in N/m: JPK, NanoScope, Igor, and .tab files.
KEYS_IN_SI = ("springConstant", r"\Spring Constant", "SpringConstant", '"spring constant"')
# A longer line is not an entry of a header.
MAX_LINE_LENGTH = 400


@dataclass(frozen=True)
class Calibration:
    """Calibration of a cantilever.

    Attributes
    ----------
    stiffness
        Spring constant [N/m], None if unknown.
    sensitivity
        Deflection of one unit of the signal [m/V or m/A], None if unknown.
    signal
        Kind of the signal of the sensitivity: voltage or current.
    stiffness_source, sensitivity_source
        Origin of the numbers: scene, header, or --sensitivity.
    notes
        Sentences about assumptions.
    """

    stiffness: float | None = None
    sensitivity: float | None = None
    signal: str = "voltage"
    stiffness_source: str = "header"
    sensitivity_source: str = "header"
    notes: tuple[str, ...] = ()

    def replace_given(self, stiffness: float | None, sensitivity: str | None) -> Calibration:
        """Return the calibration with the stiffness [N/m] and the sensitivity of the user.

        Raises ConfigError if the text is not a sensitivity.
        """
        given = self
        if sensitivity is not None:
            value, signal = parse_sensitivity(sensitivity)
            given = replace(
                given, sensitivity=value, signal=signal, sensitivity_source="--sensitivity"
            )
        if stiffness is None:
            return given
        notes = self.notes
        # Spring constants are rounded to two or three digits; a larger relative difference is
        # reported.
        rounding = 0.02
        if self.stiffness and abs(self.stiffness / stiffness - 1) > rounding:
            notes = (
                *notes,
                f"the spring constant is {self.stiffness:.4g} N/m in the header and "
                f"{stiffness:.4g} N/m in the scene: that of the scene is used",
            )
        return replace(given, stiffness=stiffness, stiffness_source="scene", notes=notes)


def read_calibration(lines: Sequence[str]) -> Calibration:
    """Return the calibration in the lines of a header."""
    calibration = Calibration()
    notes = []
    for line in lines:
        if len(line) > MAX_LINE_LENGTH:
            continue
        match = SPRING_CONSTANT.search(line)
        if calibration.stiffness is None and match and (k := _stiffness(match)):
            calibration = replace(calibration, stiffness=k)
            has_unit = match["key_unit"] or match["unit"]
            if not has_unit and not any(key in line for key in KEYS_IN_SI):
                notes.append(
                    f"the spring constant {k:.4g} of the header has no unit: N/m is assumed"
                )
        match = SENSITIVITY.search(line)
        if calibration.sensitivity is None and match and (found := _sensitivity(match)):
            calibration = replace(calibration, sensitivity=found[0], signal=found[1])
    return replace(calibration, notes=tuple(notes))


def parse_sensitivity(text: str) -> tuple[float, str]:
    """Return a sensitivity such as 50 nm/V in m/V or m/A, and the kind of its signal.

    Raises ConfigError if the text is not a sensitivity.
    """
    match = re.fullmatch(rf"\s*(?P<value>{NUMBER})\s*(?P<unit>{RATIO})\s*", text)
    factor = _sensitivity_factor(match["unit"]) if match else None
    if match is None or factor is None or not (value := _number(match["value"])) > 0:
        raise ConfigError(
            "--sensitivity",
            f"'{text}' is not a length divided by a voltage or a current",
            "write 50 nm/V",
        )
    return value * factor[0], factor[1]


def _stiffness(match: re.Match[str]) -> float | None:
    """Return the spring constant [N/m] of a line, None if its unit is unknown."""
    is_named = match[0].strip()[:1] not in ("k", "K")
    unit = match["key_unit"] or match["unit"] or ("N/m" if is_named else "")
    force, _, length = re.sub(r"\s", "", unit).partition("/")
    try:
        factor = si_factor(force, "force") / si_factor(length, "length")
    except ConfigError:
        return None
    value = _number(match["value"]) * factor
    return value if 0 < value < 1e30 else None


def _sensitivity(match: re.Match[str]) -> tuple[float, str] | None:
    """Return the sensitivity [m/V or m/A] of a line and its signal, None if it is unknown."""
    unit = match["key_unit"] or match["unit"]
    value = _number(match["value"])
    if not 0 < value < 1e30:
        return None
    if unit:
        factor = _sensitivity_factor(unit)
        return (value * factor[0], factor[1]) if factor else None
    # A sensitivity without a unit is in m/V if it is smaller than this, since no detector has 0.1
    # mm/V.
    largest_sensitivity = 1e-4
    return (value, "voltage") if value < largest_sensitivity else None


def _sensitivity_factor(unit: str) -> tuple[float, str] | None:
    """Return the SI value of a unit of length per signal and the kind of the signal."""
    length, _, signal = re.sub(r"\s", "", unit).partition("/")
    for kind, units in SIGNAL_UNITS.items():
        if signal in units:
            try:
                return si_factor(length, "length") / units[signal], kind
            except ConfigError:
                return None
    return None


def _number(text: str) -> float:
    """Return the number in a text with a decimal point or comma."""
    return float(text.replace(",", "."))
