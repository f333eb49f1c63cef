"""Every command and line of Python in README, docs and tutorials is run, or it is said where.

A block of YAML that begins with the comment "# name.yaml" is that file. A block of text behind
commands or Python lists lines that must have been printed.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import jpk_files
import numpy as np
import pytest
from documented_commands import BLOCK, ROOT, environment, followed

PAGES = sorted((ROOT / "docs" / "tutorials").glob("*.md"))
COMMAND = re.compile(r"`(indent-sim [^`]*)`")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_tutorial_can_be_followed(page, tmp_path):
    """A tutorial can be followed; its Python blocks share their names.

    So do the cells of a notebook.
    """
    before, printed = environment(tmp_path), ""
    os.symlink(ROOT / "configs", tmp_path / "configs")
    blocks = BLOCK.findall(page.read_text(encoding="utf-8"))
    python = ""
    for kind, text in blocks:
        if kind == "yaml":
            name = re.match(r"# ([\w.]+\.yaml)\n", text)
            assert name, f"{page.name}: a block of YAML without its file's name"
            (tmp_path / name[1]).write_text(text)
        elif kind == "text":
            missing = [line for line in text.splitlines() if line not in printed]
            assert not missing, f"{missing} not in\n{printed}"
        else:
            python = python + text if kind == "python" else python
            command = (
                [sys.executable, "-c", python]
                if kind == "python"
                else ["bash", "-euo", "pipefail", "-c", text]
            )
            done = subprocess.run(
                command,
                cwd=tmp_path,
                env=before,
                capture_output=True,
                text=True,
                timeout=600,
                check=False,
            )
            printed = done.stdout + done.stderr
            assert done.returncode == 0, f"{text}\n{printed}"
    assert {kind for kind, _ in blocks} & {"sh", "python"}


def test_every_tutorial_is_named_in_the_readme():
    text = (ROOT / "README.md").read_text()
    assert [page.name for page in PAGES if f"docs/tutorials/{page.name}" not in text] == []


def test_commands_of_the_pages_exist():
    """Every `indent-sim ...` of README, docs and tutorials has an existing command and options."""
    from click.testing import CliRunner

    from indent_sim.cli import commands

    docs = ROOT / "docs"
    pages = [ROOT / "README.md", *docs.glob("*.md"), *PAGES]
    said = [line for page in pages for line in COMMAND.findall(page.read_text())]
    said += [
        line
        for page in pages
        for kind, text in BLOCK.findall(page.read_text())
        if kind == "sh"
        for line in re.findall(r"^(?:\.venv/bin/)?(indent-sim .*?)(?: +#.*)?$", text, re.MULTILINE)
    ]
    known = {
        name: CliRunner().invoke(commands.program, [name, "--help"]).output
        for name in commands.program.commands
    }
    wrong = []
    for line in said:
        words = line.split()
        options = [word for word in words if word.startswith("--")]
        if words[1] not in known or any(option not in known[words[1]] for option in options):
            wrong.append(line)
    assert len(said) > 40 and wrong == []


DOCS = ("how_do_i", "study", "experiments", "conventions", "theory", "notes", "hardness")
RUN = ("README.md", *(f"docs/{name}.md" for name in DOCS))
ELSEWHERE = {  # blocks of commands that are not run here, by their first words
    "pip install . ": "tests/system/test_wheel.py, and make pypi",
    "make demo ": "installs the packages of the machine: the first step of every check of a commit",
    "make check ": "the tests themselves",
    "mpirun -n 4": "tests/system/test_parallel.py, on 2 and 3 ranks",
    "sbatch --ntasks=2": "tests/system/test_slurm.py, every line, with a stand-in for Slurm",
    "scripts/slurm/submit_study tips.yaml": "tests/system/test_slurm.py",
    "indent-sim plan scene.yaml     #": "tests/system/test_slurm.py",
    "indent-sim study STUDY.yaml --surrogate": "tests/system/test_study_rows.py",
    "import indent_sim\nimport numpy as np\n\nforce = ": "tests/unit/studies/test_surrogate.py",
    "indent-sim plan films.yaml": "tests/system/test_study_rows.py, smaller",
    "export XDG_CACHE_HOME": "tests/system/test_slurm.py",
    "module load": "an installation on a cluster",
    "docker build": "needs a Docker daemon",
    **{
        f"indent-sim init {kind}\n": "tests/system/test_journeys.py"
        for kind in ("cell", "film", "gel", "rubber", "study")
    },
    'eval "$(_INDENT_SIM_COMPLETE=zsh': "test_tab_completion, as far as it needs no zsh",
    "_INDENT_SIM_COMPLETE=fish": "test_tab_completion, as far as it needs no fish",
    'import indent_sim\n\nlayer = {"body"': "tests/system/test_notebook.py",
    "import sys\nimport nanite": "scripts/make_foreign_curves_page, in an environment of its own",
    "import pyvista": "test_fields_by_pyvista, where there is one",
}
INSTEAD = {  # the same with fewer runs
    "indent-sim study configs/studies": "indent-sim plan configs/studies",
    "{from: 0.05, to: 0.005, count: 5, spacing: log}": "{from: 0.1, to: 0.05, count: "
    "2, spacing: log}",
    "set: {loading.steps: 5}": "set: {loading.steps: 2}",
    "base: ../../hertz.yaml": "base: configs/hertz.yaml",
    # tests/system/test_fit.py
    "indent-sim fit curves/ --scene scene.yaml --vary material.E": "indent-sim fit --help",
    # tests/system/test_fit.py
    "indent-sim require scene.yaml --curve measured.csv": "indent-sim require --help",
    "indent-sim study STUDY.yaml --jobs 4": "indent-sim study STUDY.yaml --jobs 2",
}
SCENE = """\
units: {length: um, force: nN}
body: {shape: cylinder, radius: 20, height: 10}
material: {model: linear_elastic, E: 1 kPa, nu: 0.3}
indenter: {shape: sphere, R: 5 um}
loading: {delta: 0.4 um, steps: 2}
mesh: {h_contact: 0.5}
"""


def commands_of(page: Path) -> list[tuple[str, str]]:
    """Kind and text of the blocks of a page that somebody would type."""
    return [
        (kind, text)
        for kind, text in BLOCK.findall(page.read_text(encoding="utf-8"))
        if kind in ("sh", "zsh", "fish", "python")
    ]


def reason_of(text: str) -> str | None:
    """The reason why a block is not run here."""
    return next((reason for words, reason in ELSEWHERE.items() if text.startswith(words)), None)


def shortened(text: str) -> str:
    for long, short in INSTEAD.items():
        text = text.replace(long, short)
    return text


def test_every_block_of_commands_is_run_or_says_where():
    """Every block of commands is run here or has a reason why not.

    The records of docs/decisions are left out: their commands made figures of their day. The
    blocks of docs/api.md are signatures.
    """
    pages = [*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")]
    pages.remove(ROOT / "docs" / "api.md")
    found = {(str(page.relative_to(ROOT)), text) for page in pages for _, text in commands_of(page)}
    assert [(name, text) for name, text in found if name not in RUN and not reason_of(text)] == []
    told = [words for words in ELSEWHERE if not any(text.startswith(words) for _, text in found)]
    assert told == [] and {name for name, _ in found} >= set(RUN)
    assert all(any(long in (ROOT / name).read_text() for name in RUN) for long in INSTEAD)


@pytest.mark.parametrize("name", RUN)
def test_the_commands_of_a_page_run(name, tmp_path):
    """The commands of a page run in their order, with smaller studies.

    The folder has the configs, a scene and a study.
    """
    text = (ROOT / name).read_text(encoding="utf-8")
    os.symlink(ROOT / "configs", tmp_path / "configs")
    if "STUDY.yaml" in text:
        (tmp_path / "STUDY.yaml").write_text(shortened(BLOCK.findall(text)[0][1]))
    for kind, block in commands_of(ROOT / name):
        if reason_of(block):
            continue
        if kind == "python":
            followed([f'"{sys.executable}" - <<"END"\n{block}\nEND'], tmp_path)
        else:
            lines = [re.sub(r" +#.*", "", line.strip()) for line in shortened(block).splitlines()]
            followed([line for line in lines if line], tmp_path)


def test_fields_by_pyvista(tmp_path):
    """The recipe for PyVista runs up to its picture, for which there may be no screen.

    Without PyVista its arrays are checked with meshio.
    """
    (tmp_path / "scene.yaml").write_text(SCENE)
    followed(["indent-sim run scene.yaml --output results/gel --quiet"], tmp_path)
    page = (ROOT / "docs" / "how_do_i.md").read_text(encoding="utf-8")
    recipe = next(text for _, text in BLOCK.findall(page) if text.startswith("import pyvista"))
    if find_spec("pyvista"):
        return followed(
            [f'"{sys.executable}" - <<"END"\n{recipe.split("body.plot")[0]}\nEND'], tmp_path
        )
    import meshio

    with meshio.xdmf.TimeSeriesReader(tmp_path / "results" / "gel" / "fields.xdmf") as reader:
        reader.read_points_cells()
        arrays = {name for found in reader.read_data(reader.num_steps - 1)[1:] for name in found}
    assert set(re.findall(r'(?:body\[|by_vector\(|scalars=)"(\w+)"', recipe)) == {
        "displacement",
        "pressure",
        "von_mises",
    }
    assert {"displacement", "pressure", "von_mises"} <= arrays


def write_hertzian_map(path: Path) -> None:
    """Write a map of 64 curves of a ball of 5 um, by Hertz."""
    z = np.linspace(-1e-6, 1e-6, 250)
    force = 4.0 / 3.0 * 1333.0 * np.sqrt(5e-6) * np.maximum(z, 0.0) ** 1.5
    noise = np.random.default_rng(0).standard_normal((8, 8, 250))
    forces = force + 0.01 * force.max() * noise
    jpk_files.write_map(path, z, forces, jpk_files.Grid(8, 8, 1e-5, 1e-5, back_and_forth=False))


def test_the_answers_of_the_how_do_i_page_run(tmp_path):
    """Every command in the sentences of docs/how_do_i.md runs.

    They run in order, beside a scene, a study, a result and a measured curve.
    """
    os.symlink(ROOT / "configs", tmp_path / "configs")
    (tmp_path / "scene.yaml").write_text(SCENE)
    (tmp_path / "study.yaml").write_text("base: scene.yaml\nvary: {material.nu: [0.3, 0.4]}\n")
    followed(
        [
            "indent-sim run scene.yaml --output results/gel --quiet",
            "cut -d, -f2,3 results/gel/force_indentation.csv > measured.csv",
        ],
        tmp_path,
    )
    write_hertzian_map(tmp_path / "map.jpk-force-map")
    said = COMMAND.findall((ROOT / "docs" / "how_do_i.md").read_text(encoding="utf-8"))
    assert len(said) >= 11
    followed(list(dict.fromkeys(map(shortened, said))), tmp_path)


def test_commands_in_the_sentences_of_the_theory_run(tmp_path):
    """The lines of Python in theory.md run, and the measurements it names are tests."""
    theory = (ROOT / "docs" / "theory.md").read_text(encoding="utf-8")
    lines = re.findall(r"`(python -c [^`]*)`", theory)
    assert len(lines) == 2
    followed([line.replace("python", sys.executable, 1) for line in lines], tmp_path)
    for tests, word in re.findall(r"`python -m pytest -s (\S+) -k (\w+)`", theory):
        source = (ROOT / tests).read_text(encoding="utf-8")
        assert re.search(rf"def test_\w*{word}", source), (tests, word)


def test_every_make_of_the_pages_is_a_target():
    pages = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
    named = {word for page in pages for word in re.findall(r"`make (\w+)`", page.read_text())}
    blocks = [text for page in pages for _, text in commands_of(page)]
    named |= {word for text in blocks for word in re.findall(r"^make (\w+)", text, re.MULTILINE)}
    targets = set(re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    assert len(named) > 7 and named <= targets, named - targets


@pytest.mark.parametrize(
    ("shell", "says"),
    [
        ("bash", "complete -o nosort -F"),
        ("zsh", "compdef "),
        ("fish", "complete --no-files --command indent-sim"),
    ],
)
def test_tab_completion(tmp_path, shell, says):
    """What the page tells a shell to evaluate defines a completion, which completes commands."""
    variables = environment(tmp_path)
    source = variables | {"_INDENT_SIM_COMPLETE": f"{shell}_source"}
    script = subprocess.run(
        ["indent-sim"], env=source, capture_output=True, text=True, check=True
    ).stdout
    assert says in script
    words = {
        "_INDENT_SIM_COMPLETE": f"{shell}_complete",
        "COMP_CWORD": "st" if shell == "fish" else "1",
        "COMP_WORDS": "indent-sim" if shell == "fish" else "indent-sim st",
    }
    found = subprocess.run(
        ["indent-sim"], env=variables | words, capture_output=True, text=True, check=True
    ).stdout
    assert re.findall(r"study", found) and "plot" not in found
