"""The operating-system process: errors and exit codes, MPI ranks, signals, time and memory."""
