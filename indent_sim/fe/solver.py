"""The door of the solver: what a run needs from this folder."""

from indent_sim.fe.compat import versions
from indent_sim.fe.enforce import enforcement
from indent_sim.fe.fields import Fields
from indent_sim.fe.mesh import distribute
from indent_sim.fe.newton import Newton
from indent_sim.fe.path import Walk
from indent_sim.fe.problem import Problem

__all__ = ["Fields", "Newton", "Problem", "Walk", "distribute", "enforcement", "versions"]
