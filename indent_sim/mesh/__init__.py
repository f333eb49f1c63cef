"""Meshes of bodies: model domain, element sizes, mesh generation with gmsh, imported meshes."""
