"""Memory of every rank until it has its part of a mesh, which nothing is solved on.

usage: mpirun -n N .venv/bin/python scripts/mesh_memory.py SCENE [KEY=VALUE]...

What this prints are MB of the process itself, beyond what it had with all libraries loaded: at most until then, and of
the process beside rank 0 that meshes, or reads a mesh file.
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
    mesher_process.start_mesher()  # as `indent-sim run` does, before MPI is up

from mpi4py import MPI

from indent_sim.config.scene_file import load
from indent_sim.process import usage
from indent_sim.run.single_run import backend
from indent_sim.scene import scene as scenes
from indent_sim.scene.imported_body import read_imported_mesh


def own() -> float:
    """Memory of this process now that no file holds [MB]."""
    found = re.search(r"RssAnon:\s*(\d+)", Path("/proc/self/status").read_text())
    return int(found[1]) / 1024 if found else usage.current_memory()


class Watch(threading.Thread):
    """Looks at the memory of this process again and again."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.first = self.most = own()

    def run(self) -> None:
        while True:
            self.most = max(self.most, own())
            time.sleep(0.003)


def main(path: str, *settings: str) -> None:
    comm, solver = MPI.COMM_WORLD, backend()
    scenes.machine_memory = lambda: float("inf")
    watch = Watch()
    watch.start()
    config, began = load(Path(path), settings), time.monotonic()
    scene = scenes.resolve(config, piece=read_imported_mesh(config, comm))
    part = scene.physics.domain
    grid = run_on_root(comm, gmsh.build_mesh, part, scene.sizes)
    ready = comm.bcast(time.monotonic() - began)
    mesh = solver.distribute(grid, part, comm)
    took = time.monotonic() - began - ready
    found = comm.gather((watch.most - watch.first, len(mesh.regions)))
    if comm.rank == 0:
        print(
            f"{len(grid.cells)} cells; {usage.CHILD_USAGE.memory:.0f} MB of the process beside rank 0, {ready:.0f} s; "
            f"divided in {took:.1f} s"
        )
        for rank, (most, cells) in enumerate(found):
            print(f"rank {rank}: {cells} cells, at most {most:.0f} MB")


if __name__ == "__main__":
    main(*sys.argv[1:])
