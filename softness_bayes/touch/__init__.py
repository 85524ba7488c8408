"""The forward model: from fabric to firing, pure NumPy and SciPy."""
