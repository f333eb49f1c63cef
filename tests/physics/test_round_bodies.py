"""Caps and balls beside independent values, the limit of a flat cap, and the mirror plane.

Every contact method is compared with the others, and a plate with other tips.
"""

from __future__ import annotations

import dataclasses
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI
from scenes import ELASTIC, PARABOLOID, force, meshed, scene, solve

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.fe.discrete_body import Body
from indent_sim.run.pipeline import simulate

BALL = {"shape": "ball", "radius": 1.0}
BONDED = BALL | {"base": "fixed"}
CAP = {"shape": "cap", "base_radius": 2.0, "height": 1.0}
HALF = {"shape": "cap", "base_radius": 1.0, "height": 1.0, "base": "roller"}
PLATE = {"shape": "plate"}
DEEP = {"delta": 0.02, "steps": 1}
QUIET = {"plot": False, "fields": "none"}
NEO_HOOKEAN = {"model": "neo_hookean", "E": 1.0, "nu": 0.45}

# An independent solver (small strain, reference gap), good to 1e-5: body, tip, nu, force at delta =
# 0.02
KNOWN: dict[str, tuple[dict[str, Any], dict[str, Any], float, float]] = {
    "ball between plates": (BALL, PLATE, 0.3, 1.548175e-3),
    "cap on glass": (CAP, PARABOLOID, 0.45, 4.536025e-3),
}
A_OF_CAP = 0.124622


def known(name: str, **sections: Any) -> dict[str, Any]:
    body, tip, nu, _ = KNOWN[name]
    return {
        "body": body,
        "indenter": tip,
        "material": ELASTIC | {"nu": nu},
        "loading": DEEP,
    } | sections


@pytest.mark.parametrize("solver", ["condensed", "newton"])
@pytest.mark.parametrize("name", KNOWN)
def test_independent_values_at_automatic_sizes(name: str, solver: str) -> None:
    """At automatic element sizes forces are within 0.3 % of independent values."""
    assert force(scene(**known(name, solver={"method": solver}))) == pytest.approx(
        KNOWN[name][3], rel=3e-3
    )


@pytest.mark.parametrize("name", KNOWN)
def test_independent_values_within_the_accuracy_asked_for(name: str, tmp_path: Path) -> None:
    """`accuracy: 0.001` is met, and the error bar holds the independent value."""
    config = config_from_mapping(known(name, accuracy=0.001, output=QUIET))
    (state,) = simulate(config, MPI.COMM_SELF, directory=tmp_path / "result").states
    assert state.force_error is not None and state.force_error <= 1e-3 * state.force
    assert abs(state.force - KNOWN[name][3]) <= state.force_error
    if name == "cap on glass":
        assert state.a_error is not None and abs(state.a - A_OF_CAP) <= state.a_error


@pytest.mark.parametrize("nu", [0.3, 0.5])
@pytest.mark.parametrize("base_radius", [6.0, 10.0])
def test_a_flat_cap_is_a_layer(base_radius: float, nu: float) -> None:
    """A cap of six heights' radius or more has the force of a layer within 0.5 %.

    The curvature of the tip relative to the surface is the same in both. Measured 0.15 and 0.05 %.
    """
    dome = (base_radius**2 + 1) / 2
    cap = {"shape": "cap", "base_radius": base_radius, "height": 1.0}
    layer = {"shape": "cylinder", "radius": base_radius, "height": 1.0}
    found = [
        force(
            scene(
                body,
                indenter={"shape": "paraboloid", "R": R},
                material=ELASTIC | {"nu": nu},
                loading=DEEP,
            )
        )
        for body, R in ((cap, 1 / (1 - 1 / dome)), (layer, 1.0))
    ]
    assert found[0] == pytest.approx(found[1], rel=5e-3)


def test_half_of_the_ball_takes_half_of_the_approach() -> None:
    """A ball between plates and half of it have one force; the ball has twice the depth and energy.

    Both are the same contact on one mesh and agree to rounding.
    """
    ball, cap = (
        scene(body, indenter=PLATE, loading={"delta": delta, "steps": 1})
        for body, delta in ((BALL, 0.02), (HALF, 0.01))
    )
    alike = dataclasses.replace(cap.replace_physics(contact=ball.physics.contact), sizes=ball.sizes)
    (whole,), (half,) = solve(ball), solve(alike)
    for name, times in (("force", 1), ("a", 1), ("p_max", 1), ("energy", 2), ("delta", 2)):
        assert getattr(whole, name) == pytest.approx(
            times * getattr(half, name), rel=1e-9, abs=0
        ), name


