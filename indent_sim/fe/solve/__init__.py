"""Solution of one equilibrium: Newton's method, Uzawa's iteration, linear solvers."""
