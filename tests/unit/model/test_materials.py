"""Constants of material laws: their relations, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.model.hyperelasticity import Fung, Gent, MooneyRivlin, Ogden, Yeoh
from indent_sim.model.linear_elasticity import TransverselyIsotropic
from indent_sim.process.errors import ConfigError
from indent_sim.scene.scene import resolve


@pytest.mark.parametrize(
    ("law", "mu"),
    [
        (MooneyRivlin(C10=0.3, C01=0.2, nu=0.4), 1.0),
        (Yeoh(C10=0.5, C20=3.0, nu=0.4), 1.0),
        (Ogden(mu=(0.6, -0.2), alpha=(1.5, -2.0), nu=0.4), 0.65),
        (Gent(mu=1.3, Jm=9.0, nu=0.4), 1.3),
        (Fung(mu=1.3, b=2.0, nu=0.4), 1.3),
    ],
)
def test_small_strain_modulus(law: Any, mu: float) -> None:
    assert law.constants == pytest.approx((2 * mu * 1.4, 0.4), rel=1e-14)


def test_kappa_says_what_nu_says() -> None:
    """A law given by kappa has the constants of the same law given by nu.

    kappa = 2 mu (1 + nu) / (3 (1 - 2 nu)).
    """
    law = Gent(mu=1.0, Jm=9.0, kappa=2 * 1.3 / 3 / 0.4).canonical()
    assert law.constants == pytest.approx(Gent(mu=1.0, Jm=9.0, nu=0.3).constants, rel=1e-14)


def surface_compliance(C11: float, C13: float, C33: float, C44: float) -> float:
    """w k/p of an anisotropic half-space from its decaying waves at wavenumber k = 1.

    The waves solve v' = A v for u_r, u_z, sigma_rz and sigma_zz.
    """
    A = np.array(
        [
            [0, 1, 1 / C44, 0],
            [-C13 / C33, 0, 0, 1 / C33],
            [C11 - C13**2 / C33, 0, 0, C13 / C33],
            [0, 0, -1, 0],
        ]
    )
    values, vectors = np.linalg.eig(A)
    decaying = vectors[:, values.real < 0]
    amplitudes = np.linalg.solve(decaying[2:], [0, -1])
    return float((decaying[1] @ amplitudes).real)


@pytest.mark.parametrize(
    ("E", "E_z", "nu", "nu_z", "G_z"),
    [
        (1, 2, 0.3, 0.4, 0.3),
        (3, 1, 0.1, 0.2, 2.0),
        (1, 1, -0.2, 0.3, 0.1),
        (0.2, 5, 0.3, 0.45, 1.0),
    ],
)
def test_indentation_modulus_is_that_of_the_decaying_waves(
    E: float, E_z: float, nu: float, nu_z: float, G_z: float
) -> None:
    # stiffnesses from the inverse of the compliance matrix of the directions 1, 2, 3 = z
    S = np.array(
        [
            [1 / E, -nu / E, -nu_z / E_z],
            [-nu / E, 1 / E, -nu_z / E_z],
            [-nu_z / E_z, -nu_z / E_z, 1 / E_z],
        ]
    )
    C = np.linalg.inv(S)
    M = 2 / surface_compliance(C[0, 0], C[0, 2], C[2, 2], G_z)  # w = 2 p/(E* k)
    assert TransverselyIsotropic(E=E, E_z=E_z, nu=nu, nu_z=nu_z, G_z=G_z).E_star == pytest.approx(
        M, rel=1e-12
    )


@pytest.mark.parametrize("nu", [-0.5, 0.0, 0.3, 0.4999, 0.5])
def test_an_isotropic_material_stands_for_itself(nu: float) -> None:
    law = TransverselyIsotropic(E=2.0, E_z=2.0, nu=nu, nu_z=nu, G_z=1.0 / (1.0 + nu)).canonical()
    assert law.constants == pytest.approx((2.0, nu), rel=1e-14, abs=1e-15)


AXIS = {"model": "transversely_isotropic", "E": 1.0, "E_z": 2.0, "nu": 0.3, "nu_z": 0.4, "G_z": 0.5}
WRONG = {
    "neither": ({"model": "gent", "mu": 1.0, "Jm": 9.0}, "exactly one of nu and kappa"),
    "both": ({"model": "yeoh", "C10": 1.0, "nu": 0.3, "kappa": 1.0}, "exactly one of nu and kappa"),
    "no_constants": ({"model": "mooney_rivlin", "nu": 0.3}, "shear modulus is 0; it must be > 0"),
    "pulls": (
        {"model": "ogden", "mu": [1.0], "alpha": [-2.0], "nu": 0.3},
        "shear modulus is -1; it must be > 0",
    ),
    "pairs": (
        {"model": "ogden", "mu": [1.0], "alpha": [2.0, 1.0], "nu": 0.3},
        "1 entries and alpha has 2",
    ),
    "zero": (
        {"model": "ogden", "mu": [1.0, 1.0], "alpha": [2.0, 0.0], "nu": 0.3},
        "alpha must not be zero",
    ),
    "empty": ({"model": "ogden", "nu": 0.3}, "mu"),
    "three": ({"model": "neo_hookean", "E": 1.0, "nu": 0.3, "mu": 1.0}, "exactly two of"),
    "no_Jm": ({"model": "gent", "mu": 1.0, "nu": 0.3}, "material.Jm: missing"),
    "no_b": ({"model": "fung", "mu": 1.0, "nu": 0.3}, "material.b: missing"),
    "flat_b": ({"model": "fung", "mu": 1.0, "b": 0, "nu": 0.3}, "material.b"),
    "no_mu": ({"model": "gent", "Jm": 9.0, "nu": 0.3}, "material.mu: missing"),
    "no_C10": ({"model": "yeoh", "C20": 1.0, "nu": 0.3}, "material.C10: missing"),
    "no_lambda_m": ({"model": "arruda_boyce", "mu": 1.0, "nu": 0.3}, "material.lambda_m: missing"),
    "no_G_z": (
        {key: value for key, value in AXIS.items() if key != "G_z"},
        "material.G_z: missing",
    ),
    "nu_z": (AXIS | {"nu_z": 0.9}, "with these E, E_z and nu it must lie within +-0.83666"),
    "nu_across": (AXIS | {"nu": 1.0}, "must be > -1 and < 1, got 1.0"),
    "finite": (AXIS | {"mu": 1.0}, "has no parameter 'mu'"),
    "lambda_m": (
        {"model": "arruda_boyce", "mu": 1.0, "lambda_m": 0.9, "nu": 0.3},
        "must be > 1, got 0.9",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_is_said(case: str) -> None:
    material, words = WRONG[case]
    with pytest.raises(ConfigError) as refused:
        resolve(
            config_from_mapping(
                {
                    "body": {"shape": "cylinder", "radius": 1.0, "height": 1.0},
                    "material": material,
                    "indenter": {"shape": "sphere", "R": 1.0},
                    "loading": {"delta": 0.1},
                }
            )
        )
    assert words in str(refused.value)


def test_a_bulk_modulus_lost_beside_the_shear_modulus_is_refused():
    """A ratio kappa/mu below rounding is refused, because nu would be -1 and E zero."""
    with pytest.raises(ValueError, match="nu would be -1"):
        Gent(mu=1e17, Jm=1.0, kappa=1.0).canonical()
