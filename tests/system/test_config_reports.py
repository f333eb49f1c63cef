"""Every scene of configs/ has a report whose pictures have room."""

from __future__ import annotations

import warnings
from pathlib import Path

import html_page
import pytest
from mpi4py import MPI
from shipped_scenes import COARSER, CONFIGS, SCENES, Run

from indent_sim.config.scene_file import load
from indent_sim.results.run_report import run_page
from indent_sim.run.pipeline import simulate


@pytest.mark.parametrize("name", SCENES)
def test_scene_gives_a_report(name: str, tmp_path: Path) -> None:
    overrides = ("output.plot=false", *COARSER.get(name, Run()).overrides)
    simulate(load(CONFIGS / name, overrides), MPI.COMM_SELF, directory=tmp_path / "result")
    with warnings.catch_warnings():
        warnings.filterwarnings("error", "constrained_layout")  # panels without room
        html_page.check(run_page(tmp_path / "result"))
