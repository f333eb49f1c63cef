"""Measures speed against accuracy and writes docs/accuracy.md with its pictures.

usage: scripts/bench [--quick]      needs .venv (make setup); about a quarter of an hour, alone on the machine

    --quick   every process once instead of three times, and runs of the studies that are there already are kept

The studies are those of configs/studies/accuracy, their results go to results/studies/accuracy. page.md is the text of
the page and has no number in it: what this program does is measured here, what others do stands in peers.csv.
"""

from __future__ import annotations

import logging
import os
import platform
import sys
from pathlib import Path
from string import Template

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "scripts"), str(ROOT / "tests")]
for threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[threads] = "1"

import processes  # noqa: E402
import side_by_side  # noqa: E402
import sources  # noqa: E402
import sweeps  # noqa: E402
from generated_page import write  # noqa: E402
from markdown import number, table  # noqa: E402

from indent_sim import __version__  # noqa: E402
from indent_sim.results.result_files import read_report  # noqa: E402
from indent_sim.studies import Study  # noqa: E402

PAGE = ROOT / "docs" / "accuracy.md"
REFINED = {  # studies that refine a mesh: the error that is known, and what else varies
    "hertz_axi": ("force_error_worst", "contact.method"),
    "hertz_cube": ("force_error_vs", "contact.method"),
    "layer": ("force_error_worst", "contact.method"),
    "neo_hookean_30": ("force_error_vs", "contact.method"),
    "neo_hookean_49": ("force_error_vs", "contact.method"),
}
COMPILED = ("configs/hertz.yaml", "configs/hertz_cube.yaml", "configs/gel.yaml")
RANKED = (
    ("configs/hertz.yaml",),
    ("configs/hertz_cube.yaml", "mesh.h_contact=0.0125"),
    (
        "configs/notes/hyperelastic_augmented_lagrangian.yaml",
        "loading.delta=0.1",
        "loading.steps=5",
    ),
)
DEEP = {  # a sphere to 0.3 and to 0.7 of its radius
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
    logging.basicConfig(level=logging.WARNING)  # FFCx tells of every compilation otherwise
    repeat = 1 if quick else 3
    names = sorted(path.stem for path in sweeps.STUDIES.glob("*.yaml"))
    studies = {name: sweeps.carry_out(name, resume=quick) for name in names}
    slots = of_studies(studies) | of_processes(repeat)
    text = Template(Path(__file__).with_name("page.md").read_text(encoding="utf-8")).substitute(
        {name: value.rstrip() for name, value in slots.items()}
    )
    write(PAGE, text)


def of_studies(studies: dict[str, Study]) -> dict[str, str]:
    """What the studies have to say."""
    first = studies["hertz_axi"]
    report = read_report(first.directory / "runs" / first.rows[0]["run"])
    by_source = {name: studies[f"source_{name}"].rows for name in ("mesh", "truncation", "model")}
    return {
        "version": __version__,
        "versions": ", ".join(f"{name} {version}" for name, version in report["versions"].items()),
        "asked_axi": sweeps.asked(studies["asked_axi"]),
        "asked_cube": sweeps.asked(studies["asked_cube"]),
        "sources": sources.sources(by_source),
        "reductions": sweeps.reductions(studies["reductions"].rows),
        "growth": sweeps.growth(studies["growth"].rows),
        **{
            name: sweeps.section(studies[name], down, error)
            for name, (error, *down) in REFINED.items()
        },
    }


def of_processes(repeat: int) -> dict[str, str]:
    """What whole processes have to say."""
    rows = [*side_by_side.ours(repeat), *side_by_side.peers()]
    side_by_side.draw(rows)
    nodes, tip = processes.tips()
    return {
        "machine": platform.machine(),
        "cores": str(os.cpu_count()),
        "programs": side_by_side.tables(rows),
        "stages": side_by_side.stages(rows),
        "steps": steps(repeat),
        "throughput": throughput(repeat),
        "nodes": str(nodes),
        "tip": number(1e3 * tip, 2),
        "kernels": kernels(repeat),
        "deep": deep(repeat),
        "ranks": ranks(repeat),
        "predictions": predictions(),
        "error_bars": of_error_bars(),
    }


def of_error_bars() -> str:
    """The tables that `scripts/make_error_bar_table` has written into the page, which stay."""
    _, _, rest = PAGE.read_text(encoding="utf-8").partition("<!-- error bars -->")
    return rest.partition("<!-- end of error bars -->")[0].strip()


def steps(repeat: int) -> str:
    """Growth with load steps."""
    (base, least), *_ = found = processes.steps(repeat)
    extra = [number(1e3 * (cpu - least) / (n - base), 2) if n > base else "" for n, cpu in found]
    lines = [[str(n), number(cpu), ms] for (n, cpu), ms in zip(found, extra, strict=True)]
    return table(["steps", "CPU s of the process", f"ms a step beyond {base}"], lines)


def throughput(repeat: int) -> str:
    """Scenes per minute of a study."""
    lines = [
        [str(jobs), number(wall), number(cpu), number(processes.RUNS * 60 / wall)]
        for jobs, wall, cpu in processes.throughput(repeat)
    ]
    return table(["runs at a time", "wall s of the study", "CPU s", "scenes a minute"], lines)


def kernels(repeat: int) -> str:
    """What an empty cache costs."""
    found = processes.kernels(COMPILED, repeat)
    lines = [
        [scene, number(cold), number(warm), number(cold - warm, 2)] for scene, cold, warm in found
    ]
    return table(["scene", "empty", "full", "difference"], lines)


def deep(repeat: int) -> str:
    """What finite strain costs, in two and in three dimensions."""
    lines = []
    for scene, words in DEEP.items():
        done = processes.measure(*words, repeat=repeat)
        counts = [
            str(done.report["dofs"]),
            str(len(done.force)),
            str(done.report["audit"]["newton_iterations"]),
        ]
        lines.append([scene, *counts, number(done.cpu), number(done.memory)])
    return table(["scene", "dofs", "steps", "linear solves", "CPU s of the process", "MB"], lines)


def ranks(repeat: int) -> str:
    """What more ranks buy."""
    lines: list[list[str]] = []
    alone: dict[tuple[str, ...], tuple[float, float]] = {}
    for scene, count, done in processes.on_ranks(RANKED, repeat):
        work = sum(done.report["timings"][stage] for stage in ("assemble", "solve"))
        whole, part = alone.setdefault(scene, (done.wall, work))
        seconds = [number(value) for value in (done.wall, work, done.cpu)]
        gains = [number(whole / done.wall, 2), number(part / work, 2)]
        lines.append([" ".join(scene), str(done.report["dofs"]), str(count), *seconds, *gains])
    names = [
        "scene",
        "dofs",
        "ranks",
        "wall s",
        "wall s, assemble and solve",
        "CPU s, all ranks",
        "gain",
    ]
    return table([*names, "gain, assemble and solve"], lines)


def predictions() -> str:
    """What `plan` says every scene costs, over what it does cost."""
    lines = []
    for scene, pairs in processes.predictions():
        cells = (
            cell
            for value, said in pairs.values()
            for cell in (number(value), f"{said / value:.2f}x")
        )
        lines.append([scene, *cells])
    return table(["scene", "dofs", "plan", "MB", "plan", "CPU s", "plan"], lines)


if __name__ == "__main__":
    main("--quick" in sys.argv[1:])
