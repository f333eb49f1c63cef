"""What the runs of a study are held to: theory, a finer run, a value that somebody published."""
