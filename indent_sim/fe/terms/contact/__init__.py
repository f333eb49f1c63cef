"""Contact terms: the pressure by every contact method, friction and regularization."""
