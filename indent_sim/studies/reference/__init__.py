"""References of a study: theory, its finest run, a result, or published values."""
