"""Initialisation of the server process from which workers are forked; not to be imported by any other process."""

from __future__ import annotations

import multiprocessing
import sys
from pathlib import Path
from types import TracebackType

_HOME = Path(multiprocessing.__file__).parent
_GONE = (FileNotFoundError, EOFError, ConnectionError)


def _said(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Suppress the error of a worker that starts after its run has ended, for example by Ctrl-C."""
    last = trace
    while last is not None and last.tb_next is not None:
        last = last.tb_next
    inside = last is not None and Path(last.tb_frame.f_code.co_filename).parent == _HOME
    if not (inside and issubclass(kind, _GONE)):
        sys.__excepthook__(kind, error, trace)


sys.excepthook = _said
