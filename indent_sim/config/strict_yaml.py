"""Strict reader of YAML 1.2 (core schema): plain data with the line of every key.

`1e-6` is a number, `on` and `yes` are words, and `010` is the number ten. Errors are raised for
repeated keys, tags, anchors, aliases, a second document, and files that are too long or nested too
deeply.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping
from itertools import chain
from typing import Any

import yaml

from indent_sim.process.errors import ConfigError

KeyPath = tuple[str | int, ...]
Lines = dict[KeyPath, int]

# Limits of a file: bytes, and levels of nesting.
MAX_BYTES = 1_000_000
MAX_DEPTH = 20

UNWRITABLE = re.compile("[\0\ud800-\udfff]")
_UNPRINTABLE = re.compile("[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_CONSTANTS = {"": None, "~": None, "null": None, "Null": None, "NULL": None} | {
    word: word.lower() == "true" for word in ("true", "True", "TRUE", "false", "False", "FALSE")
}
_INTEGER = re.compile(r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_NON_FINITE = re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")
_PLAIN_WORDS = re.compile(r"[A-Za-z][A-Za-z0-9_./-]*( [A-Za-z0-9_./-]+)*")
# Words that a YAML 1.1 reader does not read as words.
_AMBIGUOUS_WORDS = re.compile("y|yes|n|no|on|off|true|false|null", re.IGNORECASE)
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def parse(text: str, name: str = "") -> tuple[Any, Lines]:
    """Return the value of a YAML document and the line of every key path.

    Parameters
    ----------
    text
        Text of the document.
    name
        Name of the file in errors.

    Raises
    ------
    ConfigError
        If the text is not strict YAML.
    """
    _refuse_text(text, name)
    reader = _EventReader(name)
    try:
        return reader.document(yaml.parse(text, Loader=_LOADER)), reader.lines
    except yaml.MarkedYAMLError as error:
        raise _syntax_error(error, text, name) from None
    except (yaml.YAMLError, UnicodeError) as error:
        raise ConfigError("", f"not YAML: {' '.join(str(error).split())}", file=name) from None


def key_text(path: KeyPath) -> str:
    """Return the dotted form of a key path: ("loading", "deltas", 2) -> loading.deltas[2]."""
    text = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path)
    return text.removeprefix(".")


def key_path(text: str) -> KeyPath:
    """Return the key path of a text such as loading.deltas[2]."""
    parts = re.findall(r"\[(\d+)\]|([^.\[\]]+)", text)
    return tuple(int(index) if index else word for index, word in parts)


def leaf_values(value: Any, path: KeyPath = ()) -> Iterator[tuple[str, Any]]:
    """Yield dotted key and value of all entries except sections and lists of sections."""
    is_list = isinstance(value, list) and any(isinstance(part, Mapping) for part in value)
    if not isinstance(value, Mapping) and not is_list:
        yield key_text(path), value
        return
    for key, part in value.items() if isinstance(value, Mapping) else enumerate(value):
        yield from leaf_values(part, (*path, key))


def dump(data: Mapping[str, Any], indent: str = "") -> str:
    """Return nested mappings, lists (in brackets) and scalars as YAML; inverse of `parse`."""
    lines = []
    for key, value in data.items():
        if isinstance(value, Mapping) and value and not indent:
            lines.append(f"{_scalar_yaml(key)}:\n{dump(value, '  ')}")
        else:
            lines.append(f"{indent}{_scalar_yaml(key)}: {inline_yaml(value)}\n")
    return "".join(lines)


class _EventReader:
    """Reader of the parser's events, which returns plain data and the line of every key path."""

    def __init__(self, name: str):
        self.name = name
        self.lines: Lines = {}

    def document(self, events: Iterator[yaml.Event]) -> Any:
        """Return the value of the only document; None if there is no document."""
        next(events)  # StreamStartEvent
        start = next(events)
        if isinstance(start, yaml.StreamEndEvent):
            return None
        value = self.node(next(events), events, ())
        next(events)  # DocumentEndEvent
        after = next(events)
        if isinstance(after, yaml.DocumentStartEvent):
            raise self.error(after, (), "a second document starts here", "one file is one scene")
        return value

    def node(self, event: Any, events: Iterator[yaml.Event], path: KeyPath) -> Any:
        """Return the value that begins with an event of the YAML parser.

        The value is a scalar, a list or a mapping.
        """
        self.lines.setdefault(path, event.start_mark.line + 1)
        max_values = 200_000
        if len(self.lines) > max_values:
            raise self.error(event, path[:1], f"the file has more than {max_values} values")
        if isinstance(event, yaml.AliasEvent) or event.anchor is not None:
            raise self.error(
                event,
                path,
                "anchors and aliases (&, *) are not allowed",
                "write the value itself in this place",
            )
        if event.tag is not None:
            raise self.error(
                event, path, f"tags ({event.tag}) are not allowed", "write the plain value"
            )
        if isinstance(event, yaml.ScalarEvent):
            return self.scalar(event, path)
        if len(path) >= MAX_DEPTH:
            raise self.error(event, path[:3], f"nested deeper than {MAX_DEPTH} levels")
        if isinstance(event, yaml.SequenceStartEvent):
            return self.sequence(events, path)
        return self.mapping(events, path)

    def sequence(self, events: Iterator[yaml.Event], path: KeyPath) -> list[Any]:
        """Return the list whose first item is the next event."""
        values: list[Any] = []
        while not isinstance(event := next(events), yaml.SequenceEndEvent):
            values.append(self.node(event, events, (*path, len(values))))
        return values

    def mapping(self, events: Iterator[yaml.Event], path: KeyPath) -> dict[str, Any]:
        """Return the mapping whose first key is the next event."""
        values: dict[str, Any] = {}
        while not isinstance(event := next(events), yaml.MappingEndEvent):
            key = self.key(event, path)
            inner_path = (*path, key)
            if key in values:
                problem = f"given twice, first in line {self.lines[inner_path]}"
                raise self.error(event, inner_path, problem, "keep one")
            self.lines[inner_path] = event.start_mark.line + 1
            values[key] = self.node(next(events), events, inner_path)
        return values

    def key(self, event: Any, path: KeyPath) -> str:
        """Return the key of an event; raise ConfigError if it is not a word."""
        word = self.node(event, iter(()), path) if isinstance(event, yaml.ScalarEvent) else None
        if not isinstance(word, str):
            raise self.error(event, path, "a key must be a word")
        return word

    def scalar(self, event: yaml.ScalarEvent, path: KeyPath) -> Any:
        """Return the text of a quoted or block scalar, or the value of an unquoted scalar."""
        text = event.value
        is_quoted = not event.implicit[0]
        if is_quoted:
            if UNWRITABLE.search(text):
                raise self.error(event, path, "the text contains a character that no file can have")
            return text
        if _NON_FINITE.fullmatch(text):
            raise self.error(event, path, f"{text} is not a finite number")
        try:
            return parse_scalar(text)
        except OverflowError as error:
            raise self.error(event, path, str(error)) from None

    def error(self, event: Any, path: KeyPath, problem: str, remedy: str = "") -> ConfigError:
        """Return the ConfigError for a key path at the line of an event."""
        return ConfigError(key_text(path), problem, remedy, self.name, event.start_mark.line + 1)


