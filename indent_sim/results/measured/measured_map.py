"""Map of measured curves on a grid of places, each of which is read when it is requested."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import overload

import numpy as np

from indent_sim.results.measured.measurement import SI, MeasuredCurve


@dataclass(frozen=True, eq=False)
class MeasuredMap(Sequence[MeasuredCurve]):
    """Force curves of a grid of places, as a sequence in which no curve is kept in memory.

    Attributes
    ----------
    shape
        Number of rows and columns of the grid. The first row is scanned first.
    size
        Lengths [length] of the scanned area along a column and along a row; None if unknown.
        Neighbouring places are size[0] / shape[0] and size[1] / shape[1] apart.
    places
        Row and column of every curve (n, 2), from 0; a place may have no curve.
    read_curve
        Function that reads the curve with an index; it raises NoCurve if the curve is damaged.
    height
        Measured height of the surface (rows, columns) [length], or None.
    stiffness
        Spring constant of the cantilever [force/length], or None.
    units
        Names of the units of length, force and time.
    """

    shape: tuple[int, int]
    size: tuple[float, float] | None
    places: np.ndarray
    read_curve: Callable[[int], MeasuredCurve]
    height: np.ndarray | None = None
    stiffness: float | None = None
    units: Mapping[str, str] = field(default_factory=lambda: SI)

    def __len__(self) -> int:
        return len(self.places)

    @overload
    def __getitem__(self, index: int) -> MeasuredCurve: ...
    @overload
    def __getitem__(self, index: slice) -> list[MeasuredCurve]: ...
    def __getitem__(self, index: int | slice) -> MeasuredCurve | list[MeasuredCurve]:
        if isinstance(index, slice):
            return [self.read_curve(one) for one in range(len(self))[index]]
        return self.read_curve(range(len(self))[index])

    def curve(self, index: int) -> MeasuredCurve:
        """Return the curve with an index; raise NoCurve if it is damaged."""
        return self[index]

    def select_rows(self, first: int, end: int) -> MeasuredMap:
        """Return the map with the curves of the rows `first` to `end - 1` only."""
        rows = self.places[:, 0]
        indices = np.flatnonzero((first <= rows) & (rows < end))
        read_curve = partial(_read_selected, self.read_curve, indices)
        return replace(self, places=self.places[indices], read_curve=read_curve)

    def index_of(self, row: int, column: int) -> int | None:
        """Return the index of the curve at a place, from 0; None if the place has no curve."""
        indices = np.flatnonzero((self.places == (row, column)).all(axis=-1))
        return int(indices[0]) if len(indices) else None

    def place(self, index: int) -> tuple[int, int]:
        """Return row and column of a curve, from 0."""
        row, column = self.places[index].tolist()
        return row, column

    def image(self, values: np.ndarray) -> np.ndarray:
        """Return one number of each curve (n,) as an image (rows, columns), NaN without a curve."""
        pixels = np.full(self.shape, np.nan)
        pixels[self.places[:, 0], self.places[:, 1]] = values
        return pixels


def _read_selected(
    read_curve: Callable[[int], MeasuredCurve], indices: np.ndarray, index: int
) -> MeasuredCurve:
    """Return a curve by its index among the selected curves."""
    return read_curve(int(indices[index]))


def grid_places(numbers: np.ndarray, columns: int, back_and_forth: bool) -> np.ndarray:
    """Return row and column (n, 2) of the places of a path that goes row by row.

    Parameters
    ----------
    numbers
        Numbers (n,) of the places along the path, from 0.
    columns
        Number of places of a row.
    back_and_forth
        Whether every second row is traversed backwards.
    """
    rows, place = np.divmod(numbers, columns)
    turned = np.where(back_and_forth & (rows % 2 == 1), columns - 1 - place, place)
    return np.column_stack([rows, turned])
