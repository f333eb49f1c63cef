"""Progress of the fit of a map: results of finished blocks, with which a killed fit continues."""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from indent_sim.fitting import fit_table
from indent_sim.fitting.curve_fit import CurveFit
from indent_sim.fitting.fit_folder import MAP_PROGRESS
from indent_sim.fitting.inference.pooled_noise import PooledNoise
from indent_sim.fitting.map_fit import BLOCK_SIZE, MapFitter
from indent_sim.process.limits import write_error
from indent_sim.process.version import VERSION
from indent_sim.results.atomic_files import temporary_path, write_atomically
from indent_sim.results.json_text import to_json
from indent_sim.results.map_arrays import hdf5_bytes, read_hdf5_file
from indent_sim.results.result_files import CURVES_FOLDER, FIT, PROGRAM

NOT_FITTED = 0
INITIALLY_FITTED = 1
# Fits by ordinary least squares with the thickness that follows from the first pass.
REFITTED = 2
FITTED_WITH_NOISE = 3


@dataclass(frozen=True)
class ThicknessFit:
    """Thickness of each curve (N,) [length], and the largest depth for which it is used."""

    values: np.ndarray
    max_depth: float


class MapProgress:
    """Results of the finished blocks of a map, in a file that is replaced after each block.

    Parameters
    ----------
    folder
        Folder of the fit; None if nothing is kept.
    header
        Entries of fit.json by which a later call recognises that it fits the same curves.
    """

    def __init__(self, folder: Path | None = None, header: Mapping[str, Any] | None = None):
        self.folder = folder
        self.noise: PooledNoise | None = None
        self.sample: dict[int, CurveFit] = {}
        # Thickness fits by the stage in which they are used.
        self.thickness: dict[int, ThicknessFit] = {}
        self._header = dict(header or {})
        self._stages = np.zeros(0, dtype=np.int8)

    def restore(self, fitter: MapFitter) -> int:
        """Set the results of an earlier call; return the number of curves that are already fitted.

        A file that cannot be read, or that belongs to other curves, is replaced.
        """
        count = len(fitter.blocks)
        self._stages = np.zeros(count, dtype=np.int8)
        if self.folder is None:
            return 0
        with suppress(OSError, KeyError, ValueError, TypeError):
            arrays, attributes = read_hdf5_file(self.folder / MAP_PROGRESS)
            stages = arrays.pop("stages")
            sample = json.loads(arrays.pop("sample").tobytes())
            noise = json.loads(attributes["noise"])
            if attributes["identity"] != self._identity or len(stages) != count:
                return 0
            self.thickness = {
                stage: ThicknessFit(arrays.pop(name), float(arrays.pop(f"max_depth.{stage}")))
                for stage in (REFITTED, FITTED_WITH_NOISE)
                if (name := f"thickness.{stage}") in arrays
            }
            fitter.restore(np.arange(fitter.count), arrays)
            self._stages = stages
            self.noise = PooledNoise.from_record(noise) if noise else None
            self.sample = {int(k): self._read_curve_fit(entry) for k, entry in sample.items()}
        return int(np.count_nonzero(self.is_finished(fitter)))

    def is_finished(self, fitter: MapFitter) -> np.ndarray:
        """Return for each curve (N,) whether it is fitted with the noise of the map."""
        sizes = [len(block) for block in fitter.blocks]
        return np.repeat(self._stages >= FITTED_WITH_NOISE, sizes)

    def unfinished(self, fitter: MapFitter, stage: int) -> list[np.ndarray]:
        """Return the blocks that have not reached a stage."""
        pairs = zip(fitter.blocks, self._stages, strict=True)
        return [block for block, reached in pairs if reached < stage]

    def finish_block(self, fitter: MapFitter, block: np.ndarray, stage: int) -> None:
        """Keep the results of a block that has reached a stage."""
        self._stages[block[0] // BLOCK_SIZE] = stage
        self.save(fitter)

    def finish_curve(self, fitter: MapFitter, index: int, fit: CurveFit) -> None:
        """Keep the fit of a curve of the sample, and write its table."""
        self.sample[index] = fit
        if self.folder is not None and fit.plotted is not None:
            table = self.folder / CURVES_FOLDER / f"{fit.name}.csv"
            write_atomically(table, fit_table.table_of_curve(fit.plotted), sync=False)
        self.save(fitter)

    def _read_curve_fit(self, entry: dict[str, Any]) -> CurveFit:
        """Return the fit of a curve of the sample, without data if its table is not readable."""
        assert self.folder is not None
        with suppress(OSError, ValueError):
            table = self.folder / CURVES_FOLDER / f"{entry['curve']}.csv"
            return CurveFit(entry, fit_table.read_curve_table(table.read_text()))
        return CurveFit(entry)

    def save(self, fitter: MapFitter) -> None:
        """Write the results of all finished blocks.

        Raises
        ------
        UsageError
            If the folder cannot be written.
        """
        if self.folder is None:
            return
        entries = to_json({str(index): fit.entry for index, fit in self.sample.items()})
        arrays = fitter.state(np.arange(fitter.count)) | {
            "stages": self._stages,
            "sample": np.frombuffer(entries.encode(), dtype=np.uint8),
        }
        for stage, thickness in self.thickness.items():
            arrays[f"thickness.{stage}"] = thickness.values
            arrays[f"max_depth.{stage}"] = np.array(thickness.max_depth)
        noise = self.noise.as_record() if self.noise else None
        attributes = {"identity": self._identity, "noise": json.dumps(noise)}
        data = hdf5_bytes(arrays, attributes, is_compressed=False)
        try:
            if not (self.folder / MAP_PROGRESS).exists():
                self.write_status("running")
            write_atomically(self.folder / MAP_PROGRESS, data, sync=False)
        except OSError as error:
            raise write_error(self.folder, error) from error

    def write_status(self, status: str) -> None:
        """Write fit.json without results."""
        assert self.folder is not None
        header = {"program": PROGRAM, "version": VERSION, "status": status, "exit_code": None}
        write_atomically(self.folder / FIT, to_json(header | self._header) + "\n")

    def interrupt(self) -> None:
        """State in fit.json that the fit was interrupted, if a block is finished."""
        if self.folder is not None and self._stages.any():
            self.write_status("interrupted")

    def discard(self) -> None:
        """Delete all files of an unfinished fit."""
        self.remove()
        if self.folder is not None:
            (self.folder / FIT).unlink(missing_ok=True)

    def remove(self) -> None:
        """Delete the file of the progress."""
        if self.folder is not None:
            path = self.folder / MAP_PROGRESS
            for file in (path, temporary_path(path)):
                file.unlink(missing_ok=True)

    @property
    def _identity(self) -> str:
        return to_json({"version": VERSION} | self._header, indent=None)
