"""Soft tips: an elastic lens that is pressed onto an elastic body."""

from __future__ import annotations

from dataclasses import replace
from math import inf, pi
from typing import Any, ClassVar

import h5py
import numpy as np
import pytest

from indent_sim.config.quantities import pressure_keys
from indent_sim.config.scene_file import config_from_mapping
from indent_sim.model.state import State
from indent_sim.process.errors import ConfigError
from indent_sim.run.error_estimation.coarser_run import coarsen_scene
from indent_sim.run.pipeline import simulate, states
from indent_sim.scene.scene import Scene, resolve
from indent_sim.theory import profiles
from indent_sim.theory.layer import Layer
from indent_sim.theory.stack import Stack, StackLayer
from indent_sim.theory.stack_pair import StackPair
from indent_sim.theory.theory import Theory

BODY = StackLayer(1.0, 1.0, 0.3)
SOFT = StackLayer(0.5, 2.0, 0.45)
LAW = {"model": "linear_elastic", "E": 1.0, "nu": 0.3}
SOFT_LAW = {"model": "linear_elastic", "E": SOFT.E, "nu": SOFT.nu}
CAP = {"shape": "cap", "base_radius": 0.75**0.5, "height": 0.5}  # of a ball of radius 1


def scene_of(**sections: Any) -> Scene:
    """The scene of a lens on a wide layer, with other sections."""
    return resolve(config_from_mapping(document(**sections)))


def document(**sections: Any) -> dict[str, Any]:
    return {
        "body": {"shape": "cylinder", "radius": 6.0, "height": BODY.thickness, "base": "fixed"},
        "material": LAW,
        "indenter": {
            "shape": "paraboloid",
            "R": 1.0,
            "thickness": SOFT.thickness,
            "material": SOFT_LAW,
        },
        "loading": {"delta": 0.02},
        "mesh": {"h_contact": 0.02},
        **sections,
    }


def last_row(scene: Scene) -> State:
    return list(states(scene, with_surface=False))[-1]


def pair_theory(first: Stack, second: Stack) -> Layer:
    return Layer.from_stack(profiles.paraboloid(1.0), StackPair.join(first, second))


class TestTheory:
    """Two stacks that are pressed together, by one integral equation."""

    def test_two_layers(self) -> None:
        """Force and radius by an Abel-Nystrom solution of the summed compliance, to its digits."""
        contact = pair_theory(Stack((BODY,)), Stack((SOFT,))).solutions_at_depths([0.02])[0]
        assert contact.force == pytest.approx(0.003497095, rel=2e-7)
        assert contact.a == pytest.approx(0.150524, rel=3e-6)

    def test_adhesion_of_two_layers(self) -> None:
        """The pull-off of the same layers, by Griffith's balance on the independent solution."""
        contact = pair_theory(Stack((BODY,)), Stack((SOFT,)))
        pull_off = Theory("pair", contact).jkr(2e-4).pull_off(inf)
        assert pull_off.force == pytest.approx(-9.44180e-4, rel=1e-6)
        assert pull_off.delta == pytest.approx(-0.002410, rel=1e-3)

    def test_equal_layers_are_one_layer_at_half_the_approach(self) -> None:
        """The plane between two equal bodies stays plane: each sees a tip of twice the radius."""
        pair = pair_theory(Stack((BODY,)), Stack((BODY,))).solutions_at_depths([0.04])[0]
        alone = Layer.from_stack(profiles.paraboloid(2.0), Stack((BODY,)))
        assert pair.force == pytest.approx(alone.solutions_at_depths([0.02])[0].force, rel=1e-9)

    @pytest.mark.parametrize("unit", [0.01, 1.0, 100.0])
    def test_two_half_spaces_have_the_summed_compliance(self, unit: float) -> None:
        """Hertz with 1/E* = 1/E_1* + 1/E_2*, whatever the unit of the half-spaces."""
        pair = pair_theory(Stack.half_space(2.0, unit), Stack.half_space(3.0, 1.0))
        hertz = 4 / 3 / (1 / 2.0 + 1 / 3.0) * 0.02**1.5
        assert pair.solutions_at_depths([0.02])[0].force == pytest.approx(hertz, rel=1e-8)

    def test_a_thick_lens_on_a_half_space_of_any_unit(self) -> None:
        """A half-space has no thickness: its unit of length may not change the force."""
        forces = [
            pair_theory(Stack.half_space(1.0, unit), Stack((SOFT,)))
            .solutions_at_depths([0.02])[0]
            .force
            for unit in (1e-3, 0.1, 1.0, 1e3)
        ]
        assert np.ptp(forces) <= 1e-9 * forces[0]


