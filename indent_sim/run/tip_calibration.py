"""Calibration of a tip: its area function from unloading curves of a sample of known modulus."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from indent_sim.process.errors import ConfigError, UsageError
from indent_sim.results.atomic_files import write_atomically
from indent_sim.run.hardness_analysis import HardnessOptions, analyse, reference_modulus
from indent_sim.theory.oliver_pharr import (
    AREA_EXPONENTS,
    area_function,
    area_of_stiffness,
    fit_area_function,
)

# Smallest number of curves: a fit to fewer has no scatter.
MIN_CURVES = 3
# Rows of the table. sqrt(A) is interpolated linearly between them; at 60 rows in geometric
# progression over a factor of 100 in depth the error is below 1e-4 of the area of a round tip.
TABLE_ROWS = 60


@dataclass(frozen=True)
class TipCalibration:
    """Area function of a tip, and the curves from which it follows.

    Attributes
    ----------
    curves
        Names of the curves (n,).
    h_c, A_p, fitted
        Contact depths, areas that follow from the stiffness, and areas of the fitted function,
        (n,).
    coefficients
        Factors C_k of A = sum C_k h_c^p_k with the exponents p_k of AREA_EXPONENTS; none is
        negative.
    unit
        Unit of length; "" without units.
    assumptions
        Assumptions on which the areas rest, by name.
    warnings
        Reasons to distrust the function.
    """

    curves: tuple[str, ...]
    h_c: np.ndarray
    A_p: np.ndarray
    fitted: np.ndarray
    coefficients: np.ndarray
    unit: str
    assumptions: dict[str, str]
    warnings: tuple[str, ...]

    @property
    def scatter(self) -> float:
        """Root mean square of the relative differences between curves and function."""
        return float(np.sqrt(np.mean((self.A_p / self.fitted - 1) ** 2)))

    def area(self, h_c: np.ndarray) -> np.ndarray:
        """Return the areas (m,) at contact depths (m,)."""
        return area_function(h_c, self.coefficients)

    @property
    def table(self) -> str:
        """Table of contact depths and areas over the depths of the curves, as for `--area`."""
        h_c = np.geomspace(self.h_c.min(), self.h_c.max(), TABLE_ROWS)
        # The end points keep all digits, so that the curves of the calibration lie inside.
        rows = (f"{h:.17g},{A:.8g}" for h, A in zip(h_c, self.area(h_c), strict=True))
        titles = f"h_c [{self.unit}],A_p [{self.unit}^2]" if self.unit else "h_c,A_p"
        return "\n".join([titles, *rows, ""])

    @property
    def formula(self) -> str:
        """The function as a sum of powers of h_c."""
        return " + ".join(
            f"{factor:.5g} h_c^{exponent:g}"
            for exponent, factor in zip(AREA_EXPONENTS, self.coefficients, strict=True)
            if factor > 0
        )

    def as_json(self) -> dict[str, Any]:
        """Return curves, coefficients, scatter, assumptions and warnings."""
        return {
            "curves": [
                {"curve": name, "h_c": h, "A_p": A, "fitted": f}
                for name, h, A, f in zip(
                    self.curves,
                    self.h_c.tolist(),
                    self.A_p.tolist(),
                    self.fitted.tolist(),
                    strict=True,
                )
            ],
            "coefficients": dict(
                zip(map(str, AREA_EXPONENTS), self.coefficients.tolist(), strict=True)
            ),
            "scatter": self.scatter,
            "units": {"length": self.unit},
            "assumptions": self.assumptions,
            "warnings": self.warnings,
        }


def calibrate_tip(paths: Sequence[Path], sample: str, options: HardnessOptions) -> TipCalibration:
    """Find the area function of a tip from unloading curves of a sample of known modulus.

    Each curve gives the area pi (S/(2 beta E_r))^2 at its contact depth; the function is fitted to
    the relative differences with coefficients that are not negative, so that it increases.

    Parameters
    ----------
    paths
        Files of at least MIN_CURVES curves, of different depths.
    sample
        Young's modulus and Poisson's ratio of the sample, "E,NU".
    options
        Settings of the analysis; area and nu are not used.

    Raises
    ------
    UsageError
        If a curve cannot be analysed, or there are too few.
    ConfigError
        If an option is not valid.
    """
    if len(paths) < MIN_CURVES:
        raise UsageError(
            f"{len(paths)} curves do not determine an area function; at least {MIN_CURVES} of "
            "different depths are needed"
        )
    # Stiffness and contact depth depend neither on the area function nor on the moduli.
    stiffness_only = replace(options, area="berkovich", nu=0.3, tip="rigid")
    analysed = [analyse(path, stiffness_only) for path in paths]
    units = {(result.units["h_c"], result.units["F_max"]) for result in analysed}
    if len(units) > 1:
        raise UsageError(
            "the curves have different units: "
            + ", ".join("/".join(pair) for pair in sorted(units)),
            "convert them to the same units of depth and force",
        )
    length, force = next(iter(units))
    E_r, sample_words, tip_words = reference_modulus(
        sample, options.tip or "diamond", {"length": length, "force": force}
    )
    h_c = np.array([result.values["h_c"] for result in analysed], dtype=float)
    S = np.array([result.values["S"] for result in analysed], dtype=float)
    if not (h_c > 0).all():
        name = analysed[int(np.argmin(h_c))].curve
        raise UsageError(
            f"the contact depth of {name} is {h_c.min():.3g}",
            "check the zero point of the depth and the frame compliance",
        )
    A_p = np.array([area_of_stiffness(stiffness, E_r, options.beta) for stiffness in S])
    coefficients = fit_area_function(h_c, A_p)
    fitted = area_function(h_c, coefficients)
    notes = [f"{result.curve}: {note}" for result in analysed for note in result.warnings]
    kept = [note for note in notes if "apex radius" not in note and "piles up" not in note]
    calibration = TipCalibration(
        tuple(result.curve for result in analysed),
        h_c,
        A_p,
        fitted,
        coefficients,
        length,
        {"sample": sample_words, "tip": tip_words}
        | {
            name: words
            for name, words in analysed[0].assumptions.items()
            if name in ("epsilon", "beta", "frame compliance", "drift")
        },
        tuple(kept),
    )
    return replace(calibration, warnings=(*kept, *_warnings(calibration)))


def _warnings(calibration: TipCalibration) -> list[str]:
    """Return warnings about depths that are too few, and areas that scatter."""
    warnings = []
    # A narrower range of depths does not show the rounding of the apex.
    narrow_range = 2.0
    if calibration.h_c.max() < narrow_range * calibration.h_c.min():
        warnings.append(
            f"the contact depths span {calibration.h_c.min():.4g} to {calibration.h_c.max():.4g} "
            "only: the function holds between them, and other depths are refused"
        )
    # A larger scatter is above the accuracy of the method.
    large_scatter = 0.03
    if calibration.scatter > large_scatter:
        warnings.append(
            f"the areas scatter by {calibration.scatter:.1%} around the function: check the "
            "sample, the frame compliance and the zero points"
        )
    return warnings


def write_table(calibration: TipCalibration, output: Path) -> None:
    """Write the table of the area function into a new file; raise UsageError if it exists."""
    if os.path.lexists(output):
        raise ConfigError(
            "--output", f"{output} exists already and is not replaced", "choose another name"
        )
    write_atomically(output, calibration.table)
