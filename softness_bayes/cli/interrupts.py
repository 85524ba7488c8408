"""End of a command by a signal, at any instant, without a traceback or orphaned processes.

The first signal raises `Interrupted` in the main thread, so that files are closed and states in memory are written.
A library may catch the exception; a timer therefore ends the process `GRACE` seconds later in any case. Files on the
disk are whole at any instant, so that nothing depends on these seconds. The exit code is 128 plus the signal's number,
as in shells.
"""

from __future__ import annotations

import atexit
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import NoReturn

from softness_bayes.base.defaults import SIGNALS

GRACE = 0.75
"""Time [s] in which a command may end by itself."""

_kept: list[Callable[[], str]] = []
_ending = threading.Lock()


class Interrupted(BaseException):
    """A signal asked the command to end; only `guarded` catches this."""


@contextmanager
def keeping(hint: Callable[[], str]) -> Iterator[None]:
    """Print a hint on kept files and how to continue if the command is interrupted inside; ``hint`` may return ''."""
    _kept.append(hint)
    yield
    _kept.remove(hint)


def tell_kept() -> None:
    """Write the hints on kept files and how to continue to the error stream."""
    for hint in reversed(_kept):
        if text := hint():
            _tell(text)


@contextmanager
def guarded(last: bool) -> Iterator[None]:
    """End the process with a short message if a signal arrives inside; do nothing outside of the main thread.

    Parameters
    ----------
    last
        Whether only the end of the process follows, during which signals are then ignored.
    """
    _kept.clear()
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    received: list[int] = []
    timers: list[threading.Timer] = []

    def stop(number: int, frame: FrameType | None) -> None:
        if received:
            _end(number)  # a second signal ends the process at once
        received.append(number)
        # errors that the interrupt causes in a callback or another thread are not shown
        sys.unraisablehook = lambda *_: None
        threading.excepthook = lambda *_: None
        timers.append(threading.Timer(GRACE, _end, [number]))
        timers[0].daemon = True
        timers[0].start()
        raise Interrupted

    before = {number: signal.getsignal(number) for number in SIGNALS}
    before = {number: handler for number, handler in before.items() if handler is not signal.SIG_IGN}
    try:
        for number in before:
            signal.signal(number, stop)
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, signal.SIG_IGN if last and not received else handler)
    except BaseException as error:
        if received and not (isinstance(error, SystemExit) and not error.code):
            _end(received[0])
        raise
    finally:
        for timer in timers:
            timer.cancel()


def _end(number: int) -> NoReturn:
    """Print that the command was interrupted, and end the workers and then this process."""
    if not _ending.acquire(blocking=False):  # another thread is already ending the process
        time.sleep(GRACE)
        os._exit(128 + number)
    with suppress(BaseException):
        for other in SIGNALS:
            signal.signal(other, signal.SIG_IGN)  # raises an error outside the main thread, which can be ignored
    with suppress(BaseException):
        for process in workers():
            with suppress(OSError):
                os.kill(process, signal.SIGKILL)
    with suppress(BaseException):
        _tell("\rinterrupted" if sys.stderr.isatty() else "interrupted")
        tell_kept()
    # the usual cleanup of the interpreter, without waiting for other threads
    last = threading.Thread(target=_clean, daemon=True)
    with suppress(BaseException):
        last.start()
        last.join(0.5 * GRACE)
    os._exit(128 + number)


def workers() -> set[int]:
    """Return the numbers of the worker processes, on systems with /proc also of those that are still starting."""
    found: set[int] = set()
    if "multiprocessing" in sys.modules:
        import multiprocessing

        found |= {process.pid for process in multiprocessing.active_children() if process.pid}
    for path in Path("/proc").glob("[0-9]*"):
        with suppress(OSError, ValueError, IndexError):
            parent = int((path / "stat").read_text().rpartition(")")[2].split()[1])
            if parent == os.getpid() and b"multiprocessing.spawn" in (path / "cmdline").read_bytes():
                found.add(int(path.name))
    return found


def _clean() -> None:
    with suppress(BaseException):
        sys.stdout.flush()
    with suppress(BaseException):
        atexit._run_exitfuncs()


def _tell(text: str) -> None:
    """Write a line directly, because the interrupted code may hold the stream's lock."""
    with suppress(OSError, AttributeError, ValueError):
        os.write(sys.stderr.fileno(), f"{text}\n".encode(errors="surrogateescape"))
        return
    with suppress(OSError, AttributeError, ValueError):
        print(text, file=sys.stderr)
