"""Writer of .tab files: tab-separated text in SI units with metadata, for AFM programs."""

from __future__ import annotations

import json

import numpy as np

from indent_sim.config.quantities import si_factor
from indent_sim.process.errors import UsageError
from indent_sim.process.version import VERSION
from indent_sim.results.reader import Results


def tab_text(results: Results) -> str:
    """Return the text of a .tab file of a result, with three parts in the order of time.

    The parts are the approach before contact, the approach in contact, and the retraction.

    With the spring constant k of the metadata, height (measured) [m] is the height of the base,
    -(delta + force/k), and tip position [m] is -delta.

    Raises
    ------
    UsageError
        If the result has no units, which other programs need, or no row in contact.
    """
    units = results.report.get("units") or {}
    if not (units.get("length") and units.get("force")):
        raise UsageError(
            f"{results.path} has no units", "add units: {length: um, force: nN} to its scene"
        )
    if not results["delta"].max(initial=0.0) > 0:
        raise UsageError(f"{results.path} has no row in contact", file=str(results.path))
    delta, force = (
        results[name] * si_factor(units[kind], kind)
        for name, kind in (("delta", "length"), ("force", "force"))
    )
    turn = int(np.argmax(delta)) + 1
    step = delta.max() / max(turn, 2)
    # Length of the approach before contact, relative to the largest depth.
    free_approach = 0.5
    free_depths = np.arange(
        -free_approach * delta.max(), min(0.5 * step, delta[0] - 0.5 * step), step
    )
    retract_depths = np.array([delta[turn - 1]]) if turn == len(delta) else delta[turn:]
    retract_forces = np.array([force[turn - 1]]) if turn == len(delta) else force[turn:]
    delta = np.concatenate([free_depths, delta[:turn], retract_depths])
    force = np.concatenate([0.0 * free_depths, force[:turn], retract_forces])
    # Ratio of the written spring constant to the stiffest secant of the curve. With this ratio the
    # cantilever hardly bends.
    stiff_spring_ratio = 1e3
    k = stiff_spring_ratio * float(np.max(np.abs(force) / np.maximum(np.abs(delta), 1e-3 * step)))
    depths_per_second = 1.0
    time = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(delta)))]) / (
        depths_per_second * delta.max()
    )
    retracts = np.arange(len(delta)) >= len(free_depths) + turn
    table = zip(force, -(delta + force / k), -delta, time, retracts, strict=True)
    lines = [
        "\t".join([*(f"{value:.12e}" for value in row[:4]), str(bool(row[4]))]) for row in table
    ]
    return "\n".join([*_tab_header(k, len(delta)), *lines, ""])


def _tab_header(stiffness: float, points: int) -> list[str]:
    """Return the lines of metadata and column titles."""
    entries = {
        "imaging mode": "force-distance",
        "spring constant": stiffness,
        "point count": points,
        "enum": 0,
    }
    json_lines = json.dumps(entries | {"software": f"indent-sim {VERSION}"}, indent=2).splitlines()
    metadata = [f"# {line}" for line in json_lines]
    columns = ("force", "height (measured)", "tip position", "time", "segment")
    return ["# BEGIN METADATA", *metadata, "# END METADATA", "#", "# " + "\t".join(columns)]
