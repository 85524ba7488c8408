"""The comparison of two versions' speed: a process of its own for each, and the kept rows."""

from pathlib import Path

import pandas as pd
import pytest

import softness_bayes
from softness_bayes.tools import benchmark_versions
from softness_bayes.tools.benchmark_versions import CASES, COLUMNS, HERE, measure

KEPT = Path(softness_bayes.__file__).parents[1] / "notebooks" / "results" / "versions.csv"


class Fake:
    """A version whose times are known."""

    def __init__(self, where, accuracy, channels, calls):
        self.share = 1.0 if where == HERE.resolve() else 2.0

    def seconds(self, what):
        return {"forward": 2e-6, "likelihood": 3e-6, "bare": 1e-6}[what] * self.share

    def end(self):
        pass


def test_ratios_are_those_of_this_version_to_the_other(monkeypatch, tmp_path):
    monkeypatch.setattr(benchmark_versions, "Version", Fake)
    found = dict(zip(COLUMNS, measure(tmp_path, 1e-3, "held"), strict=True))
    numbers = {name: float(value) for name, value in found.items() if name != "channels"}
    assert numbers["other_likelihood_us"] == 6.0
    assert numbers["likelihood_us"] == 3.0
    assert numbers["likelihood_ratio"] == numbers["forward_ratio"] == 0.5
    assert numbers["forward_over_bare"] == 2.0
    assert numbers["likelihood_over_forward"] == 1.5


@pytest.mark.slow
def test_a_version_is_as_fast_as_itself():
    found = dict(zip(COLUMNS, measure(HERE, 1e-2, "held", rounds=3, calls=40), strict=True))
    assert 0.7 < float(found["likelihood_ratio"]) < 1.4


def test_kept_rows_have_all_cases_and_are_faster():
    found = pd.read_csv(KEPT)
    assert tuple(found.columns) == COLUMNS
    assert list(zip(found["accuracy"], found["channels"], strict=True)) == [*CASES]
    assert (found["likelihood_ratio"] < 0.9).all()
