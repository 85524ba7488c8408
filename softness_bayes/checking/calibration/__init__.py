"""Simulation-based calibration: ranks of true values, their power, and what they say."""
