"""Synthetic measurements: noise of known covariance on curves of known scenes."""

from __future__ import annotations

import numpy as np
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.config.schema import Config
from indent_sim.fitting.forward_model.forward_model import ForwardModel
from indent_sim.fitting.inference.noise import Noise

N, LONGEST = 300, 8  # samples, and records of 1/f noise that the longest wave has
LAYER = {"shape": "layer", "height": 1.0}
HALF_SPACE = {"shape": "half_space"}
NOISES = {
    "white": Noise(),
    "AR 3": Noise(3.0, 0.0003),
    "AR 10": Noise(10.0, 0.0003),
    "mixed 10": Noise(10.0, 0.5),
}


def scene(body=None, nu: float = 0.45, tip=None, depth: float = 0.1, **more) -> Config:  # type: ignore[no-untyped-def]
    """A scene that theory solves: E = 1 under a paraboloid of R = 1."""
    material = {"model": "linear_elastic", "E": 1.0, "nu": nu}
    parts = {
        "body": body or LAYER,
        "material": material,
        "indenter": tip or {"shape": "paraboloid", "R": 1.0},
    }
    return config_from_mapping({**parts, "loading": {"delta": depth}, **more})


def relaxing(terms, body=None, **more) -> Config:  # type: ignore[no-untyped-def]
    """The same scene with a relaxing material, pressed in by a ramp."""
    material = {"model": "linear_elastic", "E": 1.0, "nu": 0.45, "relaxation": {"prony": terms}}
    return scene(body, material=material, loading={"history": [[0, 0], [1, 0.1]]}, **more)


def drawn(noise: Noise, n: int, draw: np.random.Generator) -> np.ndarray:
    """Noise of variance 1, shape (n,)."""
    rho, before = noise.rho, int(20 * max(noise.tau, 1))
    slow = lfilter([np.sqrt(1 - rho**2)], [1, -rho], draw.standard_normal(n + before))[before:]
    return np.sqrt(noise.w) * draw.standard_normal(n) + np.sqrt(1 - noise.w) * slow


def covariance(noise: Noise | None, n: int) -> np.ndarray:
    """Covariance (n, n) of noise of variance 1; None stands for a spectrum 1/f.

    No process with a single correlation time has such a spectrum.
    """
    if noise is None:
        size = LONGEST * n
        spectrum = np.append(0.0, 1.0 / np.arange(1, size // 2 + 1))
        row = np.fft.irfft(spectrum)[:n]
        return toeplitz(row / row[0])
    return noise.apply_covariance(np.eye(n))


def measured(
    truth: ForwardModel, theta, x: np.ndarray, noise: np.ndarray, c: float = 0.013, t=None
):  # type: ignore[no-untyped-def]
    """Forces on a tilted baseline, with noise of one per cent of the largest force."""
    force = truth(np.asarray(theta, dtype=float), x - c, t)
    return force + force.max() * (0.01 * noise + 0.3 + 0.05 * x / x.max())
