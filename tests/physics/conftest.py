"""dolfinx is loaded as the program loads it: it reads the command line, which is pytest's here."""

from indent_sim.fe.environment import load_dolfinx

load_dolfinx()
