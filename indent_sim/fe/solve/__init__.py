"""How one equilibrium is found: Newton, Uzawa, the linear solver and its options."""
