"""Bayesian inference for tactile softness."""

__version__ = "0.1.0"
