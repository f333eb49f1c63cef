"""Terms of the virtual work; the contact terms are in the subpackage `contact`."""
