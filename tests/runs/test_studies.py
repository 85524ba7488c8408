"""Studies behind the tables of the docs: stored tables are of stored rows, and a mistaken likelihood is another one."""

import sys

import numpy as np
import pandas as pd
import pytest

from support.pages import text_of
from support.paths import ROOT

RESULTS = ROOT / "notebooks" / "results"


@pytest.fixture
def studies(monkeypatch):
    """Import a study by its name."""
    monkeypatch.syspath_prepend(str(ROOT / "notebooks" / "studies"))
    yield lambda name: __import__(name)
    for name in ("coverage", "ranks"):
        sys.modules.pop(name, None)


def test_the_stored_table_of_coverage_is_of_the_stored_fits(studies):
    coverage, rows = studies("coverage"), pd.read_csv(RESULTS / "coverage.csv")
    assert coverage.table(rows).strip() in text_of("results.md")
    assert coverage.table(rows.assign(below=0.5)) != coverage.table(rows)  # control


def test_a_mistaken_likelihood_is_another_one_and_the_right_one_is_not(studies):
    ranks = studies("ranks")
    case = ranks.CASES["slider"]
    posterior = case.scene.model(case.options).posterior
    theta = posterior.space.draw_prior(np.random.default_rng(0), 3)
    right = posterior.log_likelihood(theta)
    same = posterior.with_term(ranks.Mistaken(posterior.observation, {}))
    np.testing.assert_allclose(same.log_likelihood(theta), right)
    for mistake in case.mistakes.values():
        wrong = posterior.with_term(mistake(posterior.observation)).log_likelihood(theta)
        assert (np.abs(wrong - right) > 0.1).any()
