"""Runs from data to result: sampling, plate runs, comparison, calibration and evaluation."""
