"""The server of the workers starts before the options are read, where workers are needed."""

import sys

import pytest

from softness_bayes.cli import main
from softness_bayes.sampler import workers

PLOTTING = "softness_bayes.plotting.libraries"


@pytest.fixture
def started(monkeypatch):
    """Return a function that gives the modules which the server of a command line imports; None without a server."""

    def modules(*typed):
        asked = []
        monkeypatch.setattr(workers, "prepare", lambda *names: asked.append(names))
        monkeypatch.setattr(sys, "argv", ["softness-bayes", *typed])
        with pytest.raises(SystemExit):
            main([*typed])
        assert len(asked) <= 1
        return asked[0] if asked else None

    return modules


@pytest.mark.parametrize("typed", [("sample", "--data", "none.csv"), ("resume", "none")], ids=lambda typed: typed[0])
def test_it_starts_even_if_what_follows_is_wrong(started, typed):
    assert PLOTTING in started(*typed, "--max-time", "soon")
    without = started(*typed, "--max-time", "soon", "--no-figures")
    assert without is not None
    assert PLOTTING not in without


@pytest.mark.parametrize(
    "typed",
    [
        ("sample", "--help"),
        ("sample", "--data", "none.csv", "--processes", "1"),
        ("resume", "none", "--processes=1"),
        ("sample", "--nonsense"),
        ("status", "none"),
    ],
    ids=" ".join,
)
def test_it_does_not_start_where_no_worker_is_needed(started, typed):
    assert started(*typed) is None
