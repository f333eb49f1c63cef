"""How a scene is solved: the only folder that imports dolfinx and petsc4py."""

from __future__ import annotations

from indent_sim.fe.environment import load_dolfinx

load_dolfinx()
