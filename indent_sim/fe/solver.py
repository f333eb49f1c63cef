"""The door of the solver: what a run needs from this folder."""

from __future__ import annotations

import gc

from petsc4py import PETSc

from indent_sim.fe.compat import versions
from indent_sim.fe.condensed.equilibrium import CondensedEquilibrium
from indent_sim.fe.discrete_body import Body
from indent_sim.fe.kernel_cache import lock_ffcx_cache, translate_compiler_errors
from indent_sim.fe.mesh import BodyMesh, distribute
from indent_sim.fe.path.equilibrium import Equilibrium
from indent_sim.fe.path.load_stepping import LoadStepper
from indent_sim.fe.postprocessing.fields import Fields
from indent_sim.fe.solve.equilibrium import BodyEquilibrium
from indent_sim.fe.terms.scene_terms import additional_fields
from indent_sim.fe.terms.strain_energy import pressure_fields
from indent_sim.scene.scene import Scene

__all__ = [
    "Fields",
    "LoadStepper",
    "create_equilibrium",
    "create_load_stepper",
    "distribute",
    "release",
    "versions",
]


def create_equilibrium(scene: Scene, mesh: BodyMesh) -> Equilibrium:
    """The body of a scene on its mesh, whole or condensed, by the scene's solver."""
    lock_ffcx_cache()
    with translate_compiler_errors():
        if scene.solver.method == "condensed":
            return CondensedEquilibrium(scene, Body(scene, mesh, pressure_fields(scene)))
        return BodyEquilibrium(Body(scene, mesh, additional_fields(scene)))


def create_load_stepper(scene: Scene, mesh: BodyMesh, started: float | None = None) -> LoadStepper:
    """The load path of a scene on its mesh."""
    return LoadStepper(create_equilibrium(scene, mesh), started)


def release(mesh: BodyMesh) -> None:
    """Free what PETSc keeps of objects on this mesh that Python has let go of (collective).

    They are put aside, matrices with their factors, until all ranks agree to free them; even where
    there is one rank.
    """
    gc.collect()
    PETSc.garbage_cleanup(mesh.comm)
