"""Error of a fit at the runs of a study that are held out of it, and where it is largest."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.special import bdtr

CONFIDENCE = 0.95


def held_out_mask(count: int) -> np.ndarray:
    """Return a mask of the runs that are held out of a fit, a random fifth of all runs."""
    seed = 20261127
    # Share of the runs that is held out of a fit to measure its error.
    held_out_share = 0.2
    return np.random.default_rng(seed).random(count) < held_out_share


def held_out_error(keys: Mapping[str, np.ndarray], errors: np.ndarray) -> dict[str, Any]:
    """Return quantiles of the errors at held-out runs, a bound of one of them, and the worst run.

    Parameters
    ----------
    keys
        Values of the varied keys at the held-out runs; (rows,).
    errors
        The errors; (rows,).
    """
    order = np.argsort(errors)
    quantile, place = _bounded_quantile(len(errors))
    return {
        "quantile": quantile,
        "error": float(errors[order[place]]),
        "confidence": CONFIDENCE,
        "held_out": len(errors),
        "median": float(np.median(errors)),
        "largest": float(errors[order[-1]]),
        "largest_at": {key: float(values[order[-1]]) for key, values in keys.items()},
    }


def place_text(point: Mapping[str, float]) -> str:
    """Return a point as text."""
    return ", ".join(f"{key}={value:.4g}" for key, value in point.items())


def _bounded_quantile(count: int) -> tuple[float, int]:
    """Return a quantile, and the index of the sorted error that bounds it with CONFIDENCE.

    The k-th smallest of n errors exceeds the quantile q with the probability that fewer than k of
    the n errors are below the quantile.
    """
    for quantile in (0.99, 0.95, 0.9):
        places = np.arange(count)
        bounds = bdtr(places, count, quantile) >= CONFIDENCE
        if bounds.any():
            return quantile, int(np.argmax(bounds))
    return round(float((1 - CONFIDENCE) ** (1 / count)), 3), count - 1
