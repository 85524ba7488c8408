"""Checks of a fitted model: predictive checks, turning points, sensitivity and identifiability."""
