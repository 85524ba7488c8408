"""Direction of a table's ratings with stiffness, and the direction with the response that agrees with it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.layout import Layout
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.directions import FALLS, FREE, RISES, RatingDirection
from softness_bayes.model.trend import Correlation, Trend, find_trend, mean_correlation
from softness_bayes.readable import counted, percent

WAY = {1: "rise", -1: "fall"}
"""Verbs for the sign of a correlation of ratings with stiffness."""

DRAWS, FEWEST = 256, 16
"""Number of prior draws whose response is examined, and the smallest number whose response must vary with the
fabric."""

SURE = 0.9
"""Share of these draws in which firing must rise (or fall) with stiffness for the ratings to determine the
direction."""


class Evidence(NamedTuple):
    """The evidence of a table about the direction of its ratings."""

    trend: Trend
    loads: tuple[str, ...]
    firing: float
    """Share of prior draws for which firing rises with stiffness across these fabrics (`firing_rises`)."""
    left_out: int = 0
    """Number of fabrics left out because nothing is known about their moduli."""

    @property
    def direction(self) -> RatingDirection | None:
        """The direction that predicts the observed trend with stiffness; None if the table does not determine it."""
        firing = int(self.firing >= SURE) - int(self.firing <= 1.0 - SURE)
        return {1: RISES, -1: FALLS}.get(firing * self.trend.sign)

    @property
    def sentence(self) -> str:
        """The trend of the ratings with stiffness over all loads, in one line."""
        mean, sign = self.trend.mean, self.trend.sign
        if not math.isfinite(mean.value):
            return (
                "these ratings contain no information about stiffness: moduli or mean ratings do not differ at any load"
            )
        over = f"over {len(self.loads)} loads" if len(self.loads) > 1 else f"at {self.loads[0]}"
        numbers = f"rank correlation with E_fab {_numbers(mean)} {over}; p = {self.trend.p_value:.2g} if "
        numbers += f"{self.trend.shuffled} were random"
        if self.left_out:
            numbers += f"; without {counted(self.left_out, 'fabric')} of unknown modulus"
        if not sign:
            return f"these ratings neither rise nor fall clearly with stiffness ({numbers})"
        return f"these ratings {WAY[sign]} with stiffness ({numbers})"

    @property
    def model(self) -> str:
        """The model's prediction for firing as a function of stiffness, in a clause."""
        rises = self.firing >= 0.5
        share = self.firing if rises else 1.0 - self.firing
        way = "rises" if rises else "falls"
        return f"firing {way} with stiffness over these fabrics in {percent(share)} of prior draws"

    @property
    def lines(self) -> list[str]:
        """One line for each load, then one for all of them and one for the direction that agrees with the table."""
        each = zip(self.loads, self.trend.loads, self.trend.fabrics, strict=True)
        lines = [
            f"{load}: {_way(one)}, rank correlation of mean rating with E_fab {_numbers(one)}, {count} fabrics"
            for load, one, count in each
            if math.isfinite(one.value)
        ]
        if self.direction is None:
            reading = f"the table cannot decide between {RISES.name} and {FALLS.name}; {self.model}"
        else:
            reading = f"these ratings agree with --direction {self.direction.name}, because {self.model}"
        return [*lines, self.sentence, reading]


class DirectionChoice(NamedTuple):
    """The direction that a run takes, and the evidence of its data."""

    direction: RatingDirection
    asked: bool
    """True if the user chose it; otherwise it is inferred from the data, or is the default if these do not decide."""
    evidence: Evidence

    @property
    def against_data(self) -> bool:
        """True if the data clearly show the opposite direction."""
        return self.direction is not FREE and self.evidence.direction not in (None, self.direction)

    @property
    def sentence(self) -> str:
        """The chosen direction, the reason, and the option that overrides it."""
        name, found = self.direction.name, self.evidence
        if self.direction is FREE:
            return f"--direction {name}: both directions are sampled, each with prior probability 1/2: {found.sentence}"
        other = next(one for one in (RISES, FALLS) if one is not self.direction).name
        if self.against_data:
            return (
                f"the direction contradicts the data: with --direction {name} the prediction has the wrong "
                f"sign, because {found.sentence}, and {found.model}; use --direction {other}"
            )
        if self.asked:
            return f"--direction {name}, as asked: {found.sentence}"
        if found.direction is None:
            return (
                f"--direction {name} is used by default: {found.sentence}, and {found.model}; the alternative "
                f"is --direction {other}"
            )
        return (
            f"--direction {name} was chosen from the data: {found.sentence}, and {found.model}; --direction "
            f"{other} overrides it"
        )


def evidence_of(
    layout: Layout,
    ratings: NDArray[np.float64],
    rate: NDArray[np.float64],
    known: NDArray[np.bool_],
    loads: Sequence[str],
) -> Evidence:
    """Return the evidence of a table about the direction of its ratings.

    Only fabrics with known moduli show a trend with stiffness. If fewer than two rated fabrics have one, the medians
    of the priors take their place.

    Parameters
    ----------
    layout
        Design of the ratings.
    ratings
        Shape (rows,).
    rate
        Total rate [spikes/s] at some draws of the prior, shape (draws, conditions).
    known
        True for fabrics whose modulus was measured or bracketed, shape (fabrics,).
    loads
        Names of the loads.
    """
    design, rated = layout.design, np.unique(layout.design.fabric)
    if known[rated].sum() < 2:
        known = np.ones_like(known)
    conditions = known[design.fabric]
    rows, place = conditions[design.condition], np.cumsum(conditions) - 1
    kept = Design(
        place[design.condition[rows]], design.participant[rows], design.fabric[conditions], design.n_participants
    )
    part = replace(layout, design=kept, modulus=layout.modulus[conditions], load=layout.load[conditions])
    return Evidence(
        find_trend(part, ratings[rows]),
        tuple(loads[k] for k in part.loads),
        firing_rises(part, rate[:, conditions]),
        int((~known[rated]).sum()),
    )


def firing_rises(layout: Layout, rate: NDArray[np.float64]) -> float:
    """Return the share of parameter vectors for which firing rises with stiffness across the fabrics.

    The response rises with E_fab up to its turning point and falls beyond it. Only vectors with varying responses are
    counted; a response rises if its mean rank correlation over the loads is positive. If fewer than `FEWEST` vary,
    loads are too light for a turning point, and the share is 1.

    Parameters
    ----------
    layout
        Moduli and loads of the conditions.
    rate
        Total rate [spikes/s], shape (draws, conditions).
    """
    found = mean_correlation(layout, rate)
    varies = found[np.isfinite(found)]
    return float((varies > 0).mean()) if varies.size >= FEWEST else 1.0


def _way(found: Correlation) -> str:
    sure = found.low * found.high > 0  # NaN does not count as varying
    return f"ratings {WAY[int(np.sign(found.value))]} with stiffness" if sure else "no clear order with stiffness"


def _numbers(found: Correlation) -> str:
    if math.isnan(found.low):
        return f"{found.value:+.2f}"
    return f"{found.value:+.2f} (90 % interval {found.low:+.2f} to {found.high:+.2f} over participants)"
