"""Error bars of random scenes that chose no constant.

The truth of a cap or ball is the force with 36 elements in the contact radius, extrapolated from 24
with the order 2.5; where independent values are known (test_round_bodies.py) it is good to 1e-5.
The truth of a mesh file is exact theory, or the same body meshed here with far more elements. That
of soft tips, resting bodies, and tips that are tilted or slide is the same scene on elements half
as large, which have a sixth of the error; of a tip that slides with steps a quarter as long.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from contact_scenes import Drawn, contact_scenes
from promised_bars import ROWS_OF_A_CLASS

from indent_sim.config.scene_file import config_from_mapping, load
from indent_sim.config.strict_yaml import dump
from indent_sim.model.state import State
from indent_sim.model.work import path_integral
from indent_sim.run.error_estimation.coarser_run import coarsen_scene, halve_increments
from indent_sim.run.pipeline import simulate, states
from indent_sim.run.work_and_loops import slide_work
from indent_sim.scene.scene import Scene, resolve

QUIET = {"fields": "none", "surface": "none", "plot": False}
NUMBERS = ("force", "p_max", "a")
NU = [0.0, 0.2, 0.3, 0.4, 0.45, 0.49, 0.4999]
COARSE, FINE, RATE = 24.0, 36.0, 2.5


class Tally:
    """Rows inside their bars, and bar over error, for each number."""

    def __init__(self) -> None:
        self.over: dict[str, list[float]] = {name: [] for name in NUMBERS}

    def add(self, name: str, found: float, bar: float | None, right: float) -> None:
        if bar is not None and found == found and right > 0:
            self.over[name].append(bar / max(abs(found - right), 1e-15 * right))

    def inside(self, name: str) -> float:
        """Share of rows inside their bars."""
        return float(np.mean(np.array(self.over[name]) >= 1))

    def median(self, name: str) -> float:
        """Median of bar over error."""
        return float(np.median(self.over[name]))

    def __str__(self) -> str:
        return "; ".join(
            (
                f"{name}: {100 * self.inside(name):.1f} % of {len(rows)} rows, bar over error "
                f"{self.median(name):.2g}"
            )
            for name, rows in self.over.items()
            if rows
        )


def round_scenes(count: int, seed: int = 3) -> list[dict[str, Any]]:
    """Caps and balls of any angle, support and material under tips of all kinds."""
    draw = np.random.default_rng(seed)

    def spread(low: float, high: float) -> float:
        return float(np.exp(draw.uniform(np.log(low), np.log(high))))

    def one() -> dict[str, Any]:
        base, angle = str(draw.choice(["fixed", "roller"])), float(draw.uniform(15, 160))
        body: dict[str, Any] = {"shape": "ball", "radius": 1.0, "base": base}
        height = R = 1.0
        if draw.random() < 0.5:
            body = {"shape": "cap", "base_radius": 1.0, "contact_angle": angle, "base": base}
            height = float(np.tan(np.radians(angle / 2)))
            R = (1 + height**2) / (2 * height)
        tip = str(
            draw.choice(
                ["plate", "sphere", "paraboloid", "cone", "flat_punch"], p=[0.3, 0.3, 0.2, 0.1, 0.1]
            )
        )
        small = min(height, R)
        sizes = {
            "cone": {"half_angle": float(draw.uniform(70, 87))},
            "plate": {},
            "flat_punch": {"radius": spread(0.05, 0.3) * small},
        }.get(tip, {"R": spread(0.2, 5) * R})
        nu, depth = (
            float(draw.choice([*NU, 0.5])),
            spread(0.004, 0.02 if tip == "flat_punch" else 0.06) * small,
        )
        material = {
            "model": "neo_hookean" if draw.random() < 0.08 else "linear_elastic",
            "E": 1.0,
            "nu": nu,
        }
        return {
            "body": body,
            "material": material,
            "indenter": {"shape": tip} | sizes,
            "output": QUIET,
            "loading": {"delta": depth, "steps": int(draw.integers(1, 6))},
        }

    return [one() for _ in range(count)]


def truth(mapping: dict[str, Any]) -> list[dict[str, float]]:
    """Force, peak pressure and radius of every row, extrapolated."""
    config = config_from_mapping(mapping | {"accuracy": 0.001})
    walks = [list(states(resolve(config, n), with_surface=False)) for n in (COARSE, FINE)]
    share = 1 / ((FINE / COARSE) ** RATE - 1)
    return [
        {
            "force": fine.force + share * (fine.force - coarse.force),
            "p_max": fine.p_max,
            "a": fine.a,
        }
        for coarse, fine in zip(*walks, strict=True)
    ]


def tallied(rows: list[State], right: list[dict[str, float]], tally: Tally) -> None:
    for state, exact in zip(rows, right, strict=True):
        for name, value in exact.items():
            tally.add(name, getattr(state, name), getattr(state, f"{name}_error"), value)


@pytest.mark.verify
def test_caps_and_balls_drawn_at_random(tmp_path: Path) -> None:
    """Random caps and balls meet their target, and their bars have the promised coverage.

    12 scenes of some 36 rows are run with 1 %, with 0.1 % and on automatic sizes.
    """
    scenes = round_scenes(12)
    right = [truth(mapping) for mapping in scenes]
    for target in (None, 0.01, 0.001):
        tally = Tally()
        for k, (mapping, exact) in enumerate(zip(scenes, right, strict=True)):
            config = config_from_mapping(mapping | ({"accuracy": target} if target else {}))
            rows = simulate(
                config, directory=tmp_path / f"{target}-{k}", error_bars=target is None
            ).states
            tallied(rows, exact, tally)
            worst = max(
                abs(row.force / one["force"] - 1) for row, one in zip(rows, exact, strict=True)
            )
            assert target is None or worst <= target, mapping
        print(target, tally)
        assert min(map(tally.inside, NUMBERS)) >= ROWS_OF_A_CLASS


def file_scenes(plane: int, solid: int, seed: int = 13) -> list[dict[str, Any]]:
    """Sections and blocks of height 1 with random element sizes, and their tips."""
    draw = np.random.default_rng(seed)

    def spread(low: float, high: float) -> float:
        return float(np.exp(draw.uniform(np.log(low), np.log(high))))

    def one(kinematics: str) -> dict[str, Any]:
        is_solid = kinematics == "3d"
        a, tip = (
            spread(0.2 if is_solid else 0.08, 0.5),
            str(draw.choice(["paraboloid", "sphere", "cone"])),
        )
        R, cone = spread(2, 6) * a, float(draw.uniform(75, 86))
        depth = (0.7 if a > 0.3 else 1.0) * (
            1.57 * a / np.tan(np.radians(cone)) if tip == "cone" else a * a / R
        )
        sides = "free" if kinematics == "axisymmetric" and draw.random() < 0.5 else "roller"
        return {
            "kinematics": kinematics,
            "width": float(draw.uniform(1.0, 2.5)),
            "held": {"base": str(draw.choice(["fixed", "roller"])), "sides": sides},
            "sizes": (
                a / (spread(1.3, 2.5) if is_solid else spread(2, 8)),
                spread(0.25 if is_solid else 0.1, 0.5),
                spread(0.1, 0.6),
            ),
            "refinements": int(draw.integers(0, 2 if is_solid else 3)),
            "sections": {
                "material": {"model": "linear_elastic", "E": 1.0, "nu": float(draw.choice(NU))},
                "indenter": {"shape": tip} | ({"half_angle": cone} if tip == "cone" else {"R": R}),
                "loading": {"delta": float(depth), "steps": int(draw.integers(1, 5))},
                "output": QUIET,
            },
        }

    kinds = [*draw.choice(["axisymmetric", "axisymmetric", "plane_strain"], plane), *["3d"] * solid]
    return [one(str(kind)) for kind in kinds]


def write_part(
    path: Path, kinematics: str, width: float, sizes: tuple[float, float, float]
) -> None:
    """Mesh a section or block by gmsh, with sizes growing from the first to the second."""
    import gmsh  # which takes a second to load, for tests that seldom run

    dim, (near, far, growth) = 3 if kinematics == "3d" else 2, sizes
    gmsh.initialize([], False)
    try:
        for option in (
            "General.Terminal",
            "Mesh.MeshSizeExtendFromBoundary",
            "Mesh.MeshSizeFromPoints",
        ):
            gmsh.option.setNumber(option, 0)
        if dim == 3:
            gmsh.model.occ.addBox(-width, -width, -1, 2 * width, 2 * width, 1)
        else:
            left = 0.0 if kinematics == "axisymmetric" else -width
            gmsh.model.occ.addRectangle(left, -1, 0, width - left, 1)
        gmsh.model.occ.synchronize()
        faces: dict[str, list[int]] = {"top": [], "bottom": [], "wall": []}
        for _, tag in gmsh.model.getEntities(dim - 1):
            box = gmsh.model.getBoundingBox(dim - 1, tag)
            low, high = box[dim - 1], box[dim + 2]
            is_axis = kinematics == "axisymmetric" and box[3] < 1e-5
            if not is_axis:
                faces["wall" if high - low > 0.5 else "top" if low > -0.5 else "bottom"].append(tag)
        for name, tags in faces.items():
            gmsh.model.setPhysicalName(dim - 1, gmsh.model.addPhysicalGroup(dim - 1, tags), name)
        gmsh.model.addPhysicalGroup(dim, [1])
        field, wanted = (
            gmsh.model.mesh.field,
            f"({near}+{growth}*Sqrt(x^2+y^2{'+z^2' if dim == 3 else ''}))",
        )
        field.setString(field.add("MathEval"), "F", f"0.5*({wanted}+{far}-Abs({wanted}-{far}))")
        field.setAsBackgroundMesh(1)
        gmsh.model.mesh.generate(dim)
        gmsh.write(str(path))
    finally:
        gmsh.finalize()


def drawn_here(scene: dict[str, Any]) -> dict[str, Any]:
    """The same body without a file."""
    width = scene["width"]
    shape = {
        "axisymmetric": {"shape": "cylinder", "radius": width, "height": 1.0},
        "plane_strain": {"shape": "strip", "width": 2 * width, "height": 1.0},
        "3d": {"shape": "box", "size": [2 * width, 2 * width, 1.0]},
    }[scene["kinematics"]]
    return {"body": shape | scene["held"]} | scene["sections"]


def forces_of(scene: dict[str, Any]) -> list[float]:
    """Forces by theory, or on meshes that leave 1e-4 (5e-4 in three dimensions)."""
    config = config_from_mapping(drawn_here(scene) | {"accuracy": 0.001})
    found = resolve(config, 8.0 if scene["kinematics"] == "3d" else 30.0)
    if (theory := found.exact_theory) is not None:
        return [
            one.force * found.physics.scales.force
            for one in theory.solutions_at_depths(found.physics.deltas) or []
        ]
    return [state.force for state in states(found, with_surface=False)]


@pytest.mark.verify
def test_mesh_files_drawn_at_random(tmp_path: Path) -> None:
    """Error bars of random mesh files have the promised coverage."""
    tally = Tally()
    for k, scene in enumerate(file_scenes(5, 1)):
        folder = tmp_path / str(k)
        folder.mkdir()
        write_part(folder / "part.msh", scene["kinematics"], scene["width"], scene["sizes"])
        body = {
            "shape": "mesh",
            "file": "part.msh",
            "kinematics": scene["kinematics"],
            "surfaces": {"contact": "top", "base": "bottom", "sides": "wall"},
        } | scene["held"]
        asked = {"mesh": {"refinements": scene["refinements"]}} if scene["refinements"] else {}
        (folder / "scene.yaml").write_text(
            dump({"body": body} | scene["sections"] | asked), encoding="utf-8"
        )
        rows = simulate(
            load(folder / "scene.yaml"), directory=folder / "run", error_bars=True
        ).states
        tallied(rows, [{"force": force} for force in forces_of(scene)], tally)
    print(tally)
    assert tally.inside("force") >= ROWS_OF_A_CLASS


# Number of scenes by kind, in `make test` and in `make verify`; test_resting_bodies.py has more.
QUICK = {
    "soft tips": 3,
    "resting bodies": 3,
    "two rubbers": 1,
    "tilted tips": 1,
    "sliding tips": 3,
}
LONG = {
    "soft tips": 12,
    "two rubbers": 4,
    "tilted tips": 6,
    "tilted tips in 3D": 1,
    "sliding tips": 12,
}
HALVINGS = 2  # of the steps of the reference of a tip that slides


def finer_rows(scene: Scene) -> list[State]:
    """Return the rows of a scene on smaller elements, and where it matters with shorter steps.

    Elements are half as large, in three dimensions 0.6 times as large.
    """
    scene = coarsen_scene(scene, 0.6 if scene.physics.domain.dim == 3 else 0.5)
    if not scene.physics.depends_on_step_size:
        return list(states(scene, with_surface=False))
    for _ in range(HALVINGS):
        halved = halve_increments(scene)
        assert halved is not None
        scene = halved
    return list(states(scene, with_surface=False))[2**HALVINGS - 1 :: 2**HALVINGS]


@pytest.mark.parametrize(
    ("kind", "count"),
    [*QUICK.items(), *(pytest.param(*given, marks=pytest.mark.verify) for given in LONG.items())],
)
def test_soft_resting_tilted_and_sliding_contacts(kind: str, count: int, tmp_path: Path) -> None:
    """Forces, radii and peak pressures of random contacts have the promised coverage."""
    tally = Tally()
    for k, mapping in enumerate(contact_scenes(count, 8, kind)):
        config = config_from_mapping(mapping | {"output": QUIET})
        rows = simulate(config, directory=tmp_path / str(k), error_bars=True).states
        scene = resolve(config)
        by_depth = scene.physics.path.control == "depth"
        numbers = [
            name
            for name in NUMBERS
            if (name != "force" or by_depth) and (name != "a" or scene.sizes.punch_edge is None)
        ]
        right = [
            {name: getattr(row, name) for name in numbers} for row in finer_rows(resolve(config))
        ]
        tallied(rows, right, tally)
    print(kind, tally)
    assert min(tally.inside(name) for name in NUMBERS if tally.over[name]) >= ROWS_OF_A_CLASS


@pytest.mark.parametrize(
    ("kind", "count"),
    [
        (kind, count) if count < 3 else pytest.param(kind, count, marks=pytest.mark.verify)
        for kind in ("soft tips", "resting bodies", "two rubbers", "tilted tips")
        for count in (1, 6)
    ],
)
def test_the_work_is_stored(kind: str, count: int) -> None:
    """The energy is the work of the tip to 1e-3, by Simpson's rule over 16 rows.

    Where the force grows as delta^1.5 from first contact, the rule is exact to 1e-4.
    """
    for mapping in contact_scenes(count, 6, kind):
        loading = mapping["loading"] | {"steps": 16}
        scene = resolve(config_from_mapping(mapping | {"loading": loading, "output": QUIET}))
        rows = list(states(scene, with_surface=False))
        forces = np.array([0.0, *(row.force for row in rows)])
        weights = np.array([1, *([4, 2] * 8)[:-1], 1]) * rows[0].delta / 3
        assert weights @ forces == pytest.approx(rows[-1].energy, rel=1e-3), mapping


def work_of(rows: list[State]) -> float:
    """Return the work of a tip along its rows, by trapezoids."""
    depths = np.array([row.delta for row in rows])
    forces = np.array([row.force for row in rows])
    return path_integral(depths, forces) + slide_work(rows, "side_force_x")


@pytest.mark.parametrize("count", [2, pytest.param(40, marks=pytest.mark.verify)])
def test_random_friction_loops_dissipate_their_work(count: int) -> None:
    """Dissipation and stored energy of a slide and of its last loop are the work of the tip.

    The difference is at most four times the error of the trapezoids, plus 1e-3 of the work of
    pressing for that of the first slip in a stretch, which lies between two rows. The error of the
    trapezoids is estimated from every second row.
    """
    stretch = 16
    drawn = Drawn(7)
    for _ in range(count):
        mapping = drawn.friction_loop(stretch) | {"output": QUIET}
        rows = list(states(resolve(config_from_mapping(mapping)), with_surface=False))
        for part in (rows[-2 * stretch - 1 :], rows[2:]):
            work = work_of(part)
            error = abs(work - work_of(part[::2])) / 3
            dissipated = sum(row.dissipation or 0.0 for row in part[1:])
            stored = part[-1].energy - part[0].energy
            assert dissipated > 0
            tolerance = 4 * error + 1e-3 * part[0].energy
            assert dissipated + stored == pytest.approx(work, abs=tolerance), mapping
