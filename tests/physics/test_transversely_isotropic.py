"""Transversely isotropic bodies beside uniform strain, a half-space and isotropy.

Sections, strips and bodies in three dimensions are compared with each other.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from compiled_laws import Numbers
from patch_scenes import AREA, DELTA, EPSILON_N, EXACT, H, covered
from scenes import BOX, CYLINDER, ELASTIC, PARABOLOID, STRIP, WALLED, force, scene, solve

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.model.linear_elasticity import LinearElastic, TransverselyIsotropic
from indent_sim.process.errors import ConfigError
from indent_sim.run import pipeline
from indent_sim.scene.scene import resolve

E, E_Z, NU, NU_Z, G_Z = 1.0, 2.0, 0.3, 0.4, 0.3
AXIS = {"model": "transversely_isotropic", "E": E, "E_z": E_Z, "nu": NU, "nu_z": NU_Z, "G_z": G_Z}
ISOTROPIC = AXIS | {"E_z": 1.0, "nu_z": 0.3, "G_z": 1 / 2.6}  # ELASTIC
BONE = AXIS | {"E": 12.0, "E_z": 20.0, "nu": 0.4, "nu_z": 0.3, "G_z": 4.5}
INCOMPRESSIBLE = AXIS | {"nu": 0.75, "nu_z": 0.5}  # D = 1 - nu - 2 nu_z^2 E/E_z = 0
SHEARED = AXIS | {"E_z": 1.0, "nu_z": 0.3, "G_z": 0.01}
LOOSE = AXIS | {"E_z": 0.1, "nu_z": 0.05, "G_z": 0.05}
FIBROUS = AXIS | {"E_z": 10.0, "nu_z": 0.3, "G_z": 0.5}
ACROSS = -NU_Z / E_Z
COMPLIANCE = np.array(
    [[1 / E, -NU / E, ACROSS], [-NU / E, 1 / E, ACROSS], [ACROSS, ACROSS, 1 / E_Z]]
)


@pytest.mark.parametrize("mixed", [False, True])
def test_the_stress_is_that_of_the_compliance_matrix(mixed: bool) -> None:
    """The stress of a random displacement gradient is that of the compliance matrix, to round-off.

    In mixed form it is so at q = stiffness theta, where the energy is stationary.
    """
    law = TransverselyIsotropic(E=E, E_z=E_Z, nu=NU, nu_z=NU_Z, G_z=G_Z)
    H = np.random.default_rng(1).normal(size=(3, 3))
    eps = (H + H.T) / 2
    stress = np.diag(np.linalg.solve(COMPLIANCE, np.diag(eps)))
    for i, j, G in ((0, 1, E / (2 * (1 + NU))), (0, 2, G_Z), (1, 2, G_Z)):
        stress[i, j] = stress[j, i] = 2 * G * eps[i, j]
    d = (1 - NU - 2 * NU_Z**2 * E / E_Z) / (1 + NU)
    q = (
        E * (1 - d) / (2 * d * (1 + NU)) * (eps[0, 0] + eps[1, 1] + (2 * NU_Z + d) * eps[2, 2])
        if mixed
        else 0.0
    )
    assert Numbers(law, mixed).stress_of_gradient(H, q) == pytest.approx(
        stress, rel=1e-12, abs=1e-12
    )


@pytest.mark.parametrize("mixed", [False, True])
@pytest.mark.parametrize("nu", [-0.4, 0.3, 0.49])
def test_the_isotropic_limit_is_hookes_law(mixed: bool, nu: float) -> None:
    """With isotropic constants the stress is Hooke's to round-off, for any pressure q."""
    law = TransverselyIsotropic(E=2.0, E_z=2.0, nu=nu, nu_z=nu, G_z=1 / (1 + nu))
    H = np.random.default_rng(2).normal(size=(3, 3))
    found, wanted = (
        Numbers(one, mixed).stress_of_gradient(H, 0.7) for one in (law, LinearElastic(E=2.0, nu=nu))
    )
    assert found == pytest.approx(wanted, rel=1e-11, abs=1e-11)


