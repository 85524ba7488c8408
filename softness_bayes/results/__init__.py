"""Results of a run: groups of variables, tables, and the files that hold them."""
