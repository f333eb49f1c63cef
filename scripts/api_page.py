"""Text of docs/api.md: the public functions with their signatures and docstrings."""

from __future__ import annotations

import inspect
import re
import textwrap
from collections.abc import Callable, Iterator
from typing import Any

import indent_sim

# Functions by what they are for. A test compares them with `indent_sim.__all__`.
GROUPS = {
    "One scene": ("load", "resolve", "states", "condense", "simulate", "sensitivities"),
    "Before a run": ("plan", "require"),
    "Many scenes": ("study", "surrogate"),
    "Measured curves": ("fit", "fit_map", "hardness"),
    "Results": ("read", "compare", "plot"),
}
TITLE = """# Python functions

Generated from the signatures and docstrings by `scripts/reference_pages.py`.

These are the names that `import indent_sim` provides, and the only stable ones; modules inside the
package may move between releases. [Python and notebooks](tutorials/python.md) shows them at work.
A function raises an exception with the exit code that the command of the same name would end with
([exit codes](results.md#exit-codes)).
"""
SECTION = re.compile(r"^(Parameters|Returns|Raises|Yields|Notes)\n-+\n", re.MULTILINE)


def api_page() -> str:
    """Return docs/api.md."""
    parts = [TITLE]
    for group, names in GROUPS.items():
        parts.append(f"## {group}\n")
        for name in names:
            parts += _function_parts(name, getattr(indent_sim, name))
    return "\n".join(parts)


def _function_parts(name: str, function: Callable[..., Any]) -> Iterator[str]:
    """Yield heading, signature and docstring of a function as Markdown."""
    yield f"### {name}\n"
    yield f"```python\n{_signature(name, function)}\n```\n"
    text = inspect.getdoc(function) or ""
    words, *sections = SECTION.split(text)
    yield _paragraphs(words)
    for title, body in zip(sections[::2], sections[1::2], strict=True):
        yield f"**{title}**\n"
        yield _paragraphs(body) if title == "Notes" else _items(body)


def _signature(name: str, function: Callable[..., Any]) -> str:
    """Return a call with a line for each parameter."""
    signature = inspect.signature(function)
    lines = []
    has_star = False
    for parameter in signature.parameters.values():
        if parameter.kind is parameter.KEYWORD_ONLY and not has_star:
            has_star = True
            lines.append("*")
        if parameter.kind is parameter.VAR_KEYWORD:
            has_star = True
        lines.append(_parameter(parameter))
    body = "".join(f"    {line},\n" for line in lines)
    return f"indent_sim.{name}(\n{body}) -> {signature.return_annotation}"


def _parameter(parameter: inspect.Parameter) -> str:
    """Return a parameter with annotation and default; a function as default by its name."""
    default = parameter.default
    stars = "**" if parameter.kind is parameter.VAR_KEYWORD else ""
    text = f"{stars}{parameter.name}: {parameter.annotation}"
    if default is parameter.empty:
        return text
    shown = default.__qualname__ if callable(default) else repr(default)
    return f"{text} = {shown}"


def _paragraphs(text: str) -> str:
    """Return paragraphs, each on one line."""
    return "".join(
        f"{_one_line(part)}\n\n" for part in text.strip().split("\n\n") if part.strip()
    ).removesuffix("\n")


def _items(body: str) -> str:
    """Return the entries of a section of a docstring as a list."""
    items = []
    for line in body.strip().splitlines():
        if line.startswith(" "):
            items[-1][1].append(line)
        elif line:
            items.append((line, []))
    texts = []
    for head, lines in items:
        meaning = _one_line(textwrap.dedent("\n".join(lines)))
        # The types of parameters are in the signature.
        names = head.split(" : ")[0]
        texts.append(f"* `{names}`: {meaning}\n" if meaning else f"* `{names}`\n")
    return "".join(texts)


def _one_line(text: str) -> str:
    """Return a text without line breaks."""
    return " ".join(text.split())
