"""Scenes in time: their characteristic times, limits, and the elastic body that they approach."""

from __future__ import annotations

from typing import Any

import pytest

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.model.hyperelasticity import MooneyRivlin
from indent_sim.model.linear_elasticity import LinearElastic, TransverselyIsotropic
from indent_sim.model.materials import Material
from indent_sim.model.pore_flow import Flow
from indent_sim.model.relaxation import Relaxation
from indent_sim.scene.limiting_elastic_laws import relaxed_law, undrained_law
from indent_sim.scene.scene import resolve
from indent_sim.scene.time_prediction import TimePrediction
from indent_sim.theory.half_space import E_star, paraboloid_force
from indent_sim.theory.poroelasticity import paraboloid_fraction_remaining

DEPTH = 0.0225
LAYER = {"shape": "layer", "height": 1.0}
POROUS = {"model": "linear_elastic", "E": 1.0, "nu": 0.2, "flow": {"diffusivity": 2.0}}
RAMP = [[0, 0], [0.5, DEPTH]]


def scene(material: dict[str, Any] = POROUS, history: Any = RAMP, **sections: Any) -> Any:
    base = {"body": LAYER, "material": material, "indenter": {"shape": "paraboloid", "R": 1.0}}
    return resolve(config_from_mapping(base | {"loading": {"history": history}} | sections))


def of(*args: Any, **sections: Any) -> TimePrediction:
    found = scene(*args, **sections).plan.time
    assert isinstance(found, TimePrediction)
    return found


ELASTIC = {"model": "linear_elastic", "E": 1.0, "nu": 0.3}
PRONY = [[0.5, 1.0]]
CREEPING = ELASTIC | {"plasticity": {"yield_stress": 0.01, "creep": {"rate": 0.1, "m": 0.2}}}
CYCLES = [[0, 0], [1, DEPTH], [2, 0], [3, DEPTH]]


@pytest.mark.parametrize(
    "material, history, sections, way, method",
    [
        (ELASTIC, RAMP, {}, "curve", "equilibria"),
        (ELASTIC, RAMP, {"experiment": {"adhesion": {"work": 1e-5}}}, "curve", "JKR"),
        (ELASTIC | {"relaxation": {"prony": PRONY}}, RAMP, {}, "curve", "quadrature"),
        (ELASTIC | {"relaxation": {"prony": PRONY}}, CYCLES, {}, "curve", "time steps"),
        (ELASTIC, RAMP, {"solver": {"method": "newton"}}, "steps", "equilibria"),
        (
            ELASTIC | {"relaxation": {"prony": PRONY, "of": "shear"}},
            RAMP,
            {},
            "steps",
            "exponentials",
        ),
        (POROUS, RAMP, {}, "steps", "SDIRK2"),
        (CREEPING, RAMP, {}, "steps", "backward Euler"),
    ],
)
def test_method_of_a_history(
    material: dict[str, Any], history: Any, sections: dict[str, Any], way: str, method: str
) -> None:
    """Each kind of body and history has its method; a repeated approach needs time steps."""
    found = of(material, history, **sections)
    assert (found.way, found.method) == (way, method)


def test_times_of_a_body_that_drains() -> None:
    """The diffusion times are a^2/D of the contact, of its elements and of the height."""
    planned = scene()
    found, L, a = planned.plan.time, planned.physics.scales.length, planned.plan.prediction["a"]
    assert (found.D, found.way, found.method) == (pytest.approx(2.0), "steps", "SDIRK2")
    assert found.times["contact"] == pytest.approx(a**2 / 2) and found.times[
        "height"
    ] == pytest.approx(0.5)
    assert found.times["element"] == pytest.approx((planned.sizes.h_contact * L) ** 2 / 2)
    assert found.times["way_in"] == 0.5 and found.times["history"] == 0.5
    assert found.stages == 2 * len(planned.physics.path.values) - 1  # at rest no time passes


def test_limits_on_a_half_space() -> None:
    """The limits on a half-space are Hertz's, drained and with nu = 0.5 at equal shear modulus."""
    found = of(body={"shape": "half_space"})
    assert found.limits["drained"] == pytest.approx(
        paraboloid_force(DEPTH, 1.0, E_star(1.0, 0.2)), rel=1e-9
    )
    assert found.limits["undrained"] == pytest.approx(
        paraboloid_force(DEPTH, 1.0, E_star(1.25, 0.5)), rel=1e-9
    )


def test_the_depth_of_a_force_has_limits_too() -> None:
    """The limits of the depth of a force are Hertz's depths of both bodies."""
    force = paraboloid_force(DEPTH, 1.0, E_star(1.0, 0.2))
    found = of(loading={"force_history": [[0, 0], [1, force]]}, body={"shape": "half_space"})
    assert found.limits["drained"] == pytest.approx(DEPTH, rel=1e-6)
    ratio = E_star(1.25, 0.5) / E_star(1.0, 0.2)
    assert found.limits["undrained"] == pytest.approx(DEPTH / ratio ** (2 / 3), rel=1e-6)


