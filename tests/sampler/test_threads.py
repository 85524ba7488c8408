"""Linear algebra on one thread: in a run, in its workers and in the program, whatever the number of processors."""

import os
import subprocess
import sys

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from softness_bayes.__main__ import THREADS
from softness_bayes.sampler.workers import Workers, one_thread

PROGRAM = (
    "from softness_bayes.__main__ import limit_threads; limit_threads(); "
    "import numpy, scipy.linalg; from threadpoolctl import threadpool_info; "
    "print({library['num_threads'] for library in threadpool_info()})"
)


def threads():
    """The largest number of threads of any library of linear algebra."""
    return max(library["num_threads"] for library in threadpool_info())


def told(_):
    return threads()


@pytest.fixture
def two_threads():
    with threadpool_limits(2):
        if threads() != 2:
            pytest.skip("linear algebra without threads")
        yield


def test_a_block_has_one_thread_and_gives_the_others_back(two_threads):
    with one_thread():
        assert threads() == 1
    assert threads() == 2


@pytest.mark.parametrize("processes", [1, 2])
def test_tasks_have_one_thread(two_threads, processes):
    with Workers(None, processes) as workers:
        assert workers.map(told, [()]) == [1]


@pytest.mark.parametrize(("chosen", "expected"), [({}, "{1}"), (dict.fromkeys(THREADS, "2"), "{2}")])
def test_the_program_has_one_thread_unless_the_user_chose_a_number(two_threads, chosen, expected):
    environment = {name: value for name, value in os.environ.items() if name not in THREADS} | chosen
    said = subprocess.run([sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True, check=True)
    assert said.stdout.strip() == expected
