"""Verdict of a calibration in words: its alarms or, without any, its power."""

from __future__ import annotations

import math

import numpy as np

from softness_bayes.checking.rank_power import Least
from softness_bayes.checking.ranks import FALSE_ALARM, LARGEST_WIDTH, Calibration
from softness_bayes.readable import percent


def verdict(calibration: Calibration, size: str, decided: bool) -> str:
    """Return the verdict in one line.

    Parameters
    ----------
    calibration
        The ranks.
    size
        Number of replicates and their outcome, in words.
    decided
        Whether all replicates are finished and have valid ranks.
    """
    faults = calibration.faults()
    if faults:
        return f"Not calibrated: {size}: {'; '.join(faults)}."
    kind = ("Calibrated" if calibration.enough else "Too few replicates") if decided else "Not decided"
    worst = min(min(one.uniform_p, one.spread_p) for one in calibration.judge().values())
    return (
        f"{kind}: {size}; no alarm over {len(calibration.names)} quantities ranked among {calibration.draws} "
        f"draws: smallest p-value {worst:.2g}, alarm below {calibration.threshold:.1g} (false alarms in at "
        f"most {percent(FALSE_ALARM)} of calibrations). {_seen(calibration)}"
    )


def coverage_sentence(calibration: Calibration) -> str:
    """Describe how many coverages lie outside their limits, and how many are expected by chance."""
    rows = calibration.coverage()
    named = ("low", "share", "high", "outside")
    low, share, high, chance = np.array([[float(row[name]) for name in named] for row in rows]).T
    outside = ((share < low) | (share > high)).sum()
    said = f"{outside} of {len(rows)} shares lie outside their own 95 % limits (low, high)"
    return f"{said}; about {chance.sum():.0f} do by chance"


def _seen(calibration: Calibration) -> str:
    """Describe the faults that the number of replicates can detect, by simulation of the verdict."""
    width, shift = calibration.least_width, calibration.least_shift
    said = "No fault would have been detected with a power of 90 %."
    if math.isfinite(width.value + shift.value):
        said = (
            f"A posterior {_number(width)} times too narrow, or shifted by {_number(shift)} of its standard "
            "deviations, would have been detected with a power of 90 %; smaller faults may be missed."
        )
    if calibration.enough:
        return said
    return f"{said} To find one {LARGEST_WIDTH:g} times too narrow takes about {calibration.needed} replicates."


def _number(least: Least) -> str:
    return f"{least.value:.2f} ± {max(least.error, 0.01):.2f}"
