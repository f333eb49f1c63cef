"""Text of a closed formula: statements that Python executes, and an equation for LaTeX."""

from __future__ import annotations

import itertools
import keyword
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from textwrap import wrap

from indent_sim.model.symbols import lookup
from indent_sim.studies.closed_formula import DIGITS, ClosedFormula, Term
from indent_sim.studies.dimensionless_groups import MAX_DENOMINATOR

WIDTH = 100
# Number of terms on one line of an equation.
TERMS_PER_LINE = 4


@dataclass(frozen=True)
class _Style:
    """Signs of a language: between factors, of powers, fractions and powers of ten."""

    times: str
    power: str
    fraction: str
    scientific: str


PYTHON = _Style(" * ", "{base}**{exponent}", "({fraction})", "{mantissa}e{exponent}")
LATEX = _Style(
    r" \, ", "{base}^{{{exponent}}}", "{fraction}", r"{mantissa} \cdot 10^{{{exponent}}}"
)


@dataclass(frozen=True)
class _Notation:
    """How the parts of a formula are written.

    Attributes
    ----------
    style
        Signs of the language.
    symbols
        Symbols of the keys.
    variables
        Names of the variables of the formula.
    """

    style: _Style
    symbols: Mapping[str, str]
    variables: Sequence[str]

    def product(self, factors: Iterable[tuple[str, float]]) -> str:
        """Return a product of powers of names; "" without factors."""
        return self.style.times.join(self._factor(name, power) for name, power in factors if power)

    def keys_product(self, powers: Mapping[str, float]) -> str:
        """Return a product of powers of keys."""
        return self.product((self.symbols[key], power) for key, power in powers.items()) or "1"

    def terms(self, terms: Sequence[Term]) -> list[str]:
        """Return terms with their signs."""
        texts = []
        for term in terms:
            sign = "-" if term.coefficient < 0 else "+"
            factors = self.product(zip(self.variables, term.powers, strict=True))
            parts = filter(None, (self._number(abs(term.coefficient)), factors))
            texts.append(f"{sign} {self.style.times.join(parts)}")
        return texts

    def sum(self, terms: Sequence[Term]) -> str:
        """Return a sum of terms."""
        return " ".join(self.terms(terms)).removeprefix("+ ")

    def _factor(self, name: str, power: float) -> str:
        """Return a power of a name."""
        fraction = Fraction(power).limit_denominator(MAX_DENOMINATOR)
        if fraction == 1:
            return name
        form = "{fraction}" if fraction.denominator == 1 else self.style.fraction
        return self.style.power.format(base=name, exponent=form.format(fraction=fraction))

    def _number(self, value: float) -> str:
        """Return a coefficient."""
        text = f"{value:.{DIGITS}g}"
        mantissa, is_scientific, exponent = text.partition("e")
        if not is_scientific:
            return text
        return self.style.scientific.format(mantissa=mantissa, exponent=int(exponent))


def python_text(formula: ClosedFormula) -> str:
    """Return the formula as statements that Python can execute with the keys of the scene."""
    keys = _keys(formula)
    symbols = _python_symbols(keys, formula.column)
    names = _variable_names(formula, symbols, "x{}")
    notation = _Notation(PYTHON, symbols, names)
    lines = [f"{symbol} = {key}" for key, symbol in symbols.items()]
    lines += [
        f"{name} = {notation.keys_product(powers)}"
        for name, powers in zip(names, formula.variables, strict=True)
        if not _is_key(powers)
    ]
    lines += [
        f"numerator = {notation.sum(formula.numerator)}",
        f"denominator = {notation.sum((_constant_one(names), *formula.denominator))}",
        f"{formula.column} = {notation.keys_product(formula.factor)} * numerator / denominator",
    ]
    return "\n".join(lines) + "\n"


