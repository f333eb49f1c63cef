"""Result folders: writing and reading of their tables, fields, reports and pictures."""
