"""Checkpoints: a run under way, in files that survive a kill."""
