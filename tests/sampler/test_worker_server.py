"""The server that workers are forked from: what their errors say, and to whom, and when it ends."""

import multiprocessing
import os
import subprocess
import sys
from pathlib import Path

import pytest

from softness_bayes.sampler import server, workers

ENDS_DURING_PREPARATION = "from softness_bayes.sampler import workers; workers.prepare('takes_long')"


@pytest.fixture
def said():
    """The hook for errors that the server's processes have."""
    return server._said


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


def test_this_process_is_no_server(said):
    assert not server.SERVING
    assert sys.excepthook is not said
    assert server.PARENT not in os.environ


@pytest.mark.skipif(not workers._served(), reason="there is no server on this system")
def test_the_server_ends_with_a_parent_that_ends_while_it_prepares(tmp_path):
    (tmp_path / "takes_long.py").write_text("import time\ntime.sleep(600)")
    found = subprocess.run(
        [sys.executable, "-c", ENDS_DURING_PREPARATION],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])},
        capture_output=True,  # returns when no process holds the streams any more
        timeout=300,
        text=True,
        check=True,
    )
    assert (found.stdout, found.stderr) == ("", "")
