"""How a scene is solved: the only room that imports dolfinx and petsc4py."""
