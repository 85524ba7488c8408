"""Ensemble sampling of arbitrary densities: moves, convergence, and the state from which a run continues."""
