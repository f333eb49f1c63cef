"""Measures speed against accuracy, and writes docs/accuracy.md with its pictures.

usage: scripts/bench [--quick]

    --quick    run every process once instead of three times, and keep the runs of the studies that
               are in results/studies/accuracy

Needs .venv (make setup) and about a quarter of an hour, alone on the machine. The studies are those
of configs/studies/accuracy, and their results go to results/studies/accuracy. The text of the page
is page.md, which contains no number that this script measures. Numbers of other programs are those
of peers.csv.
"""

from __future__ import annotations

import argparse
import logging
import os
import platform
import sys
from pathlib import Path
from string import Template

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
sys.path.insert(1, str(Path(__file__).resolve().parents[1]))
sys.path.insert(2, str(Path(__file__).resolve().parents[2] / "tests"))
os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import processes
import side_by_side
import sources
import sweeps
from generated_page import ROOT, write
from markdown import number, table

from indent_sim import __version__
from indent_sim.results.result_files import read_report
from indent_sim.studies import Study

PAGE = ROOT / "docs" / "accuracy.md"
TEMPLATE = Path(__file__).with_name("page.md")
# Marks around the tables of scripts/make_error_bar_table.
ERROR_BARS_BEGIN = "<!-- error bars -->"
ERROR_BARS_END = "<!-- end of error bars -->"
# Studies that refine a mesh, with the column of the known error.
REFINEMENT_STUDIES = {
    "hertz_axi": "force_error_worst",
    "hertz_cube": "force_error_vs",
    "layer": "force_error_worst",
    "neo_hookean_30": "force_error_vs",
    "neo_hookean_49": "force_error_vs",
}
# Scenes on which the compilation of kernels is measured.
KERNEL_SCENES = ("configs/hertz.yaml", "configs/hertz_cube.yaml", "configs/gel.yaml")
# Scenes that are run on several ranks.
RANK_SCENES = (
    ("configs/hertz.yaml",),
    ("configs/hertz_cube.yaml", "mesh.h_contact=0.0125"),
    (
        "configs/notes/hyperelastic_augmented_lagrangian.yaml",
        "loading.delta=0.1",
        "loading.steps=5",
    ),
)
# Spheres that are pressed 0.3 and 0.7 of their radius into rubber.
DEEP_SCENES = {
    "a quarter of a box, nu = 0.4999": (
        "configs/hertz_cube.yaml",
        "body.size=[4.0, 4.0, 1.0]",
        "body.sides=roller",
        "indenter={shape: sphere, R: 1.0}",
        "material={model: neo_hookean, E: 1.0, nu: 0.4999}",
        "loading={delta: 0.3, steps: 4}",
        "mesh.h_contact=0.09",
    ),
    "a cylinder, nu = 0.49": (
        "configs/hertz.yaml",
        "body.radius=2",
        "body.sides=roller",
        "indenter={shape: sphere, R: 1.0}",
        "material={model: neo_hookean, E: 1.0, nu: 0.49}",
        "loading={deltas: [0.05, 0.1, 0.2, 0.3, 0.5, 0.7]}",
        "mesh.h_contact=0.02",
    ),
}


def main(quick: bool) -> None:
    """Measure everything and write the page."""
    # FFCx logs every compilation at a lower level.
    logging.basicConfig(level=logging.WARNING)
    names = sorted(path.stem for path in sweeps.STUDIES.glob("*.yaml"))
    studies = {name: sweeps.execute(name, resume=quick) for name in names}
    slots = study_slots(studies) | process_slots(repeat=1 if quick else 3)
    template = Template(TEMPLATE.read_text(encoding="utf-8"))
    write(PAGE, template.substitute({name: text.rstrip() for name, text in slots.items()}))


def study_slots(studies: dict[str, Study]) -> dict[str, str]:
    """Return the slots of the page that come from the studies."""
    study = studies["hertz_axi"]
    report = read_report(study.directory / "runs" / study.rows[0]["run"])
    source_rows = {name: studies[f"source_{name}"].rows for name in ("mesh", "truncation", "model")}
    sections = {
        name: sweeps.section(studies[name], ["contact.method"], error)
        for name, error in REFINEMENT_STUDIES.items()
    }
    return {
        "version": __version__,
        "versions": ", ".join(f"{name} {version}" for name, version in report["versions"].items()),
        "asked_axi": sweeps.accuracy_table(studies["asked_axi"]),
        "asked_cube": sweeps.accuracy_table(studies["asked_cube"]),
        "sources": sources.sources_table(source_rows),
        "reductions": sweeps.reductions_table(studies["reductions"].rows),
        "growth": sweeps.growth_table(studies["growth"].rows),
        **sections,
    }


