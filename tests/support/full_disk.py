"""A disk on which there is room for some writes only."""

import errno
import os

from softness_bayes.base.files import whole


def fill_disk(monkeypatch, room):
    """Let so many files reach the disk, and refuse all that follow as a full disk does."""
    sync, left = os.fsync, room

    def full(handle):
        nonlocal left
        left -= 1
        if left < 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        sync(handle)

    monkeypatch.setattr(whole.os, "fsync", full)
