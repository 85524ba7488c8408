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
    """Keep warnings of libraries from the screen, here and in worker processes, unless Python is asked for them.

    What a user must know is said by the command itself. ``python -W default -m softness_bayes`` shows all warnings.
    """
    if not sys.warnoptions:
        warnings.simplefilter("ignore")
        os.environ["PYTHONWARNINGS"] = "ignore"
        logging.lastResort = logging.NullHandler()  # shows messages of loggers without a handler
    logging.getLogger().addHandler(logging.NullHandler())


def heed_signals() -> None:
    """End the process without a traceback if a signal comes before the command line has its own handlers.

    `softness_bayes.cli.interrupts` installs those before the first verb begins.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _end)


def _end(number: int, frame: FrameType | None) -> NoReturn:
    os.write(2, b"interrupted: nothing was begun\n")
    os._exit(128 + number)


if __name__ == "__main__":
    run()