class TestTwoMeshes:
    """Both bodies meshed, their compliances joined by a mortar projection."""

    @pytest.mark.parametrize(("h", "h_tip"), [(0.02, 0.02), (0.01, 0.02), (0.02, 0.007)])
    def test_two_layers_by_theory(self, h: float, h_tip: float) -> None:
        """7 elements in the contact, and a tip of coarser or finer elements.

        The force is within 5e-4 (measured: 1e-4 to 4.3e-4), the radius within a quarter of an
        element; interpolation in place of the mortar projection is 9e-3 wrong with the finer tip.
        """
        flat = scene_of(
            body={"shape": "cylinder", "radius": 6.0, "height": SOFT.thickness, "base": "fixed"},
            material=SOFT_LAW,
            indenter={"shape": "paraboloid", "R": 1.0},
            mesh={"h_contact": h_tip},
            solver={"method": "condensed"},
        )
        row = last_row(replace(scene_of(mesh={"h_contact": h}), tip_scene=flat))
        assert row.force == pytest.approx(0.003497095, rel=5e-4)
        assert row.a == pytest.approx(0.150524, abs=h / 4)
        assert row.intrusion == 0.0

    @pytest.mark.parametrize("delta", [0.02, 0.1])
    def test_twins_are_one_body_under_a_plate(self, delta: float) -> None:
        """Two equal caps are one cap under a plate at half the approach, by symmetry.

        Both meshes are equal, but a node of the plate's contact opens alone: 1e-4 of the force was
        measured to be at most 1.4e-4 with 4 elements in the contact.
        """
        lens = {"shape": "sphere", "R": 1.0, "thickness": 0.5, "material": LAW}
        twins = last_row(scene_of(body=CAP, indenter=lens, loading={"delta": delta}))
        plate = {"shape": "plate"}
        alone = last_row(scene_of(body=CAP, indenter=plate, loading={"delta": delta / 2}))
        assert twins.force == pytest.approx(alone.force, rel=2e-4)
        assert twins.energy == pytest.approx(2 * alone.energy, rel=2e-4)
        assert twins.tip_energy == pytest.approx(alone.energy, rel=2e-4)
        assert twins.tip_sink == pytest.approx(delta / 2, rel=5e-4)

    def test_a_stiff_tip_is_the_rigid_one(self) -> None:
        """Of E = 1e8: what is left is the tip's own compliance, some 1e-8."""
        hard = {"model": "linear_elastic", "E": 1e8, "nu": 0.3}
        tip = {"shape": "sphere", "R": 1.0, "thickness": 0.5}
        soft = last_row(scene_of(indenter={**tip, "material": hard}))
        rigid = last_row(scene_of(indenter={"shape": "sphere", "R": 1.0}))
        assert soft.force == pytest.approx(rigid.force, rel=1e-7)

    def test_a_small_contact_of_two_thick_bodies_is_hertz(self) -> None:
        """a/R = 0.009: Hertz with the summed compliance; finite bodies add 0.7 a, 0.6 %."""
        scene = scene_of(
            body={"shape": "half_space"},
            indenter={"shape": "sphere", "R": 1.0, "material": SOFT_LAW},
            loading={"delta": 8e-5},
            mesh={"h_contact": 1e-3},
        )
        E_star = scene.physics.contact_modulus * scene.physics.scales.pressure
        assert E_star == pytest.approx(1 / ((1 - 0.3**2) / 1.0 + (1 - 0.45**2) / 2.0))
        hertz = 4 / 3 * E_star * 8e-5**1.5
        assert last_row(scene).force == pytest.approx(hertz, rel=0.01)

    def test_energy_is_the_work(self) -> None:
        """Simpson's rule on F ~ delta^1.5 of 16 rows is exact to 1e-4 of the work."""
        rows = list(states(scene_of(loading={"delta": 0.02, "steps": 16}), with_surface=False))
        depths = [0.0, *(row.delta for row in rows)]
        forces = [0.0, *(row.force for row in rows)]
        work = np.sum(
            [
                (depths[k + 2] - depths[k]) / 6 * (forces[k] + 4 * forces[k + 1] + forces[k + 2])
                for k in range(0, 16, 2)
            ]
        )
        assert rows[-1].energy == pytest.approx(work, rel=1e-3)
        assert 0 < (rows[-1].tip_energy or 0.0) < rows[-1].energy

    def test_prescribed_forces_find_the_depths(self) -> None:
        """The expected radius, and with it the mesh, differs a little: 4e-6 of the depth."""
        row = last_row(scene_of())
        found = last_row(scene_of(loading={"force": row.force}))
        assert found.delta == pytest.approx(row.delta, rel=1e-4)

    def test_pull_off_of_the_pair(self, tmp_path: Any) -> None:
        """The JKR limit of two layers by theory: -9.4418e-4 (force control).

        The lens is a cap, not a layer, which changes the pull-off force of a contact that is small
        against its thickness by less than 1 %.
        """
        adhesion = {"adhesion": {"work": 2e-4}}
        outcome = simulate(
            document(experiment=adhesion, output={"fields": "none", "plot": False}),
            directory=tmp_path / "adhesive",
        )
        pull_off = outcome.report["experiment"]["adhesion"]["pull_off"]["force_control"]
        assert pull_off["force"] == pytest.approx(-9.4418e-4, rel=0.01)

    def test_the_drawn_tip_is_deformed(self, tmp_path: Any) -> None:
        """Within the contact the surfaces of tip and body coincide, and the holder does not."""
        lens = {"shape": "sphere", "R": 1.0, "thickness": 0.5, "material": LAW}
        outcome = simulate(
            document(indenter=lens, output={"plot": False}), directory=tmp_path / "lens"
        )
        row = outcome.states[-1]
        folder = tmp_path / "lens" / "fields"
        with h5py.File(folder / "mesh.h5") as mesh:
            tip = np.array(mesh["tip_points"])
        with h5py.File(sorted(folder.glob("step*"))[-1]) as step:
            lift = np.array(step["tip_displacement"])[:, 2] + row.delta
        assert lift[0] == pytest.approx(row.tip_sink, rel=1e-3)
        assert np.all(lift[tip[:, 2] > 0.5] == 0.0)
        assert np.all(np.diff(lift[tip[:, 0] < row.a]) <= 1e-6)

    def test_error_bars_hold_against_a_finer_mesh(self, tmp_path: Any) -> None:
        quiet = {"fields": "none", "plot": False}
        outcome = simulate(document(output=quiet), directory=tmp_path / "bars", error_bars=True)
        right = last_row(scene_of(mesh={"h_contact": 0.004}))
        row = outcome.states[-1]
        assert abs(row.force - right.force) <= (row.force_error or 0.0) <= 0.02 * right.force
        assert abs(row.a - right.a) <= (row.a_error or 0.0)
        assert not any("auxiliary" in warning for warning in outcome.report["warnings"])


