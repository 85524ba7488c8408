"""Set-up of the server that workers are forked from, which imports this module first: no other process may."""

from __future__ import annotations

import multiprocessing
import sys
from pathlib import Path
from types import TracebackType

_HOME = Path(multiprocessing.__file__).parent
_GONE = (FileNotFoundError, EOFError, ConnectionError)


def _said(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Say nothing where a worker begins after the run that asked for it has ended, such as by Ctrl-C."""
    last = trace
    while last is not None and last.tb_next is not None:
        last = last.tb_next
    inside = last is not None and Path(last.tb_frame.f_code.co_filename).parent == _HOME
    if not (inside and issubclass(kind, _GONE)):
        sys.__excepthook__(kind, error, trace)


sys.excepthook = _said
