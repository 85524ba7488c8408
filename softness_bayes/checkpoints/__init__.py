"""Checkpoints: files from which an interrupted or killed run can continue."""
