"""Messages about a saved run: changed settings, and points at which its density failed."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping

import numpy as np

from softness_bayes.likelihood.directions import RATING_DIRECTIONS
from softness_bayes.sampler.starts import TargetDensity
from softness_bayes.sampler.state import RunState


def differences(then: Mapping[str, str], now: Mapping[str, str]) -> str:
    """Describe the settings in which a run differs from its start."""
    names = [name for name in {**then, **now} if _today(then.get(name)) != _today(now.get(name))]
    return "; ".join(f"{n} {then.get(n, 'not given')} (now {now.get(n, 'not given')})" for n in names)


def _today(value: str | None) -> str | None:
    """Return the present name of a value."""
    return next((d.name for d in RATING_DIRECTIONS.values() if d.former == value), value)


def failure_table(state: RunState, target: TargetDensity) -> str:
    """Return the points at which the density could not be computed, in natural units, with the stage that failed."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(["stage", *target.names])
    for failure in state.nonfinite.failures:
        writer.writerow([failure.stage, *map(repr, target.natural(np.array(failure.point)).tolist())])
    return buffer.getvalue()
