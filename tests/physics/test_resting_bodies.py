"""Balls and caps that rest on a rigid flat without a bond: a second contact below."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from contact_scenes import contact_scenes

from indent_sim.config.scene_file import config_from_mapping
from indent_sim.fe.condensed import resting_body
from indent_sim.model.state import State
from indent_sim.process.errors import ConfigError
from indent_sim.run.pipeline import simulate, states
from indent_sim.scene.scene import Scene, resolve

LAW = {"model": "linear_elastic", "E": 1.0, "nu": 0.3}
E_STAR = 1.0 / (1 - 0.3**2)
PLATE = {"shape": "plate"}


def document(**sections: Any) -> dict[str, Any]:
    return {
        "body": {"shape": "ball", "radius": 1.0, "base": "unbonded"},
        "material": LAW,
        "indenter": {"shape": "sphere", "R": 1 / 3},
        "loading": {"delta": 0.0267},
        **sections,
    }


def scene_of(**sections: Any) -> Scene:
    return resolve(config_from_mapping(document(**sections)))


def last_row(scene: Scene) -> State:
    return list(states(scene, with_surface=False))[-1]


def hertz_depth(force: float, R: float, E_star: float = E_STAR) -> float:
    return float((0.75 * force / (E_star * R**0.5)) ** (2 / 3))


class TestTwoContacts:
    """Both contacts are solved on one compliance of the body."""

    @pytest.mark.parametrize("nu", [0.3, 0.49])
    def test_a_ball_under_a_plate_is_half_a_ball_by_symmetry(self, nu: float) -> None:
        """Plate above and flat below: the mid-plane is a mirror plane, which another mesh has.

        Both meshes have 20 elements in the contact; measured: force 1.1e-4, radius 6e-4.
        """
        law = {"model": "linear_elastic", "E": 1.0, "nu": nu}
        common: dict[str, Any] = {
            "material": law,
            "indenter": PLATE,
            "loading": {"delta": 0.1},
            "mesh": {"h_contact": 0.01},
        }
        resting = last_row(scene_of(**common))
        half = last_row(scene_of(body={"shape": "ball", "radius": 1.0, "base": "roller"}, **common))
        assert resting.force == pytest.approx(half.force, rel=5e-4)
        assert resting.energy == pytest.approx(half.energy, rel=5e-4)
        assert resting.a == pytest.approx(half.a, rel=2e-3)
        assert resting.a_base == pytest.approx(half.a, rel=2e-3)
        assert resting.base_approach == pytest.approx(0.05, rel=1e-3)

    def test_small_contacts_are_two_hertz_contacts_in_series(self) -> None:
        """Approaches add up at one force; a/R = 0.003 changes them by some 1e-3."""
        scene = scene_of(loading={"delta": 2e-5}, mesh={"h_contact": 1e-4})
        row = last_row(scene)
        upper = hertz_depth(row.force, 1 / (1 + 3))
        lower = hertz_depth(row.force, 1.0)
        assert upper + lower == pytest.approx(row.delta, rel=1e-3)
        assert row.base_approach == pytest.approx(lower, rel=2e-3)
        assert row.a_base == pytest.approx(lower**0.5, rel=0.01)

    @pytest.mark.parametrize("method", ["active_set", "penalty", "uzawa"])
    def test_all_contact_methods_agree(self, method: str) -> None:
        right = last_row(scene_of())
        row = last_row(scene_of(contact={"method": method}))
        assert row.force == pytest.approx(right.force, rel=5e-3)
        assert row.a_base == pytest.approx(right.a_base, rel=0.03)
        assert row.stiffness == pytest.approx(right.stiffness, rel=0.02)

    @pytest.mark.parametrize("factor", [1.0, 100.0])
    def test_the_spring_does_not_change_the_force(
        self, factor: float, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """The spring between body and flat is free of force once both forces agree, to 1e-10."""
        usual = last_row(scene_of())
        monkeypatch.setattr(resting_body, "SPRING_FACTOR", factor)
        other = last_row(scene_of())
        assert other.force == pytest.approx(usual.force, rel=1e-8)
        assert other.a == pytest.approx(usual.a, rel=1e-6)

    def test_energy_is_the_work_and_the_forces_balance(self) -> None:
        """Simpson's rule on F ~ delta^1.5 of 16 rows is exact to 1e-4 of the work."""
        rows = list(states(scene_of(loading={"delta": 0.0267, "steps": 16}), with_surface=False))
        depths = [0.0, *(row.delta for row in rows)]
        forces = [0.0, *(row.force for row in rows)]
        work = sum(
            (depths[k + 2] - depths[k]) / 6 * (forces[k] + 4 * forces[k + 1] + forces[k + 2])
            for k in range(0, 16, 2)
        )
        assert rows[-1].energy == pytest.approx(work, rel=1e-3)
        assert rows[-1].reaction == pytest.approx(rows[-1].force, rel=1e-9)
        slope = np.gradient(forces, depths)[-2]
        assert rows[-2].stiffness == pytest.approx(slope, rel=3e-3)

    @pytest.mark.parametrize("method", ["auto", "active_set"])
    def test_unloading_returns_to_the_same_rows(self, method: str) -> None:
        """An elastic body without friction or adhesion has one force at a depth, 0 at last."""
        path = {"loading": {"deltas": [0.01, 0.0267, 0.01, 1e-5, 0.0]}}
        rows = list(states(scene_of(contact={"method": method}, **path), with_surface=False))
        assert rows[2].force == pytest.approx(rows[0].force, rel=1e-8)
        assert rows[2].base_approach == pytest.approx(rows[0].base_approach, rel=1e-8)
        assert 0 < rows[3].force < 1e-4 * rows[1].force
        assert rows[3].reaction == pytest.approx(rows[3].force, rel=1e-8)
        assert (rows[4].force, rows[4].reaction, rows[4].a_base) == (0.0, 0.0, 0.0)

    def test_prescribed_forces_find_the_depths(self) -> None:
        row = last_row(scene_of())
        found = last_row(scene_of(loading={"force": row.force}))
        assert found.delta == pytest.approx(row.delta, rel=5e-4)

    def test_a_stiff_soft_tip_is_the_rigid_one(self) -> None:
        """Of E = 1e8: the expected radius, and with it the mesh, differs a little."""
        hard = {"model": "linear_elastic", "E": 1e8, "nu": 0.3}
        soft = last_row(scene_of(indenter={"shape": "sphere", "R": 1 / 3, "material": hard}))
        rigid = last_row(scene_of())
        assert soft.force == pytest.approx(rigid.force, rel=1e-6)
        assert soft.a_base == pytest.approx(rigid.a_base, rel=1e-4)

    def test_a_small_contact_with_a_soft_tip_is_hertz_in_series(self) -> None:
        """The compliance of the tip is added to that of the upper contact alone."""
        law = {"model": "linear_elastic", "E": 2.0, "nu": 0.45}
        tip = {"shape": "sphere", "R": 1.0, "material": law}
        row = last_row(scene_of(indenter=tip, loading={"delta": 2e-5}, mesh={"h_contact": 1e-4}))
        both = 1 / (1 / E_STAR + (1 - 0.45**2) / 2.0)
        depth = hertz_depth(row.force, 0.5, both) + hertz_depth(row.force, 1.0)
        assert depth == pytest.approx(row.delta, rel=4e-3)

    def test_a_cap_on_a_flat_may_lift(self) -> None:
        """A roller cannot lift, so that it is at least as stiff; the theorem holds on one mesh."""
        cap = {"shape": "cap", "base_radius": 2.0, "height": 0.5}
        rows = {
            base: last_row(
                scene_of(body={**cap, "base": base}, mesh={"h_contact": 0.01, "h_far": 0.04})
            )
            for base in ("unbonded", "roller")
        }
        assert 0.9 * rows["roller"].force < rows["unbonded"].force
        assert rows["unbonded"].force < rows["roller"].force * (1 + 1e-4)
        assert 0.5 < (rows["unbonded"].a_base or 0.0) < 1.9

    def test_an_overhanging_cap_touches_the_flat_beside_its_base(self) -> None:
        """A cap that is nearly a ball, on a base smaller than its contact.

        A ball must approach by 0.005 more to touch the flat on the same base. Without the contact
        of the overhang the cap would be several times softer.
        """
        depth = {"loading": {"delta": 0.1}, "mesh": {"h_contact": 0.01}, "indenter": PLATE}
        deeper = {**depth, "loading": {"delta": 0.1 + 1 - (1 - 0.1**2) ** 0.5}}
        height = 1 + (1 - 0.1**2) ** 0.5
        cap = {"shape": "cap", "base_radius": 0.1, "height": height, "base": "unbonded"}
        force = last_row(scene_of(body=cap, **depth)).force
        assert last_row(scene_of(**depth)).force < force
        assert force == pytest.approx(last_row(scene_of(**deeper)).force, rel=0.01)

    def test_error_bars_hold_against_another_method_on_a_finer_mesh(self, tmp_path: Any) -> None:
        """A bead of 7.5 um on glass, under a bead of 2.5 um, pressed by 0.2 um."""
        beads = {
            "body": {"shape": "ball", "radius": 7.5, "base": "unbonded"},
            "indenter": {"shape": "sphere", "R": 2.5},
            "loading": {"delta": 0.2},
        }
        quiet = {"fields": "none", "plot": False}
        outcome = simulate(
            document(**beads, output=quiet), directory=tmp_path / "beads", error_bars=True
        )
        fine = {"contact": {"method": "active_set"}, "mesh": {"h_contact": 0.02}}
        right = last_row(scene_of(**beads, **fine))
        row = outcome.states[-1]
        assert abs(row.force - right.force) <= (row.force_error or 0.0) <= 0.02 * right.force
        assert abs(row.a - right.a) <= (row.a_error or 0.0)
        assert row.a_base == pytest.approx(right.a_base, rel=0.02)


REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "friction": ({"contact": {"method": "augmented_lagrangian", "friction": 0.3}}, "friction"),
    "the whole body": ({"solver": {"method": "newton"}}, "static condensation"),
    "finite strain": (
        {"material": {"model": "neo_hookean", "E": 1.0, "nu": 0.3}},
        "needs a linear elastic body",
    ),
    "relaxation": (
        {
            "material": {**LAW, "relaxation": {"prony": [[0.5, 1.0]]}},
            "loading": {"history": [[0.0, 0.0], [1.0, 0.02]]},
        },
        "relaxation or a history",
    ),
    "yield": (
        {"material": {**LAW, "plasticity": {"yield_stress": 0.01}}},
        "may not yield",
    ),
    "adhesion": ({"experiment": {"adhesion": {"work": 1e-4}}}, "base_work"),
    "surface tension": (
        {
            "body": {
                "shape": "ball",
                "radius": 1.0,
                "base": "unbonded",
                "surface_tension": 0.1,
            }
        },
        "surface tension",
    ),
    "the current gap": (
        {"contact": {"method": "augmented_lagrangian", "gap": "current"}},
        "undeformed point",
    ),
    "nitsche": ({"contact": {"method": "nitsche"}}, "nitsche"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_not_modelled_is_refused(name: str) -> None:
    sections, message = REFUSED[name]
    with pytest.raises(ConfigError, match=message):
        scene_of(**sections)


def test_a_cylinder_cannot_rest_without_a_bond() -> None:
    cylinder = {"shape": "cylinder", "radius": 1.0, "height": 1.0, "base": "unbonded"}
    with pytest.raises(ConfigError, match="fixed or roller"):
        scene_of(body=cylinder)


@pytest.mark.verify
def test_error_bars_hold_in_random_scenes(tmp_path: Any) -> None:
    """Against the active set method on a mesh 4 times finer: 97 % of the forces, 95 % of the radii.

    The radius of the lower contact has no error bar; it is as accurate as a, 1 %.
    """
    count = 12
    held = {"force": 0, "a": 0}
    for number, sections in enumerate(contact_scenes(count, 9, "resting bodies")):
        quiet = {"fields": "none", "plot": False}
        outcome = simulate(
            {**sections, "output": quiet}, directory=tmp_path / str(number), error_bars=True
        )
        row = outcome.states[-1]
        scene = resolve(config_from_mapping(sections))
        h = scene.sizes.h_contact * scene.physics.scales.length
        fine = {"mesh": {"h_contact": h / 4}, "contact": {"method": "active_set"}}
        right = last_row(resolve(config_from_mapping({**sections, **fine})))
        held["force"] += abs(row.force - right.force) <= (row.force_error or 0.0)
        held["a"] += abs(row.a - right.a) <= (row.a_error or 0.0)
        assert row.reaction == pytest.approx(row.force, rel=1e-8)
        assert row.a_base == pytest.approx(right.a_base, rel=0.01)
    assert held["force"] >= 0.97 * count - 1
    assert held["a"] >= 0.95 * count - 1
