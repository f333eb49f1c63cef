"""Thickness of the body at each pixel of a map: given, or from the height of the surface."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from indent_sim.config.quantities import si_factor
from indent_sim.config.schema import Config
from indent_sim.fitting.curve_fit import FitRequest
from indent_sim.fitting.forward_model.parameters import number_at, replace_numbers
from indent_sim.fitting.map_scene import HEIGHT_KEY
from indent_sim.process.errors import ConfigError, UsageError
from indent_sim.results.map_images import read_image


@dataclass(frozen=True)
class Thickness:
    """Thickness of each pixel of a map.

    Attributes
    ----------
    mean
        Median thickness [length of the scene], if it follows the height of the surface at zero
        force: the body lies on a flat base.
    values
        Thickness of each pixel (rows, columns) [length of the scene], if it is given.

    Without both, the thickness is the height above a plane that is fitted to the pixels on the bare
    substrate.
    """

    mean: float | None = None
    values: np.ndarray | None = None


def heights_above_base(places: np.ndarray, heights: np.ndarray, is_base: np.ndarray) -> np.ndarray:
    """Return heights (N,) above the plane through the pixels on the bare substrate.

    Parameters
    ----------
    places
        Rows and columns of the pixels (N, 2).
    heights
        Heights of the surface (N,) [length]; NaN if unknown.
    is_base
        Whether a pixel is on the bare substrate (N,).

    Raises
    ------
    UsageError
        If these pixels do not determine a plane.
    """
    columns = np.column_stack([np.ones(len(places)), places])
    used = is_base & np.isfinite(heights)
    plane, _, rank, _ = np.linalg.lstsq(columns[used], heights[used], rcond=None)
    if rank < columns.shape[1]:
        raise UsageError(
            "the plane of the substrate cannot be fitted: the number of pixels on the bare "
            f"substrate is {used.sum()}",
            "give --thickness height:MEAN or a file",
        )
    above: np.ndarray = heights - columns @ plane
    return above


def parse_thickness(text: str, request: FitRequest, shape: tuple[int, int]) -> Thickness:
    """Return the thickness of the pixels given by `height`, `height:MEAN`, `base`, or a file.

    Parameters
    ----------
    text
        `height`: body.height is the median thickness, and the thickness follows the surface;
        `height:MEAN` with another median, such as `height:6 um`; `base`: height above the plane of
        the base, fitted to the bare substrate; or a .gsf, .tif or text file with a number for each
        pixel [length of the scene; .gsf: m].
    request
        The scene.
    shape
        Shape of the map.

    Raises
    ------
    UsageError
        If the file cannot be read, or has another shape.
    ConfigError
        If the body has no height, or the median is not a length.
    """
    config = request.config
    if match := re.fullmatch(r"height(?::(.+))?", text):
        if match[1]:
            config = replace_numbers(config, {HEIGHT_KEY: _number_or_text(match[1])})
        return Thickness(mean=number_at(config, HEIGHT_KEY))
    if text == "base":
        number_at(config, HEIGHT_KEY)
        return Thickness()
    path = Path(text)
    try:
        values = read_image(path)
    except (OSError, ValueError) as error:
        raise UsageError(
            f"--thickness {text}: cannot be read ({error})",
            "give height, height:MEAN as in height:6um, base, or a .gsf, .tif or .csv file",
        ) from None
    if values.shape != shape:
        raise UsageError(
            f"--thickness {text}: has {values.shape[0]} x {values.shape[1]} numbers, and the map "
            f"{shape[0]} x {shape[1]} pixels"
        )
    length = request.config.units.length
    if path.suffix.lower() == ".gsf" and length:
        values = values / si_factor(length, "length")
    _reject_other_unit(text, values, number_at(config, HEIGHT_KEY), length)
    return Thickness(values=values)


def _reject_other_unit(text: str, values: np.ndarray, height: float, length: str | None) -> None:
    """Raise UsageError if the thicknesses seem to be given in another unit of length."""
    # Largest ratio of the median thickness to the height of the scene, in either direction. The
    # next units of length are a thousand times larger or smaller.
    largest_ratio = 100.0
    finite = values[np.isfinite(values)]
    median = float(np.median(finite)) if len(finite) else 0.0
    if height / largest_ratio <= median <= height * largest_ratio:
        return
    unit = length or "the unit of length of the scene"
    raise UsageError(
        f"--thickness {text}: the median of its numbers is {median:.3g}, and body.height is "
        f"{height:.3g} {unit}",
        f"give the numbers in {unit}, or body.height near their median",
    )


def thickness_of_scene(config: Config) -> Thickness | None:
    """Return the thickness given by the section `map` of a scene; None if it has none.

    Raises
    ------
    ConfigError
        If the body has no height, or if both a median and a base are given.
    """
    settings = config.map
    if settings is None:
        return None
    height = number_at(config, HEIGHT_KEY)
    if settings.base and settings.mean is not None:
        raise ConfigError(
            "map", "has both mean and base", "give only one of the two: with base no mean is needed"
        )
    if settings.base:
        return Thickness()
    return Thickness(mean=height if settings.mean is None else settings.mean)


def _number_or_text(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text
