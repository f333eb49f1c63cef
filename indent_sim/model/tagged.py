"""A mark on the type of a field that holds one of several dataclasses, chosen by one of their keys."""

from __future__ import annotations

from dataclasses import dataclass
from types import NoneType
from typing import Any, get_args, get_type_hints


@dataclass(frozen=True)
class TaggedBy:
    """Marks a section whose dataclass one key chooses; unlike pydantic's mark it knows a union of one, and None."""

    tag: str

    def __get_pydantic_core_schema__(self, union: Any, handler: Any) -> Any:
        from pydantic_core import core_schema

        parts = get_args(union) or (union,)
        kinds = {get_args(get_type_hints(kind)[self.tag])[0]: kind for kind in parts if kind is not NoneType}
        choices = {word: handler.generate_schema(kind) for word, kind in kinds.items()}
        schema = core_schema.tagged_union_schema(choices, discriminator=self.tag)
        return core_schema.nullable_schema(schema) if NoneType in parts else schema
