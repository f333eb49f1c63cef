"""Bodies from mesh files: what is read, refused with which message, and kept by refinement."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import pytest
from mesh_files import block, section, write

from indent_sim.config.scene_file import load, loads
from indent_sim.mesh import mesh_import
from indent_sim.mesh.grid import boundary_facets, iterate_facets
from indent_sim.mesh.imported_domain import ImportedDomain, first_contact_height, refine_domain
from indent_sim.mesh.imported_mesh import ImportedMesh, boundary_cells_of
from indent_sim.mesh.uniform_refinement import refined_once
from indent_sim.model.imported_body import MeshFromFile, MeshSurfaces
from indent_sim.model.tips import Paraboloid
from indent_sim.process.errors import ConfigError, MeshFileError
from indent_sim.scene.imported_body import read_mesh_file
from indent_sim.scene.scene import Scene, resolve

SURFACES = MeshSurfaces("top", "bottom", "wall")
SCENE = """
body:
  shape: mesh
  file: {file}
  kinematics: {kinematics}
  surfaces: {{contact: top, base: bottom, sides: wall}}
material: {{model: linear_elastic, E: 1.0, nu: 0.3}}
indenter: {{shape: paraboloid, R: 1.0}}
loading: {{delta: 0.02}}
"""


def piece(
    folder: Path,
    body: dict[str, Any],
    kinematics: Any = "axisymmetric",
    name: str = "part.msh",
    surfaces: MeshSurfaces = SURFACES,
    has_material: bool = True,
    **others: Any,
) -> ImportedMesh:
    """Imported mesh of a body that is first written to a file."""
    write(folder / name, body)
    source = MeshFromFile(name, kinematics, surfaces, **others)
    return mesh_import.import_mesh(str(folder), source, has_material)


def scene(
    folder: Path, name: str = "part.msh", kinematics: str = "axisymmetric", *settings: str
) -> Scene:
    """Scene of a mesh file in a folder."""
    (folder / "scene.yaml").write_text(
        SCENE.format(file=name, kinematics=kinematics), encoding="utf-8"
    )
    return resolve(load(folder / "scene.yaml", settings))


def volume(found: ImportedMesh) -> float:
    """Volume or area of all cells together."""
    corners = found.grid.points[found.grid.cells]
    return float(np.linalg.det(corners[:, 1:] - corners[:, :1]).sum()) / (
        2 if found.dim == 2 else 6
    )


# ---- what is read


@pytest.mark.parametrize("name", ["part.msh", "part.inp"])
@pytest.mark.parametrize(("body", "kinematics"), [(section(), "axisymmetric"), (block(), "3d")])
def test_all_kinds_of_files_with_names_hold_the_same_body(
    tmp_path: Path, name: str, body: dict[str, Any], kinematics: str
) -> None:
    found = piece(tmp_path, body, kinematics, name)
    assert volume(found) == pytest.approx(2.0 if kinematics == "axisymmetric" else 4.0, rel=1e-12)
    for surface, given in (("top", "top"), ("base", "bottom"), ("sides", "wall")):
        assert len(found.grid.surfaces[surface]) == len(body["facets"][given])


@pytest.mark.parametrize("name", ["part.vtu", "part.xdmf"])
@pytest.mark.parametrize(("body", "kinematics"), [(section(), "plane_strain"), (block(), "3d")])
def test_files_without_names_have_numbers_at_their_cells(
    tmp_path: Path, name: str, body: dict[str, Any], kinematics: str
) -> None:
    found = piece(tmp_path, body, kinematics, name, MeshSurfaces("part=1", "part=2", "part=3"))
    assert (
        np.ptp(found.facet_corners("top")[..., -1]) == 0
        and np.ptp(found.facet_corners("base")[..., -1]) == 0
    )


def test_sets_of_points_name_the_facets_between_them(tmp_path: Path) -> None:
    body = section()
    write(tmp_path / "part.inp", body)
    text = (tmp_path / "part.inp").read_text(encoding="utf-8")
    top = ", ".join(str(k + 1) for k in np.flatnonzero(body["points"][:, 1] == 0))
    (tmp_path / "part.inp").write_text(f"{text}*NSET, NSET=skin\n{top}\n", encoding="utf-8")
    source = MeshFromFile("part.inp", "plane_strain", MeshSurfaces("skin", "bottom"))
    found = mesh_import.import_mesh(str(tmp_path), source, True)
    assert len(found.grid.surfaces["top"]) == 8


@pytest.mark.parametrize(("body", "kinematics"), [(section(), "axisymmetric"), (block(), "3d")])
def test_the_copy_of_a_piece_is_the_piece(
    tmp_path: Path, body: dict[str, Any], kinematics: Any
) -> None:
    """A mesh written as text and imported again has the same hash, which is that of all bytes."""
    body["points"][:, :2] *= 1 / 3
    found = piece(tmp_path, body, kinematics, has_material=False, regions={"gel": None})
    source = MeshFromFile("copy.msh", kinematics, SURFACES, regions={"gel": None})  # type: ignore[dict-item]
    (tmp_path / "copy.msh").write_text("".join(found.msh_text(source)), encoding="utf-8")
    again = mesh_import.import_mesh(str(tmp_path), source, False)
    assert again.hash == found.hash and again.region_names == found.region_names == ("gel",)


def test_a_material_of_no_cell_makes_no_region(tmp_path: Path) -> None:
    """A material that no cell has makes no region, as where every layer has its own."""
    assert piece(tmp_path, section(), regions={"gel": None}).region_names == ("gel",)


@pytest.mark.parametrize("indenter", ["{shape: paraboloid, R: 1}", "{shape: cone, half_angle: 70}"])
def test_half_of_a_symmetric_section_is_cut_where_the_tip_stands(
    tmp_path: Path, indenter: str
) -> None:
    """A half section with the tip at its edge gets a contact radius and no reference theory."""
    write(tmp_path / "part.msh", section())
    found = scene(tmp_path, "part.msh", "plane_strain", f"indenter={indenter}", "body.sides=free")
    assert found.sizes.a > 0 and not found.plan.theory


def test_the_order_of_corners_is_not_the_shape(tmp_path: Path) -> None:
    """A cell with reversed corners is turned over; only overlapping cells are inverted."""
    body = section()
    body["cells"][::2] = body["cells"][::2, ::-1]
    assert volume(piece(tmp_path, body)) == pytest.approx(2.0, rel=1e-12)


# ---- surfaces without names


def without_names(body: dict[str, Any]) -> dict[str, Any]:
    """Return the cells without groups, as gmsh writes them where no group was asked for."""
    return body | {"facets": {}, "regions": {}}


@pytest.mark.parametrize("name", ["part.msh", "part.xdmf", "part.vtu", "part.inp"])
@pytest.mark.parametrize(("body", "kinematics"), [(section(), "axisymmetric"), (block(), "3d")])
def test_cells_alone_have_the_surfaces_that_their_names_would_give(
    tmp_path: Path, name: str, body: dict[str, Any], kinematics: Any
) -> None:
    """Without groups, surfaces are found by the direction in which they face.

    A box has the four named faces, and a tilted base is refused with a hint.
    """
    body["points"][:, -1 if kinematics == "3d" else 1] += (
        body["points"][:, 0] / 10
    )  # tilted: the base is not level
    with pytest.raises(
        MeshFileError,
        match="boundary faces down and is horizontal; name it in gmsh: Physical",
    ):
        piece(tmp_path, without_names(body), kinematics, name, MeshSurfaces())
    body["points"][:, -1 if kinematics == "3d" else 1] -= body["points"][:, 0] / 10
    bare = piece(tmp_path, without_names(body), kinematics, name, MeshSurfaces(), sides="fixed")
    if kinematics == "3d":
        body["facets"]["wall"] = np.array(
            [
                facet
                for facet in boundary_facets(body["cells"])[0]
                if np.ptp(body["points"][facet], axis=0)[2] > 0
            ]
        )
    named = piece(tmp_path, body, kinematics, "named.msh", sides="fixed")
    for surface in ("top", "base", "sides"):
        found, given = (
            np.unique(
                one.grid.points[one.grid.surfaces[surface]].reshape(-1, one.dim).round(9), axis=0
            )
            for one in (bare, named)
        )
        assert np.array_equal(found, given)
        assert len(bare.grid.surfaces[surface]) == len(named.grid.surfaces[surface])
    source = MeshFromFile(
        "copy.msh",
        kinematics,
        MeshFromFile("", kinematics, sides="fixed").surface_names,
        sides="fixed",
    )
    (tmp_path / "copy.msh").write_text("".join(bare.msh_text(source)), encoding="utf-8")
    assert mesh_import.import_mesh(str(tmp_path), source, True).hash == bare.hash


def test_names_that_a_file_without_any_cannot_have(tmp_path: Path) -> None:
    with pytest.raises(
        MeshFileError, match=r'has no named lines and thus no .top.; .* Physical Curve\("top"\)'
    ) as found:
        piece(tmp_path, without_names(section()))
    assert found.value.exit_code == 4 and found.value.key == "body.surfaces.contact"


def test_a_surface_by_where_it_faces_leaves_what_has_a_name(tmp_path: Path) -> None:
    """A surface found by its direction leaves out facets that belong to a group."""
    body = section()
    body["facets"] = {"half": body["facets"]["top"][:4]}
    found = piece(tmp_path, body, "plane_strain", surfaces=MeshSurfaces(sides="half"))
    assert len(found.grid.surfaces["top"]) == 4 and len(found.grid.surfaces["base"]) == 8


def test_what_faces_up_or_down_at_two_heights_must_be_named(tmp_path: Path) -> None:
    body = section()
    _stepped(body)
    with pytest.raises(MeshFileError, match="no single part of the boundary faces down"):
        piece(tmp_path, without_names(body), surfaces=MeshSurfaces())
    body["facets"] = {"bottom": body["facets"]["bottom"]}
    with pytest.raises(ConfigError, match="parts of the contact surface lie above one another"):
        piece(tmp_path, body, surfaces=MeshSurfaces(base="bottom"))


# ---- refinement


@pytest.mark.parametrize(("body", "kinematics"), [(section(), "axisymmetric"), (block(), "3d")])
def test_refinement_keeps_the_body_and_its_surfaces(
    tmp_path: Path, body: dict[str, Any], kinematics: Any
) -> None:
    coarse = piece(tmp_path, body, kinematics)
    fine = refined_once(refined_once(coarse))
    assert len(fine.grid.cells) == 4**coarse.dim * len(coarse.grid.cells)
    assert volume(fine) == pytest.approx(volume(coarse), rel=1e-12)
    outside, _ = boundary_facets(fine.grid.cells)
    outer = {tuple(sorted(facet)) for facet in outside.tolist()}
    for name, facets in fine.grid.surfaces.items():
        assert len(facets) == 4 ** (coarse.dim - 1) * len(coarse.grid.surfaces[name])
        assert {tuple(sorted(facet)) for facet in facets.tolist()} <= outer


def test_refinement_puts_new_corners_on_midside_nodes(tmp_path: Path) -> None:
    """Refinement of quadratic cells places new corners on their midside nodes.

    The top is a quadratic arc through (0, 0), (0.5, 0.06) and (1, 0).
    """
    points = np.array(
        [
            (0, -1),
            (1, -1),
            (1, 0),
            (0, 0),
            (0.5, -1),
            (1, -0.5),
            (0.5, 0.06),
            (0, -0.5),
            (0.5, -0.5),
        ]
    )
    cells = [(0, 1, 2, 4, 5, 8), (0, 2, 3, 8, 6, 7)]
    groups = {"top": (2, 3), "bottom": (0, 1), "wall": (1, 2)}
    lines = [f"{k + 1} 1 2 {k + 1} 1 {a + 1} {b + 1}" for k, (a, b) in enumerate(groups.values())]
    lines += [
        f"{k + 4} 9 2 9 1 {' '.join(str(c + 1) for c in cell)}" for k, cell in enumerate(cells)
    ]
    nodes = [f"{k + 1} {x} {y} 0" for k, (x, y) in enumerate(points)]
    names = [f'1 {k + 1} "{name}"' for k, name in enumerate(groups)]
    (tmp_path / "part.msh").write_text(
        "\n".join(
            [
                "$MeshFormat",
                "2.2 0 8",
                "$EndMeshFormat",
                "$PhysicalNames",
                "3",
                *names,
                "$EndPhysicalNames",
                "$Nodes",
                "9",
                *nodes,
                "$EndNodes",
                "$Elements",
                "5",
                *lines,
                "$EndElements",
                "",
            ]
        ),
        encoding="utf-8",
    )
    source = MeshFromFile("part.msh", "plane_strain", SURFACES)
    found = mesh_import.import_mesh(str(tmp_path), source, True)
    assert len(found.grid.points) == 4
    top = refined_once(found).facet_corners("top").reshape(-1, 2)
    assert sorted(map(tuple, top.tolist())) == [(0.0, 0.0), (0.5, 0.06), (0.5, 0.06), (1.0, 0.0)]
    # where it is curved a tip touches it at the midside node, though the unrefined mesh has no
    # point there
    assert first_contact_height(Paraboloid(R=1e9), found, (0.5,)) == pytest.approx(0.06, abs=1e-9)


# ---- the skin of a body


@pytest.mark.parametrize(
    ("body", "kinematics"), [(section(), "axisymmetric"), (block(n=8, m=6), "3d")]
)
def test_a_scene_of_the_skin_is_that_of_the_body(
    tmp_path: Path, body: dict[str, Any], kinematics: Any
) -> None:
    """The boundary cells of a mesh give the sizes, choices, pins and grid of the whole mesh."""
    body["regions"] = {
        "gel": np.flatnonzero(np.arange(len(body["cells"])) % 3),
        "rest": np.arange(0),
    }
    write(tmp_path / "part.msh", body)
    regions = "body.regions={gel: {model: linear_elastic, E: 2.0, nu: 0.3}}"
    whole = scene(tmp_path, "part.msh", kinematics, regions, "mesh.refinements=1")
    config = load(tmp_path / "scene.yaml", (regions, "mesh.refinements=1"))
    assert isinstance(config.body, MeshFromFile)
    skin = boundary_cells_of(read_mesh_file(config, config.body))
    found = resolve(config, piece=skin)
    assert found.sizes == whole.sizes and found.plan.choices == whole.plan.choices
    assert (
        found.physics.body.height == whole.physics.body.height
        and found.plan.prediction == whole.plan.prediction
    )
    parts = [one.physics.domain for one in (found, whole)]
    assert isinstance(parts[0], ImportedDomain) and isinstance(parts[1], ImportedDomain)
    assert parts[0].pins == parts[1].pins and parts[0].extent == parts[1].extent
    grids = [refine_domain(part, whole.sizes) for part in parts]
    assert grids[0].hash == grids[1].hash and np.array_equal(grids[0].regions, grids[1].regions)
    for name, facets in grids[1].surfaces.items():
        assert np.array_equal(grids[0].surfaces[name], facets)
    assert len(skin.grid.cells) < len(body["cells"]) or kinematics == "axisymmetric"


@pytest.mark.parametrize("body", [section(), block()])
def test_facets_in_lots_are_all_facets_and_neighbours_stay_together(body: dict[str, Any]) -> None:
    cells = body["cells"]
    lots = list(iterate_facets(cells, chunk_size=50))
    assert len(lots) > 1 and sum(len(facets) for facets, _, _ in lots) == cells.size
    seen: set[tuple[int, ...]] = set()
    for facets, cell, corner in lots:
        here = {tuple(sorted(facet)) for facet in facets.tolist()}
        assert not here & seen
        seen |= here
        whole = np.sort(np.column_stack([facets, cells[cell, corner]]), axis=1)
        assert np.array_equal(whole, np.sort(cells[cell], axis=1))


# ---- where the tip touches


def test_first_touch_of_a_slope_is_beside_the_axis(tmp_path: Path) -> None:
    """First contact on a slope z = x/10 under a paraboloid lies 0.005 higher, at x = R/10."""
    body = section()
    body["points"][:, 0] -= 1
    body["points"][:, 1] += body["points"][:, 0] / 10 * (1 + body["points"][:, 1])
    found = piece(tmp_path, body, "plane_strain")
    assert first_contact_height(Paraboloid(R=1.0), found, (0.0,)) == pytest.approx(0.005, abs=1e-9)


def test_any_height_is_the_same_scene(tmp_path: Path) -> None:
    """A body at z = 3 gives the scene of the same body at z = 0."""
    body = section()
    write(tmp_path / "part.msh", body)
    low = scene(tmp_path)
    body["points"][:, 1] += 3.0
    write(tmp_path / "high.msh", body)
    high = scene(tmp_path, "high.msh")
    assert high.physics.domain.extent == low.physics.domain.extent == ((0.0, 2.0), (-1.0, 0.0))
    assert high.physics.deltas == low.physics.deltas and high.sizes == low.sizes


def test_facets_that_look_like_a_curved_surface_are_told_of(tmp_path: Path) -> None:
    """Facets of a curved surface are warned of, with their sagitta h^2/16.

    For z = -x^2/4 and h = 1/4 it is 1/256, beside a depth of 0.02.
    """
    body = section(1.0, 1.0, 4, 4)
    body["points"][:, 1] -= body["points"][:, 0] ** 2 / 4 * (1 + body["points"][:, 1])
    write(tmp_path / "part.msh", body)
    found = scene(tmp_path)
    part = found.physics.domain
    assert isinstance(part, ImportedDomain)
    assert part.facet_sagitta((0.0, 0.0), 0.3) == pytest.approx(
        1 / 256, rel=0.05
    )  # but for the squares of slopes up to 0.2
    assert any(doubt.key == "facets" for doubt in found.plan.model_warnings)
    write(tmp_path / "part.msh", section())
    assert not any(doubt.key == "facets" for doubt in scene(tmp_path).plan.model_warnings)


# ---- what is refused


def _pulled(body: dict[str, Any]) -> None:
    inside = int(np.flatnonzero((body["points"][:, 0] == 1.0) & (body["points"][:, 1] == -0.5))[0])
    body["points"][inside, 0] = 1.6  # beyond the next nodes


def _flat(body: dict[str, Any]) -> None:
    body["points"][body["points"][:, 1] > -0.6, 1] = 0.0


def _torn(body: dict[str, Any]) -> None:
    half = body["points"][body["cells"]][:, :, 0].mean(axis=1) > 1
    body["cells"][half] += len(body["points"])
    body["points"] = np.vstack([body["points"], body["points"]])
    body["facets"] = {
        "top": body["facets"]["top"][:4],
        "bottom": body["facets"]["bottom"][:4],
        "wall": body["facets"]["wall"] + len(body["points"]) // 2,
    }


def _swapped(body: dict[str, Any]) -> None:
    body["facets"]["top"], body["facets"]["bottom"] = (
        body["facets"]["bottom"],
        body["facets"]["top"],
    )


def _named_inside(body: dict[str, Any]) -> None:
    body["facets"]["top"] = np.array([[20, 21]])


def _shared(body: dict[str, Any]) -> None:
    body["facets"]["bottom"] = body["facets"]["wall"]


def _sideways(body: dict[str, Any]) -> None:
    body["facets"]["top"], body["facets"]["wall"] = body["facets"]["wall"], body["facets"]["top"]


def _stepped(body: dict[str, Any]) -> None:
    """Cut a notch into the wall, so that its floor lies below the top."""
    x, z = body["points"][body["cells"]].mean(axis=1)[:, :2].T
    body["cells"] = body["cells"][~((x > 1) & (z > -0.75) & (z < -0.5))]
    body["regions"] = {"gel": np.arange(len(body["cells"]))}
    floor = np.flatnonzero((body["points"][:, 1] == -0.75) & (body["points"][:, 0] >= 1))
    body["facets"]["top"] = np.vstack(
        [body["facets"]["top"], np.column_stack([floor[:-1], floor[1:]])]
    )
    body["facets"]["wall"] = body["facets"]["wall"][:1]


def _left(body: dict[str, Any]) -> None:
    body["points"][:, 0] -= 0.5


def _tilted(body: dict[str, Any]) -> None:
    body["points"][:, 2] = body["points"][:, 0]


def _lines_alone(body: dict[str, Any]) -> None:
    body["regions"] = {"gel": np.arange(0)}
    body["cells"] = body["cells"][:0]


MALFORMED: list[tuple[Callable[[dict[str, Any]], None], str, str]] = [
    (_pulled, "body.file", "cells are inverted and overlap an adjacent cell, the first at"),
    (_flat, "body.file", "cells have no volume, the first at"),
    (_torn, "body.file", "the mesh is in 2 pieces that share no points; merge double points"),
    (_swapped, "body.surfaces.contact", "8 facets of 'top' face down, the first at"),
    (_sideways, "body.surfaces.contact", "4 facets of 'top' face sideways, the first at"),
    (
        _named_inside,
        "body.surfaces.contact",
        "1 facets of 'top' are not on the boundary of the body, the first at",
    ),
    (_shared, "body.surfaces.sides", "'wall' shares facets with another surface"),
    (_stepped, "body.surfaces.contact", "parts of 'top' lie above one another at"),
    (_left, "body.kinematics", "points of the section have r = -0.5; move the section to r >= 0"),
    (_tilted, "body.kinematics", "the triangles do not lie in one plane z = const"),
    (
        _lines_alone,
        "body.file",
        "the file has lines, but a body in 2 dimensions is made of triangles",
    ),
]


@pytest.mark.parametrize(
    ("spoil", "key", "words"), MALFORMED, ids=[spoil.__name__[1:] for spoil, _, _ in MALFORMED]
)
def test_a_malformed_mesh_has_its_message(
    tmp_path: Path, spoil: Callable[[dict[str, Any]], None], key: str, words: str
) -> None:
    body = section()
    spoil(body)
    with pytest.raises(ConfigError) as refused:
        piece(tmp_path, body)
    assert refused.value.key == key and words in str(refused.value)


@pytest.mark.parametrize(
    ("setting", "key", "words"),
    [
        (
            "body.surfaces.contact=roof",
            "body.surfaces.contact",
            "no group 'roof'; the file has bottom, gel, ",
        ),
        (
            "body.surfaces.base=gel",
            "body.surfaces.base",
            "'gel' is a group of triangles, but lines are needed here",
        ),
        ("body.kinematics=3d", "body.kinematics", "a body in 3 dimensions is made of tetrahedra"),
        (
            "body.regions={top: {model: linear_elastic, E: 1.0, nu: 0.3}}",
            "body.regions.top",
            "is a group of lines",
        ),
        (
            "indenter.center=[5.0, 0.0]",
            "indenter.center",
            "the tip is on the axis of an axisymmetric mesh",
        ),
        (
            "indenter={shape: pyramid, half_angle: 65.0, faces: 3}",
            "indenter.shape",
            "is not a tip of revolution",
        ),
        ("mesh.h_contact=0.1", "mesh.h_contact", "applies only to bodies that the program meshes"),
        ("mesh.symmetry=full", "mesh.symmetry", "applies only to bodies that the program meshes"),
        ("body.hash=0123456789abcdef", "body.hash", "'part.msh' is not the mesh of this scene"),
        ("body.file=other.msh", "body.file", "cannot read the mesh 'other.msh': No such file"),
        (
            "body.file=scene.yaml",
            "body.file",
            "has no known file extension; its name must end in one of .msh, .xdmf, .vtu, .inp",
        ),
        (
            "body.file=/etc/passwd",
            "body.file",
            "must be below the scene's folder, not absolute and without ..",
        ),
        (
            "body.file=../part.msh",
            "body.file",
            "must be below the scene's folder, not absolute and without ..",
        ),
    ],
)
def test_a_scene_that_does_not_fit_its_mesh_has_its_message(
    tmp_path: Path, setting: str, key: str, words: str
) -> None:
    write(tmp_path / "part.msh", section())
    with pytest.raises(ConfigError) as refused:
        scene(tmp_path, "part.msh", "axisymmetric", setting)
    assert refused.value.key == key and words in str(refused.value)


def test_a_mesh_is_part_of_no_other_shape() -> None:
    with pytest.raises(ConfigError, match="applies only to body"):
        loads(
            "body: {shape: cylinder, radius: 1.0, height: 1.0}\nmaterial: {model: "
            "linear_elastic, E: 1.0, nu: 0.3}\n"
            "indenter: {shape: cone, half_angle: 70.0}\nloading: {delta: 0.1}\nmesh: "
            "{refinements: 1}\n"
        )


@pytest.mark.parametrize(
    ("suffix", "points", "cells", "words"),
    [
        (".vtu", np.zeros((3, 6)), [[0, 1, 2]], "two or three real coordinates"),
        (".xdmf", np.full((3, 3), np.nan), [[0, 1, 2]], "are not finite or exceed 1e"),
        (".xdmf", np.full((3, 3), 1e200), [[0, 1, 2]], "are not finite or exceed 1e"),
        (".vtu", np.eye(3), np.array([[0.0, 1.4, 2.0]]), "is not a mesh that can be read"),
        (".xdmf", np.eye(3), np.array([[0.0, 1.4, 2.0]]), "corners are not indices of points"),
        (".xdmf", np.eye(3), [[0, 1, 9]], "corners that are not points of the file"),
    ],
)
def test_points_are_real_and_corners_are_whole(
    tmp_path: Path, suffix: str, points: np.ndarray, cells: Any, words: str
) -> None:
    mesh = meshio.Mesh(points, [("triangle", np.asarray(cells))])
    path = tmp_path / f"part{suffix}"
    mesh.write(path, **({"data_format": "XML"} if suffix == ".xdmf" else {"binary": False}))
    with pytest.raises(MeshFileError, match=words):
        scene(tmp_path, path.name)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("*NODE\n", "*NODE\n1, 0., 0.\n*NODE\n", "several lists of nodes"),
        ("*ELEMENT, TYPE=", "*ELEMENT, ELSET=gel, TYPE=", "without an ELSET of their own"),
    ],
)
def test_an_abaqus_file_that_its_reader_mistakes_is_refused(
    tmp_path: Path, old: str, new: str, words: str
) -> None:
    """Abaqus files that meshio misreads are refused.

    It keeps the last of several lists of nodes, and gives the first ELSET to the first block.
    """
    path = write(tmp_path / "part.inp", section())
    path.write_text(path.read_text(encoding="utf-8").replace(old, new), encoding="utf-8")
    with pytest.raises(MeshFileError, match=words):
        scene(tmp_path, "part.inp")


def test_a_file_in_several_pieces_is_refused(tmp_path: Path) -> None:
    """A VTU file in several pieces is refused, because meshio keeps the last one alone."""
    path = write(tmp_path / "part.vtu", section())
    text = path.read_bytes()
    begin, end = text.index(b"<Piece"), text.index(b"</Piece>") + len(b"</Piece>")
    path.write_bytes(text[:end] + text[begin:end] + text[end:])
    with pytest.raises(MeshFileError, match="several pieces"):
        scene(tmp_path, "part.vtu")


# ---- files of strangers


def test_links_lead_nowhere(tmp_path: Path) -> None:
    (tmp_path / "inside").mkdir()
    write(tmp_path / "part.msh", section())
    (tmp_path / "inside" / "part.msh").symlink_to(tmp_path / "part.msh")
    with pytest.raises(ConfigError, match="leads out of the scene's folder through a link"):
        scene(tmp_path / "inside")


@pytest.mark.parametrize("word", ["*INCLUDE", "include", "*IN*CLUDE ", "\n *Include"])
def test_an_abaqus_file_includes_no_other(tmp_path: Path, word: str) -> None:
    """An include in an Abaqus file is refused in every spelling that its reader accepts."""
    (tmp_path / "part.inp").write_text(f"*NODE\n{word}, INPUT=/etc/passwd\n", encoding="utf-8")
    with pytest.raises(ConfigError, match="includes another file"):
        scene(tmp_path, "part.inp")


@pytest.mark.parametrize(
    ("form", "where"), [("Binary", "/etc/passwd"), ("HDF", "../part.h5:/data0")]
)
def test_an_xdmf_file_takes_numbers_from_beside_it_alone(
    tmp_path: Path, form: str, where: str
) -> None:
    write(tmp_path / "part.xdmf", section())
    text = (tmp_path / "part.xdmf").read_text(encoding="utf-8")
    text = text.replace("part.h5:/data0", where).replace('Format="HDF"', f'Format="{form}"', 1)
    (tmp_path / "part.xdmf").write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match="refers to data in"):
        scene(tmp_path, "part.xdmf")


def external_numbers(store: h5py.File) -> None:
    store.create_dataset("data0", (4, 2), "f8", external=[("/etc/passwd", 0, 64)])


def external_link(store: h5py.File) -> None:
    store["data0"] = h5py.ExternalLink("other.h5", "/data0")


def soft_link_onto_it(store: h5py.File) -> None:
    store["away"] = h5py.ExternalLink("other.h5", "/data0")
    store["data0"] = h5py.SoftLink("/away")


def soft_link(store: h5py.File) -> None:
    store["data0"] = h5py.SoftLink("/data1")


def virtual_numbers(store: h5py.File) -> None:
    layout = h5py.VirtualLayout((45, 3), "f8")
    layout[:] = h5py.VirtualSource("other.h5", "data0", (45, 3))
    store.create_virtual_dataset("data0", layout)


def references(store: h5py.File) -> None:
    store.create_dataset("data0", data=[store["data1"].ref] * 3, dtype=h5py.ref_dtype)


def words(store: h5py.File) -> None:
    store["data0"] = np.full((45, 3), b"0.5", dtype="S3")


def complex_numbers(store: h5py.File) -> None:
    store["data0"] = np.full((45, 3), 1 + 2j)


def a_group(store: h5py.File) -> None:
    store.create_group("data0")


ELSEWHERE = [
    external_numbers,
    external_link,
    soft_link_onto_it,
    soft_link,
    virtual_numbers,
    a_group,
]
NOT_REAL = [references, words, complex_numbers]


def with_numbers(folder: Path, kept: Callable[[h5py.File], None]) -> None:
    """XDMF file whose points are stored by `kept` in its HDF5 file; a copy has them unchanged."""
    write(folder / "part.xdmf", section())
    shutil.copy(folder / "part.h5", folder / "other.h5")
    with h5py.File(folder / "part.h5", "a") as store:
        del store["data0"]
        kept(store)


@pytest.mark.parametrize(
    ("kept", "said"),
    [
        *((kept, "which are stored outside of 'part.h5'") for kept in ELSEWHERE),
        *((k, "which are not real") for k in NOT_REAL),
    ],
)
def test_an_hdf5_file_has_its_numbers_itself(
    tmp_path: Path, kept: Callable[[h5py.File], None], said: str
) -> None:
    with_numbers(tmp_path, kept)
    with pytest.raises(MeshFileError, match=f"refers to data in '/data0'.*{said}"):
        scene(tmp_path, "part.xdmf")


def test_no_link_on_the_way_to_numbers_leads_out(tmp_path: Path) -> None:
    """Links out of the HDF5 file are refused at every level and in every XML element."""
    with_numbers(tmp_path, lambda store: store.update(away=h5py.ExternalLink("other.h5", "/")))
    text = (tmp_path / "part.xdmf").read_text(encoding="utf-8")
    text = text.replace("/data0", "/away/data0").replace("DataItem", "Anything")
    (tmp_path / "part.xdmf").write_text(text, encoding="utf-8")
    with pytest.raises(MeshFileError, match="refers to data in '/away/data0'"):
        scene(tmp_path, "part.xdmf")


def unfolding_numbers(store: h5py.File) -> None:
    store.create_dataset("data0", (2**40, 3), "f8", chunks=(2**16, 3), compression="gzip")


def zeros_that_take_no_room(store: h5py.File) -> None:
    store.create_dataset("data0", (2**26, 3), "f8", chunks=(2**16, 3))  # 1.6 GB


@pytest.mark.parametrize("kept", [unfolding_numbers, zeros_that_take_no_room])
def test_a_few_bytes_do_not_fill_the_memory(
    tmp_path: Path, kept: Callable[[h5py.File], None]
) -> None:
    with_numbers(tmp_path, kept)
    with pytest.raises(MeshFileError, match="reading may take 10 s and 500 MB"):
        scene(tmp_path, "part.xdmf")


@pytest.mark.parametrize("name", ["part.msh", "part.xdmf", "part.vtu", "part.inp"])
@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"no mesh\n",
        b"\x00\xff" * 50,
        b"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n",
        b"*NODE\n1, a, b\n",
        b"<Xdmf/>",
    ],
)
def test_what_is_no_mesh_is_an_error_of_the_scene(
    tmp_path: Path, name: str, content: bytes
) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ConfigError) as refused:
        scene(tmp_path, name)
    assert refused.value.key in ("body.file", "body.kinematics")
