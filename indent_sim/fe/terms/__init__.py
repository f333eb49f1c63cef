"""Parts of the virtual work: strain, wall, and those of the tip in `contact`."""
