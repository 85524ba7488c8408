"""Observation models: the probability of ratings, z-scores and plate forces given the response."""
