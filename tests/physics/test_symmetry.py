"""The part of a body that is modelled has the force, radius and energy of the whole.

The mesh of the part is mirrored to make the whole's, so that the two are the same discrete problem
and agree to the solver's tolerance. What gmsh would make of the whole by itself differs by the mesh
error and is tested apart.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from scenes import BOX, PARABOLOID, STRIP, force, grid_of, scene, solve

from indent_sim.mesh import gmsh
from indent_sim.mesh.grid import Grid, named_surfaces, regions_of_cells
from indent_sim.model.state import State
from indent_sim.scene.scene import Scene

SAME = 1e-8  # of the force: Newton stops at 1e-10 of the reactions
DEEP = {"loading": {"delta": 0.04, "steps": 2}}
NUMBERS = ("force", "a", "p_max", "penetration", "energy", "reaction")


def mirrored(grid: Grid, axis: int, plane: float) -> Grid:
    """A grid and its mirror image, joined along the plane they share."""
    image = grid.points.copy()
    image[:, axis] = 2 * plane - image[:, axis]
    on_plane = np.abs(grid.points[:, axis] - plane) < 1e-9
    new = np.where(on_plane, np.arange(len(image)), len(image) + np.cumsum(~on_plane) - 1)
    points = np.vstack([grid.points, image[~on_plane]])
    return Grid(points, np.vstack([grid.cells, new[grid.cells]]))


def on_grid(base: Scene, grid: Grid, monkeypatch: pytest.MonkeyPatch) -> list[State]:
    """The states of a scene on a given grid."""
    part = base.physics.domain
    named = named_surfaces(grid.points, grid.cells, part, base.sizes.min_size)
    regions = regions_of_cells(grid.points, grid.cells, part)
    with monkeypatch.context() as patch:
        patch.setattr(
            gmsh,
            "build_mesh",
            lambda part, sizes: dataclasses.replace(grid, surfaces=named, regions=regions),
        )
        return solve(base)


def assert_same(part: list[State], whole: list[State]) -> None:
    """Assert that every number of every step is the same."""
    for one, other in zip(part, whole, strict=True):
        numbers = ([getattr(state, name) for name in NUMBERS] for state in (one, other))
        assert next(numbers) == pytest.approx(next(numbers), rel=SAME)


@pytest.mark.parametrize("sides", ["free", "roller", "fixed"])
@pytest.mark.parametrize("gap", ["reference", "current"])
def test_strip_by_its_half(gap: str, sides: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A strip in plane strain with the tip in the middle is the same by its half."""
    body, contact = STRIP | {"sides": sides}, {"method": "auto", "gap": gap}
    half, full = (
        scene(body, contact=contact, mesh={"h_contact": 0.03, "symmetry": symmetry}, **DEEP)
        for symmetry in ("half", "full")
    )
    assert (half.physics.domain.symmetry_factor, full.physics.domain.symmetry_factor) == (2, 1)
    grid = grid_of(half)
    assert_same(
        on_grid(half, grid, monkeypatch), on_grid(full, mirrored(grid, 0, 2.0), monkeypatch)
    )


