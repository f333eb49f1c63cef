"""What a notebook calls: the commands as functions that take dictionaries and return numbers and figures."""
