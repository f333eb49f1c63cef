"""A posteriori error estimation: the error of every row from auxiliary runs of the same scene."""