@pytest.mark.parametrize(
    "body",
    [
        CYLINDER | {"radius": 1.5, "height": H},
        STRIP | {"width": 3.0, "height": H},
        BOX | {"size": [3.0, 2.0, H]},
    ],
    ids=lambda body: body["shape"],
)
@pytest.mark.parametrize("sides", ["roller", "free"])
def test_uniform_strain(body: dict[str, Any], sides: str) -> None:
    """A body under a punch that covers it has the closed form's uniform pressure, to 1e-9.

    p = delta/(h/M + 1/epsilon_n), where M is C33 between rollers, E_z with free sides, and 1/(S33 -
    S13^2/S11) with free sides in plane strain.
    """
    S, is_strip = COMPLIANCE, body["shape"] == "strip"
    free = 1 / (S[2, 2] - S[0, 2] ** 2 / S[0, 0]) if is_strip else E_Z
    modulus = np.linalg.inv(S)[2, 2] if sides == "roller" else free
    state = solve(covered(body | {"base": "roller", "sides": sides}, material=AXIS))[-1]
    p = DELTA / (H / modulus + 1 / EPSILON_N)
    assert state.force == pytest.approx(p * AREA[body["shape"]], rel=EXACT)
    assert state.p_max == pytest.approx(p, rel=EXACT)


@pytest.mark.parametrize(
    "material",
    [BONE, INCOMPRESSIBLE, SHEARED, LOOSE, FIBROUS],
    ids=["bone", "incompressible", "sheared", "loose", "fibrous"],
)
def test_a_half_space(material: dict[str, Any]) -> None:
    """A mesh agrees with the half-space of the indentation modulus to 0.3 %.

    Theory is exact there. The stated truncation of the half-space is allowed on top.
    """
    exact = scene({"shape": "half_space"}, material=material)
    assert not exact.is_meshed and exact.exact_theory is not None
    (state,) = pipeline.states(exact)
    meshed = scene({"shape": "half_space"}, material=material, solver={"method": "condensed"})
    found = force(meshed)
    print(f"half-space by a mesh: {found / state.force - 1:+.3%}")
    assert found == pytest.approx(
        state.force, rel=3e-3 + meshed.plan.prediction["truncation_error"]
    )


@pytest.mark.parametrize(
    "body", [WALLED, STRIP, CYLINDER | {"symmetry": "quarter"}], ids=["section", "strip", "3d"]
)
def test_the_isotropic_limit_of_a_run(body: dict[str, Any]) -> None:
    """A run with isotropic constants has the force of the isotropic material to 1e-9.

    Elements and decisions are the same.
    """
    mesh = {"h_contact": 0.05, "h_far": 0.4, "symmetry": body.get("symmetry", "auto")}
    body = {key: value for key, value in body.items() if key != "symmetry"}
    forces = [force(scene(body, material=material, mesh=mesh)) for material in (ELASTIC, ISOTROPIC)]
    assert forces[1] == pytest.approx(forces[0], rel=1e-9)


def test_a_section_and_a_quarter_agree() -> None:
    """A quarter of a cylinder has the force of its section to 0.5 %.

    That is what the facets of the curved wall and four elements in the contact radius leave.
    """
    body, deep = CYLINDER | {"sides": "roller"}, {"delta": 0.04, "steps": 1}
    section = force(scene(body, material=AXIS, loading=deep))
    mesh = {"h_contact": 0.05, "h_far": 0.2, "symmetry": "quarter"}
    assert force(scene(body, material=AXIS, loading=deep, mesh=mesh)) == pytest.approx(
        section, rel=5e-3
    )


def test_layers_and_inclusions_have_the_material_too() -> None:
    """With isotropic constants in layers and inclusions the force is the isotropic one to 1e-9.

    Theory's layers are isotropic, and a scene of anisotropic ones says so.
    """
    found = []
    for material in (ELASTIC, ISOTROPIC):
        ball = {
            "shape": "ball",
            "center": [0.0, 0.0, -0.4],
            "radius": 0.1,
            "material": material | {"E": 1.0},
        }
        layers = [
            {"thickness": 0.1, "material": ELASTIC | {"E": 3.0}},
            {"thickness": 0.9, "material": material},
        ]
        given = {"body": WALLED | {"layers": layers, "inclusions": [ball]}, "indenter": PARABOLOID}
        found.append(scene(given["body"], "material=null", mesh={"h_contact": 0.02, "h_far": 0.3}))
    assert force(found[1]) == pytest.approx(force(found[0]), rel=1e-9)
    layered = scene(WALLED | {"layers": [{"thickness": 0.1}, {"thickness": 0.9}]}, material=AXIS)
    assert (
        layered.exact_theory is None
        and "the layers of the theory are isotropic" in layered.theory_differences
    )


def test_theory_alone_says_why_it_cannot() -> None:
    config = {
        "body": WALLED,
        "material": AXIS,
        "indenter": PARABOLOID,
        "loading": {"delta": 0.01, "steps": 1},
        "solver": {"method": "theory"},
    }
    with pytest.raises(ConfigError, match="the layers of the theory are isotropic"):
        resolve(config_from_mapping(config))
