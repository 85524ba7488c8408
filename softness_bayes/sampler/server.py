"""Initialisation of the server process from which workers are forked; it has no effect in any other process.

It is the first module that the server imports, and `server_ready` the last. Meanwhile the server looks whether its
parent still exists: if that ended with an error, a program that reads its output would wait for the server as well.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
from pathlib import Path
from types import TracebackType
from typing import Any

PARENT = "SOFTNESS_BAYES_PARENT"
"""Environment variable with the number of the parent process, which only the server receives."""

_HOME = Path(multiprocessing.__file__).parent
_GONE = (FileNotFoundError, EOFError, ConnectionError)
_PERIOD = 0.1  # s between looks


def _said(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Suppress the error of a worker that starts after its run has ended, for example by Ctrl-C."""
    last = trace
    while last is not None and last.tb_next is not None:
        last = last.tb_next
    inside = last is not None and Path(last.tb_frame.f_code.co_filename).parent == _HOME
    if not (inside and issubclass(kind, _GONE)):
        sys.__excepthook__(kind, error, trace)


def _look(*_: Any) -> None:
    """End this process if its parent has ended."""
    if os.getppid() != _PARENT:
        os.kill(os.getpid(), signal.SIGKILL)


_PARENT = int(os.environ.pop(PARENT, "0"))
SERVING = _PARENT > 0
"""True in the server."""

if SERVING:
    sys.excepthook = _said
    signal.signal(signal.SIGALRM, _look)
    signal.setitimer(signal.ITIMER_REAL, _PERIOD, _PERIOD)
