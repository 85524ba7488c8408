"""Files of a run under way: written whole or not at all, by one process at a time."""
