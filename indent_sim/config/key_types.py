"""Type annotations of the keys of a scene, read for checks, messages and pages.

From an annotation follow the members of a union, the fields and tags of dataclasses, the remedy for
a wrong value, and the description of the allowed values.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from annotated_types import Ge, Gt, Le, Len, Lt, MinLen

from indent_sim.model.units import TaggedBy


def remedy_of(hint: Any) -> str:
    """Return the remedy in the annotations of a type; "" if there is no remedy."""
    marks = hint.__metadata__ if get_origin(hint) is Annotated else ()
    return next((mark for mark in marks if isinstance(mark, str)), "")


@cache
def field_names(kind: Any) -> tuple[str, ...]:
    """Return the fields of a dataclass or pydantic model in order."""
    if dataclasses.is_dataclass(kind):
        return tuple(f.name for f in dataclasses.fields(kind))
    return tuple(kind.model_fields)


@cache
def field_types(kind: type) -> dict[str, Any]:
    """Return the annotated types of the fields of a dataclass or pydantic model."""
    all_types = get_type_hints(kind, include_extras=True)
    return {name: all_types[name] for name in field_names(kind)}


@cache
def types_by_tag(union: Any, tag: str) -> dict[str, type]:
    """Return the dataclasses of a union by the value of their tag."""
    return {get_args(field_types(kind)[tag])[0]: kind for kind in union_members(union)}


@cache
def tag_of(hint: Any) -> str | None:
    """Return the key that selects the alternative of a section; None without alternatives."""
    marks = hint.__metadata__ if get_origin(hint) is Annotated else ()
    return next((mark.key for mark in marks if isinstance(mark, TaggedBy)), None)


def type_of_tag(hint: Any, word: Any) -> type | None:
    """Return the dataclass of a section by the value of its tag; None for any other type."""
    if (tag := tag_of(hint)) is not None:
        return types_by_tag(hint, tag).get(word) if isinstance(word, str) else None
    kinds = [
        bare_type(part) for part in union_members(hint) if dataclasses.is_dataclass(bare_type(part))
    ]
    return kinds[0] if len(kinds) == 1 else None


@cache
def default_of(kind: Any, name: str) -> Any:
    """Return the default of a field of a dataclass or pydantic model; None without a default."""
    if not dataclasses.is_dataclass(kind):
        return kind.model_fields[name].default
    default = next(f.default for f in dataclasses.fields(kind) if f.name == name)
    return None if default is dataclasses.MISSING else default


@cache
def union_members(hint: Any) -> tuple[Any, ...]:
    """Return the alternatives of a union without None; any other type alone."""
    if get_origin(hint) is Annotated and any(
        isinstance(mark, TaggedBy) for mark in hint.__metadata__
    ):
        hint = hint.__origin__
    if get_origin(hint) in (Union, UnionType):
        return tuple(part for part in get_args(hint) if part is not NoneType)
    return (hint,)


@cache
def untagged_sections(hint: Any) -> tuple[str, ...]:
    """Return the names of dataclasses without a tag that are allowed in place of a word.

    An example is the conductance of a face in place of `drained`.
    """
    if hint is None or tag_of(hint) is not None:
        return ()
    members = [bare_type(member) for member in union_members(hint)]
    kinds = [kind for kind in members if isinstance(kind, type) and dataclasses.is_dataclass(kind)]
    return tuple(kind.__name__ for kind in kinds) if len(members) > 1 else ()


@cache
def bare_type(hint: Any) -> Any:
    """Return a type without its annotations and without None."""
    if get_origin(hint) is Annotated:
        return bare_type(hint.__origin__)
    parts = union_members(hint)
    return hint if len(parts) > 1 or parts[0] is hint else bare_type(parts[0])


@cache
def allowed_words(hint: Any) -> tuple[str, ...]:
    """Return the words (literals) that are allowed as a value.

    Included are words that set all fields of a dataclass, such as "fixed" for all walls of a box.
    """
    kinds = [shared_field_type(bare_type(part)) for part in union_members(hint)]
    return tuple(
        str(word) for kind in kinds if get_origin(kind) is Literal for word in get_args(kind)
    )


def shared_field_type(kind: Any) -> Any:
    """Return the common type of all fields of a dataclass, so that one value can set them all.

    The walls of a box are an example. The result is None if the fields have different types. Types
    other than dataclasses are returned unchanged.
    """
    if not dataclasses.is_dataclass(kind):
        return kind
    first, *further_types = field_types(kind).values()  # type: ignore[arg-type]
    are_alike = (
        get_origin(first) is Literal
        and further_types
        and all(further_type == first for further_type in further_types)
    )
    return first if are_alike else None


def describe_type(hint: Any) -> str:
    """Return the description of a type with its range, such as "a number > 0 or auto"."""
    members = union_members(hint)
    # "a whole number" is left out beside "a number", which includes it.
    described_members = [member for member in members if not (member is int and float in members)]
    return join_words(list(dict.fromkeys(map(_describe_member, described_members))))


def join_words(words: Sequence[str], last: str = "or") -> str:
    """Return words joined as in "a, b or c"."""
    return f"{', '.join(words[:-1])} {last} {words[-1]}" if len(words) > 1 else "".join(words)


def _describe_member(hint: Any) -> str:
    """Return the description of one alternative of a type."""
    marks = hint.__metadata__ if get_origin(hint) is Annotated else ()
    kind = bare_type(hint)
    if get_origin(kind) is Literal:
        return join_words([str(word) for word in get_args(kind)])
    if get_origin(kind) is tuple:
        return _describe_list(describe_type(get_args(kind)[0]), marks)
    if get_origin(kind) is dict:
        return f"a mapping of names to {describe_type(get_args(kind)[1])}"
    if dataclasses.is_dataclass(kind):
        shared_type = shared_field_type(kind)
        names = ", ".join(part.name for part in dataclasses.fields(kind))
        return (
            f"{describe_type(shared_type)} (or one each: {names})" if shared_type else "a section"
        )
    signs = {
        Gt: ("> {:g}", "gt"),
        Ge: (">= {:g}", "ge"),
        Lt: ("< {:g}", "lt"),
        Le: ("<= {:g}", "le"),
    }
    bounds = [signs[type(mark)] + (mark,) for mark in marks if type(mark) in signs]
    texts = [text.format(getattr(mark, name)) for text, name, mark in bounds]
    prefix = "non-empty " if any(isinstance(mark, MinLen) for mark in marks) else ""
    nouns = {float: "a number", int: "a whole number", str: "text", bool: "true or false"}
    return f"{prefix}{nouns[kind]} {' and '.join(texts)}".rstrip()


def _describe_list(item: str, marks: Sequence[Any]) -> str:
    """Return the description of the type of a list."""
    items = item.removeprefix("a ")
    if items.startswith("list"):
        items = items.replace("list", "lists", 1)
    else:
        items = items.replace("number", "numbers")
    items = items.replace("section", "sections")
    size = next((mark for mark in marks if isinstance(mark, Len)), None)
    if size and size.min_length == size.max_length:
        return f"a list of {size.min_length} {items}"
    if size and size.max_length:
        return f"a list of {size.min_length} to {size.max_length} {items}"
    return f"a {'non-empty ' if size else ''}list of {items}"
