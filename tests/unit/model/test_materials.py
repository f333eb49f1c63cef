"""The constants of a material law: what they say of each other, and what is refused."""

from __future__ import annotations

from typing import Any

import pytest

from indent_sim.config.file import from_mapping
from indent_sim.model.materials import Gent, MooneyRivlin, Ogden, Yeoh
from indent_sim.process.errors import ConfigError
from indent_sim.scene.scene import resolve


@pytest.mark.parametrize(
    ("law", "mu"),
    [
        (MooneyRivlin(C10=0.3, C01=0.2, nu=0.4), 1.0),
        (Yeoh(C10=0.5, C20=3.0, nu=0.4), 1.0),
        (Ogden(mu=(0.6, -0.2), alpha=(1.5, -2.0), nu=0.4), 0.65),
        (Gent(mu=1.3, Jm=9.0, nu=0.4), 1.3),
    ],
)
def test_small_strain_modulus(law: Any, mu: float) -> None:
    assert law.constants == pytest.approx((2 * mu * 1.4, 0.4), rel=1e-14)


def test_kappa_says_what_nu_says() -> None:
    """kappa = 2 mu (1 + nu) / (3 (1 - 2 nu))."""
    law = Gent(mu=1.0, Jm=9.0, kappa=2 * 1.3 / 3 / 0.4).canonical()
    assert law.constants == pytest.approx(Gent(mu=1.0, Jm=9.0, nu=0.3).constants, rel=1e-14)


WRONG = {
    "neither": ({"model": "gent", "mu": 1.0, "Jm": 9.0}, "exactly one of nu, kappa"),
    "both": ({"model": "yeoh", "C10": 1.0, "nu": 0.3, "kappa": 1.0}, "exactly one of nu, kappa"),
    "no_constants": ({"model": "mooney_rivlin", "nu": 0.3}, "shear modulus is 0; it must be > 0"),
    "pulls": ({"model": "ogden", "mu": [1.0], "alpha": [-2.0], "nu": 0.3}, "shear modulus is -1; it must be > 0"),
    "pairs": ({"model": "ogden", "mu": [1.0], "alpha": [2.0, 1.0], "nu": 0.3}, "1 entries and alpha 2"),
    "zero": ({"model": "ogden", "mu": [1.0, 1.0], "alpha": [2.0, 0.0], "nu": 0.3}, "alpha of zero"),
    "empty": ({"model": "ogden", "nu": 0.3}, "mu"),
    "three": ({"model": "neo_hookean", "E": 1.0, "nu": 0.3, "mu": 1.0}, "exactly two of"),
    "no_Jm": ({"model": "gent", "mu": 1.0, "nu": 0.3}, "material.Jm: missing"),
    "no_mu": ({"model": "gent", "Jm": 9.0, "nu": 0.3}, "material.mu: missing"),
    "no_C10": ({"model": "yeoh", "C20": 1.0, "nu": 0.3}, "material.C10: missing"),
    "no_lambda_m": ({"model": "arruda_boyce", "mu": 1.0, "nu": 0.3}, "material.lambda_m: missing"),
    "lambda_m": ({"model": "arruda_boyce", "mu": 1.0, "lambda_m": 0.9, "nu": 0.3}, "must be > 1, got 0.9"),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_is_said(case: str) -> None:
    material, words = WRONG[case]
    with pytest.raises(ConfigError) as refused:
        resolve(from_mapping({
            "body": {"shape": "cylinder", "radius": 1.0, "height": 1.0}, "material": material,
            "indenter": {"shape": "sphere", "R": 1.0}, "loading": {"delta": 0.1},
        }))  # fmt: skip
    assert words in str(refused.value)


def test_a_bulk_modulus_lost_beside_the_shear_modulus_is_refused():
    """kappa/mu = 1e-17 is below rounding: nu would be -1 and E nothing."""
    with pytest.raises(ValueError, match="nu is -1"):
        Gent(mu=1e17, Jm=1.0, kappa=1.0).canonical()
