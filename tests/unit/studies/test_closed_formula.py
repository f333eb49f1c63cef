"""Closed formulas of studies: known laws are found again, and the texts have the stated error."""

from __future__ import annotations

import json
import re
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.mathtext import MathTextParser
from surrogate_tables import RANGES, SCENE, hertz, study_with_table

from indent_sim import studies
from indent_sim.results.result_files import STUDY
from indent_sim.studies.chebyshev_sum import ChebyshevSum
from indent_sim.studies.closed_formula import ClosedFormula, Term
from indent_sim.studies.formula_file import formula_entry
from indent_sim.studies.formula_fit import MAX_COEFFICIENTS, fit_closed_formula
from indent_sim.studies.formula_text import latex_text, python_text
from indent_sim.studies.held_out_error import held_out_mask
from indent_sim.studies.surrogate import Coordinate, Surrogate, read_surrogate

GROUPS = (
    Coordinate({"body.height": 1.0, "indenter.R": -0.5, "loading.delta": -0.5}, True),
    Coordinate({"body.height": 1.0, "indenter.R": -1.0}, True),
    Coordinate({"material.nu": 1.0}, False),
)
HEIGHT = "body.height"
# A surrogate with the groups of a layer. The formula does not use its polynomial, which is 0.
SURROGATE = Surrogate(
    "force",
    {key: (part["from"], part["to"]) for key, part in RANGES.items()} | {HEIGHT: (0.1, 10.0)},
    {},
    GROUPS,
    (),
    {"material.E": 1.0, "indenter.R": 2.0},
    True,
    ChebyshevSum(np.zeros((1, 3), int), np.zeros(1)),
    (),
    {},
    {"title": "a layer"},
)


def keys_of(count=800):
    """Random values of the keys of a layer."""
    random = np.random.default_rng(5)
    keys = {key: random.uniform(part["from"], part["to"], count) for key, part in RANGES.items()}
    return keys | {HEIGHT: 10 ** random.uniform(-1, 1, count)}


def fitted(force, count=800):
    """The formula of a force that is a function of the keys."""
    keys = keys_of(count)
    return fit_closed_formula(SURROGATE, keys, force(keys))


def executed(text, keys):
    """The column of the last line of a formula, by Python, at values of dotted keys."""
    names = {}
    for key, value in keys.items():
        section, name = key.split(".")
        setattr(names.setdefault(section, SimpleNamespace()), name, value)
    exec(text, {"__builtins__": {}}, names)
    return names["force"]


def python_of_latex(text):
    """The lines of an equation for LaTeX as statements of Python, the last ones first."""
    text = re.sub(r" \\\\\n&\\quad", "", text)
    lines = [line.removesuffix(r" \\").rstrip(",.") for line in text.splitlines()[1:-1]]
    changes = {r"\\frac{N}{D}": "N/D", "&": "", r" \\[,] ": " * ", r"\\nu": "nu", r"\\delta": "d"}
    changes |= {r"x_\{(\d)\}": r"x\1", r" \\cdot 10\^\{(.+?)\}": r"e\1", r"\{(\w+)\}": r"\1"}
    changes |= {r"\^\{(.+?)\}": r"**(\1)", r"\^(\w+)": r"**\1"}
    for old, new in changes.items():
        lines = [re.sub(old, new, line) for line in lines]
    return "\n".join(reversed(lines))


def test_hertz_is_found():
    """4/3 E R^(1/2) delta^(3/2) / (1 - nu^2): factor, numerator and denominator.

    The error is that of 5 digits of 4/3, 1.3333.
    """
    formula = fitted(hertz)
    assert "force = E * R**(1/2) * delta**(3/2) * numerator / denominator" in python_text(formula)
    assert formula.numerator == (Term(1.3333, (0.0, 0.0, 0.0)),)
    assert formula.denominator == (Term(-1.0, (0.0, 0.0, 2.0)),)
    assert formula.error["largest"] == pytest.approx(1 - 1.3333 / (4 / 3), rel=1e-6)


def test_other_powers_are_found():
    """A cone: the force is proportional to delta^2, whatever R is."""
    formula = fitted(lambda keys: hertz(keys, 2.0))
    assert formula.factor == pytest.approx({"material.E": 1.0, "loading.delta": 2.0})
    assert formula.coefficient_count == 2


def series(keys):
    """Force on a layer by a power series of (R delta)^(1/2)/h."""
    x = np.sqrt(keys["indenter.R"] * keys["loading.delta"]) / keys[HEIGHT]
    return hertz(keys | {"material.nu": 0.0}) * (1 + 1.25 * x + 0.5 * keys["material.nu"] * x**2)


def test_a_series_is_found_again():
    """Its three terms are found, in a variable with positive powers, whose reciprocal was given.

    The coefficients, all positive, are rounded to 5 digits, by at most 5e-5 of each of them.
    """
    formula = fitted(series)
    assert formula.error["largest"] < 5e-5
    assert (formula.coefficient_count, formula.denominator) == (3, ())
    powers = {HEIGHT: -1.0, "indenter.R": 0.5, "loading.delta": 0.5}
    assert formula.variables[0] == powers


def rough(keys):
    """A force that no short formula gives exactly."""
    x = np.sqrt(keys["indenter.R"] * keys["loading.delta"]) / keys[HEIGHT]
    return hertz(keys) * np.exp(np.tanh(x * (1 + 3 * keys["material.nu"] ** 3)))


