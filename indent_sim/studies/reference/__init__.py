"""References of a study: theory, the finest run, another result, or published values."""
