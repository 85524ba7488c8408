"""A result of a few numbers, so that most of its file is what HDF5 adds."""

import numpy as np
import pandas as pd

from softness_bayes.base import arviz_bridge
from softness_bayes.results.result import Result
from softness_bayes.results.stored import SCHEMA


def small_result():
    """Return a small result without the groups of ratings."""
    rng = np.random.default_rng(3)
    tree = arviz_bridge.to_tree(
        {
            "posterior": {
                "b": rng.lognormal(4, 0.1, (4, 6)),
                "participant_effect": rng.normal(size=(4, 6, 3)),
                "inside": rng.integers(0, 2, (4, 6)).astype(np.int8),
            },
            "predictions": {"total_rate": rng.normal(size=(1, 5)).astype(np.float32)},
            "observed_data": {"rating": np.array([1.0, np.nan, -np.nan, -0.0])},
            "constant_data": {"omega": np.array(0.0)},
        },
        dims={"participant_effect": ["participant"], "rating": ["row"]},
        coords={"participant": ["Änne", "Bo", "NA"]},
        attrs={"schema_version": float(SCHEMA), "command": "softness-bayes sample", "sd": 0.5, "empty": ""},
        variable_attrs={"b": {"units": "kPa"}},
    )
    index = pd.Index(["b", "NA"], name="parameter")
    table = pd.DataFrame({"mean": [0.1 + 0.2, np.nan], "n": [1, 2], "says": ["=1+1", ""], "fine": [True, False]}, index)
    return Result(tree, table, {"checks": table.reset_index().set_index(["parameter", "says"])})
