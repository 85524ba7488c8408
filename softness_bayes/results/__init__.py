"""Results of a run: groups of variables, tables, and their files."""
