"""The process itself, no mechanics: errors and exit codes, MPI ranks, signals, clock and memory."""
