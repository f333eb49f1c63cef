"""Contact terms: contact pressure for every contact method, friction and regularization."""
