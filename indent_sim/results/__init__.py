"""States and files: the result folder, its tables, fields and pictures."""