def parse_scalar(text: str) -> Any:
    """Return the value of an unquoted YAML 1.2 scalar; raise OverflowError if it is too large."""
    if text in _CONSTANTS:
        return _CONSTANTS[text]
    integer_match = _INTEGER.fullmatch(text)
    if not (integer_match or _FLOAT.fullmatch(text)):
        return text
    max_digits = 400
    if len(text) > max_digits:
        raise OverflowError(f"a number of {len(text)} characters is too long")
    if integer_match:
        return int(text, 0) if text[:2] in ("0o", "0x") else int(text)
    if math.isinf(float(text)):
        raise OverflowError(f"{text} is too large a number")
    return float(text)


def _refuse_text(text: str, name: str) -> None:
    """Raise ConfigError for a text that is too long or has control characters."""
    if len(text) > MAX_BYTES:
        raise ConfigError(
            "", f"the text is longer than {MAX_BYTES} characters", "this is not a scene", name
        )
    if unprintable := _UNPRINTABLE.search(text.removeprefix("\ufeff")):
        line = text.count("\n", 0, unprintable.start()) + 1
        raise ConfigError(
            "", f"character U+{ord(unprintable.group()):04X} is not allowed", "", name, line
        )


def _syntax_error(error: yaml.MarkedYAMLError, text: str, name: str) -> ConfigError:
    """Return the ConfigError for a text that is not YAML, with its line."""
    mark = error.problem_mark or error.context_mark
    problem = "not YAML: " + " ".join(part for part in (error.context, error.problem) if part)
    # Some versions of libyaml have a smaller limit of nesting than this reader.
    if "nesting depth" in problem:
        problem = f"nested deeper than {MAX_DEPTH} levels"
    lines = text.splitlines()
    line = min(mark.line + 1, len(lines)) if mark else None
    remedy = "indent with spaces, not tabs" if line and re.match(r" *\t", lines[line - 1]) else ""
    return ConfigError("", problem, remedy, name, line)


def inline_yaml(value: Any) -> str:
    """Return the YAML text of any value on one line."""
    if isinstance(value, Mapping):
        items = (f"{_scalar_yaml(key)}: {inline_yaml(part)}" for key, part in value.items())
        return "{" + ", ".join(items) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(inline_yaml, value)) + "]"
    return _scalar_yaml(value)


def short_yaml(value: object) -> str:
    """Return the YAML text of a value for messages, with four digits of a float."""
    return f"{value:.4g}" if isinstance(value, float) else inline_yaml(value)


def _scalar_yaml(value: Any) -> str:
    """Return the YAML text of a number, a boolean, null or a text."""
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    if isinstance(value, float):
        # A YAML 1.1 reader reads 1.0e-06 as a number, but 1e-06 as a word.
        return re.sub(r"^(-?\d+)e", r"\1.0e", repr(value))
    if isinstance(value, int):
        return str(value)
    is_plain = _PLAIN_WORDS.fullmatch(value) and not _AMBIGUOUS_WORDS.fullmatch(value)
    return str(value) if is_plain else "".join(chain('"', map(_escape, value), '"'))


def _escape(character: str) -> str:
    """Return a character as it is written between double quotes."""
    if character in '"\\\n\t':
        return json.dumps(character)[1:-1]
    if character == " " or character.isprintable():
        return character
    return f"\\U{ord(character):08x}"
