"""The program `softness-bayes`, also started by ``python -m softness_bayes``."""

from __future__ import annotations

import gc
import logging
import os
import signal
import sys
import warnings
from types import FrameType
from typing import NoReturn

from softness_bayes.base.defaults import GARBAGE, SIGNALS

THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")
"""Environment variables with the number of threads of NumPy's and SciPy's linear algebra, read at their import."""


def run() -> None:
    """Run the command line."""
    heed_signals()
    quieten_libraries()
    limit_threads()
    gc.set_threshold(*GARBAGE)
    from softness_bayes.cli import main

    try:
        main(prog_name="softness-bayes")
    finally:
        gc.freeze()  # the memory ends with the process: to look for garbage in it would take half a second


def quieten_libraries() -> None:
    """Suppress warnings from libraries, here and in worker processes, unless Python's ``-W`` option is given.

    The command itself reports what a user needs to know. ``python -W default -m softness_bayes`` shows all warnings.
    """
    if not sys.warnoptions:
        warnings.simplefilter("ignore")
        os.environ["PYTHONWARNINGS"] = "ignore"
        logging.lastResort = logging.NullHandler()  # prints messages from loggers without a handler
    logging.getLogger().addHandler(logging.NullHandler())


def limit_threads() -> None:
    """Limit linear algebra to one thread in this process and those that it starts, unless the user chose a number.

    The cores are used by worker processes, so that more threads spend their time waiting for each other, and the last
    bits of results would depend on their number.
    """
    for name in THREADS:
        os.environ.setdefault(name, "1")


def heed_signals() -> None:
    """End the process without a traceback if a signal arrives before the command line has installed its handlers.

    `softness_bayes.cli.interrupts` installs these handlers before the first command starts.
    """
    for number in SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _end)


def _end(number: int, frame: FrameType | None) -> NoReturn:
    os.write(2, b"interrupted: nothing was begun\n")
    os._exit(128 + number)


if __name__ == "__main__":
    run()
