"""`python -m indent_sim` runs the program if the command `indent-sim` is not on the PATH."""

from indent_sim.cli.start import main

main()
