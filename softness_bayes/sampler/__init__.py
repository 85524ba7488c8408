"""Ensembles of walkers on any density: moves, convergence, and the state that continues a walk."""
