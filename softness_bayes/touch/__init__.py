"""The forward model, from fabric mechanics to receptor firing, in pure NumPy and SciPy."""
