"""Imports of the libraries that every figure needs, for the server from which processes are forked."""

import logging
import sys

logging.getLogger().addHandler(logging.NullHandler())  # such as matplotlib's remarks on its cache

# ArviZ takes a second, and corner needs it only for arguments that are not arrays
_ABSENT = "arviz" not in sys.modules
if _ABSENT:
    sys.modules["arviz"] = None  # type: ignore[assignment]
try:
    import corner  # noqa: F401
finally:
    if _ABSENT:
        del sys.modules["arviz"]
import matplotlib.backends.backend_agg  # noqa: E402
import matplotlib.figure  # noqa: E402, F401
import pandas  # noqa: E402, F401
import xarray  # noqa: E402, F401
