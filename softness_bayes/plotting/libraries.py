"""Imports of the libraries that every figure needs, for the server from which processes are forked."""

import logging

logging.getLogger().addHandler(logging.NullHandler())  # such as matplotlib's remarks on its cache

import corner  # noqa: E402, F401
import matplotlib.backends.backend_agg  # noqa: E402
import matplotlib.figure  # noqa: E402, F401
import pandas  # noqa: E402, F401
import xarray  # noqa: E402, F401
