"""Element sizes of the config, and checks that the sizes of a scene can be meshed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from indent_sim.mesh.sizes import Sizes
from indent_sim.model.units import Scales
from indent_sim.process.errors import ConfigError
from indent_sim.scene.measured_constants import MIN_AXIS_SIZE, MIN_ELEMENT_SIZE
from indent_sim.scene.problem_setup import ProblemSetup
from indent_sim.scene.resolution import FixedSizes

if TYPE_CHECKING:
    from indent_sim.config.scene_sections import MeshSettings


def configured_sizes(
    mesh: MeshSettings, scales: Scales, height: float, edge: float | None
) -> FixedSizes:
    """Return the element sizes that the config gives.

    Parameters
    ----------
    mesh : MeshSettings
        The section `mesh` of the config.
    scales : Scales
        The scales of the problem.
    height : float
        Height of the model domain [length].
    edge : float or None
        Radius of an edge of the tip that needs small elements [length].

    Raises
    ------
    ConfigError
        If the sizes are inconsistent with each other or with the scene.
    """
    names = ("h_contact", "h_axis", "h_edge", "h_corner", "h_film", "h_far")
    lengths = {
        name: getattr(mesh, name) for name in names if getattr(mesh, name) not in (None, "auto")
    }
    h = lengths.get("h_contact", 0.0)
    if h and lengths.get("h_far", h) < h:
        raise ConfigError("mesh.h_far", "is smaller than h_contact", f"use at least {h:g}")
    if h > height * scales.length:
        raise ConfigError(
            "mesh.h_contact",
            "is larger than the height of the body",
            f"use at most {height * scales.length:g}",
        )
    for name in ("h_axis", "h_edge", "h_corner", "h_film"):
        if name in lengths and not h:
            problem = "needs h_contact, to which the element size grows"
            raise ConfigError(f"mesh.{name}", problem, "give both keys")
        if lengths.get(name, 0.0) > h:
            raise ConfigError(f"mesh.{name}", "is larger than h_contact", f"use at most {h:g}")
    if edge is None and "h_edge" in lengths:
        problem = "applies only to the sharp edge of a punch, or of a tip that ends in the contact"
        raise ConfigError("mesh.h_edge", problem, "leave it out")
    grading = None if mesh.grading == "auto" else mesh.grading
    return FixedSizes(
        **{name: length / scales.length for name, length in lengths.items()}, grading=grading
    )


def check_sizes(sizes: Sizes, setup: ProblemSetup, longest_side: float) -> None:
    """Raise ConfigError for sizes that cannot be meshed.

    Parameters
    ----------
    sizes : Sizes
        The element sizes.
    setup : ProblemSetup
        The problem setup.
    longest_side : float
        Longest side of the model domain [length].

    Raises
    ------
    ConfigError
        If elements or a punch are too small for gmsh on a model domain of this size, or if elements
        are larger than the radius of the tip's edge.
    """
    domain = setup.physics.domain
    L = setup.physics.scales.length
    edge = sizes.punch_edge
    # Smallest radius of a punch relative to the longest side of a box. Below 3e-6 gmsh's CAD
    # kernel, which has a tolerance of 1e-7, loses the edge and fails or aborts.
    min_punch_radius = 1e-5
    min_radius = min_punch_radius * longest_side
    if edge is not None and domain.dim == 3 and domain.wall_radius is None and edge < min_radius:
        problem = (
            f"a punch of radius {edge * L:g} is too small for a box of this size, which needs at "
            f"least {min_radius * L:.3g}"
        )
        raise ConfigError(
            "indenter.radius", problem, "use a smaller box, or body.shape: half_space"
        )
    is_axisymmetric = domain.kinematics.name == "axisymmetric"
    min_size = (MIN_AXIS_SIZE if is_axisymmetric else MIN_ELEMENT_SIZE) * longest_side
    if sizes.min_size < min_size * (1 - 1e-9):
        problem = (
            f"elements of {sizes.min_size * L:.3g} are too small for a body of this size, which "
            f"needs at least {min_size * L:.3g}"
        )
        raise ConfigError(
            "mesh",
            problem,
            "use a smaller body: with 1e5 contact radii it deforms as a half-space",
        )
    if edge is None:
        return
    edge_size = float(sizes.size_at(np.array(edge), np.array(0.0)))
    if edge_size > edge * (1 + 1e-9):
        problem = f"elements of {edge_size * L:.3g} are larger than the tip's radius {edge * L:.3g}"
        remedy = f"use at most {edge * L / 4:.3g}, or auto; are both in the same unit of length?"
        raise ConfigError("mesh.h_contact", problem, remedy)