@pytest.mark.parametrize(
    ("material", "body"),
    [
        pytest.param(
            material,
            body,
            marks=[] if (material is ELASTIC) != (body is CAP) else [pytest.mark.verify],
            id=f"{strain}-{shape}",
        )
        for strain, material in (("linear", ELASTIC), ("finite", NEO_HOOKEAN))
        for shape, body in (("mirrored", BALL), ("bonded", BONDED), ("cap", CAP))
    ],
)
def test_force_is_the_derivative_of_the_energy(
    material: dict[str, Any], body: dict[str, Any]
) -> None:
    """The force is the central difference of the energy at a depth of 0.1 (1 +- 0.01) to 0.1 %.

    The quotient's own error is 1e-5; the rest is the scatter of the contact edge.
    """
    path = {"deltas": [0.099, 0.1, 0.101]}
    below, here, above = solve(scene(body, indenter=PLATE, material=material, loading=path))
    assert (above.energy - below.energy) / 0.002 == pytest.approx(here.force, rel=1e-3)


def test_a_plate_has_one_gap() -> None:
    """Under a plate the gaps at the reference and at the deformed point give one force.

    The distance to the plate is z, however far the point has moved sideways.
    """
    reference, current = (
        force(scene(BALL, indenter=PLATE, loading=DEEP, contact={"gap": gap}))
        for gap in ("reference", "current")
    )
    assert current == pytest.approx(reference, rel=1e-10)  # the tolerance of the solver


METHODS = [
    pytest.param(
        method,
        gap,
        marks=[] if (method, gap) == ("active_set", "reference") else [pytest.mark.verify],
    )
    for method, gap in product(
        ("penalty", "uzawa", "nitsche", "active_set"), ("reference", "current")
    )
]


@pytest.mark.parametrize(
    ("method", "gap"), METHODS
)  # that methods agree at all is shown in test_methods
def test_every_method_gives_the_same_force(method: str, gap: str) -> None:
    """Every contact method has the force of the augmented Lagrangian on one mesh to 0.1 %.

    A penalty lets the tip sink in, by less than 0.5 % of the force as chosen and stated.
    """
    sphere = {"shape": "sphere", "R": 1.0}
    forces = [
        force(scene(CAP, indenter=sphere, loading=DEEP, contact={"method": name, "gap": gap}))
        for name in (method, "augmented_lagrangian")
    ]
    assert forces[0] == pytest.approx(forces[1], rel=5e-3 if method == "penalty" else 1e-3)


@pytest.mark.parametrize(
    "tip", [{"shape": "flat_punch", "radius": 0.3}, {"shape": "flat_punch", "radius": 0.05}]
)
def test_a_punch_is_a_plate_up_to_its_edge(tip: dict[str, Any]) -> None:
    """A punch wider than the contact, 0.24, has the force of a plate; a narrower one pushes less.

    Only the meshes differ: 0.3 %.
    """
    found, plate = (
        force(scene(CAP, indenter=tip, loading=DEEP)),
        force(scene(CAP, indenter=PLATE, loading=DEEP)),
    )
    assert found == pytest.approx(plate, rel=3e-3) if tip["radius"] == 0.3 else found < 0.5 * plate


def test_the_gap_is_that_of_the_sphere_not_of_its_chords() -> None:
    """The gap of an untouched ball is that of the sphere at vertices and midpoints.

    It is the distance to the plate plus R - sqrt(R^2 - r^2).
    """
    (state,) = solve(
        scene(BALL, indenter=PLATE, loading={"deltas": [-0.02]}, mesh={"h_contact": 0.1})
    )
    assert state.surface is not None
    r = np.minimum(state.surface.x, 1.0)
    assert state.surface.gap == pytest.approx(
        0.01 + 1 - np.sqrt(1 - r * r), abs=1e-7
    )  # the root at the equator


@pytest.mark.parametrize("base", ["fixed", "roller"])
def test_the_mesh_fills_the_ball(base: str) -> None:
    """The mesh's volume is that of the ball, or of its half, to 1e-4.

    Facets span at most 7 degrees; their straight chords would leave out 0.3 %.
    """
    ball = scene(BALL | {"base": base}, mesh={"h_contact": 0.1, "h_far": 0.125})
    body = Body(ball, meshed(ball))
    volume = fem.assemble_scalar(fem.form(body.weight * ufl.dx(domain=body.mesh)))
    exact = 4 / 3 * np.pi / ball.physics.scales.contacts_per_body
    assert volume * ball.physics.scales.length**3 == pytest.approx(exact, rel=1e-4)


