"""Configuration of Sphinx for the site. `make_site` gives the version and the source folder."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.utils.math import latex2mathml
from pygments.lexers import PythonLexer

HERE = Path(__file__).resolve().parent

project = "indent-sim"
author = "indent-sim contributors"
copyright = "indent-sim contributors, MIT license"

extensions = ["myst_parser", "sphinx_copybutton"]
root_doc = "index"
# Titles of GitHub's Markdown are anchors, and dollars enclose formulas.
myst_heading_anchors = 4
myst_enable_extensions = ["dollarmath"]
myst_fence_as_directive = ["math"]
highlight_language = "none"
smartquotes = False
copybutton_exclude = ".linenos, .gp, .go"
copybutton_prompt_text = "$ "
nitpicky = True

html_theme = "furo"
html_math_renderer = "mathml"
html_static_path = [str(HERE / "static")]
templates_path = [str(HERE / "templates")]
html_css_files = ["site.css"]
html_js_files = ["versions.js"]
html_copy_source = False
html_show_sourcelink = False
html_sidebars = {
    "**": [
        "sidebar/brand.html",
        "sidebar/search.html",
        "versions.html",
        "sidebar/scroll-start.html",
        "sidebar/navigation.html",
        "sidebar/scroll-end.html",
    ]
}
html_theme_options = {"navigation_with_keys": True}


# Commands that docutils does not know, by what shows the same.
REPLACED_COMMANDS = {r"\texttt": r"\text", r"\Big": "", r"\big": ""}
# Fractions of single digits without braces, of which docutils would read "12" as one number.
FRACTION = re.compile(r"(\\[td]?frac)\s*(\d)")
SECOND_DIGIT = re.compile(r"(\\[td]?frac\{\d\})\s*(\d)")


def mathml(formula: str, as_block: bool) -> str:
    """Return a formula in LaTeX as MathML, which browsers show without a script or a network."""
    for command, other in REPLACED_COMMANDS.items():
        whole_command = re.escape(command) + "(?![A-Za-z])"
        formula = re.sub(whole_command, re.escape(other), formula)
    formula = FRACTION.sub(r"\1{\2}", formula)
    formula = SECOND_DIGIT.sub(r"\1{\2}", formula)
    return str(latex2mathml.tex2mathml(formula, as_block=as_block))


def inline_formula(self: Any, node: nodes.math) -> None:
    """Write a formula inside a line."""
    self.body.append(mathml(node.astext(), as_block=False))
    raise nodes.SkipNode


def displayed_formula(self: Any, node: nodes.math_block) -> None:
    """Write a formula on lines of its own."""
    self.body.append(f'<div class="formula">{mathml(node.astext(), as_block=True)}</div>')
    raise nodes.SkipNode


def setup(app: Any) -> None:
    """Register the writers of formulas, and a name of GitHub for files of Snakemake."""
    app.add_html_math_renderer("mathml", (inline_formula, None), (displayed_formula, None))
    app.add_lexer("python-snakefile", PythonLexer)
