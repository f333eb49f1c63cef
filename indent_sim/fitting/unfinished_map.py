"""Map whose fit has not ended: the curves that are fitted with the noise of the map so far."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from indent_sim.fitting.forward_model.forward_model_cache import ForwardModelCache
from indent_sim.fitting.map_estimate import map_fit_of_curves
from indent_sim.fitting.map_fit import MapFitter, MapModel
from indent_sim.fitting.map_folder import has_ended, read_map
from indent_sim.fitting.map_progress import FITTED_WITH_NOISE, MapProgress
from indent_sim.fitting.map_result import MapFit
from indent_sim.fitting.map_scene import plan_map
from indent_sim.fitting.map_source import request_of_record, source_of_record
from indent_sim.process.errors import UsageError
from indent_sim.results.result_files import FIT, read_report


def read_fitted_curves(folder: Path) -> MapFit:
    """Return the map of a folder; if its fit has not ended, with the curves that are fitted.

    The other curves are missing, and `left` in the entry is their number.

    Raises
    ------
    UsageError
        If the folder has no readable map, if no curve of it is fitted, or if its files are missing
        or have changed.
    """
    report = read_report(folder, FIT)
    if has_ended(report):
        return read_map(folder)
    request = request_of_record(report["request"])
    curves = source_of_record(report["source"]).open(request)
    scene = plan_map(curves, request, ForwardModelCache())
    model = MapModel(scene.forward_model, scene.request.origin)
    fitter = MapFitter(scene.samples, len(curves), model)
    header = {name: report[name] for name in ("request", "source")}
    progress = MapProgress(folder, header)
    finished_count = progress.restore(fitter)
    if not finished_count or progress.noise is None:
        raise UsageError(
            f"{folder}: the fit of this map has not ended, and no curve has an interval yet",
            "call `indent-sim fit` again with the same options, which continues it",
        )
    # The first pass is not shown: its fits have no intervals.
    fitter.fits.reason[~progress.is_finished(fitter)] = -1
    thickness = progress.thickness.get(FITTED_WITH_NOISE)
    map_fit = map_fit_of_curves(
        scene, fitter.fits, progress.noise, None if thickness is None else thickness.values
    )
    left = len(curves) - finished_count
    return replace(map_fit, entry={"request": report["request"], "left": left})
