"""The door of the solver: what a run needs from this folder."""

from __future__ import annotations

import gc

from petsc4py import PETSc

from indent_sim.fe.compat import versions
from indent_sim.fe.condensed.equilibrium import CondensedEquilibrium
from indent_sim.fe.discrete_body import Body
from indent_sim.fe.kernels import compiling, watch_the_cache
from indent_sim.fe.mesh import BodyMesh, distribute
from indent_sim.fe.observe.fields import Fields
from indent_sim.fe.path.equilibrium import Equilibrium
from indent_sim.fe.path.walk import Walk
from indent_sim.fe.solve.equilibrium import BodyEquilibrium
from indent_sim.fe.terms.scene_terms import fields_of
from indent_sim.fe.terms.strain import pressures
from indent_sim.scene.scene import Scene

__all__ = ["Fields", "Walk", "distribute", "equilibrium", "release", "versions", "walk"]


def equilibrium(scene: Scene, mesh: BodyMesh) -> Equilibrium:
    """The body of a scene on its mesh, whole or condensed, by the scene's solver."""
    watch_the_cache()
    with compiling():
        if scene.solver.method == "condensed":
            return CondensedEquilibrium(scene, Body(scene, mesh, pressures(scene)))
        return BodyEquilibrium(Body(scene, mesh, fields_of(scene)))


def walk(scene: Scene, mesh: BodyMesh, started: float | None = None) -> Walk:
    """The load path of a scene on its mesh."""
    return Walk(equilibrium(scene, mesh), started)


def release(mesh: BodyMesh) -> None:
    """Free what PETSc keeps of objects on this mesh that Python has let go of (collective).

    They are put aside, matrices with their factors, until all ranks agree to free them; even where
    there is one rank.
    """
    gc.collect()
    PETSc.garbage_cleanup(mesh.comm)
