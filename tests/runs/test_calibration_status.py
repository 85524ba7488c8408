"""`status` of a calibration: under way, interrupted and finished."""

import math
import os
import time

import pytest

from softness_bayes.checking.calibration import Replicate
from softness_bayes.errors import InputError
from softness_bayes.files.asked import ASKED, read_asked, write_asked
from softness_bayes.files.lock import Lock
from softness_bayes.runs.calibration_files import LOCK, REPLICATES, progress_of, write_manifest, write_replicate
from support.command_line import call, refused


@pytest.fixture
def three_of_five(tmp_path):
    """Two from an earlier call, and one that took four seconds."""
    (tmp_path / REPLICATES).mkdir()
    write_manifest(tmp_path, {"seed": 1})
    write_asked(tmp_path, 5)
    now = time.time()
    os.utime(tmp_path / ASKED, (now, now))
    for index, after in enumerate((-20.0, -10.0, 4.0)):
        write_replicate(tmp_path / REPLICATES, index, Replicate(("b",), (3,), (1.0,), 400, 5.0, index != 1))
        os.utime(tmp_path / REPLICATES / f"{index:05d}.json", (now + after, now + after))
    return tmp_path


def test_under_way(three_of_five):
    with Lock(three_of_five / LOCK):
        found = progress_of(three_of_five)
        said = call("status", three_of_five).stdout
    assert found[:4] == (5, 3, 1, True)
    assert found.seconds == pytest.approx(8.0, abs=0.01)
    assert "3 of 5 replicates are finished, 1 did not converge" in said
    assert "a process is running it, about 8 s to go" in said


def test_interrupted(three_of_five):
    done = call("status", three_of_five)
    assert done.returncode == 0
    assert "interrupted, no process is running it; the same 'softness-bayes calibrate' runs the other 2" in done.stdout


def test_finished(three_of_five):
    write_asked(three_of_five, 3)
    said = call("status", three_of_five).stdout
    assert "3 of 3 replicates are finished" in said
    assert "interrupted" not in said
    # begun by a version that did not write down what was asked for
    (three_of_five / ASKED).unlink()
    said = call("status", three_of_five).stdout
    assert "3 replicates are finished, 1 did not converge" in said
    assert "no process is running it" in said
    assert math.isnan(progress_of(three_of_five).seconds)


def test_damaged(three_of_five):
    (three_of_five / ASKED).write_text("{}")
    with pytest.raises(InputError, match="not the number of tasks"):
        read_asked(three_of_five)
    refused(call("status", three_of_five), "asked.json: not the number of tasks")