def process_slots(repeat: int) -> dict[str, str]:
    """Return the slots of the page that come from whole processes."""
    rows = [*side_by_side.own_rows(repeat), *side_by_side.peers()]
    side_by_side.draw(rows)
    node_count, tip_seconds = processes.measure_tips()
    return {
        "machine": platform.machine(),
        "cores": str(os.cpu_count()),
        "programs": side_by_side.tables(rows),
        "stages": side_by_side.stages_table(rows),
        "steps": steps_table(repeat),
        "throughput": throughput_table(repeat),
        "nodes": str(node_count),
        "tip": number(1e3 * tip_seconds, 2),
        "kernels": kernels_table(repeat),
        "deep": deep_table(repeat),
        "ranks": ranks_table(repeat),
        "predictions": predictions_table(),
        "error_bars": error_bar_tables(),
    }


def error_bar_tables() -> str:
    """Return the tables of `scripts/make_error_bar_table` from the present page."""
    _, _, rest = PAGE.read_text(encoding="utf-8").partition(ERROR_BARS_BEGIN)
    return rest.partition(ERROR_BARS_END)[0].strip()


def steps_table(repeat: int) -> str:
    """Return the table of the cost of load steps."""
    measurements = processes.measure_steps(repeat)
    fewest, base_cpu = measurements[0]
    lines = []
    for count, cpu in measurements:
        per_step = 1e3 * (cpu - base_cpu) / (count - fewest) if count > fewest else None
        lines.append([str(count), number(cpu), number(per_step, 2)])
    return table(["steps", "CPU s of the process", f"ms per step beyond the first {fewest}"], lines)


def throughput_table(repeat: int) -> str:
    """Return the table of scenes per minute of a study."""
    lines = [
        [str(jobs), number(wall), number(cpu), number(processes.STUDY_RUNS * 60 / wall)]
        for jobs, wall, cpu in processes.measure_throughput(repeat)
    ]
    head = ["runs at the same time", "wall s of the study", "CPU s", "scenes per minute"]
    return table(head, lines)


def kernels_table(repeat: int) -> str:
    """Return the table of the cost with an empty and with a full cache of kernels."""
    lines = [
        [scene, number(cold), number(warm), number(cold - warm, 2)]
        for scene, cold, warm in processes.measure_kernels(KERNEL_SCENES, repeat)
    ]
    return table(["scene", "empty cache", "full cache", "difference"], lines)


def deep_table(repeat: int) -> str:
    """Return the table of the cost of finite strain in two and in three dimensions."""
    lines = []
    for name, settings in DEEP_SCENES.items():
        done = processes.measure(*settings, repeat=repeat)
        lines.append(
            [
                name,
                str(done.report["dofs"]),
                str(len(done.force)),
                str(done.report["audit"]["newton_iterations"]),
                number(done.cpu),
                number(done.memory),
            ]
        )
    return table(["scene", "dofs", "steps", "linear solves", "CPU s of the process", "MB"], lines)


def ranks_table(repeat: int) -> str:
    """Return the table of scenes on several ranks, with the gain relative to one rank."""
    head = [
        "scene",
        "dofs",
        "ranks",
        "wall s",
        "wall s, assembly and solution",
        "CPU s, all ranks",
        "gain",
        "gain, assembly and solution",
    ]
    lines: list[list[str]] = []
    one_rank: dict[tuple[str, ...], tuple[float, float]] = {}
    for scene, ranks, done in processes.measure_ranks(RANK_SCENES, repeat):
        solution = sum(done.report["timings"][stage] for stage in ("assemble", "solve"))
        # The first measurement of a scene is that on one rank.
        wall_of_one, solution_of_one = one_rank.setdefault(scene, (done.wall, solution))
        lines.append(
            [
                " ".join(scene),
                str(done.report["dofs"]),
                str(ranks),
                number(done.wall),
                number(solution),
                number(done.cpu),
                number(wall_of_one / done.wall, 2),
                number(solution_of_one / solution, 2),
            ]
        )
    return table(head, lines)


def predictions_table() -> str:
    """Return the table of every scene's cost, with the prediction over it."""
    lines = []
    for name, pairs in processes.measure_predictions():
        line = [name]
        for measured, predicted in pairs:
            line += [number(measured), f"{predicted / measured:.2f}x"]
        lines.append(line)
    return table(["scene", "dofs", "plan", "MB", "plan", "CPU s", "plan"], lines)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true")
    main(parser.parse_args().quick)
