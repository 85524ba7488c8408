"""Observation models: how probable ratings, z-scores and plate forces are given the response."""