@pytest.mark.parametrize(
    ("share", "word"),
    [(1e-4, "undrained, within"), (1.0, "close to neither"), (1e4, "drained, within")],
    ids=str,
)
def test_the_elastic_body_that_is_near(share: float, word: str) -> None:
    contact = of().times["contact"]
    found = of(history=[[0, 0], [share * contact, DEPTH]])
    assert f"{share:.2g} of a^2/D: {word}" in found.words
    assert (
        found.expected is not None
        and found.limits["drained"] <= found.expected <= found.limits["undrained"]
    )


def test_a_hold_drains() -> None:
    contact = of().times["contact"]
    found = of(history=[[0, DEPTH], [1e3 * contact, DEPTH]])
    assert found.times["way_in"] == 0
    assert (
        "loading takes 0" in found.words
        and "at the end of the history drained, within" in found.words
    )
    back = of(history=[[0, 0], [contact, DEPTH], [1e3 * contact, 0]])
    assert "at the end" not in back.words


def test_surfaces_that_nobody_tabled_have_no_estimate() -> None:
    found = of(drainage={"surface": "sealed", "sides": "drained"})
    assert found.expected is None and "`indent-sim require`" in found.words


def test_times_of_a_body_that_relaxes() -> None:
    """The limits of shear relaxation are the unrelaxed force and half of it.

    Half of the shear modulus of an incompressible body relaxes, at one time.
    """
    law = {"model": "linear_elastic", "E": 1.0, "nu": 0.5}
    law |= {"relaxation": {"prony": [[0.2, 0.1], [0.3, 1.0]], "of": "shear"}}
    found = of(law)
    assert found.method == "exponentials" and found.times["relaxation"] == 1.0 and found.D is None
    assert found.limits["relaxed"] == pytest.approx(0.5 * found.limits["unrelaxed"])
    assert "0.5 of the longest relaxation time: close to neither" in found.words
    assert "unrelaxed, within" in of(law, [[0, 0], [1e-4, DEPTH]]).words
    assert (
        "; at the end of the history relaxed, within"
        in of(law, [[0, 0], [1e-4, DEPTH], [50, DEPTH]]).words
    )


def test_a_history_of_an_elastic_body_has_its_way() -> None:
    found = of({"model": "linear_elastic", "E": 1.0, "nu": 0.2})
    assert found.way == "curve" and not found.limits and not found.words and found.stages is None
    assert (
        scene({"model": "linear_elastic", "E": 1.0, "nu": 0.2}, loading={"delta": DEPTH}).plan.time
        is None
    )


def test_what_is_left_falls_from_one_to_nothing() -> None:
    times = [0.0, 1e-4, 0.01, 0.03, 0.1, 1.0, 30.0, 100.0, 1e4, float("inf")]
    for after in ("step", "ramp"):
        for tip in ("sealed", "drained"):
            found = [paraboloid_fraction_remaining(tau, tip, after) for tau in times]  # type: ignore[arg-type]
            assert found == sorted(found, reverse=True) and found[0] == 1 and found[-1] == 0
    assert paraboloid_fraction_remaining(0.1, "sealed", "ramp") == pytest.approx(0.865)


@pytest.mark.parametrize(("alpha", "storage"), [(1.0, 0.0), (0.8, 0.5)])
def test_undrained_across_an_axis_of_isotropy(alpha: float, storage: float) -> None:
    """The undrained law of a transversely isotropic body contains the isotropic one."""
    flow = Flow(permeability=1.0, alpha=alpha, storage=storage)
    plain: Any = undrained_law(LinearElastic(E=1.0, nu=0.2, flow=flow))
    like = TransverselyIsotropic(E=1.0, E_z=1.0, nu=0.2, nu_z=0.2, G_z=1 / 2.4, flow=flow)
    found: Any = undrained_law(like).canonical()
    assert (found.E, found.E_z) == pytest.approx((plain.E, plain.E), rel=1e-12)
    assert (found.nu, found.nu_z) == pytest.approx((plain.nu, plain.nu), rel=1e-12)
    assert plain.E / (1 + plain.nu) == pytest.approx(1 / 1.2) and found.flow is None


@pytest.mark.parametrize(
    "law",
    [
        LinearElastic(E=1.0, nu=0.3, relaxation=Relaxation(prony=((0.6, 1.0),), of="shear")),
        MooneyRivlin(
            C10=0.2, C01=0.05, nu=0.3, relaxation=Relaxation(prony=((0.6, 1.0),), of="shear")
        ),
    ],
)
def test_a_relaxed_law_keeps_its_bulk_modulus(law: Material) -> None:
    def moduli(E: float, nu: float) -> tuple[float, float]:
        return E / (2 * (1 + nu)), E / (3 * (1 - 2 * nu))

    mu, kappa = moduli(*law.constants)
    assert moduli(*relaxed_law(law, 0.4).constants) == pytest.approx((0.4 * mu, kappa), rel=1e-12)
