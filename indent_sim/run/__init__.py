"""One config -> one result folder."""
