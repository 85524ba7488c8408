"""Recordings: the real ones beside the project, and simulated ones."""

import numpy as np
import pandas as pd
import pytest

from support.paths import SHARED

GRAM_FORCE = 9.80665e-3


def digitised(name):
    """Return a table digitised from a publication, which is not part of the project."""
    path = SHARED / "data" / name
    if not path.exists():
        pytest.skip(f"the recordings are not part of the project: no {path.name} in ../shared/data")
    return pd.read_csv(path)


@pytest.fixture(scope="session")
def recording_a():
    """SA1 rates against curvature and force at the contact's centre (Goodwin, Browning & Wheat 1995), 21 rows."""
    table = digitised("sa1_rate_vs_curvature_force_goodwin1995.csv")
    return pd.DataFrame(
        {
            "recording": "A",
            "force_n": table.force_N,
            "probe_curvature_per_m": table.curvature_per_m,
            "distance_mm": 0.0,
            "rate_hz": table.response_impulses_per_s,
        }
    )


@pytest.fixture(scope="session")
def recording_b():
    """Rates against distance and curvature at 15 gf, 77 rows; positions run from -1 to 4 mm in steps of 0.5."""
    table = digitised("sa1_rate_vs_distance_curvature_goodwin1995.csv")
    return pd.DataFrame(
        {
            "recording": "B",
            "force_n": 15 * GRAM_FORCE,
            "probe_curvature_per_m": table.curvature_per_m,
            "distance_mm": np.abs(-1.0 + 0.5 * table.distance_index),
            "rate_hz": table.response_impulses_per_s,
        }
    )


@pytest.fixture(scope="session")
def pressed():
    """Forces of indentors on four fingerpads (Gulati & Srinivasan 1997)."""
    return digitised("fingerpad_force_displacement_gulati.csv")
