"""Measures the memory of every rank until it has its part of a mesh; nothing is solved.

usage: mpirun -n N .venv/bin/python scripts/mesh_memory.py SCENE [KEY=VALUE]...

Prints, in MB, the largest memory of every rank beyond the memory that it has once all libraries are
loaded, and the memory of the process beside rank 0 that makes the mesh or reads the mesh file.
"""

from __future__ import annotations

import re
import sys
import threading
import time
from pathlib import Path

from indent_sim.mesh import gmsh, mesher_process
from indent_sim.process.ranks import is_root, run_on_root

if is_root():
    # `indent-sim run` also starts this process before MPI is initialised.
    mesher_process.start_mesher()

from mpi4py import MPI

from indent_sim.config.scene_file import load
from indent_sim.process import usage
from indent_sim.run.single_run import backend
from indent_sim.scene import scene as scenes
from indent_sim.scene.imported_body import read_imported_mesh

SAMPLING_INTERVAL = 0.003  # s


def anonymous_memory() -> float:
    """Return the present memory of this process without mapped files [MB]."""
    match = re.search(r"RssAnon:\s*(\d+)", Path("/proc/self/status").read_text())
    return int(match[1]) / 1024 if match else usage.current_memory()


class MemorySampler(threading.Thread):
    """Thread that samples the memory of this process until the process ends.

    Attributes
    ----------
    initial, largest
        Memory at the creation of the sampler, and the largest one since then [MB].
    """

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.initial = anonymous_memory()
        self.largest = self.initial

    def run(self) -> None:
        while True:
            self.largest = max(self.largest, anonymous_memory())
            time.sleep(SAMPLING_INTERVAL)


def main(path: str, *settings: str) -> None:
    """Make or read the mesh of a scene, distribute it, and print the memory of every rank."""
    comm = MPI.COMM_WORLD
    solver = backend()
    # The scene is not solved: a mesh whose solution needs too much memory is not refused.
    scenes.machine_memory = lambda: float("inf")
    sampler = MemorySampler()
    sampler.start()
    config = load(Path(path), settings)
    start = time.monotonic()
    scene = scenes.resolve(config, piece=read_imported_mesh(config, comm))
    domain = scene.physics.domain
    grid = run_on_root(comm, gmsh.build_mesh, domain, scene.sizes)
    meshing_time = comm.bcast(time.monotonic() - start)
    mesh = solver.distribute(grid, domain, comm)
    distribution_time = time.monotonic() - start - meshing_time
    ranks = comm.gather((sampler.largest - sampler.initial, len(mesh.regions)))
    if comm.rank == 0:
        print(
            f"{len(grid.cells)} cells; {usage.CHILD_USAGE.memory:.0f} MB of the process beside "
            f"rank 0, {meshing_time:.0f} s; distributed in {distribution_time:.1f} s"
        )
        for rank, (memory, cell_count) in enumerate(ranks):
            print(f"rank {rank}: {cell_count} cells, at most {memory:.0f} MB")


if __name__ == "__main__":
    main(*sys.argv[1:])
