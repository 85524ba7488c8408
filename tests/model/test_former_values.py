"""The log posterior at fixed points, against values of the package before its rooms and its likelihoods were rewritten.

`tests/reference/log_posterior.json` holds the tables, the points and the values.
"""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest

from softness_bayes.data import read_experiment
from softness_bayes.likelihood.directions import RISES
from softness_bayes.likelihood.error_laws import NORMAL
from softness_bayes.likelihood.scales import scale_named
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.touch.scene import Discretisation
from support.paths import REFERENCE

RECORD = json.loads((REFERENCE / "log_posterior.json").read_text())
FINE = Discretisation(nodes=40, saturation=30.0, field_tolerance=1e-8)
NAMES = {"magnitude": "rating", "standardised": "z"}


def posterior(case):
    properties = pd.DataFrame.from_dict(
        RECORD["fabrics"], orient="index", columns=["tensile_modulus_mpa", "thickness_mm", "poisson_ratio"]
    )
    columns = ["participant", "fabric", "indentation_mm", "rating", "z"]
    ratings = pd.DataFrame(RECORD["ratings"], columns=columns).join(properties, on="fabric")
    ratings["rating"] = ratings[NAMES[case["scale"]]]
    forces = pd.DataFrame(RECORD["forces"], columns=["participant", "indentation_mm", "force_n"])
    experiment = read_experiment(ratings.drop(columns="z"), compression_path=forces if case["compression"] else None)
    options = ModelOptions(
        fix={name: value for name, value in case["held"].items() if name == "eps"},
        scale=scale_named(case["scale"]),
        direction=RISES,
        errors=NORMAL,
        resolution=0.0,
        discretisation=FINE,
    )
    return build(experiment, options).posterior


@pytest.mark.parametrize("case", RECORD["cases"], ids=lambda case: f"{case['scale']}-{case['compression']}")
def test_log_posterior_is_as_before(case):
    density, points = posterior(case), np.array(case["points"])
    assert sorted(density.names) == sorted(case["names"])
    theta = points[:, [case["names"].index(name) for name in density.names]]
    np.testing.assert_allclose(density.log_prior(theta), case["log_prior"], rtol=1e-12)
    np.testing.assert_allclose(density.log_likelihood(theta), case["log_likelihood"], rtol=1e-9)


def test_a_change_of_a_ten_millionth_would_be_found():
    case = RECORD["cases"][0]
    theta = np.array(case["points"])
    moved = theta * np.where(np.array(case["names"]) == "sigma_0", 1 + 1e-7, 1.0)
    density = posterior(case)
    theta, moved = (x[:, [case["names"].index(name) for name in density.names]] for x in (theta, moved))
    found = density.log_likelihood(moved)
    assert (np.abs(found / case["log_likelihood"] - 1) > 1e-9).all()
