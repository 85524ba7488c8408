"""Bayes: priors, parameters, likelihood, sampling and diagnostics."""
