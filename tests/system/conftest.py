"""dolfinx is loaded as the program loads it, for it reads the command line, which is pytest's here."""

from indent_sim.fe.environment import load_dolfinx


def pytest_collect_file() -> None:
    """Before the first test file is imported, and never in the process that only shares tests out to others: MPI would
    leave its variables to them, and every mpirun they start would take itself for a rank."""
    load_dolfinx()
