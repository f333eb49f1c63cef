"""Parts of the virtual work: strain, wall, contact."""