class TestSoftCylinders:
    """Soft flat punches and soft plates: cylinders with free sides, bonded to a rigid holder."""

    CYLINDER: ClassVar = {"shape": "cylinder", "radius": 1.0, "height": 0.5, "base": "fixed"}

    @pytest.mark.parametrize("shape", ["flat_punch", "plate"])
    def test_twins_are_one_cylinder_under_a_rigid_plate(self, shape: str) -> None:
        """Two equal cylinders: the plane between them stays plane, each has half of the approach.

        Both bodies have the same mesh, with the size at the corners that is chosen for the tip; the
        contact ends at the edge of both.
        """
        tip = {"shape": shape, "radius": 1.0, "thickness": 0.5, "material": LAW}
        mesh = {"h_contact": 0.05}
        chosen = scene_of(body=self.CYLINDER, indenter=tip, mesh=mesh).tip_scene
        assert chosen is not None and chosen.sizes.h_corner is not None
        mesh["h_corner"] = chosen.sizes.h_corner * chosen.physics.scales.length
        twins = last_row(scene_of(body=self.CYLINDER, indenter=tip, mesh=mesh))
        half = {"loading": {"delta": 0.01}, "indenter": {"shape": "plate"}, "mesh": mesh}
        alone = last_row(scene_of(body=self.CYLINDER, **half))
        assert twins.force == pytest.approx(alone.force, rel=1e-4)
        assert twins.energy == pytest.approx(2 * alone.energy, rel=1e-4)
        assert twins.tip_sink == pytest.approx(0.01, rel=1e-3)

    def test_the_corners_of_a_soft_punch_are_resolved(self) -> None:
        """The rim at the holder is singular: 0.3 % of the force, for any accuracy, if not refined.

        The reference has elements 8 times smaller there, and elements in the contact half as large.
        """
        sections: dict[str, Any] = {
            "body": {"shape": "cylinder", "radius": 3.0, "height": 1.0, "base": "roller"},
            "indenter": {"shape": "flat_punch", "radius": 0.25, "thickness": 1.0}
            | {"material": {"model": "linear_elastic", "E": 0.8, "nu": 0.45}},
            "loading": {"delta": 0.006, "steps": 1},
        }
        scene = scene_of(**sections, accuracy=0.001, mesh={})
        assert scene.tip_scene is not None and scene.tip_scene.sizes.h_corner is not None
        fine = coarsen_scene(scene, 0.5)
        assert fine.tip_scene is not None
        h_corner = scene.tip_scene.sizes.h_corner / 8
        sizes = replace(fine.tip_scene.sizes, h_corner=h_corner)
        right = last_row(replace(fine, tip_scene=replace(fine.tip_scene, sizes=sizes)))
        assert last_row(scene).force == pytest.approx(right.force, rel=2e-4)

    def test_a_stiff_punch_is_the_rigid_one(self) -> None:
        """Of E = 1e8 on a body of E = 1: the compliance of the punch is left, some 1e-8."""
        hard = {"model": "linear_elastic", "E": 1e8, "nu": 0.3}
        punch = {"shape": "flat_punch", "radius": 0.5}
        mesh: dict[str, Any] = {"mesh": {"h_contact": 0.05}}
        soft = last_row(scene_of(indenter={**punch, "thickness": 1.0, "material": hard}, **mesh))
        rigid = last_row(scene_of(indenter=punch, **mesh))
        assert soft.force == pytest.approx(rigid.force, rel=1e-6)
        assert soft.a == pytest.approx(0.5)

    def test_a_stiff_plate_is_the_rigid_one(self) -> None:
        hard = {"model": "linear_elastic", "E": 1e8, "nu": 0.3}
        plate = {"shape": "plate", "radius": 1.0, "thickness": 1.0, "material": hard}
        soft = last_row(scene_of(body=CAP, indenter=plate))
        rigid = last_row(scene_of(body=CAP, indenter={"shape": "plate"}))
        assert soft.force == pytest.approx(rigid.force, rel=1e-6)

    def test_a_slender_punch_is_a_bar_above_the_body(self) -> None:
        """One unit of length more adds the compliance 1/(E A) of a bar.

        Both meshes differ at the edge of the contact, whose pressure is singular: 1.6e-3. Without
        the edge in the mortar projection a sixth of the compliance was missing.
        """
        punch = {"shape": "flat_punch", "radius": 0.1}
        mesh: dict[str, Any] = {"mesh": {"h_contact": 0.02}}
        compliances = []
        for thickness in (1.0, 2.0):
            tip = {**punch, "thickness": thickness, "material": LAW}
            row = last_row(scene_of(indenter=tip, **mesh))
            compliances.append(row.delta / row.force)
        assert compliances[1] - compliances[0] == pytest.approx(1 / (pi * 0.01), rel=3e-3)

    def test_a_ball_between_soft_plates_of_its_material(self) -> None:
        """A small contact with a thick plate is Hertz with the summed compliance.

        A contact of a/h = 0.018 on the cap adds 1.1 %.
        """
        plate = {"shape": "plate", "radius": 2.0, "thickness": 2.0, "material": SOFT_LAW}
        scene = scene_of(
            body=CAP, indenter=plate, loading={"delta": 8e-5}, mesh={"h_contact": 1e-3}
        )
        E_star = 1 / ((1 - 0.3**2) / 1.0 + (1 - 0.45**2) / 2.0)
        assert last_row(scene).force == pytest.approx(4 / 3 * E_star * 8e-5**1.5, rel=0.015)


REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "a soft punch of no thickness": (
        {"indenter": {"shape": "flat_punch", "radius": 0.5, "material": SOFT_LAW}},
        "missing: a soft flat_punch",
    ),
    "a soft punch with a rounded edge": (
        {
            "indenter": {
                "shape": "flat_punch",
                "radius": 0.5,
                "edge_radius": 0.1,
                "thickness": 1.0,
                "material": SOFT_LAW,
            }
        },
        "whose edge is sharp",
    ),
    "a soft plate of no radius": (
        {"indenter": {"shape": "plate", "thickness": 1.0, "material": SOFT_LAW}},
        "missing: a soft plate",
    ),
    "a soft plate that does not cover": (
        {"indenter": {"shape": "plate", "radius": 1.0, "thickness": 1.0, "material": SOFT_LAW}},
        "does not cover",
    ),
    "the radius of a rigid plate": (
        {"body": CAP, "indenter": {"shape": "plate", "radius": 1.0}},
        "is rigid and has no end",
    ),
    "a thickness of a rigid tip": (
        {"indenter": {"shape": "sphere", "R": 1.0, "thickness": 0.5}},
        "this tip is rigid",
    ),
    "more than half a ball": (
        {"indenter": {"shape": "sphere", "R": 1.0, "thickness": 1.1, "material": SOFT_LAW}},
        "must not exceed the radius",
    ),
    "friction": ({"contact": {"method": "augmented_lagrangian", "friction": 0.3}}, "friction"),
    "the whole body": ({"solver": {"method": "newton"}}, "static condensation"),
    "finite strain": (
        {"material": {"model": "neo_hookean", "E": 1.0, "nu": 0.3}},
        "needs a linear elastic body",
    ),
    "three dimensions": (
        {"body": {"shape": "box", "size": [2.0, 2.0, 1.0]}},
        "only axisymmetric bodies",
    ),
    "off the axis": (
        {"indenter": {"shape": "sphere", "R": 1.0, "material": SOFT_LAW, "center": [0.1, 0.0]}},
        "axisymmetric scenes only",
    ),
    "a body that yields": (
        {"material": {**LAW, "plasticity": {"yield_stress": 0.01}}},
        "does not yield",
    ),
    "a tip that yields": (
        {
            "indenter": {
                "shape": "sphere",
                "R": 1.0,
                "material": {**SOFT_LAW, "plasticity": {"yield_stress": 0.01}},
            }
        },
        "does not yield",
    ),
    "a tip that relaxes": (
        {
            "indenter": {
                "shape": "sphere",
                "R": 1.0,
                "material": {**SOFT_LAW, "relaxation": {"prony": [[0.5, 1.0]]}},
            }
        },
        "does not relax",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_not_modelled_is_refused(name: str) -> None:
    sections, message = REFUSED[name]
    with pytest.raises(ConfigError, match=message):
        scene_of(**sections)


def test_the_force_is_not_proportional_to_one_of_two_moduli() -> None:
    """A fit must solve the scene anew for every E, since the tip keeps its own."""
    keys = pressure_keys(config_from_mapping(document()))
    assert keys == ["material.E", "indenter.material.E"]


def test_the_scene_of_the_lens_has_its_sizes() -> None:
    scene = scene_of()
    lens = scene.tip_scene
    assert lens is not None
    assert lens.physics.scales.length == pytest.approx(0.5)
    assert lens.sizes.h_contact * lens.physics.scales.length == pytest.approx(0.02)
    area = pi * float(lens.physics.body.base_edge[0]) ** 2 * 0.25
    assert area == pytest.approx(pi * 0.75)
