"""The module gmsh, imported by this module also without a display."""

from __future__ import annotations

from indent_sim.mesh.display_libraries import import_gmsh

gmsh = import_gmsh()