def latex_text(formula: ClosedFormula) -> str:
    """Return the formula as an equation for LaTeX with the package amsmath."""
    symbols = _latex_symbols(_keys(formula))
    names = _variable_names(formula, symbols, "x_{{{}}}")
    notation = _Notation(LATEX, symbols, names)
    rows = [
        rf"{_latex_symbol(formula.column)} &= {notation.keys_product(formula.factor)}"
        r" \, \frac{N}{D},",
        *_latex_sum("N", notation.terms(formula.numerator)),
        *_latex_sum("D", notation.terms((_constant_one(names), *formula.denominator))),
    ]
    rows += [
        f"{name} &= {notation.keys_product(powers)},"
        for name, powers in zip(names, formula.variables, strict=True)
        if not _is_key(powers)
    ]
    last = rows.pop().removesuffix(",") + "."
    body = " \\\\\n".join([*rows, last])
    return f"\\begin{{aligned}}\n{body}\n\\end{{aligned}}\n"


def comment(lines: Iterable[str], sign: str) -> str:
    """Return lines as a comment that begins with a sign, such as "#"."""
    wrapped = [
        part
        for line in lines
        for part in wrap(line, WIDTH, initial_indent=f"{sign} ", subsequent_indent=f"{sign}   ")
    ]
    return "\n".join(wrapped) + "\n"


def _variable_names(
    formula: ClosedFormula, symbols: Mapping[str, str], group_name: str
) -> list[str]:
    """Return the names of the variables: symbols of keys, and numbered names of groups."""
    is_key = [_is_key(powers) for powers in formula.variables]
    numbers = itertools.count(1)
    return [
        symbols[next(iter(powers))] if flag else group_name.format(next(numbers))
        for powers, flag in zip(formula.variables, is_key, strict=True)
    ]


def _constant_one(names: Sequence[str]) -> Term:
    """Return the term 1."""
    return Term(1.0, (0.0,) * len(names))


def _keys(formula: ClosedFormula) -> list[str]:
    """Return the keys of a formula, each once."""
    return list(dict.fromkeys(key for part in (formula.factor, *formula.variables) for key in part))


def _is_key(powers: Mapping[str, float]) -> bool:
    """Return whether a variable is one key itself."""
    return list(powers.values()) == [1.0]


def _end(key: str) -> str:
    """Return the last name of a key, such as "E" of material.E."""
    return key.rpartition(".")[2]


def _python_symbols(keys: Sequence[str], column: str) -> dict[str, str]:
    """Return a short name for each key: the end of the key, numbered where it is not unique."""
    ends = {key: re.sub(r"\W", "_", _end(key)) for key in keys}
    known = [column, "numerator", "denominator", *ends.values()]
    symbols = {}
    for number, (key, end) in enumerate(ends.items(), 1):
        is_unique = known.count(end) == 1 and not keyword.iskeyword(end)
        symbols[key] = end if is_unique else f"{end}_{number}"
    return symbols


def _latex_symbols(keys: Sequence[str]) -> dict[str, str]:
    """Return the symbol of each key, numbered where it is not unique."""
    plain = {key: _latex_symbol(key) for key in keys}
    known = list(plain.values())
    return {
        key: symbol if known.count(symbol) == 1 else f"{{{symbol}}}_{{({number})}}"
        for number, (key, symbol) in enumerate(plain.items(), 1)
    }


def _latex_symbol(key: str) -> str:
    """Return the symbol of a key or column, or its name in upright letters."""
    symbol = lookup(_end(key), key.split(".")[0])
    if symbol is not None and symbol.latex:
        return symbol.latex
    name = _end(key).replace("_", r"\_")
    return rf"\mathrm{{{name}}}"


def _latex_sum(name: str, terms: Sequence[str]) -> list[str]:
    """Return the lines of an equation with a sum of terms."""
    lines = [
        " ".join(terms[start : start + TERMS_PER_LINE])
        for start in range(0, len(terms), TERMS_PER_LINE)
    ]
    first, *others = lines
    rows = [f"{name} &= {first.removeprefix('+ ')}", *(rf"&\quad {line}" for line in others)]
    rows[-1] += ","
    return rows
