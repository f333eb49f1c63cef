"""Reader of PeakForce captures (Bruker .pfc) by the optional package pyfmreader."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from indent_sim.process.errors import BackendError
from indent_sim.process.installation import afm_command
from indent_sim.results.measured.measurement import (
    SI,
    STIFFNESS_KEY,
    MeasuredCurve,
    NoCurve,
    Uncalibrated,
)


def read_peakforce_file(path: Path, stiffness: float | None = None) -> list[MeasuredCurve]:
    """Read all curves of a PeakForce capture, in SI units.

    Parameters
    ----------
    path
        The file.
    stiffness
        Spring constant of the cantilever [N/m], for a file that contains none.

    Raises
    ------
    NoCurve
        If the file cannot be read or its deflections are impossible; the message gives the reason.
    BackendError
        The package is missing.
    """
    try:
        from pyfmreader.nanosc.loadnanosccurve import loadNANOSCcurve
        from pyfmreader.nanosc.parsenanoscheader import parseNANOSCheader
    except ImportError as error:
        raise BackendError(
            f"{path} is a PeakForce capture, and pyfmreader is missing ({error}); this line "
            f"installs it: {afm_command()}"
        ) from error
    try:
        with np.errstate(all="ignore"):
            header = parseNANOSCheader(str(path))
            data_sets = [
                loadNANOSCcurve(k, header) for k in range(int(header["Entry_tot_nb_curve"]))
            ]
    except Exception as error:
        error_text = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise NoCurve(f"pyfmreader cannot read it ({error_text})", str(path)) from None
    k = header.get("spring_const_Nbym") or stiffness
    if "defl_sens_nmbyV" not in header or not k:
        missing = "spring constant" if "defl_sens_nmbyV" in header else "sensitivity"
        raise Uncalibrated(f"lacks {missing}: {STIFFNESS_KEY}", str(path))
    return [
        _measured_curve(path, data, index, header, float(k)) for index, data in enumerate(data_sets)
    ]


def _measured_curve(
    path: Path, data: Any, index: int, header: Mapping[str, Any], k: float
) -> MeasuredCurve:
    """Return one curve, approach first, with z increasing towards the body."""
    segments = [segment.segment_formated_data for _, segment in data.get_segments()]
    base_paths = [np.asarray(segment_data["height"], dtype=float) for segment_data in segments]
    volts = [np.asarray(segment_data["vDeflection"], dtype=float) for segment_data in segments]
    # Some files store the retraction in reverse order, from its far end on.
    if np.ptp(base_paths[-1]) and base_paths[-1][0] < base_paths[-1][-1]:
        base_paths[-1] = base_paths[-1][::-1]
        volts[-1] = volts[-1][::-1]
    z = np.concatenate(base_paths)
    deflection = 1e-9 * float(header["defl_sens_nmbyV"]) * np.concatenate(volts)
    # A deflection can exceed the travel of the base only by a snap-in. If the ratio of their ranges
    # exceeds this, the deflections are wrong.
    max_deflection_ratio = 1.5
    if (
        not np.isfinite(z).all()
        or not np.isfinite(deflection).all()
        or np.ptp(deflection) > max_deflection_ratio * np.ptp(z)
    ):
        raise NoCurve(
            "the deflections that pyfmreader computes exceed the travel of the base", str(path)
        )
    times = [np.asarray(segment_data["time"], dtype=float) for segment_data in segments]
    t = np.concatenate([times[0], times[0][-1] + times[0][1] + times[-1]])
    turn = len(base_paths[0])
    parts = {"approach": slice(0, turn), "retract": slice(turn, len(z))}
    name = f"{path.stem}-{index}" if int(header["Entry_tot_nb_curve"]) > 1 else path.stem
    return MeasuredCurve(name, k * deflection, z=z, t=t, stiffness=k, parts=parts, units=SI)
