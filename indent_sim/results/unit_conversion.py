"""Conversion of measured curves to the units of a simulation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from indent_sim.config.quantities import si_factor
from indent_sim.process.errors import UsageError
from indent_sim.results.reader import MEASURED, Results


def convert_to_common_units(runs: Sequence[Results]) -> list[Results]:
    """Convert measured curves to the units of the first simulated result that gives its units.

    A curve without units is assumed to have these units already.

    Raises
    ------
    ConfigError
        If a unit of a curve is unknown.
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
    """Raise UsageError if two runs have different units; a run without units is accepted.

    Parameters
    ----------
    runs
        Results whose `units` are compared, for lengths and forces.
    remedy
        Advice at the end of the message.
    """
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
    """Return a measured curve with its depths and forces in other units."""
    table = dict(run.table)
    for column, kind in (("delta", "length"), ("force", "force")):
        if own_unit := run.report["units"][kind]:
            table[column] = table[column] * (
                si_factor(own_unit, kind) / si_factor(units[kind], kind)
            )
    return replace(run, table=table, report=run.report | {"units": dict(units)})
