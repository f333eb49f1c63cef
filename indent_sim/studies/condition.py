"""Conditions between the keys of a study, such as "indenter.R < body.height".

A condition is parsed by a small grammar and computed from numbers only:

    condition  = sum (("<" | "<=" | ">" | ">=") sum)+
    sum        = product (("+" | "-") product)*
    product    = power (("*" | "/") power)*
    power      = ["-"] value ["**" power]
    value      = number | key | "(" sum ")"
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np

# Largest length of the text of a condition, and largest number of conditions of a study.
MAX_LENGTH = 200
MAX_CONDITIONS = 20
# Largest nesting depth of parentheses, signs and powers.
MAX_NESTING = 30
_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)"
    r"|(?P<key>[A-Za-z_]\w*(?:\[\d+\])*(?:\.\w+(?:\[\d+\])*)*)"
    r"|(?P<sign>\*\*|<=|>=|[-+*/()<>]))"
)
_COMPARISONS: dict[str, Callable[[Any, Any], Any]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
_OPERATIONS: dict[str, Callable[[Any, Any], Any]] = {
    "+": np.add,
    "-": np.subtract,
    "*": np.multiply,
    "/": np.true_divide,
    "**": np.float_power,
}

# Numbers by key; with arrays the condition is evaluated for many points at once.
Numbers = Mapping[str, Any]
_Term = Callable[[Numbers], Any]


class ConditionError(ValueError):
    """Error: a text is not a condition; the message describes the error in the text."""


@dataclass(frozen=True)
class Condition:
    """Condition between keys, which a point of a study must fulfil.

    Attributes
    ----------
    text
        The condition as written.
    keys
        The keys whose numbers it needs.
    """

    text: str
    keys: tuple[str, ...]
    _terms: tuple[_Term, ...]
    _comparisons: tuple[str, ...]

    def holds(self, numbers: Numbers) -> Any:
        """Return whether the condition holds; False if one of its terms is not finite."""
        with np.errstate(all="ignore"):
            values = [term(numbers) for term in self._terms]
        pairs = zip(self._comparisons, values[:-1], values[1:], strict=True)
        conditions = [np.isfinite(value) for value in values]
        conditions += [_COMPARISONS[sign](left, right) for sign, left, right in pairs]
        return reduce(np.logical_and, conditions)


def parse_condition(text: str) -> Condition:
    """Parse a condition; raise ConditionError if the text is not a condition."""
    if len(text) > MAX_LENGTH:
        raise ConditionError(f"is longer than {MAX_LENGTH} characters")
    parser = _Parser(_tokens(text))
    terms = [parser.sum(0)]
    comparisons = []
    while parser.next_is(*_COMPARISONS):
        comparisons.append(parser.take())
        terms.append(parser.sum(0))
    if parser.tokens:
        raise ConditionError(f"has an unexpected '{parser.tokens[0]}'")
    if not comparisons:
        raise ConditionError(f"compares nothing: it has none of {', '.join(_COMPARISONS)}")
    return Condition(text, tuple(dict.fromkeys(parser.keys)), tuple(terms), tuple(comparisons))


def _tokens(text: str) -> list[str]:
    """Split a text into tokens: numbers, keys and signs."""
    tokens = []
    position = 0
    while position < len(text.rstrip()):
        match = _TOKEN.match(text, position)
        if match is None:
            raise ConditionError(f"has an unexpected '{text[position:].strip()[:20]}'")
        tokens.append(match.group().strip())
        position = match.end()
    return tokens


class _Parser:
    """Parser by recursive descent; each method takes the tokens of one rule of the grammar."""

    def __init__(self, tokens: list[str]):
        self.tokens = tokens
        self.keys: list[str] = []

    def next_is(self, *signs: str) -> bool:
        """Return whether the next token is one of the given signs."""
        return bool(self.tokens) and self.tokens[0] in signs

    def take(self) -> str:
        """Return the next token and remove it."""
        if not self.tokens:
            raise ConditionError("ends too early")
        return self.tokens.pop(0)

    def sum(self, depth: int) -> _Term:
        """Parse a sum."""
        term = self.product(depth)
        while self.next_is("+", "-"):
            term = _combine(self.take(), term, self.product(depth))
        return term

    def product(self, depth: int) -> _Term:
        """Parse a product."""
        term = self.power(depth)
        while self.next_is("*", "/"):
            term = _combine(self.take(), term, self.power(depth))
        return term

    def power(self, depth: int) -> _Term:
        """Parse a power; a sign before it applies to the whole power."""
        if depth > MAX_NESTING:
            raise ConditionError(f"is nested more than {MAX_NESTING} times")
        if self.next_is("-"):
            self.take()
            return _combine("-", lambda numbers: 0.0, self.power(depth + 1))
        base = self.value(depth + 1)
        if not self.next_is("**"):
            return base
        return _combine(self.take(), base, self.power(depth + 1))

    def value(self, depth: int) -> _Term:
        """Parse a number, a key or a sum in parentheses."""
        token = self.take()
        if token == "(":
            term = self.sum(depth)
            if not self.next_is(")"):
                raise ConditionError("lacks a ')'")
            self.take()
            return term
        if token[0].isdigit() or token[0] == ".":
            number = float(token)
            return lambda numbers: number
        if not (token[0].isalpha() or token[0] == "_"):
            raise ConditionError(f"has an unexpected '{token}'")
        self.keys.append(token)
        return lambda numbers: numbers[token]


def _combine(sign: str, left: _Term, right: _Term) -> _Term:
    """Return the function of an operation on two terms."""
    operation = _OPERATIONS[sign]
    return lambda numbers: operation(left(numbers), right(numbers))
