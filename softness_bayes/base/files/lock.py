"""Advisory lock on a directory, released when its process ends, so that a dead process never blocks others."""

from __future__ import annotations

import errno
import os
import re
import time
from contextlib import ExitStack, suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from filelock import lock_descriptor

from softness_bayes.base.errors import InputError, LockedError

_LOCKED = re.compile(rb"(?:[0-9]+\n?)?")
# neither through a symbolic link, nor waiting for a pipe's other end, nor changing the ends of lines; as far as a
# system has these
_PLAIN = sum(getattr(os, name, 0) for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_BINARY"))
_TRIES, _WAIT = 10, 0.05  # a process that only checks the lock holds it for an instant
_ASKED, _INSTANT = 3, 2e-3  # as does another process that checks at the same time


class Lock:
    """Context manager for a lock file that one process at a time can hold.

    Parameters
    ----------
    path
        The file; it is created if missing, and remains unless `vanish` is called.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._handle = path, -1

    def __enter__(self) -> Self:
        for _ in range(_TRIES):
            with ExitStack() as unless_held:
                handle = os.open(self._path, os.O_RDWR | os.O_CREAT | _PLAIN, 0o666)
                unless_held.callback(os.close, handle)
                if not lock_descriptor(handle, blocking=False):
                    time.sleep(_WAIT)
                    continue
                try:
                    if not os.path.samestat(os.fstat(handle), os.stat(self._path)):
                        continue
                except FileNotFoundError:  # its last holder removed the file in the meantime
                    continue
                if not _LOCKED.fullmatch(os.read(handle, 32)):
                    raise InputError(f"{self._path}: is not the lock of a run; move it away, or choose another --out")
                os.ftruncate(handle, 0)
                os.lseek(handle, 0, os.SEEK_SET)
                os.write(handle, f"{os.getpid()}\n".encode())
                unless_held.pop_all()
                self._handle = handle
                return self
        raise _refusal(self._path)

    def vanish(self) -> None:
        """Remove the file while it is held."""
        self._path.unlink(missing_ok=True)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.close(self._handle)


def require_free(path: Path) -> None:
    """Raise an error for a lock held by a process.

    Raises
    ------
    LockedError
        If it is held; the message gives the process number.
    """
    if is_held(path):
        raise _refusal(path)


def is_held(path: Path) -> bool:
    """Return whether a process holds a lock, without writing anything and within milliseconds.

    If this cannot be determined, as on a network drive without write permission, the lock counts as free.
    """
    try:
        handle = os.open(path, os.O_RDWR | _PLAIN)
    except FileNotFoundError:
        return False
    except OSError as error:
        if error.errno not in (errno.EACCES, errno.EPERM, errno.EROFS):
            raise
        handle = os.open(path, os.O_RDONLY | _PLAIN)
    try:
        for _ in range(_ASKED):
            if lock_descriptor(handle, blocking=False):
                return False
            time.sleep(_INSTANT)
    except OSError:
        return False
    finally:
        os.close(handle)
    return True


def _refusal(path: Path) -> LockedError:
    number = ""
    with suppress(OSError):
        number = path.read_text(encoding="ascii").strip()
    return LockedError(f"{path.parent}: another run is using it" + (f" (process {number})" if number else ""))
