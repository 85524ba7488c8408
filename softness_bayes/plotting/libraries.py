"""The library corner without ArviZ, which takes a second and is needed only for arguments that are no arrays."""

import sys

_ABSENT = "arviz" not in sys.modules
if _ABSENT:
    sys.modules["arviz"] = None  # type: ignore[assignment]
try:
    import corner as corner
finally:
    if _ABSENT:
        del sys.modules["arviz"]
