"""Atomic writing of files that never replaces files of others, and CSV files that are safe in a spreadsheet."""
