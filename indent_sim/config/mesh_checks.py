"""Checks of the element sizes and of a mesh from a file."""

from __future__ import annotations

from collections.abc import Iterator

from indent_sim.config.path_checks import path_problem
from indent_sim.config.scene_sections import MeshSettings, SceneSections
from indent_sim.model.imported_body import MeshFromFile
from indent_sim.process.errors import ConfigError

# Keys of `mesh` that set element sizes.
MESH_SIZE_KEYS = (
    "h_contact",
    "h_axis",
    "h_edge",
    "h_corner",
    "h_film",
    "h_inclusions",
    "h_layers",
    "h_far",
    "grading",
)


def accuracy_errors(config: SceneSections) -> list[ConfigError]:
    """Return an error for every given element size that `accuracy` would choose."""
    given = _given_mesh_keys(config.mesh, "refinements") if config.accuracy is not None else []
    return [
        ConfigError(
            key, "cannot be combined with accuracy, which determines it", "give one of the two"
        )
        for key in given
    ]


def _given_mesh_keys(mesh: MeshSettings, extra_key: str) -> list[str]:
    """Return the given keys of element sizes, and one more key if it is given."""
    return [
        f"mesh.{name}"
        for name in (*MESH_SIZE_KEYS, extra_key)
        if getattr(mesh, name) not in (None, "auto")
    ]


def mesh_file_errors(config: SceneSections) -> Iterator[ConfigError]:
    """Yield errors in the keys of a mesh from a file.

    The element sizes of such a mesh are given, refinements apply only to such a mesh, and the file
    must be in the folder of the scene.
    """
    body = config.body
    mesh = config.mesh
    if not isinstance(body, MeshFromFile):
        if mesh.refinements is not None:
            yield ConfigError(
                "mesh.refinements",
                "applies only to body.shape: mesh",
                "leave it out, or give h_contact",
            )
        return
    problem = "applies only to bodies that the program meshes, but this body has a mesh from a file"
    for key in _given_mesh_keys(mesh, "symmetry"):
        yield ConfigError(key, problem, "leave it out, or refine the mesh with mesh.refinements")
    if problem := path_problem(body.file, "the scene's folder"):
        yield ConfigError("body.file", problem, "put the mesh into the folder of the scene file")
    if body.kinematics == "axisymmetric" and any(config.center or ()):
        problem = "the tip is on the axis of an axisymmetric mesh"
        yield ConfigError("indenter.center", problem, "leave it out, or use kinematics: 3d")
