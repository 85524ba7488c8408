"""Faults of a machine, from a seeded list: kills, flipped bits, cut files, full disks, denied writes."""

import errno
import os
import shutil
from contextlib import contextmanager

import pytest

from softness_bayes.base.errors import InputError
from softness_bayes.base.files import whole
from softness_bayes.runs import checkpoint as storage
from softness_bayes.runs.checkpoint import Checkpoint
from softness_bayes.runs.saved import content_of, read_last, saved_states, state_path
from support.killable import WHAT, fake_posterior, settings

DAMAGES = ("flip", "cut", "gone", "swap", "empty")
STOPS = ("kill", "fill", "deny")


class Killed(BaseException):
    """Stands for a kill: nothing handles it."""


def damage(path, how, others, random):
    """Spoil a file."""
    content = bytearray(path.read_bytes())
    if how == "gone":
        path.unlink()
        return
    if how == "flip" and content:
        content[random.integers(len(content))] ^= 1 << int(random.integers(8))
    elif how == "cut":
        content = content[: random.integers(len(content) + 1)]
    elif how == "swap":
        content = others[random.integers(len(others))].read_bytes()
    elif how == "empty":
        content = b""
    path.write_bytes(content)


@contextmanager
def stopped(how, room):
    """Let so many steps of writing succeed; from then on the disk is full, denies, or the process is killed."""
    sync, replace, left = os.fsync, os.replace, room

    def count():
        nonlocal left
        left -= 1
        if left < 0 and how == "kill":
            raise Killed
        if left < 0:
            number = errno.ENOSPC if how == "fill" else errno.EACCES
            raise OSError(number, os.strerror(number))

    def failing(work):
        def run(*arguments):
            count()
            return work(*arguments)

        return run

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(whole.os, "fsync", failing(lambda handle: None) if how == "kill" else failing(sync))
        patch.setattr(whole.os, "replace", failing(replace))
        if how == "kill":  # whoever is killed cleans nothing up
            patch.setattr(whole, "discard", lambda parts: None)
            patch.setattr(storage.Checkpoint, "_tidy", lambda checkpoint: None)
        yield


def written(directory, states, steps):
    """Write states to a checkpoint, which may hold some."""
    begun = saved_states(directory)
    with Checkpoint.open(directory, salvage=True) if begun else Checkpoint.create(directory) as checkpoint:
        state = checkpoint.begin(WHAT)
        for one in states:
            if state is None or (one.phase, one.steps) > (state.phase, state.steps):
                checkpoint.keep(one, settings(steps), fake_posterior())


def named(directory):
    """Return the names of the files of states."""
    return [state_path(directory, number).name for number in saved_states(directory)]


def rewritten(directory, **values):
    """Write the newest state of a run anew, with other values in its record."""
    record, state, _ = read_last(directory)
    state_path(directory, record.number).write_bytes(content_of(state, record._replace(**values)))


def read_back(directory):
    """Return the state of a run and what is said of damage, or a refusal."""
    try:
        with Checkpoint.open(directory, salvage=True) as checkpoint:
            return checkpoint.begin(WHAT), checkpoint.damage
    except InputError as error:
        return None, str(error)


def spoilt(run, directory, random):
    """Copy a run and damage one or both of its files; return how."""
    shutil.copytree(run, directory)
    files = sorted(path for path in (directory / "checkpoint").iterdir() if path.name != "lock")
    picked = [files[k] for k in random.choice(len(files), int(random.integers(1, len(files) + 1)), replace=False)]
    done = []
    for path in picked:
        how = str(random.choice(DAMAGES))
        damage(path, how, [other for other in files if other not in picked] or files, random)
        done.append((how, path.name))
    return done