@pytest.mark.parametrize("force", [series, rough])
def test_the_texts_have_the_stated_error(force):
    """Python evaluates both texts at the held-out runs; matplotlib reads the equation."""
    formula = fitted(force, 2000)
    is_held_out = held_out_mask(2000)
    keys = {key: values[is_held_out] for key, values in keys_of(2000).items()}
    values = executed(python_text(formula), keys)
    errors = np.sort(np.abs(values / force(keys) - 1))
    assert len(errors) == formula.error["held_out"]
    # Round-off of sums of at most MAX_COEFFICIENTS terms.
    assert errors[-1] == pytest.approx(formula.error["largest"], abs=1e-11)
    assert np.median(errors) == pytest.approx(formula.error["median"], abs=1e-11)
    assert np.mean(errors <= formula.error["error"]) >= formula.error["quantile"]
    assert formula.coefficient_count <= MAX_COEFFICIENTS
    latex = latex_text(formula)
    symbols = {"E": "material.E", "nu": "material.nu", "R": "indenter.R"}
    symbols |= {"d": "loading.delta", "h": HEIGHT}
    names = {symbol: keys[key] for symbol, key in symbols.items()}
    exec(python_of_latex(latex), {"__builtins__": {}}, names)
    assert np.allclose(names["F"], values, rtol=1e-11)
    for line in latex.splitlines()[1:-1]:
        MathTextParser("path").parse(f"${line.replace('&', '').removesuffix(chr(92) * 2)}$")


def test_a_pole_is_not_accepted():
    """A force that is infinite at an edge, nu = 0.5, has a formula without a pole before it."""
    formula = fitted(lambda keys: hertz(keys) / (0.5001 - keys["material.nu"]) ** 0.5)
    nu = np.linspace(0.1, 0.5, 4001)
    keys = {key: np.full(4001, values[0]) for key, values in keys_of(1).items()}
    values = formula(keys | {"material.nu": nu})
    assert (values > 0).all() and np.isfinite(values).all()


def test_keys_with_the_same_end_have_different_symbols():
    powers = {"body.layers[0].thickness": 1.0, "body.layers[1].thickness": -1.0}
    terms = ((Term(2.0, (0.5,)), Term(-1e-7, (0.0,))), ())
    formula = ClosedFormula("force", (powers,), {"loading.force": 1.0}, *terms, {})
    assert python_text(formula).splitlines() == [
        "force_1 = loading.force",
        "thickness_2 = body.layers[0].thickness",
        "thickness_3 = body.layers[1].thickness",
        "x1 = thickness_2 * thickness_3**-1",
        "numerator = 2 * x1**(1/2) - 1e-7",
        "denominator = 1",
        "force = force_1 * numerator / denominator",
    ]
    assert r"N &= 2 \, x_{1}^{1/2} - 1 \cdot 10^{-7}," in latex_text(formula)


def test_a_bad_formula_is_not_printed():
    """A jump of a factor of 2 at a surface that no power of the groups describes."""
    formula = fitted(lambda keys: hertz(keys) * (1 + (np.sin(40 * keys["material.nu"]) > 0)))
    entry = formula_entry("force", formula)
    assert set(entry) == {"reason"}
    assert "no closed formula of at most 24 coefficients is within 5 %" in entry["reason"]


def test_it_is_in_and_beside_the_surrogate(tmp_path):
    study_with_table(tmp_path, hertz)
    (tmp_path / STUDY).write_text('{"program": "indent-sim"}')
    settings = {"base": SCENE, "vary": RANGES, "sample": {"count": 400}, "output": {"runs": "none"}}
    made = studies.make_surrogate(settings, "force", output=tmp_path)
    text = (tmp_path / "formula-force.txt").read_text()
    assert text.startswith("# force of the study")
    keys = {key: values for key, values in keys_of(50).items() if key != HEIGHT}
    # 5 digits of 4/3.
    assert np.allclose(executed(text, keys), hertz(keys), rtol=3e-5)
    assert r"\begin{aligned}" in (tmp_path / "formula-force.tex").read_text()
    entry = read_surrogate(made.path).information["formula"]
    assert entry["coefficients"] == made.as_json()["formula"]["coefficients"] == 2
    assert entry["latex"] in (tmp_path / "formula-force.tex").read_text()
    assert entry["error"]["held_out"] == json.loads(made.path.read_text())["error"]["held_out"]
    assert any("closed formula of 2 coefficients" in note for note in made.notes)


def test_a_column_with_other_signs_has_none(tmp_path):
    """Its files say so, in place of an earlier formula."""

    def attracted(keys):
        return hertz(keys) - hertz(keys | {"loading.delta": 0.02})

    study_with_table(tmp_path, attracted)
    (tmp_path / STUDY).write_text('{"program": "indent-sim"}')
    (tmp_path / "formula-force.txt").write_text("force = 1\n")
    settings = {"base": SCENE, "vary": RANGES, "sample": {"count": 400}, "output": {"runs": "none"}}
    made = studies.make_surrogate(settings, "force", output=tmp_path)
    text = (tmp_path / "formula-force.txt").read_text()
    assert "no closed formula: force has values that are not positive" in text
    assert all(line.startswith("#") for line in text.splitlines())
    assert any("not positive" in note for note in made.notes)
