"""Impossible bodies are refused with their exit code, key and a helpful message."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from mesh_files import section, write

from indent_sim.config.scene_file import load
from indent_sim.config.strict_yaml import dump
from indent_sim.process.errors import ConfigError
from indent_sim.scene.scene import resolve

ELASTIC = {"model": "linear_elastic", "E": 1.0, "nu": 0.3}
CYLINDER = {"shape": "cylinder", "radius": 2.0, "height": 1.0}
STRIP = {"shape": "strip", "width": 4.0, "height": 1.0}
BOX = {"shape": "box", "size": [2.0, 2.0, 1.0]}
CAP = {"shape": "cap", "base_radius": 2.0, "height": 1.0}
EGG = {"shape": "ellipsoid", "radius": 1.0, "height": 1.0}
BALL = {"shape": "ball", "radius": 1.0}
HALF_SPACE = {"shape": "half_space"}
LAYER = {"shape": "layer", "height": 1.0}
FILE = {
    "shape": "mesh",
    "file": "part.msh",
    "kinematics": "axisymmetric",
    "surfaces": {"contact": "top", "base": "bottom", "sides": "wall"},
}

POINT = """$MeshFormat
2.2 0 8
$EndMeshFormat
$Nodes
1
1 0 0 0
$EndNodes
$Elements
0
$EndElements
"""


def layers(*thicknesses: Any) -> dict[str, Any]:
    return {"layers": [{"thickness": h} if h is not None else {} for h in thicknesses]}


def ball(x: float, y: float, z: float, radius: float = 0.2, **others: Any) -> dict[str, Any]:
    return {"shape": "ball", "center": [x, y, z], "radius": radius, "material": ELASTIC} | others


def upright(x: float, y: float, z: float, radius: float, height: float) -> dict[str, Any]:
    return {
        "shape": "cylinder",
        "center": [x, y, z],
        "radius": radius,
        "height": height,
        "material": ELASTIC,
    }


def brick(x: float, y: float, z: float, *size: float) -> dict[str, Any]:
    return {"shape": "box", "center": [x, y, z], "size": list(size), "material": ELASTIC}


def egg(x: float, y: float, z: float, *semi_axes: float) -> dict[str, Any]:
    return {
        "shape": "ellipsoid",
        "center": [x, y, z],
        "semi_axes": list(semi_axes),
        "material": ELASTIC,
    }


def holding(body: dict[str, Any], *inclusions: Any) -> dict[str, Any]:
    return body | {"inclusions": list(inclusions)}


# body, key, fragment of the message
MALFORMED: list[tuple[dict[str, Any], str, str]] = [
    # layers
    (
        CYLINDER | layers(0.4, 2.0),
        "body.layers",
        "the total thickness of the layers is 2.4, but the body is 1 high",
    ),
    (CYLINDER | layers(0.4), "body.layers", "make their thicknesses add up to the height"),
    (BOX | layers(0.4, -0.6), "body.layers[1].thickness", "must be > 0, got -0.6"),
    (STRIP | layers(0.4, 0.0), "body.layers[1].thickness", "must be > 0, got 0"),
    (CYLINDER | layers(0.4, None), "body.layers[1].thickness", "missing; give a number > 0"),
    (CYLINDER | {"layers": []}, "body.layers", "a list of 1 to 50 sections, got []"),
    (CYLINDER | {"layers": {"thickness": 1.0}}, "body.layers", "a list of 1 to 50 sections"),
    (
        CYLINDER | {"layers": [1.0]},
        "body.layers[0]",
        "must be a mapping of keys to values, got 1.0",
    ),
    (
        CYLINDER | {"layers": [{"thickness": 1.0, "matter": "gel"}]},
        "body.layers[0].matter",
        "unknown key",
    ),
    (
        CYLINDER | {"layers": [{"thickness": 1.0, "material": {"model": "jelly"}}]},
        "body.layers[0].material.model",
        "there is no material 'jelly'",
    ),
    (CYLINDER | layers(1e-7, 1 - 1e-7), "body.layers[0].thickness", "too small compared"),
    (
        HALF_SPACE | layers(0.4, 1.0),
        "body.layers[1].thickness",
        "its substrate, which has no thickness",
    ),
    (HALF_SPACE | layers(None, None), "body.layers[0].thickness", "missing"),
    (LAYER | layers(0.4, None), "body.layers[1].thickness", "missing"),
    # sizes of bodies
    (BOX | {"size": [2.0, 2.0]}, "body.size", "a list of 3 numbers > 0"),
    (
        CYLINDER | {"radius": 1e6},
        "body.height",
        "lengths of a body may differ by a factor of at most 100000",
    ),
    (CAP | {"contact_angle": 53.0}, "body.contact_angle", "cannot be combined with height"),
    (
        EGG | {"height": 0.1},
        "body.height",
        "an ellipsoid with a height of 0.05 times its width is not modelled",
    ),
    (EGG | {"height": 21.0}, "body.height", "10.5 times its width is not modelled"),
    (EGG | layers(0.1, None), "body.layers", "'ellipsoid' has no parameter 'layers'"),
    (EGG | {"surface_tension": 1.0}, "body.surface_tension", "has no parameter"),
    # skins
    (
        CAP | layers(0.1, 0.9),
        "body.layers[1].thickness",
        "the last layer of a cap is its core, which has no thickness",
    ),
    (BALL | layers(0.1, 0.2), "body.layers[1].thickness", "the last layer of a ball is its core"),
    (BALL | layers(0.1), "body.layers[0].thickness", "is its core"),
    (BALL | layers(None, None), "body.layers[0].thickness", "missing"),
    (CAP | layers(0.1, None, None), "body.layers[1].thickness", "missing"),
    (BALL | layers(-0.1, None), "body.layers[0].thickness", "must be > 0"),
    (BALL | layers(0.0, None), "body.layers[0].thickness", "must be > 0"),
    (BALL | layers("thin", None), "body.layers[0].thickness", "a number"),
    (BALL | layers(1.0, None), "body.layers", "is 1, which leaves no core"),
    (BALL | layers(0.6, 0.5, None), "body.layers", "is 1.1, which leaves"),
    (BALL | {"base": "fixed"} | layers(1.2, None), "body.layers", "leaves no core"),
    (CAP | layers(1.0, None), "body.layers", "a core that does not reach the base"),
    (CAP | layers(0.99, None), "body.layers", "a core that does not reach the base"),
    (
        CAP | {"base_radius": 0.5} | layers(0.3, None),
        "body.layers",
        "a core that does not reach the base",
    ),
    (
        BALL | layers(5e-4, None),
        "body.layers",
        "0.0005 thick on a ball of radius 1 is too thin to mesh",
    ),
    (BALL | {"layers": [{"thickness": 0.1, "stuff": 1}, {}]}, "body.layers[0].stuff", ""),
    (BALL | {"layers": []}, "body.layers", "a list of 1 to 50 sections"),
    (BALL | {"layers": {"thickness": 0.1}}, "body.layers", "list"),
    (
        holding(BALL | {"base": "fixed"} | layers(0.1, None), ball(0, 0, -0.25)),
        "body.inclusions[0]",
        "crosses the inner face of body.layers[0], 0.1 below the surface, by 0.05",
    ),
    (
        holding(BALL | {"base": "fixed"} | layers(0.1, None), ball(0, 0, -1.75)),
        "body.inclusions[0]",
        "crosses the inner face of body.layers[0], 0.1 below the surface, by 0.05",
    ),
    (
        holding(BALL | {"base": "fixed"} | layers(0.1, None), ball(0, 0, -0.301)),
        "body.inclusions[0]",
        "is 0.001 from the inner face of body.layers[0]",
    ),
    (
        holding(CAP | layers(0.1, None), ball(0, 0, -0.301)),
        "body.inclusions[0]",
        "is 0.001 from the inner face of body.layers[0]",
    ),
    (
        holding(CAP | layers(0.2, 0.3, None), ball(0, 0, -0.6)),
        "body.inclusions[0]",
        "crosses the inner face of body.layers[1]",
    ),
    (
        holding(CAP | layers(0.1, None), upright(0, 0, -0.5, 1.2, 0.3)),
        "body.inclusions[0]",
        "crosses the inner face of body.layers[0]",
    ),
    # surface tension
    (BALL | {"surface_tension": -0.1}, "body.surface_tension", "must be >= 0"),
    (BALL | {"surface_tension": "wet"}, "body.surface_tension", "a number"),
    (
        FILE | {"surface_tension": 0.1},
        "body.surface_tension",
        "'mesh' has no parameter 'surface_tension'",
    ),
    (
        CYLINDER | {"layers": [{"thickness": 1.0, "surface_tension": 0.1}]},
        "body.layers[0].surface_tension",
        "",
    ),
    # ellipsoids
    (
        holding(CYLINDER, egg(0, 0, -0.2, 0.3, 0.3, 0.25)),
        "body.inclusions[0]",
        "crosses the top at z = 0: it spans z = -0.45",
    ),
    (
        holding(CYLINDER, egg(0, 0, -0.5, 0.3, 2.1, 0.2)),
        "body.inclusions[0]",
        "leaves the body through its side, by 0.1",
    ),
    (
        holding(BOX, egg(0.5, 1.0, -0.5, 0.6, 0.1, 0.2)),
        "body.inclusions[0]",
        "leaves the body through its side, by 0.1",
    ),
    (
        holding(CYLINDER, egg(0, 0, -0.5, 0.3, 0.2)),
        "body.inclusions[0].semi_axes",
        "a list of 3 numbers > 0",
    ),
    (
        holding(CYLINDER, egg(0, 0, -0.5, 0.3, 0.2, -0.1)),
        "body.inclusions[0].semi_axes[2]",
        "must be > 0",
    ),
    (
        holding(CYLINDER, egg(0, 0, -0.5, 0.3, 0.2, 0.0)),
        "body.inclusions[0].semi_axes[2]",
        "must be > 0",
    ),
    (
        holding(CYLINDER, egg(0, 0, -0.5, 0.3, 0.2, 0.1) | {"radius": 1.0}),
        "body.inclusions[0].radius",
        "no parameter",
    ),
    (
        holding(CAP, egg(0, 0, -0.5, 0.3, 0.2, 0.1)),
        "body.inclusions[0]",
        "semi-axes 0.3 along x and 0.2 along y differ",
    ),
    (holding(CAP, egg(0.1, 0, -0.5, 0.2, 0.2, 0.1)), "body.inclusions[0]", "is off the axis"),
    (
        holding(STRIP, egg(2.0, 0.1, -0.5, 0.2, 0.2, 0.1)),
        "body.inclusions[0]",
        "a strip is infinite along y",
    ),
    (
        holding(CYLINDER, egg(0, 0, -0.5, 0.5, 0.5, 0.1), ball(0, 0, -0.2505, radius=0.15)),
        "body.inclusions[1]",
        "overlaps or touches body.inclusions[0]",
    ),
    (
        holding(CYLINDER | layers(0.4, 0.6), egg(0, 0, -0.5, 0.5, 0.5, 0.15)),
        "body.inclusions[0]",
        "crosses the interface below body.layers[0] at z = -0.4",
    ),
    (
        holding(BALL | {"base": "fixed"} | layers(0.1, None), egg(0, 0, -1.0, 0.95, 0.95, 0.2)),
        "body.inclusions[0]",
        "crosses the inner face of body.layers[0], 0.1 below the surface, by 0.05",
    ),
    (
        holding(BALL | {"base": "fixed"} | layers(0.1, None), egg(0, 0, -1.0, 0.899, 0.899, 0.2)),
        "body.inclusions[0]",
        "is 0.001 from the inner face of body.layers[0]",
    ),
    # inclusions
    (
        holding(CYLINDER, ball(0, 0, -0.1)),
        "body.inclusions[0]",
        "crosses the top at z = 0: it spans z = -0.3 to 0.1",
    ),
    (holding(CYLINDER, ball(0, 0, -0.9)), "body.inclusions[0]", "crosses the base at z = -1"),
    (
        holding(CYLINDER, ball(0, 0, 0.5)),
        "body.inclusions[0]",
        "is outside the body, which spans z = -1 to 0",
    ),
    (holding(CYLINDER, ball(0, 0, -3.0)), "body.inclusions[0]", "is outside the body"),
    (
        holding(CYLINDER, ball(0, 0, -0.2005)),
        "body.inclusions[0]",
        "is 0.0005 from the top at z = 0; move it, or make it smaller: its distance from any "
        "surface must be at least 0.002",
    ),
    (
        holding(CYLINDER, ball(1.5, 1.5, -0.5)),
        "body.inclusions[0]",
        "leaves the body through its side, by 0.3213",
    ),
    (
        holding(CYLINDER, brick(1.3, 1.3, -0.5, 0.3, 0.3, 0.3)),
        "body.inclusions[0]",
        "leaves the body through its side",
    ),
    (
        holding(BOX, ball(0.1, 1.0, -0.5)),
        "body.inclusions[0]",
        "leaves the body through its side, by 0.1",
    ),
    (
        holding(STRIP, ball(3.9, 0, -0.5)),
        "body.inclusions[0]",
        "leaves the body through its side, by 0.1",
    ),
    (holding(STRIP, ball(2.0, 0.1, -0.5)), "body.inclusions[0]", "a strip is infinite along y"),
    (
        holding(CYLINDER | layers(0.4, 0.6), ball(0, 0, -0.5)),
        "body.inclusions[0]",
        "crosses the interface below body.layers[0] at z = -0.4: it spans z = -0.7 to -0.3",
    ),
    (
        holding(HALF_SPACE | layers(0.4, None), ball(0, 0, -0.5)),
        "body.inclusions[0]",
        "crosses the interface below body.layers[0]",
    ),
    (
        holding(CYLINDER, ball(0, 0, -0.3), ball(0.3, 0, -0.4)),
        "body.inclusions[1]",
        "overlaps or touches body.inclusions[0]",
    ),
    (
        holding(CYLINDER, ball(0, 0, -0.3), ball(0, 0, -0.7)),
        "body.inclusions[1]",
        "overlaps or touches",
    ),
    (
        holding(CYLINDER, upright(0, 0, -0.5, 0.5, 0.4), ball(0.6, 0, -0.5)),
        "body.inclusions[1]",
        "overlaps",
    ),
    (
        holding(CYLINDER, brick(0, 0, -0.5, 1, 1, 0.4), upright(0.6, 0, -0.5, 0.2, 0.2)),
        "body.inclusions[1]",
        "overlaps or touches",
    ),
    (holding(CYLINDER, ball(0, 0, -0.3), ball(0, 0, -0.3)), "body.inclusions[1]", "overlaps"),
    (
        holding(CAP, ball(0.1, 0, -0.5)),
        "body.inclusions[0]",
        "a cap is modelled as axisymmetric: the inclusion is off the axis",
    ),
    (
        holding(CAP, brick(0, 0, -0.5, 0.1, 0.1, 0.1)),
        "body.inclusions[0]",
        "a box is not axisymmetric",
    ),
    (
        holding(CAP, upright(0, 0, -0.5, 1.9, 0.2)),
        "body.inclusions[0]",
        "leaves the body through its side",
    ),
    (holding(BALL, ball(0, 0, -0.9)), "body.inclusions[0]", "crosses the mirror plane at z = -1"),
    (
        holding(BALL, ball(0, 0, -1.5)),
        "body.inclusions[0]",
        "is outside the body, which spans z = -1 to 0",
    ),
    (
        holding(CYLINDER, ball(0, 0, -0.5, radius=-0.1)),
        "body.inclusions[0].radius",
        "must be > 0, got -0.1",
    ),
    (
        holding(CYLINDER, ball(0, 0, -0.5, height=0.1)),
        "body.inclusions[0].height",
        "'ball' has no parameter 'height' (it belongs to cylinder)",
    ),
    (
        holding(CYLINDER, ball(0, 0, -0.5, center=[0, -0.5])),
        "body.inclusions[0].center",
        "must be a list of 3 numbers, got [0, -0.5]",
    ),
    (
        holding(CYLINDER, ball(0, 0, -0.5, material={"model": "linear_elastic", "E": 1.0})),
        "body.inclusions[0].material",
        "needs exactly two of E, nu",
    ),
    (
        holding(CYLINDER, ball(0, 0, -0.5, shape="egg")),
        "body.inclusions[0].shape",
        "choose one of ball, cylinder, box",
    ),
    (
        holding(CYLINDER, {"shape": "ball", "center": [0, 0, -0.5], "radius": 0.1}),
        "body.inclusions[0].material",
        "missing",
    ),
    (holding(CYLINDER), "body.inclusions", "a list of 1 to 50 sections, got []"),
    (holding(FILE, ball(0, 0, -0.5)), "body.inclusions", "'mesh' has no parameter 'inclusions'"),
    # meshes from files
    (FILE | {"file": "none.msh"}, "body.file", "cannot read the mesh 'none.msh'"),
    (FILE | {"file": "../part.msh"}, "body.file", "must be below the scene's folder"),
    (
        FILE | {"surfaces": {"contact": "lid", "base": "bottom"}},
        "body.surfaces.contact",
        "has no group 'lid'",
    ),
    (
        FILE | {"surfaces": {"contact": "gel", "base": "bottom"}},
        "body.surfaces.contact",
        "is a group of triangles",
    ),
    (
        FILE | {"surfaces": {"contact": "bottom", "base": "top"}},
        "body.surfaces.contact",
        "face down",
    ),
    (FILE | {"kinematics": "3d"}, "body.kinematics", "made of tetrahedra"),
    (FILE | {"regions": {"bone": ELASTIC}}, "body.regions.bone", "has no group 'bone'"),
]
NO_BODY = [
    (FILE | {"file": "text.msh"}, "body.file", "is not a mesh that can be read"),
    (
        FILE | {"file": "points.msh"},
        "body.file",
        "the file has no cells, but a body in 2 dimensions is made of triangles",
    ),
]


@pytest.mark.parametrize(
    ("body", "key", "words", "code"),
    [*((*row, 3) for row in MALFORMED), *((*row, 4) for row in NO_BODY)],
)
def test_a_malformed_body_has_its_message(
    tmp_path: Path, body: dict[str, Any], key: str, words: str, code: int
) -> None:
    write(tmp_path / "part.msh", section())
    (tmp_path / "text.msh").write_text("no mesh\n", encoding="utf-8")
    (tmp_path / "points.msh").write_text(POINT, encoding="utf-8")
    path = tmp_path / "scene.yaml"
    path.write_text(
        dump(
            {
                "body": body,
                "material": ELASTIC,
                "indenter": {"shape": "paraboloid", "R": 1.0},
                "loading": {"delta": 0.02},
            }
        ),
        encoding="utf-8",
    )
    with pytest.raises(ConfigError) as refused:
        resolve(load(path))
    found = getattr(refused.value, "errors", [refused.value])
    assert [error.key for error in found] == [key]
    assert words in str(refused.value) and refused.value.exit_code == code
