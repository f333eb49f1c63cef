"""Terms of the virtual work; those of the contact with the tip are in `contact`."""
