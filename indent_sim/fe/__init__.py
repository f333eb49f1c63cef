"""How a scene is solved: the only folder that imports dolfinx and petsc4py."""
