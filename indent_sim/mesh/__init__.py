"""The mesh of a body: element sizes, gmsh, points and cells."""
