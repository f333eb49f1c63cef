"""Titles of columns: the name of the quantity, its unit, and the part of the curve."""

from __future__ import annotations

import re
from dataclasses import dataclass

from indent_sim.config.quantities import si_factor
from indent_sim.process.errors import ConfigError
from indent_sim.results.measured.measurement import PART_WORDS

# Units of the signal of a deflection detector, with their value in V or A.
SIGNAL_UNITS = {
    "voltage": {"V": 1.0, "mV": 1e-3, "uV": 1e-6, "µV": 1e-6, "v": 1.0},
    "current": {"A": 1.0, "mA": 1e-3, "uA": 1e-6, "µA": 1e-6, "nA": 1e-9, "pA": 1e-12},
}
# Units written in the wrong case, as far as they are unambiguous.
UNIT_SPELLINGS = {"S": "s", "UM": "um", "NM": "nm", "MM": "mm", "UN": "uN", "NN": "nN", "PN": "pN"}
# Names of the quantities of a curve, by role. If several columns have such names, the earlier name
# in this list takes precedence.
ROLE_NAMES = {
    "delta": (
        *("delta", "δ", "indentation", "depth", "indentation depth", "penetration"),
        *("penetration depth", "displacement into surface", "pd", "tip", "tip position"),
        *("vertical tip position", "verticaltipposition", "eindringtiefe", "tiefe"),
        *("profondeur",),
    ),
    "separation": (
        *("separation", "tip-sample separation", "tip sample separation", "tss"),
        *("tip-sample distance", "tip sample distance"),
    ),
    "z": (
        *("height (measured & smoothed)", "smoothedmeasuredheight", "smoothedstraingaugeheight"),
        *("head height (measured & smoothed)", "height (measured)", "measuredheight"),
        *("straingaugeheight", "head height (measured)", "height sensor", "z-axis sensor"),
        *("z axis sensor", "z sensor", "zsnsr", "z-sense", "z detector", "lvdt", "z", "base"),
        *("height", "head height", "calc ramp", "ramp", "z scan", "z scanner", "z position"),
        *("z-axis", "z axis", "piezo", "piezo position", "stage", "displacement"),
    ),
    "deflection": (
        *("vertical deflection", "vdeflection", "deflection", "defl", "deflv", "dfl"),
        *("cantilever", "cantilever deflection", "deflection error", "t-b", "a-b"),
    ),
    "force": ("force", "load", "f", "p", "fn", "normal force", "normal load", "load on sample"),
    "t": ("t", "time", "series time", "seriestime", "elapsed time", "test time", "segment time"),
    "part": (
        *("segment", "branch", "part", "phase", "cycle", "segmentid", "segment id"),
        *("direction", "segment number"),
    ),
}
# These quantities decrease while the tip moves towards the body.
OUTWARD_NAMES = ("height", "head height", "tip position", "straingauge", "smoothed", "measured")
# Names of signals in V whose titles have no unit.
VOLTAGE_NAMES = ("deflv", "t-b", "a-b")
# Entries in a line of units that stand for a column without a unit.
NO_UNITS = ("", "-", "--", "1", "#", "none", "a.u.", "au", "arb", "arb.", "%", "°", "deg", "hz")
# Units of columns that a curve does not need, such as stiffness and hardness.
OTHER_UNITS = ("n/m", "mn/nm", "µn/nm", "un/nm", "n/mm", "pa", "kpa", "mpa", "gpa", "nj", "pj", "k")
PART_TOKEN = re.compile(
    r"(?<![^\W\d_])(ex|rt|extend|extension|retract|retraction|approach|withdraw|forward|backward"
    r"|fwd|bwd|trace|retrace|load(?:ing)?(?=[ _]+\S*(?:curve|segment))|unload(?:ing)?)(?![^\W\d_])",
    re.IGNORECASE,
)
BRACKETS = re.compile(r"[\[(]\s*([^\[\]()]*?)\s*[\])]")
UNIT_AT_END = re.compile(r"^(?P<name>.+?)\s*(?:[ _,/]|\bin\b)\s*(?P<unit>[^\W\d_]{1,3})$")


