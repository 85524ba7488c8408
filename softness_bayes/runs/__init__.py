"""Complete runs from data to result: sampling, plate data, comparison, calibration and evaluation."""
