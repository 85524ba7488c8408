"""The summary of draws of known accuracy."""

import numpy as np
import pytest

from oracles.autoregressive import autoregressive, walks
from softness_bayes.results.summary import summarise
from softness_bayes.sampler.diagnostics import ess_tail


def test_effective_sizes_follow_tau():
    tau, shape = 12.0, (4, 3000, 20, 1)
    values = autoregressive(np.random.default_rng(4), shape, tau)
    draws = np.prod(shape) / tau
    table = summarise(["b"], values).loc["b"]
    assert table["ess_bulk"] == pytest.approx(draws, rel=0.2)
    # the indicators of the tails of a normal AR(1) process decorrelate faster than the process
    assert draws < table["ess_tail"] < 3 * draws
    assert table["mcse_mean"] == pytest.approx(draws**-0.5, rel=0.2)
    assert table["r_hat"] < 1.01


def test_summary_has_the_columns_of_the_file():
    values = np.random.default_rng(5).standard_normal((4, 500, 10, 2)) * [1, 2] + [0, 5]
    table = summarise(["b", "m"], values)
    assert table.index.name == "parameter"
    expected = "mean sd hdi_low hdi_high hdi_prob ess_bulk ess_tail r_hat mcse_mean mcse_sd"
    assert " ".join(table.columns) == expected
    assert table.loc["m", "mean"] == pytest.approx(5, abs=0.1)
    assert table.loc["m", "sd"] == pytest.approx(2, rel=0.05)
    assert table.loc["b", "hdi_low"] == pytest.approx(-1.64, abs=0.15)
    assert (table["hdi_prob"] == 0.9).all()


def test_tail_size_is_the_smaller_of_both_tails():
    rng = np.random.default_rng(14)
    values = rng.standard_normal((4, 2000, 20, 1))
    # the upper tail is visited in long stays
    slow = autoregressive(rng, (4, 2000, 20, 1), 40.0)
    values = np.where(slow > 1.5, values + 5, values)
    assert ess_tail(walks(values))[0] < 160_000 / 10


def test_tail_size_from_thinned_draws_is_almost_the_same():
    values = autoregressive(np.random.default_rng(15), (4, 4000, 20, 2), 80.0)
    every_draw = ess_tail(walks(values))
    thinned = ess_tail(walks(values), np.array([80.0, 60.0]))
    assert ((thinned > 0.94 * every_draw) & (thinned < 1.01 * every_draw)).all()
    assert (ess_tail(walks(values), np.array([2000.0, 2000.0])) < 0.8 * every_draw).all()  # thinned too far