@dataclass(frozen=True)
class ColumnTitle:
    """Title of a column.

    Attributes
    ----------
    text
        The title in the file.
    name
        Name of the quantity in lower case, without unit and part of the curve.
    unit
        Unit; "" if the title has no known unit.
    kind
        Kind of the unit: length, force, time, voltage or current; "" without a unit.
    part
        Part of the curve to which the column is limited, approach or retract; "" for all parts.
    unknown_unit
        Text in brackets that is no known unit and may be one; "" otherwise.
    """

    text: str
    name: str
    unit: str = ""
    kind: str = ""
    part: str = ""
    unknown_unit: str = ""


def parse_title(text: str) -> ColumnTitle:
    """Return the name, the unit and the part of a title such as Force [nN] or Defl_pN_Ex."""
    # Longer titles are cut.
    max_title_length = 200
    text = text.strip()[:max_title_length]
    name = text.strip("\"'").strip()
    unit = kind = unknown_unit = ""
    # A text in brackets of this length or longer is a remark, such as (measured), and not a unit.
    min_remark_length = 4
    for match in BRACKETS.finditer(name):
        word = match[1]
        found = unit_and_kind(word)
        if found[1]:
            unit, kind = found
            name = f"{name[: match.start()]} {name[match.end() :]}"
            unknown_unit = ""
            break
        if word and (len(word) < min_remark_length or "/" in word):
            unknown_unit = word
    part = ""
    # A title that only names a part of the curve does not name a quantity.
    if (token := PART_TOKEN.search(name)) and name.strip(" _").lower() != token[0].lower():
        part = PART_WORDS[token[0].lower()]
        name = f"{name[: token.start()]} {name[token.end() :]}".strip(" _-,")
        name = re.sub(r"[ _]{2,}", "_", name)
    last = UNIT_AT_END.match(name)
    # The word `in` at the end of a title is not the unit inch.
    if not kind and last and last["unit"] != "in" and unit_and_kind(last["unit"])[1]:
        unit, kind = unit_and_kind(last["unit"])
        name = last["name"]
    plain_name = _plain_name(name)
    if not kind and plain_name in VOLTAGE_NAMES:
        unit = "V"
        kind = "voltage"
    return ColumnTitle(text, plain_name, unit, kind, part, unknown_unit)


def unit_and_kind(text: str) -> tuple[str, str]:
    """Return a unit as it is spelled in scenes, and its kind; two empty texts if unknown."""
    word = text.strip().replace("\N{GREEK SMALL LETTER MU}", "µ")
    word = UNIT_SPELLINGS.get(word, word)
    for kind in ("length", "force", "time"):
        if _is_unit_of(word, kind):
            return word, kind
    for kind, units in SIGNAL_UNITS.items():
        if word in units:
            return word, kind
    return "", ""


def is_known_name(name: str) -> bool:
    """Return whether a name is the name of a quantity of a curve."""
    return any(name in names for names in ROLE_NAMES.values())


def is_unit_text(text: str) -> bool:
    """Return whether a cell can be a cell in a line of units."""
    word = text.strip().strip("[]()").strip()
    is_bracketed = text.strip()[:1] in ("[", "(") and text.strip()[-1:] in ("]", ")")
    is_known = word.lower() in (*NO_UNITS, *OTHER_UNITS) or bool(unit_and_kind(word)[1])
    return is_bracketed or is_known


def unit_factor(unit: str, kind: str) -> float:
    """Return the SI value of a unit of the given kind."""
    if kind in SIGNAL_UNITS:
        return SIGNAL_UNITS[kind][unit]
    return si_factor(unit, kind)


def _is_unit_of(unit: str, kind: str) -> bool:
    """Return whether a text is a unit of the given kind."""
    try:
        return si_factor(unit, kind) > 0
    except ConfigError:
        return False


def _plain_name(name: str) -> str:
    """Return a name in lower case, with single blanks between its words."""
    return re.sub(r"[\s_]+", " ", name).strip(" -.,:/").lower()
