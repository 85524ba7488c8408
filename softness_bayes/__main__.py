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

from softness_bayes.defaults import GARBAGE


def run() -> None:
    """Run the command line."""
    heed_signals()
    quieten_libraries()
    gc.set_threshold(*GARBAGE)
    from softness_bayes.cli import main

    main(prog_name="softness-bayes")


def quieten_libraries() -> None:
    """Suppress warnings from libraries, here and in worker processes, unless Python's ``-W`` option is given.

    The command itself reports what a user needs to know. ``python -W default -m softness_bayes`` shows all warnings.
    """
    if not sys.warnoptions:
        warnings.simplefilter("ignore")
        os.environ["PYTHONWARNINGS"] = "ignore"
        logging.lastResort = logging.NullHandler()  # prints messages from loggers without a handler
    logging.getLogger().addHandler(logging.NullHandler())


def heed_signals() -> None:
    """End the process without a traceback if a signal arrives before the command line has installed its handlers.

    `softness_bayes.cli.interrupts` installs these handlers before the first command starts.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _end)


def _end(number: int, frame: FrameType | None) -> NoReturn:
    os.write(2, b"interrupted: nothing was begun\n")
    os._exit(128 + number)


if __name__ == "__main__":
    run()
