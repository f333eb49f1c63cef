"""Gels in scene files: swelling in closed form, a resting tip, weights, and the drained state."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import scene
from scipy.optimize import brentq

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.model.gel import Gel
from indent_sim.model.state import State
from indent_sim.run import pipeline
from indent_sim.run.error_estimation.coarser_run import REFINEMENT_RATIO, CoarserRun
from indent_sim.run.error_estimation.error_bars import ErrorBars
from indent_sim.run.pipeline import simulate
from indent_sim.run.row_warnings import lost_contact_warnings, underresolved_rows
from indent_sim.scene.discretisation_warnings import UNDERRESOLVED_ERROR
from indent_sim.scene.expected_error import swelling_force_error
from indent_sim.scene.scene import Scene

STRETCH = 1.4
GEL = {"model": "gel", "G": 1.0, "n_omega": 1e-3, "chi": 0.6, "stretch": STRETCH}
WET = GEL | {"flow": {"diffusivity": 1.0}}
LAYER = {"shape": "cylinder", "radius": 2.0, "height": 1.0, "base": "fixed", "sides": "roller"}
FREE = LAYER | {"base": "roller", "sides": "free"}
SPHERE = {"shape": "sphere", "R": 1.0}
COARSE = {"h_contact": 0.06}
QUIET = {"fields": "none", "surface": "none", "plot": False}
DIFFUSION = 31.05  # H^2/D_c of this gel, D_c = M_c k


def gel(body: dict[str, Any] = LAYER, **sections: Any) -> Scene:
    return scene(
        body,
        **{"material": WET, "indenter": SPHERE, "mesh": COARSE, "drainage": {"bath": 0.0}}
        | sections,
    )


def rows(base: Scene) -> list[State]:
    found = list(pipeline.states(base, with_surface=False))
    assert len(found) == len(base.physics.deltas) and all(row.converged for row in found), found[
        -1
    ].reason
    return found


def at(
    times: Sequence[float], *, key: str = "history", value: float = 0.0, **sections: Any
) -> list[State]:
    """Rows at times in units of DIFFUSION, of a tip that rests or is pressed from the beginning."""
    end = DIFFUSION * times[-1]
    loading = {
        key: [[0, value], [end, value]],
        "times": [DIFFUSION * t for t in times],
        "per_doubling": 2,
    }
    return rows(gel(loading=loading, **sections))


def test_a_gel_swells_against_a_resting_sphere() -> None:
    """Forces of a gel that swells against a resting sphere are those of finer meshes.

    References are forces over G height^2 at h = 0.06 to 0.03; tolerances are their differences and
    the increments in time. The bath rises in a sixtieth of the first row's time, which costs less
    than 1 %.
    """
    found = at([0.1, 1.0, 10.0, 1000.0], drainage={"bath": 0.0, "bath_ramp": 0.05})
    assert [row.force for row in found[:2]] == pytest.approx([0.0780, 0.587], rel=3e-2)
    assert found[2].force == pytest.approx(1.480, rel=6e-3) and found[3].force == pytest.approx(
        1.5055, rel=2e-3
    )
    assert 0 < found[0].a < found[1].a < found[2].a < 1


@pytest.mark.verify
def test_a_tip_that_drains_lets_it_swell_sooner() -> None:
    sealed, drained = (
        at([1.0, 1000.0], drainage={"bath": 0.0, "tip": tip}) for tip in ("sealed", "drained")
    )
    assert drained[0].force > 1.08 * sealed[0].force
    assert drained[1].force == pytest.approx(sealed[1].force, rel=2e-3)


@pytest.mark.parametrize("body", [LAYER, FREE], ids=["held", "free"])
def test_a_resting_tip_is_lifted_by_all_that_a_gel_swells(body: dict[str, Any]) -> None:
    """A resting tip is lifted by the whole swelling of a gel, free or confined.

    References are mu(l) = 0 for a free gel and P_z = 0 between walls.
    """
    law = Gel(G=1.0, n_omega=1e-3, chi=0.6, stretch=STRETCH)
    free = law.free_swelling_stretch(0.0) / STRETCH
    swollen = free if body is FREE else law.confined_swelling(law.bath_pressure(0.0)).stretch
    coarse = {"h_contact": 0.25, "h_far": 0.5}
    early, late = at([0.1, 1e3], key="force_history", body=body, mesh=coarse)
    assert early.force == 0 and late.force == 0 and early.a == 0
    assert -late.delta == pytest.approx(
        swollen - 1, rel=1e-6
    )  # the tip is 1e-9 of the height above
    assert 0 < -early.delta < 0.5 * (swollen - 1)


def test_a_weight_sinks_in_and_is_lifted() -> None:
    """A constant force sinks in at once as into an incompressible body, and is then lifted.

    The gel is stretched below its swelling equilibrium, so that it takes up solvent and rises. The
    incompressible body has the shear modulus of the gel at that stretch.
    """
    coarse = {"h_contact": 0.1}
    found = at([0.0, 0.02, 0.1], key="force_history", value=0.3, mesh=coarse)
    assert [row.force for row in found] == pytest.approx([0.3] * 3, rel=1e-8)
    assert found[0].delta > found[1].delta > found[2].delta
    rubber = {"model": "neo_hookean", "mu": 1.0 / STRETCH, "nu": 0.5}
    (solid,) = rows(
        gel(material=rubber, drainage=None, loading={"force": 0.3, "steps": 1}, mesh=coarse)
    )
    assert found[0].delta == pytest.approx(solid.delta, rel=2e-3)


def test_a_weight_on_a_swollen_gel_is_put_on_and_taken_off_at_once() -> None:
    """A weight on a swollen gel acts and is removed at once; less than 1 % of height remains.

    What remains is the dent of one time unit of flow.
    """
    path = {
        "force_history": [[0, 0], [50, 0], [50, 0.1], [51, 0.1], [51, 0], [52, 0]],
        "times": [49, 50, 51, 52],
    }
    free, loaded, left, later = rows(gel(loading=path, mesh={"h_contact": 0.15, "h_far": 0.4}))
    assert [row.force for row in (free, loaded, left, later)] == pytest.approx(
        [0, 0.1, 0, 0], abs=1e-9
    )
    assert free.delta < -0.2 and loaded.delta > free.delta + 0.05
    assert abs(left.delta - free.delta) < 0.01 and left.a == later.a == 0


def test_the_audit_is_relative_to_what_the_supports_of_a_gel_hold(tmp_path: Path) -> None:
    """The force balance of a free gel is judged relative to the reactions of its supports.

    The nodal reactions, which hold the swelling, have 15 times the norm of the contact force.
    Newton stops at 1e-9 of that norm; the residual was 4e-8 of the contact force where 1e-8 of the
    reactions is allowed.
    """
    body = {
        "shape": "cylinder",
        "radius": 2.1674828389041867,
        "height": 1.0,
        "base": "fixed",
        "sides": "free",
    }
    material = {
        "model": "gel",
        "G": 0.44702722260745514,
        "n_omega": 0.0011363376469319755,
        "chi": 0.6077436101269671,
        "stretch": 1.531745811613219,
        "flow": {"diffusivity": 1.0},
    }
    config = {
        "body": body,
        "material": material,
        "drainage": {"tip": "sealed", "bath": 0.0},
        "indenter": {
            "shape": "hyperboloid",
            "R": 0.752403901964765,
            "half_angle": 62.6846699247545,
        },
        "loading": {"history": [[0, 0], [300, 0]], "times": [2, 60, 300], "per_doubling": 2},
        "output": QUIET,
    }
    last = simulate(config_from_mapping(config), directory=tmp_path / "run").states[-1]
    assert last.converged
    assert last.force == pytest.approx(
        last.reaction, rel=1e-6
    )  # 4e-8; a slip of the sign or of a factor shows


def test_a_gel_may_swell_higher_around_the_tip_than_the_body_is() -> None:
    """The contact of a cone ends above the body's height and below the height of free swelling.

    Between the walls the gel swells to a height known in closed form, and the apex is at the
    height of the body minus the depth. The contact ends on the cone at less than the difference.
    """
    material = {"model": "gel", "G": 0.3, "n_omega": 1.2e-3, "chi": 0.4, "stretch": 1.58}
    depth = 0.11
    base = gel(
        LAYER | {"radius": 2.9, "base": "roller"},
        material=material | {"flow": {"diffusivity": 1.0}},
        indenter={"shape": "cone", "half_angle": 63.0, "tip_radius": 0.1},
        loading={"history": [[0, 0], [2, depth], [300, depth]], "times": [300], "per_doubling": 2},
        mesh={"h_contact": 0.3, "h_far": 0.4},
    )
    (row,) = rows(base)
    tip = base.physics.indenter
    law = Gel(**material)
    swollen = law.confined_swelling(law.bath_pressure(0.0)).stretch
    assert tip.radius_at(1.0) < row.a < tip.radius_at(swollen - 1 + depth)


@pytest.mark.verify
def test_a_strongly_swelling_gel_keeps_its_bonded_corner() -> None:
    """The force on a gel bonded to a base is between those on a free and on a confined gel.

    A bonded base hinders the gel in spreading, so that it rises more than a free one and less than
    one between walls. The free face folds where elements at the corner are too small, and no
    equilibrium is found.
    """
    material = {"model": "gel", "G": 1.0, "n_omega": 5.7e-3, "chi": 0.546, "stretch": 1.31}
    depth = 0.085
    bodies = [
        LAYER | {"radius": 1.6, "base": base, "sides": sides}
        for base, sides in (("roller", "free"), ("fixed", "free"), ("fixed", "roller"))
    ]
    forces = [
        rows(
            gel(
                body,
                material=material | {"flow": {"diffusivity": 1.0}},
                indenter={"shape": "cone", "half_angle": 68.0, "tip_radius": 0.1},
                loading={
                    "history": [[0, 0], [9, depth], [60, depth]],
                    "times": [60],
                    "per_doubling": 2,
                },
                drainage={"tip": "drained", "bath": 0.0},
                mesh={},
            )
        )[-1].force
        for body in bodies
    ]
    assert forces[0] < forces[1] < forces[2]


def test_a_gel_that_shrinks_away_from_the_tip_is_told_with_its_depth() -> None:
    """A gel between walls retreats from the tip by the shrinkage that is known in closed form.

    The end state is homogeneous, hence the tolerance of Newton's method.
    """
    law = Gel(G=1.0, n_omega=0.01, chi=0.2).with_free_swelling(0.0)
    base = gel(
        material={"model": "gel", "G": 1.0, "n_omega": 0.01, "chi": 0.2}
        | {"flow": {"diffusivity": 1.0}},
        drainage={"bath": [[0, 0], [20, -0.01]]},
        loading={"history": [[0, 0], [1, 0.05], [2000, 0.05]], "times": [1, 2000]},
        mesh={"h_contact": 0.25, "h_far": 0.5},
    )
    found = rows(base)
    stretch = law.confined_swelling(law.bath_pressure(-0.01)).stretch
    assert found[-1].force == 0 and found[-1].clearance is not None
    assert found[-1].delta + found[-1].clearance == pytest.approx(1 - stretch, rel=1e-6)
    (said,) = lost_contact_warnings(base, found)
    assert f"has retreated to a depth of {1 - stretch:.4g} (t = 2000)" in said


def test_a_plate_with_a_weight_follows_a_column_that_shrinks() -> None:
    """A weight on a shrinking column between walls ends at the depth of the closed form.

    The plate touches the whole top or nothing, so that its force changes abruptly with the depth,
    also at the intermediate stages of a step. The end state is homogeneous, and the depth known to
    the tolerance of the search.
    """
    law = Gel(G=2.87, n_omega=0.07673, chi=0.5798).with_free_swelling(0.0)
    radius, force, bath = 1.9, 0.35, -0.0027
    base = gel(
        LAYER | {"radius": radius},
        material={"model": "gel", "G": 2.87, "n_omega": 0.07673, "chi": 0.5798}
        | {"flow": {"diffusivity": 1.0}},
        drainage={"tip": "drained", "base": "drained", "bath": [[0, 0], [0.5, bath]]},
        indenter={"shape": "flat_punch", "radius": radius},
        loading={
            "force_history": [[0, 0], [2.5, force], [300, force]],
            "times": [2, 300],
            "per_doubling": 2,
        },
        mesh={"h_contact": 0.5, "h_far": 0.5},
    )
    early, late = rows(base)
    pressure = force / (np.pi * radius**2)

    def imbalance(stretch: float) -> float:
        network_stress = law.shear_modulus * (stretch - 1 / stretch)
        stress = network_stress + law.swelling_stress(stretch - 1)
        return float(stress - law.bath_pressure(bath) + pressure)

    assert early.force == pytest.approx(0.8 * force, rel=1e-8)
    assert late.delta == pytest.approx(1 - brentq(imbalance, 0.9, 1.0, xtol=1e-12), rel=1e-6)


def test_without_flow_it_is_at_rest_in_its_bath() -> None:
    """A gel without flow is in its drained state, and swells freely where no stretch is given."""
    bath = Gel(G=1.0, n_omega=1e-3, chi=0.6).free_swelling_potential(STRETCH)
    coarse: dict[str, Any] = {"mesh": {"h_contact": 0.1}}  # of all
    (dry,) = rows(gel(material=GEL, drainage=None, loading={"deltas": [0.1]}, **coarse))
    drained: dict[str, Any] = {"drainage": {"bath": bath}} | coarse
    (auto,) = rows(gel(material=GEL | {"stretch": "auto"}, loading={"deltas": [0.1]}, **drained))
    (last,) = at([1e2], value=0.1, **drained)
    assert auto.force == pytest.approx(dry.force, rel=1e-9)
    assert last.force == pytest.approx(dry.force, rel=1e-6)


# ---- as Biot's body at small strain, and in time

SOLID = {
    "model": "linear_elastic",
    "E": 2.1326438835208883,
    "nu": 0.49285072,
}  # of the drained gel at stretch 1.4


def at_once_and_at_last(delta: float, material: dict[str, Any]) -> tuple[float, float]:
    """Forces of a tip pressed in at once, and after all flow."""
    loading = {"history": [[0, delta], [1e5, delta]], "times": [0.0, 1e5], "per_doubling": 2}
    paraboloid = {"shape": "paraboloid", "R": 1.0}
    base = scene(
        LAYER,
        material=material,
        indenter=paraboloid,
        mesh={"h_contact": 0.1 * delta**0.5},
        loading=loading,
        drainage={"bath": Gel(G=1.0, n_omega=1e-3, chi=0.6).free_swelling_potential(STRETCH)}
        if "G" in material
        else {},
    )
    first, last = rows(base)
    return first.force, last.force


@pytest.mark.verify
def test_a_gel_under_a_shallow_tip_is_a_linear_porous_body() -> None:
    """The limits of a gel under a shallow tip are those of Biot's body.

    The differences fall with the depth; extrapolated to zero depth they are below 1.5e-3.
    """
    biot = SOLID | {"flow": {"diffusivity": 1.0}}
    depths = (0.0012, 0.005)
    off = [
        [
            own / other - 1
            for own, other in zip(
                at_once_and_at_last(d, WET), at_once_and_at_last(d, biot), strict=True
            )
        ]
        for d in depths
    ]
    shares = [d**0.5 for d in depths]  # of the contact radius over R
    for shallow, deep in zip(*off, strict=True):
        assert abs(shallow) < abs(deep) < 0.01
        assert abs(shallow - (deep - shallow) * shares[0] / (shares[1] - shares[0])) < 1.5e-3


@pytest.mark.verify
def test_a_deep_hold_of_a_gel_is_of_second_order_in_time() -> None:
    """A deep hold of a gel converges with second order in time."""
    bath = Gel(G=1.0, n_omega=1e-3, chi=0.6).free_swelling_potential(STRETCH)
    found = {}
    for per_doubling in (2, 4, 16):
        loading = {
            "history": [[0, 0.3], [30, 0.3]],
            "times": [0.3, 1.0, 3.0, 30.0],
            "per_doubling": per_doubling,
        }
        base = gel(loading=loading, drainage={"bath": bath}, mesh={"h_contact": 0.08})
        found[per_doubling] = np.array([row.force for row in rows(base)])
    errors = [np.abs(found[n] / found[16] - 1).max() for n in (2, 4)]
    assert errors[1] < 1.5e-3 and errors[0] > 2.5 * errors[1]


@pytest.mark.verify
def test_what_is_said_of_a_small_contact_that_a_gel_closes() -> None:
    """The stated error of a small growing contact covers the difference to a finer mesh.

    Elements at the axis are six times as small; 0.01 of the force is allowed. p_max is that of the
    element that closed last and has no error bar.
    """
    shares = [0.01, 0.02, 0.03, 0.06, 0.12, 1.0]
    coarse, fine = (
        at(shares, mesh=mesh)
        for mesh in ({"h_contact": 0.07}, {"h_contact": 0.07, "h_axis": 0.012})
    )
    base = gel(mesh={"h_contact": 0.07}, loading={"history": [[0, 0], [DIFFUSION, 0]]})
    assert any(
        abs(one.force / other.force - 1) > 0.05 for one, other in zip(coarse, fine, strict=True)
    )
    bars = ErrorBars(base, CoarserRun(REFINEMENT_RATIO, coarse))
    for one, other in zip(coarse, fine, strict=True):
        assert base.physics.is_closed_by_swelling(one.delta, one.a)
        assert abs(one.force / other.force - 1) <= swelling_force_error(base.sizes, one.a) + 0.01
        assert isnan(bars.add_error_estimate(one).p_max_error or 0.0)
    (said,) = underresolved_rows(base, coarse)
    few = sum(swelling_force_error(base.sizes, one.a) >= UNDERRESOLVED_ERROR for one in coarse)
    assert 2 <= few < len(coarse) and said.startswith(f"{few} rows from step 1 on have at most")


def test_a_vertex_that_the_tip_closes_has_no_spike_of_pore_pressure() -> None:
    """A swelling gel has no positive pore pressure above 1e-5, where open vertices leave 1e-8.

    It was 0.2 to 0.5 of the modulus where a vertex was sealed between two stages.
    """
    rows = at([0.02, 0.05, 0.1, 0.2])
    assert max(row.pore_pressure_max or 0.0 for row in rows) < 1e-5


@pytest.mark.verify
def test_the_error_of_a_bath_that_takes_some_time_is_inside_its_part(tmp_path: Path) -> None:
    """The part `bath` of the error budget holds the difference to a ramp of a tenth of the time.

    From three ramps on it is at most five times that, since it is 3 times the error at late times.
    """
    base: dict[str, Any] = {
        "body": LAYER,
        "material": WET,
        "indenter": SPHERE,
        "mesh": {"h_contact": 0.1},
    }
    ramp = 1.0
    loading = {"history": [[0, 0.02], [10, 0.02]], "times": [1.5, 3.0, 10.0], "per_doubling": 2}
    base |= {"loading": loading, "drainage": {"bath": 0.0, "bath_ramp": ramp}, "output": QUIET}
    found = simulate(config_from_mapping(base), directory=tmp_path / "run", error_bars=True)
    sooner = pipeline.states(
        config_from_mapping(base | {"drainage": {"bath": 0.0, "bath_ramp": ramp / 10}}),
        with_surface=False,
    )
    for row, right, budget in zip(found.states, sooner, found.report["error_budget"], strict=True):
        error = abs(right.force - row.force)
        print(f"t {row.t:g}: bath {budget.bath / row.force:.2g}, error {error / row.force:.2g}")
        assert error <= budget.bath
        assert row.t < 3 * ramp or budget.bath <= 5 * error