def test_pressures_of_vertices_and_midpoints_are_one_curve() -> None:
    """Pressures of vertices and midpoints follow Hertz' p0 sqrt(1 - r^2/a^2) to 1 %.

    This holds inside 0.4 a with eight elements in the radius, as on a flat body. With straight
    facets vertices had 2 % less than the midpoints beside them.
    """
    (state,) = solve(
        scene(
            BALL,
            indenter={"shape": "sphere", "R": 1.0},
            loading={"delta": 0.04, "steps": 1},
            mesh={"h_contact": 0.0125, "h_far": 0.05},
        )
    )
    assert state.surface is not None
    inside = state.surface.x < 0.4 * state.a
    shape = np.sqrt(1 - (state.surface.x[inside] / state.a) ** 2)
    p = state.surface.pressure[inside] / shape
    assert len(p) > 6 and np.ptp(p) <= 0.01 * p.mean()


def test_a_cap_by_its_contact_angle() -> None:
    """A cap given by its contact angle has the force of the cap given by its height.

    tan(theta/2) = height/base_radius, also beyond a right angle, where the cap overhangs.
    """
    for height in (1.0, 3.0):
        angle = float(np.degrees(2 * np.arctan(height / 2.0)))
        by_height, by_angle = (
            force(scene({"shape": "cap", "base_radius": 2.0} | given, loading=DEEP))
            for given in ({"height": height}, {"contact_angle": angle})
        )
        assert by_angle == pytest.approx(by_height, rel=1e-9)


@pytest.mark.parametrize("nu", [0.3, 0.5])
def test_a_soft_ball_squeezed_to_two_thirds(nu: float) -> None:
    """A hyperelastic ball squeezed to two thirds converges and stiffens beyond Hertz.

    The ratio to Hertz' force grows with depth, as the ball spreads.
    """
    material = NEO_HOOKEAN | {"nu": nu}
    states = solve(
        scene(BALL, indenter=PLATE, material=material, loading={"delta": 0.7, "steps": 7})
    )
    hertz = [4 / 3 / (1 - nu**2) * (state.delta / 2) ** 1.5 for state in states]
    ratios = [state.force / F for state, F in zip(states, hertz, strict=True)]
    assert ratios == sorted(ratios) and ratios[0] > 1.05


def test_depths_at_prescribed_forces_are_the_whole_approach() -> None:
    """The depth at a prescribed force is the ball's whole approach at the independent value.

    The force of a depth is off by at most 0.3 %, the depth of a force by two thirds of it.
    """
    (state,) = solve(
        scene(BALL, indenter=PLATE, loading={"force": KNOWN["ball between plates"][3], "steps": 1})
    )
    assert state.delta == pytest.approx(0.02, rel=2e-3)


def test_units_change_nothing() -> None:
    """A bead of 5 um and 1 kPa in SI units has the numbers of the unit ball to rounding."""
    small = scene(
        {"shape": "ball", "radius": 5e-6},
        indenter=PLATE,
        material=ELASTIC | {"E": 1e3},
        loading={"delta": 1e-7, "steps": 1},
    )
    (one,), (other,) = solve(scene(BALL, indenter=PLATE, loading=DEEP)), solve(small)
    assert other.force == pytest.approx(one.force * 1e3 * 25e-12, rel=1e-9)
    assert other.energy == pytest.approx(one.energy * 1e3 * 125e-18, rel=1e-9)
    assert other.a == pytest.approx(one.a * 5e-6, rel=1e-9)


@pytest.mark.verify
@pytest.mark.parametrize(
    ("angle", "base"), [(15, "roller"), (60, "fixed"), (90, "roller"), (150, "fixed")]
)
def test_error_bars_hold(angle: float, base: str, tmp_path: Path) -> None:
    """Error bars of caps of any angle hold runs at twenty times the accuracy, at every step."""
    body = {"shape": "cap", "base_radius": 1.0, "contact_angle": angle, "base": base}
    depth = 0.05 * np.tan(np.radians(angle / 2))
    for tip, nu in ((PLATE, 0.3), ({"shape": "sphere", "R": 2.0}, 0.5)):
        sections = {
            "body": body,
            "indenter": tip,
            "material": ELASTIC | {"nu": nu},
            "output": QUIET,
            "loading": {"delta": float(depth), "steps": 4},
        }
        runs = [
            simulate(
                config_from_mapping(sections | {"accuracy": accuracy}),
                MPI.COMM_SELF,
                directory=tmp_path / f"{nu}-{accuracy}",
            ).states
            for accuracy in (0.01, 0.0005)
        ]
        for found, fine in zip(*runs, strict=True):
            assert found.force_error is not None
            assert abs(found.force - fine.force) <= found.force_error <= 0.01 * found.force
