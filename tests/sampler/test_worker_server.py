"""The server that workers are forked from: what their errors say, and to whom."""

import multiprocessing
import sys
from pathlib import Path

import pytest


@pytest.fixture
def said(monkeypatch):
    """The hook for errors that the server's processes have."""
    monkeypatch.setattr(sys, "excepthook", sys.__excepthook__)
    monkeypatch.delitem(sys.modules, "softness_bayes.sampler.server", raising=False)
    import softness_bayes.sampler.server  # noqa: F401

    return sys.excepthook


def test_a_worker_of_a_run_that_has_ended_says_nothing(said, capsys):
    """A semaphore whose owner is gone, as a worker meets it that begins after Ctrl-C."""
    lock = multiprocessing.get_context("spawn").Lock()
    with pytest.raises(FileNotFoundError) as found:
        lock.__setstate__((0, 1, 1, "/none-such"))
    said(found.type, found.value, found.tb)
    assert capsys.readouterr().err == ""


def test_other_errors_are_told(said, capsys):
    with pytest.raises(ValueError, match="made up") as own:
        raise ValueError("made up")
    with pytest.raises(FileNotFoundError) as missing:
        Path("/none/such").read_text()
    for found in (own, missing):
        said(found.type, found.value, found.tb)
        assert "Traceback" in capsys.readouterr().err
