"""TODO."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from indent_sim.config.quantities import si_factor
from indent_sim.process.errors import UsageError
from indent_sim.results.reader import MEASURED, Results


def convert_to_common_units(runs: Sequence[Results]) -> list[Results]:
    """The results, measured curves in the units of the first that is none; ConfigError for units
    that are none.

    A curve that says no units has those of the others.
    """
    simulated_first = sorted(runs, key=lambda run: run.report.get(MEASURED, False))
    unit_mappings = (run.report.get("units") or {} for run in simulated_first)
    units = next(
        (mapping for mapping in unit_mappings if mapping.get("length") and mapping.get("force")), {}
    )
    return [
        _convert_units(run, units) if units and run.report.get(MEASURED) else run for run in runs
    ]


def refuse_different_units(runs: Sequence[Results], remedy: str) -> None:
    """UsageError when two runs measure in different units; one that does not say is taken as it is."""
    for kind in ("length", "force"):
        paths_by_unit = {
            unit: run.path for run in runs if (unit := (run.report.get("units") or {}).get(kind))
        }
        if len(paths_by_unit) > 1:
            (first_unit, first), (second_unit, second) = list(paths_by_unit.items())[:2]
            raise UsageError(
                f"{first} measures {kind} in {first_unit}, {second} in {second_unit}: {remedy}"
            )


def _convert_units(run: Results, units: Mapping[str, str]) -> Results:
    table = dict(run.table)
    for column, kind in (("delta", "length"), ("force", "force")):
        if own_unit := run.report["units"][kind]:
            table[column] = table[column] * (
                si_factor(own_unit, kind) / si_factor(units[kind], kind)
            )
    return replace(run, table=table, report=run.report | {"units": dict(units)})
