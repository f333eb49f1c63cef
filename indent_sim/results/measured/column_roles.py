"""Roles of the columns of a text table: depth, displacement, force, deflection, time, segment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from indent_sim.process.errors import ConfigError
from indent_sim.results.measured.column_titles import ROLE_NAMES, ColumnTitle, parse_title
from indent_sim.results.measured.measurement import NoCurve
from indent_sim.results.measured.text_layout import TextLayout

# Names of the roles in --columns.
ROLES = {
    "depth": "delta",
    "delta": "delta",
    "z": "z",
    "separation": "separation",
    "deflection": "deflection",
    "force": "force",
    "time": "t",
    "t": "t",
    "segment": "part",
}
# Kinds of units that a column with this role may have; "" stands for no unit.
KINDS = {
    "delta": ("length", ""),
    "z": ("length", ""),
    "separation": ("length", ""),
    "deflection": ("length", "voltage", "current", ""),
    "force": ("force", ""),
    "t": ("time", ""),
    "part": ("",),
}
ABSCISSAS = ("delta", "z", "separation")
COLUMNS_HINT = (
    "name the columns with --columns, as in --columns depth=1,force=2, or "
    "--columns z=1,deflection=2 with --sensitivity '50 nm/V' if the deflection is in volts"
)


@dataclass(frozen=True)
class Column:
    """Column of a role: its index, and the factor 1 or -1 of its numbers."""

    index: int
    sign: int = 1


@dataclass(frozen=True)
class ColumnRoles:
    """Columns of a curve by their roles.

    Attributes
    ----------
    approach
        Columns of the whole curve, or of its approach.
    retract
        Columns of the retraction if it has separate columns; None otherwise.
    notes
        Sentences about assumptions.
    is_abscissa_guessed
        True if neither titles nor options say that the abscissa is a depth.
    """

    approach: Mapping[str, Column]
    retract: Mapping[str, Column] | None = None
    notes: tuple[str, ...] = ()
    is_abscissa_guessed: bool = False


def find_roles(layout: TextLayout, requested: Sequence[str] | None, file: str) -> ColumnRoles:
    """Return the roles of the columns of a table.

    Parameters
    ----------
    layout
        Layout of the table.
    requested
        Values of --columns: ROLE=COLUMN, or the columns of depth, force and time.
    file
        Name of the file, for messages.

    Raises
    ------
    NoCurve
        If the roles are unknown.
    ConfigError
        If a requested column or role does not exist.
    """
    if requested:
        return _requested_roles(layout, requested, file)
    if not layout.titles:
        return _roles_without_titles(layout)
    parts = {title.part for title in layout.titles} - {""}
    if {"approach", "retract"} <= parts:
        approach = _roles_by_name(layout, "approach")
        retract = _roles_by_name(layout, "retract")
        if _has_curve(approach) and _has_curve(retract):
            return ColumnRoles(approach, retract)
    roles = _roles_by_name(layout, parts.pop() if len(parts) == 1 else "")
    is_named = bool(roles.keys() & set(ABSCISSAS))
    notes = _add_roles_by_unit(layout, roles)
    _refuse_incomplete(layout, roles)
    return ColumnRoles(roles, None, notes, not is_named)


def check_requested(words: Sequence[str]) -> None:
    """Raise ConfigError if values of --columns are neither ROLE=COLUMN nor two or three columns."""
    if not words:
        return
    with_roles = [word for word in words if word.partition("=")[1]]
    if not with_roles and not 2 <= len(words) <= 3:
        raise ConfigError(
            "--columns", f"has {len(words)} columns", "give DEPTH,FORCE or DEPTH,FORCE,TIME"
        )
    if with_roles and len(with_roles) < len(words):
        raise ConfigError(
            "--columns", "only some of the columns have the form ROLE=COLUMN", "write z=1,force=2"
        )
    for word in with_roles:
        role = word.partition("=")[0].strip().lower()
        if role not in ROLES:
            raise ConfigError(
                "--columns", f"there is no role '{role}'", f"the roles are {', '.join(ROLES)}"
            )


def _requested_roles(layout: TextLayout, requested: Sequence[str], file: str) -> ColumnRoles:
    """Return the roles that the user has given by --columns."""
    check_requested(requested)
    roles: dict[str, Column] = {}
    notes = []
    is_positional = not any("=" in word for word in requested)
    if is_positional:
        requested = [
            f"{role}={word}" for role, word in zip(("delta", "force", "t"), requested, strict=False)
        ]
    for word in requested:
        name, _, column_word = word.partition("=")
        role = ROLES[name.strip().lower()]
        column = _column(layout, column_word.strip(), file)
        title = layout.titles[column.index] if layout.titles else parse_title("")
        if role in roles:
            raise ConfigError("--columns", f"there are two columns of {name}", "give one", file)
        if is_positional and role == "delta" and (named := _abscissa_of_name(title)) != "delta":
            notes.append(f"column '{title.text}' is taken for {ROLE_TEXTS[named]} by its title")
            role = named
        if role == "force" and title.kind in ("length", "voltage", "current"):
            notes.append(f"column '{title.text}' is in {title.unit}: it is taken as a deflection")
            role = "deflection"
        if title.kind and title.kind not in KINDS[role] and not _is_force(role, title):
            raise ConfigError(
                "--columns",
                f"column '{title.text}' is in {title.unit}, which is not a unit of {name}",
                "choose another column or role",
                file,
            )
        roles["force" if _is_force(role, title) else role] = column
    if "force" in roles:
        roles.pop("deflection", None)
    missing = [
        text
        for text, names in (("depth or z", ABSCISSAS), ("force or deflection", FORCES))
        if not roles.keys() & set(names)
    ]
    if missing:
        raise ConfigError("--columns", f"no column of {missing[0]}", COLUMNS_HINT, file)
    return ColumnRoles(roles, None, tuple(notes))


FORCES = ("force", "deflection")
ROLE_TEXTS = {"z": "the displacement of the base", "separation": "the separation"}


def _is_force(role: str, title: ColumnTitle) -> bool:
    """Return whether a column of deflection is in a unit of force."""
    return role == "deflection" and title.kind == "force"


def _abscissa_of_name(title: ColumnTitle) -> str:
    """Return the role z or separation if the title names one of the two; otherwise delta."""
    return next((role for role in ("z", "separation") if title.name in ROLE_NAMES[role]), "delta")


def _column(layout: TextLayout, word: str, file: str) -> Column:
    """Return a column by its title, with or without unit, or by its number, counted from 1."""
    texts = [title.text.lower() for title in layout.titles]
    names = [title.name for title in layout.titles]
    for sign, name in ((1, word.lower()), (-1, word.lower().removeprefix("-"))):
        if sign < 0 and not word.startswith("-"):
            continue
        for titles in (texts, names):
            if name in titles:
                return Column(titles.index(name), sign)
        if name.isdecimal() and len(name) < 9 and 1 <= int(name) <= layout.width:
            return Column(int(name) - 1, sign)
    titles_text = ", ".join(title.text for title in layout.titles)
    available = titles_text if layout.titles else f"columns 1 to {layout.width}"
    raise ConfigError("--columns", f"there is no column '{word}'", f"there are {available}", file)


def _roles_without_titles(layout: TextLayout) -> ColumnRoles:
    """Return the roles of two columns without titles; raise NoCurve if there are not two."""
    if layout.other_titles:
        raise NoCurve(
            f"the titles '{layout.other_titles[:80]}' are not those of {layout.width} columns: "
            f"{COLUMNS_HINT}"
        )
    if layout.width == 1:
        raise NoCurve("only one column, but a curve needs columns of depth and force")
    if layout.width != 2:
        raise NoCurve(f"{layout.width} columns without a header: {COLUMNS_HINT}")
    return ColumnRoles({"delta": Column(0), "force": Column(1)}, is_abscissa_guessed=True)


def _roles_by_name(layout: TextLayout, part: str) -> dict[str, Column]:
    """Return the columns of a part, or of all parts, by the names in their titles."""
    roles: dict[str, Column] = {}
    # Columns of this part of the curve take precedence over columns of all parts.
    for own_part in dict.fromkeys((part, "")):
        for role, names in ROLE_NAMES.items():
            places = [
                (names.index(title.name), k)
                for k, title in enumerate(layout.titles)
                if title.part == own_part and title.name in names and _fits(role, title)
            ]
            if places and role not in roles:
                roles[role] = Column(min(places)[1])
    for k, title in enumerate(layout.titles):
        if title.part not in (part, "") or "force" in roles:
            continue
        # A deflection in newtons is a force, and a force in metres or volts a deflection.
        if title.name in ROLE_NAMES["deflection"] and title.kind == "force":
            roles["force"] = Column(k)
        elif title.name in ROLE_NAMES["force"] and title.kind in KINDS["deflection"][:3]:
            roles.setdefault("deflection", Column(k))
    if "force" in roles:
        roles.pop("deflection", None)
    return roles


def _fits(role: str, title: ColumnTitle) -> bool:
    """Return whether a column has a unit that is possible for a role."""
    return title.kind in KINDS[role] and not (role == "part" and title.unknown_unit)


def _add_roles_by_unit(layout: TextLayout, roles: dict[str, Column]) -> tuple[str, ...]:
    """Add roles by unit: the only column with a unit of force, length or time has this role.

    This works for titles in any language. Returns sentences about the assumptions.
    """
    notes = []
    used = {column.index for column in roles.values()}
    is_named = bool(roles)
    needed = {
        "delta": not roles.keys() & set(ABSCISSAS),
        "force": not roles.keys() & set(FORCES),
        "t": "t" not in roles,
    }
    for role in (role for role, is_needed in needed.items() if is_needed):
        places = [
            k
            for k, title in enumerate(layout.titles)
            if title.kind and title.kind == KINDS[role][0] and k not in used
        ]
        if len(places) == 1:
            roles[role] = Column(places[0])
            if is_named and role == "force":
                notes.append(
                    f"column '{layout.titles[places[0]].text}' is taken as the force because of "
                    "its unit"
                )
    return tuple(notes)


def _has_curve(roles: Mapping[str, Column]) -> bool:
    """Return whether there are an abscissa and a force."""
    return bool(roles.keys() & set(ABSCISSAS) and roles.keys() & set(FORCES))


def _refuse_incomplete(layout: TextLayout, roles: Mapping[str, Column]) -> None:
    """Raise NoCurve if an abscissa or a force is missing."""
    if _has_curve(roles):
        return
    titles = ", ".join(title.text for title in layout.titles)[:200]
    missing = "depth" if roles.keys() & set(FORCES) else "force"
    raise NoCurve(f"no column of {missing} among {titles}: {COLUMNS_HINT}")
