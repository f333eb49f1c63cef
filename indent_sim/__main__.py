"""`python -m indent_sim`: the program, where the command `indent-sim` is not on the PATH."""

from indent_sim.cli.start import main

main()
