"""What the tests of the page share: its subjects, and a server in a thread of its own."""

from __future__ import annotations

import threading
from contextlib import contextmanager

import numpy as np
import pytest

from softness_bayes.data import Fabrics
from softness_bayes.report.explore.server import address_of, listening, page_server
from softness_bayes.report.explore.subject import of_priors, of_run
from softness_bayes.touch.contact import Force, Indentation

CLOTH = Fabrics(
    ("gauze, bleached", "drill's", "canvas"),
    effective_modulus=np.array([8e3, 1.2e5, 9e5]),
    poisson_ratio=np.array([0.3, 0.2, 0.25]),
)


@pytest.fixture(scope="session")
def of_medians():
    """The chain at the medians of its priors, channels free."""
    return of_priors(CLOTH, (Indentation(1e-3), Indentation(3e-3), Force(1.0)))


@pytest.fixture(scope="session")
def result(report_run):
    return report_run("ratings")


@pytest.fixture(scope="session")
def of_ratings(result):
    """A run on ratings."""
    return of_run(result)


@contextmanager
def _served(subject):
    begun, servers = threading.Event(), []

    def run(opened):
        servers.append(page_server(subject, opened))
        begun.set()
        servers[0].io_loop.start()
        servers[0].io_loop.close()

    with listening(0) as opened:
        thread = threading.Thread(target=run, args=(opened,))
        thread.start()
        assert begun.wait(30)
        loop = servers[0].io_loop

        async def stop():
            servers[0].stop(wait=False)
            await servers[0]._http.close_all_connections()
            loop.stop()

        try:
            yield address_of(servers[0])
        finally:
            loop.add_callback(stop)
            thread.join(30)


@pytest.fixture(scope="session")
def served():
    """Return the context in which a subject is served; it yields the page's address."""
    return _served
