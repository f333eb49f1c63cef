"""Tutorials and how-do-I page: every command and every line of Python in them is run, in an empty folder a page.

A block of YAML that begins with the comment "# name.yaml" is that file. A block of text behind commands or Python lists
lines that must have been printed.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted((ROOT / "docs" / "tutorials").glob("*.md"))
BLOCK = re.compile(r"```(\w+)\n(.*?)```", re.DOTALL)
COMMAND = re.compile(r"`(indent-sim [^`]*)`")


def environment(folder: Path) -> dict[str, str]:
    """Where `indent-sim` is this project's program."""
    bin_ = folder / ".bin"
    bin_.mkdir(exist_ok=True)
    script = bin_ / "indent-sim"
    script.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m indent_sim.cli.commands "$@"\n')
    script.chmod(0o755)
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    return os.environ | {"PATH": f"{bin_}{os.pathsep}{os.environ['PATH']}", "PYTHONPATH": path, "MPLBACKEND": "agg"}


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_tutorial_can_be_followed(page, tmp_path):
    """Python blocks of a page share their names, as the cells of a notebook do."""
    before, printed = environment(tmp_path), ""
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
            command = [sys.executable, "-c", python] if kind == "python" else ["bash", "-euo", "pipefail", "-c", text]
            done = subprocess.run(command, cwd=tmp_path, env=before, capture_output=True, text=True, timeout=600,
                                  check=False)  # fmt: skip
            printed = done.stdout + done.stderr
            assert done.returncode == 0, f"{text}\n{printed}"
    assert {kind for kind, _ in blocks} & {"sh", "python"}


def test_every_tutorial_is_named_in_the_readme():
    text = (ROOT / "README.md").read_text()
    assert [page.name for page in PAGES if f"docs/tutorials/{page.name}" not in text] == []


def test_commands_of_the_pages_exist():
    """Every `indent-sim ...` of README, how-do-I page and tutorials names a command and options that there are."""
    from click.testing import CliRunner

    from indent_sim.cli import commands

    docs = ROOT / "docs"
    pages = [ROOT / "README.md", docs / "how_do_i.md", docs / "study.md", docs / "cluster.md", *PAGES]
    said = [line for page in pages for line in COMMAND.findall(page.read_text())]
    said += [line for page in pages for kind, text in BLOCK.findall(page.read_text()) if kind == "sh"
             for line in re.findall(r"^(?:\.venv/bin/)?(indent-sim .*?)(?: +#.*)?$", text, re.MULTILINE)]  # fmt: skip
    known = {name: CliRunner().invoke(commands.program, [name, "--help"]).output for name in commands.program.commands}
    wrong = []
    for line in said:
        words = line.split()
        options = [word for word in words if word.startswith("--")]
        if words[1] not in known or any(option not in known[words[1]] for option in options):
            wrong.append(line)
    assert len(said) > 40 and wrong == []


@pytest.mark.slow
def test_commands_of_the_readme_run(tmp_path):
    """In their order, in a folder beside the configs; a study of many runs is planned instead of run."""
    os.symlink(ROOT / "configs", tmp_path / "configs")
    text = next(text for kind, text in BLOCK.findall((ROOT / "README.md").read_text()) if "init cell" in text)
    text = text.replace("indent-sim study configs", "indent-sim plan configs")
    done = subprocess.run(["bash", "-euo", "pipefail", "-c", text], cwd=tmp_path, env=environment(tmp_path),
                          capture_output=True, text=True, timeout=600, check=False)  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr


def test_tab_completion(tmp_path):
    """What the page tells a shell to evaluate defines a completion, and that completes commands."""
    variables = environment(tmp_path)
    source = variables | {"_INDENT_SIM_COMPLETE": "bash_source"}
    script = subprocess.run(["indent-sim"], env=source, capture_output=True, text=True, check=True).stdout
    assert "complete -o nosort -F" in script
    words = {"_INDENT_SIM_COMPLETE": "bash_complete", "COMP_WORDS": "indent-sim st", "COMP_CWORD": "1"}
    found = subprocess.run(["indent-sim"], env=variables | words, capture_output=True, text=True, check=True).stdout
    assert found.split() == ["plain,study"]
