"""Other ways to compute the total rates: programs that simulate every receptor that fires.

The work is one parameter vector: all receptors that fire, summed over the 36 conditions. The time per receptor is
measured on some, with currents from just above the rheobase to alpha, and multiplied by their number. The error is that
of the summed rate of these. Transduction and the search for the receptors are left out.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.bench.precision import CHANNELS, MEDIANS, Effort, Point, model_of
from softness_bayes.model.scenes import touch_parameters
from softness_bayes.touch.neuron.rate import firing_rate, rheobase

Array = NDArray[np.float64]


class Peer(NamedTuple):
    """One program that computes firing rates."""

    name: str
    setting: str
    rates: Callable[[Array, float], Array]
    """Function from currents [µA/cm²] and duration [ms] to rates [Hz]."""
    together: bool
    """True if it integrates all receptors side by side, false one after the other."""


def receptors() -> float:
    """Return the number of receptors that fire, over all conditions."""
    scene = model_of(True).scene
    return float(scene.respond(touch_parameters(MEDIANS)).responding.sum())


def measure(peer: Peer, count: float, effort: Effort) -> Point:
    """Take a peer's processor time for some receptors, times a count of them all, and compare rates with exact ones."""
    measured = effort.receptors[not peer.together]
    # from alpha down to near the rheobase, evenly spaced in the root of the distance from it
    least, most = float(rheobase()), float(MEDIANS["alpha"])
    current = least + (most - least) * np.linspace(1.0, 0.5, measured) ** 2
    peer.rates(current if peer.together else current[:1], 1.0)  # compilation is not counted
    begun = time.process_time()
    rates = peer.rates(current, effort.duration)
    spent = (time.process_time() - begun) / measured
    some = np.unique(np.linspace(0, measured - 1, 12).astype(int))
    error = abs(float(rates[some].sum() / firing_rate(current[some]).sum() - 1.0))
    return Point(peer.name, peer.setting, spent * count, error, np.nan)


def ratio(peer: Point, ours: Sequence[Point]) -> float:
    """Return a peer's time over that of the fastest likelihood with its error or less; NaN if none is as accurate."""
    good = [p.seconds for p in ours if p.way == CHANNELS[0] and p.error_peak <= peer.error_peak]
    return peer.seconds / min(good) if good else np.nan