@pytest.mark.parametrize(
    ("base", "sides", "gap", "method"),
    [
        pytest.param("fixed", "free", "current", "auto", marks=pytest.mark.verify),
        ("fixed", "free", "reference", "auto"),
        ("roller", "free", "reference", "penalty"),
    ],
)
def test_box_by_its_quarter_and_half(
    base: str, sides: str, gap: str, method: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A box with the tip in the middle is the same by its quarter and its half.

    On rollers the whole box is held by its pins alone.
    """
    body, contact = BOX | {"base": base, "sides": sides}, {"method": method, "gap": gap}
    quarter, half, full = (
        scene(body, contact=contact, mesh={"h_contact": 0.2, "symmetry": symmetry}, **DEEP)
        for symmetry in ("quarter", "half", "full")
    )
    assert (
        quarter.physics.domain.symmetry_factor,
        half.physics.domain.symmetry_factor,
        full.physics.domain.symmetry_factor,
    ) == (
        4,
        2,
        1,
    )
    grid = grid_of(quarter)
    by_quarter = on_grid(quarter, grid, monkeypatch)
    grid = mirrored(grid, 1, 1.0)
    assert_same(by_quarter, on_grid(half, grid, monkeypatch))
    assert_same(by_quarter, on_grid(full, mirrored(grid, 0, 1.0), monkeypatch))


def test_tip_beside_a_frictionless_wall_is_half_of_a_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    """A strip with the tip at its roller wall is half of one twice as wide.

    A wall that only holds sideways is a mirror; the wide strip has the tip in the middle.
    """
    wide = scene(
        STRIP | {"width": 4.0, "sides": "roller"}, mesh={"h_contact": 0.02, "symmetry": "full"}
    )
    narrow = scene(
        STRIP | {"width": 2.0, "sides": "roller"}, indenter=PARABOLOID | {"center": [0.0]}
    )
    sizes = dataclasses.replace(wide.sizes, axis=narrow.sizes.axis)
    narrow = dataclasses.replace(narrow.replace_physics(contact=wide.physics.contact), sizes=sizes)
    grid = grid_of(narrow)
    whole = Grid(mirrored(grid, 0, 0.0).points + np.array([2.0, 0.0]), mirrored(grid, 0, 0.0).cells)
    beside, middle = on_grid(narrow, grid, monkeypatch)[-1], on_grid(wide, whole, monkeypatch)[-1]
    assert 2 * beside.force == pytest.approx(middle.force, rel=SAME)
    assert 2 * beside.energy == pytest.approx(middle.energy, rel=SAME)
    assert 2 * beside.a == pytest.approx(middle.a, rel=SAME)  # half the width of what touches


@pytest.mark.parametrize("body", [STRIP, BOX], ids=["plane_strain", "box"])
def test_reduced_and_whole_on_meshes_of_their_own(body: dict[str, Any]) -> None:
    """Part and whole on meshes of their own differ by the mesh error.

    It is 0.5 % with three elements in the contact radius and 0.1 % with a dozen.
    """
    h, tolerance = (0.02, 1e-3) if body is STRIP else (0.12, 5e-3)
    part, whole = (
        force(
            scene(
                body,
                mesh={"h_contact": h, "symmetry": symmetry},
                loading={"delta": 0.09, "steps": 1},
            )
        )
        for symmetry in ("auto", "full")
    )
    assert whole == pytest.approx(part, rel=tolerance)


def test_choice_of_the_part() -> None:
    """The automatic part uses all symmetry that the sides and the tip's place leave."""
    off = PARABOLOID | {"center": [0.9, 1.0]}
    uneven = {"x_min": "roller", "x_max": "free", "y_min": "free", "y_max": "free"}
    assert scene(BOX).physics.domain.symmetry == "quarter"
    assert scene(BOX, indenter=off, mesh={"h_contact": 0.1}).physics.domain.symmetry == "half"
    assert scene(BOX | {"sides": uneven}, mesh={"h_contact": 0.1}).physics.domain.symmetry == "half"
    assert scene(STRIP).physics.domain.symmetry == "half"
    assert scene(STRIP, indenter=PARABOLOID | {"center": [1.9]}).physics.domain.symmetry == "full"


# ---- friction: a traction along the surface that the planes of symmetry mirror too

ROUGH = [(0.3, "reference"), ("stick", "reference"), (0.3, "current"), ("stick", "current")]


@pytest.mark.parametrize(("friction", "gap"), ROUGH)
def test_rough_strip_by_its_half(
    friction: float | str, gap: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With friction a strip is the same by its half, and the whole has no side force.

    The shear traction is odd across the mid-plane, where the half holds it at zero.
    """
    contact = {"method": "auto", "gap": gap, "friction": friction}
    half, full = (
        scene(STRIP, contact=contact, mesh={"h_contact": 0.05, "symmetry": symmetry}, **DEEP)
        for symmetry in ("half", "full")
    )
    grid = grid_of(half)
    whole = on_grid(full, mirrored(grid, axis=0, plane=half.physics.center[0]), monkeypatch)
    assert_same(on_grid(half, grid, monkeypatch), whole)
    assert abs(whole[-1].side_force_x) <= SAME * whole[-1].force


@pytest.mark.parametrize("friction", [0.3, pytest.param("stick", marks=pytest.mark.verify)])
def test_rough_box_by_its_quarter(friction: float | str, monkeypatch: pytest.MonkeyPatch) -> None:
    """With friction a box is the same by its quarter."""
    contact = {"method": "auto", "friction": friction}
    quarter, full = (
        scene(BOX, contact=contact, mesh={"h_contact": 0.2, "symmetry": symmetry}, **DEEP)
        for symmetry in ("quarter", "full")
    )
    grid = grid_of(quarter)
    whole = mirrored(
        mirrored(grid, axis=0, plane=quarter.physics.center[0]), 1, quarter.physics.center[1]
    )
    assert_same(on_grid(quarter, grid, monkeypatch), on_grid(full, whole, monkeypatch))


@pytest.mark.parametrize(("friction", "gap"), ROUGH)
def test_rough_strip_and_its_mirror_image(
    friction: float | str, gap: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A rough tip off the middle and its mirror image have one force and opposite side forces.

    The mesh is mirrored too.
    """
    contact = {"method": "auto", "gap": gap, "friction": friction}
    left, right = (
        scene(
            STRIP,
            contact=contact,
            mesh={"h_contact": 0.05},
            indenter=PARABOLOID | {"center": [x]},
            **DEEP,
        )
        for x in (1.4, 2.6)
    )
    grid = grid_of(left)
    image = Grid(grid.points * [-1.0, 1.0] + [4.0, 0.0], grid.cells)
    here, there = on_grid(left, grid, monkeypatch), on_grid(right, image, monkeypatch)
    assert_same(here, there)
    assert here[-1].side_force_x == pytest.approx(-there[-1].side_force_x, rel=1e-6)
    assert abs(here[-1].side_force_x) > 1e-6 * here[-1].force


@pytest.mark.parametrize("friction", [0.3, pytest.param("stick", marks=pytest.mark.verify)])
def test_rough_box_and_its_mirror_image(
    friction: float | str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A rough tip on a box and its mirror image in x have one force and opposite side forces in x.

    The tip is off the middle both ways; the side force in y is the same.
    """
    left, right = (
        scene(
            BOX,
            contact={"method": "auto", "friction": friction},
            mesh={"h_contact": 0.2},
            indenter=PARABOLOID | {"center": [x, 0.9]},
            **DEEP,
        )
        for x in (0.8, 1.2)
    )
    grid = grid_of(left)
    image = Grid(grid.points * [-1.0, 1.0, 1.0] + [2.0, 0.0, 0.0], grid.cells)
    here, there = on_grid(left, grid, monkeypatch), on_grid(right, image, monkeypatch)
    assert_same(here, there)
    size = here[-1].force
    assert here[-1].side_force_x == pytest.approx(-there[-1].side_force_x, abs=SAME * size)
    assert here[-1].side_force_y == pytest.approx(there[-1].side_force_y, abs=SAME * size)
    assert min(abs(here[-1].side_force_x), abs(here[-1].side_force_y)) > 1e-5 * size


def test_rough_strip_under_a_tip_over_its_edge(monkeypatch: pytest.MonkeyPatch) -> None:
    """A rough tip over a strip's lower or upper edge has one force and opposite side forces.

    Neither edge is a mirror plane.
    """
    left, right = (
        scene(
            STRIP | {"sides": "free"},
            contact={"friction": 0.3},
            mesh={"h_contact": 0.1},
            indenter=PARABOLOID | {"center": [x]},
            **DEEP,
        )
        for x in (0.0, 4.0)
    )
    grid = grid_of(left)
    image = Grid(grid.points * [-1.0, 1.0] + [4.0, 0.0], grid.cells)
    here, there = on_grid(left, grid, monkeypatch), on_grid(right, image, monkeypatch)
    assert_same(here, there)
    assert here[-1].side_force_x == pytest.approx(-there[-1].side_force_x, rel=1e-6)
    assert abs(here[-1].side_force_x) > 0.1 * here[-1].force  # the edge gives way to one side: 30 %


def test_rough_box_under_a_tip_over_its_edge(monkeypatch: pytest.MonkeyPatch) -> None:
    """A rough tip over a box's lower or upper edge in y has one force and opposite side forces."""
    near, far = (
        scene(
            BOX,
            contact={"friction": 0.3},
            mesh={"h_contact": 0.25},
            loading={"delta": 0.04, "steps": 1},
            indenter=PARABOLOID | {"center": [0.3, y]},
        )
        for y in (0.0, 2.0)
    )
    grid = grid_of(near)
    image = Grid(grid.points * [1.0, -1.0, 1.0] + [0.0, 2.0, 0.0], grid.cells)
    here, there = on_grid(near, grid, monkeypatch)[-1], on_grid(far, image, monkeypatch)[-1]
    assert there.force == pytest.approx(here.force, rel=SAME)
    assert here.side_force_x == pytest.approx(there.side_force_x, abs=SAME * here.force)
    assert here.side_force_y == pytest.approx(-there.side_force_y, abs=SAME * here.force)
    assert abs(here.side_force_y) > 0.1 * here.force


def test_a_roller_wall_under_the_tip_is_a_mirror_plane() -> None:
    """A tip at either roller wall has no side force: its image pushes back."""
    for x in (0.0, 4.0):
        assert (
            scene(
                STRIP, contact={"friction": 0.3}, indenter=PARABOLOID | {"center": [x]}
            ).physics.side_force_axes
            == {}
        )


def side_force_reasons(base: Scene) -> dict[str, str]:
    """Why side forces have no column, by the column."""
    return {
        choice.key: choice.why
        for choice in base.plan.choices
        if choice.key.startswith("side_force_")
    }


def test_rough_box_cut_by_a_roller_wall(monkeypatch: pytest.MonkeyPatch) -> None:
    """A body on one side of a roller wall through the tip takes half of the force and of the side
    force along the wall. Across it nothing pushes the whole tip, and the plan says so.
    """
    sections: dict[str, Any] = {
        "contact": {"method": "auto", "friction": 0.3},
        "mesh": {"h_contact": 0.2, "symmetry": "full"},
    } | DEEP
    cut_sides = {"x_min": "free", "x_max": "free", "y_min": "roller", "y_max": "free"}
    cut, whole = (
        scene(
            BOX | {"size": [2.0, width, 1.0], "sides": sides},
            indenter=PARABOLOID | {"center": [0.8, y]},
            **sections,
        )
        for width, sides, y in ((1.0, cut_sides, 0.0), (2.0, "free", 1.0))
    )
    grid = grid_of(cut)
    joined = mirrored(grid, axis=1, plane=0.0)
    moved = Grid(joined.points + np.array([0.0, 1.0, 0.0]), joined.cells)
    one = on_grid(cut, grid, monkeypatch)[-1]
    both = on_grid(whole, moved, monkeypatch)[-1]
    assert 2 * one.force == pytest.approx(both.force, rel=SAME)
    assert 2 * one.side_force_x == pytest.approx(both.side_force_x, abs=SAME * both.force)
    assert abs(both.side_force_x) > 1e-5 * both.force
    assert one.side_force_y is None
    assert abs(both.side_force_y) <= SAME * both.force
    reasons = side_force_reasons(cut)
    assert {*reasons} == {"side_force_y"} and "mirror image" in reasons["side_force_y"]
    assert side_force_reasons(whole) == {}


@pytest.mark.parametrize(
    ("body", "symmetry", "friction", "missing"),
    [
        (BOX, "quarter", 0.3, {"side_force_x", "side_force_y"}),
        (BOX, "full", 0.3, set()),
        (BOX, "quarter", 0.0, set()),
        (STRIP, "half", 0.3, {"side_force_x"}),
    ],
)
def test_side_forces_that_are_left_out_have_a_reason(
    body: dict[str, Any], symmetry: str, friction: float, missing: set[str]
) -> None:
    """Every side force is a column or is said to be zero."""
    base = scene(
        body,
        contact={"friction": friction},
        mesh={"h_contact": 0.2, "symmetry": symmetry},
    )
    assert {*side_force_reasons(base)} == missing
    assert not missing & {*base.physics.columns}


@pytest.mark.parametrize("method", ["newton", "condensed"])
def test_no_side_force_has_no_sign(method: str) -> None:
    """The side force is 0, not -0, once the tip has left."""
    strip = scene(
        STRIP | {"sides": "free"},
        contact={"friction": 0.3},
        mesh={"h_contact": 0.1},
        indenter=PARABOLOID | {"center": [1.4]},
        solver={"method": method},
        loading={"deltas": [0.02, -0.01]},
    )
    assert str(solve(strip)[-1].side_force_x) == "0.0"
