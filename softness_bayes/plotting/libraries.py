"""Imports of the libraries that every figure needs, for the server from which processes are forked."""

import logging

logging.getLogger().addHandler(logging.NullHandler())  # such as matplotlib's remarks on its cache

from softness_bayes.imports import without  # noqa: E402

with without("arviz"):  # which takes a second, and which corner needs only for arguments that are not arrays
    import corner  # noqa: F401
import matplotlib.backends.backend_agg  # noqa: E402
import matplotlib.figure  # noqa: E402, F401
import pandas  # noqa: E402, F401
import xarray  # noqa: E402, F401
