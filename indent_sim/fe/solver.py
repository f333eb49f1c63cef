"""Entry point of the finite-element solver: the functions of `fe` that a run uses."""

from __future__ import annotations

import gc

from petsc4py import PETSc

from indent_sim.fe.compat import versions
from indent_sim.fe.condensed.equilibrium import CondensedEquilibrium
from indent_sim.fe.discrete_body import Body
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
    """Create the equilibrium problem of a scene on its mesh.

    The body is condensed to its contact surface if the scene's solver is `condensed`.
    """
    if scene.solver.method == "condensed":
        return CondensedEquilibrium(scene, Body(scene, mesh, pressure_fields(scene)))
    return BodyEquilibrium(Body(scene, mesh, additional_fields(scene)))


def create_load_stepper(scene: Scene, mesh: BodyMesh, started: float | None = None) -> LoadStepper:
    """Create the load stepper of a scene on its mesh.

    Parameters
    ----------
    scene : Scene
        The scene.
    mesh : BodyMesh
        Mesh of its body.
    started : float, optional
        Start of the run by `time.perf_counter` [s]; by default now.
    """
    return LoadStepper(create_equilibrium(scene, mesh), started)


def release(mesh: BodyMesh) -> None:
    """Free the PETSc objects of this mesh that Python has already collected (collective).

    PETSc keeps collected matrices and factors until all ranks agree to free them, even on a single
    rank.
    """
    gc.collect()
    PETSc.garbage_cleanup(mesh.comm)
