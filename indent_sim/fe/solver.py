"""Entry point of the finite-element solver: the functions of `fe` that a run uses."""

from __future__ import annotations

import gc

from mpi4py import MPI
from petsc4py import PETSc

from indent_sim.fe.compat import versions
from indent_sim.fe.condensed.compliance import Condenser
from indent_sim.fe.condensed.equilibrium import BodyCondenser, CondensedEquilibrium
from indent_sim.fe.condensed.resting_body import RestingBodyCondenser
from indent_sim.fe.condensed.soft_tip import SoftTipCondenser
from indent_sim.fe.discrete_body import Body
from indent_sim.fe.mesh import BodyMesh, distribute, distribute_with_tip
from indent_sim.fe.path.equilibrium import Equilibrium
from indent_sim.fe.path.load_stepping import LoadStepper
from indent_sim.fe.postprocessing.fields import Fields
from indent_sim.fe.solve.equilibrium import BodyEquilibrium
from indent_sim.fe.terms.scene_terms import additional_fields
from indent_sim.fe.terms.strain_energy import pressure_fields
from indent_sim.mesh.grid import Grid
from indent_sim.process.errors import ConfigError
from indent_sim.process.ranks import run_on_root
from indent_sim.scene.scene import Scene

__all__ = [
    "Fields",
    "LoadStepper",
    "create_equilibrium",
    "create_load_stepper",
    "distribute",
    "distribute_scene",
    "release",
    "versions",
]


def create_equilibrium(scene: Scene, mesh: BodyMesh) -> Equilibrium:
    """Create the equilibrium problem of a scene on its mesh.

    If the scene's solver is `condensed`, the body and a soft tip are condensed to their contact
    surfaces.
    """
    if scene.solver.method == "condensed":
        body = Body(scene, mesh, pressure_fields(scene))
        return CondensedEquilibrium(scene, body, _condenser(scene, body))
    if scene.has_two_body_mesh:
        scene = scene.two_body_scene()
    return BodyEquilibrium(Body(scene, mesh, additional_fields(scene)))


def distribute_scene(scene: Scene, grid: Grid | None, comm: MPI.Comm) -> BodyMesh:
    """Distribute the grid of a scene among all ranks (collective).

    A soft tip at finite strain is meshed and joined with the body. A condensed soft tip has a mesh
    of its own.

    Parameters
    ----------
    scene : Scene
        The scene.
    grid : Grid or None
        The grid of its body on rank 0, None on the others.
    comm : MPI.Comm
        Communicator.

    Raises
    ------
    ConfigError
        If a soft tip at finite strain is solved on several ranks.
    """
    if not scene.has_two_body_mesh:
        return distribute(grid, scene.physics.domain, comm)
    if comm.size > 1:
        raise ConfigError(
            "indenter.material",
            "a soft tip at finite strain is solved by one process only",
            "run without mpirun",
        )
    assert grid is not None
    assert scene.tip_scene is not None
    return distribute_with_tip(grid, scene.tip_scene.grid(), scene.two_body_scene(), comm)


def _condenser(scene: Scene, body: Body) -> BodyCondenser:
    """Condense the body and, if the scene has them, a flat below it and a soft tip (collective).

    The soft tip is meshed first.
    """
    rests = scene.physics.domain.rests_on_flat
    body_condenser = RestingBodyCondenser(body) if rests else Condenser(body)
    tip_scene = scene.tip_scene
    if tip_scene is None:
        return body_condenser
    grid = run_on_root(body.comm, tip_scene.grid)
    mesh = distribute(grid, tip_scene.physics.domain, body.comm)
    tip = Body(tip_scene, mesh, pressure_fields(tip_scene))
    return SoftTipCondenser(body_condenser, Condenser(tip))


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
