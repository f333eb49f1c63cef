-- Module file (Lmod) for a cluster. Copy it to MODULEPATH as indent-sim/1.0.0.lua, the version of the program, and
-- set `root` to the environment that holds it:
--     python3.12 -m venv /opt/indent-sim/1.0.0 && /opt/indent-sim/1.0.0/bin/pip install '.[solver]'
local version = myModuleVersion()
local root = pathJoin("/opt/indent-sim", version)

help([[indent-sim simulates indentation tests by finite elements, and fits measured curves.
Commands: indent-sim --help. Ranks: the MPI of the environment, not that of another module.]])
whatis("Name: indent-sim")
whatis("Version: " .. version)
whatis("Description: indentation of soft bodies by finite elements, with error estimates")

-- The environment brings an MPI of its own.
family("mpi")
prepend_path("PATH", pathJoin(root, "bin"))
-- One thread for each rank.
setenv("OMP_NUM_THREADS", "1")
setenv("OPENBLAS_NUM_THREADS", "1")
setenv("INDENT_SIM", pathJoin(root, "bin", "indent-sim"))
