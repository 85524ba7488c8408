"""Further touches to rate, chosen by the information that their ratings are expected to give.

Touches are chosen one after another, each the one that adds most to the information of those before (by the normal law
with their covariance over the draws). The information of the whole batch is then estimated without that law, between
two nested estimates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.errors import InputError
from softness_bayes.experiments.information import (
    BINS,
    Bracket,
    Histograms,
    linear_gain,
    nested_gain,
    rank_bins,
    rank_scores,
    single_gains,
)
from softness_bayes.experiments.outlook import Touches
from softness_bayes.touch.contact import Force, Load, held

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]
IndexArray = NDArray[np.intp]

MOST_REPEATS = 2
"""Largest number of times that a touch is chosen."""

LEAST_EFFECTIVE = 20.0
"""Effective number of draws below which predicted standard deviations are those of the normal law."""

WIDE_BRACKET = 0.2
"""Distance between both estimates of the information from which the plan says so [nats]."""


class Costs(NamedTuple):
    """Costs of a batch in any unit, and the budget."""

    budget: float | None = None
    fabric: float = 0.0
    """Cost of each fabric that has to be obtained."""
    load: float = 0.0
    """Cost of each load, for setting it up."""
    rating: float = 1.0
    """Cost of one rating."""


class Panel(NamedTuple):
    """Raters who rate every chosen touch once."""

    number: int
    new: bool


@dataclass(frozen=True)
class Plan:
    """Touches to rate next.

    Parameters
    ----------
    touches
        All candidates.
    gain
        Information that a rating of each candidate by every rater would give, alone [nats].
    chosen
        Indices of the chosen candidates, in the order of choice.
    step
        Information that each adds to those before, by the normal law [nats].
    bracket
        Information of the whole batch.
    normal_gain
        That information by the normal law.
    sd_ratio
        Expected posterior sd relative to the present one, of each quantity, after the whole batch.
    costs, panel, about
        The request.
    """

    touches: Touches
    gain: Array
    chosen: tuple[int, ...]
    step: Array
    bracket: Bracket
    normal_gain: float
    sd_ratio: dict[str, float]
    costs: Costs
    panel: Panel
    about: tuple[str, ...]

    @cached_property
    def table(self) -> pd.DataFrame:
        """Chosen touches in order: fabric, to_obtain, e_fab_kpa, load, raters, gain_nats (alone), step_nats, cost."""
        import pandas as pd

        index, touches = np.array(self.chosen, np.intp), self.touches
        return pd.DataFrame(
            {
                "order": np.arange(1, index.size + 1),
                **_columns(touches, index),
                "raters": self.panel.number,
                "gain_nats": self.gain[index],
                "step_nats": self.step,
                "cost": np.diff(_cumulative_cost(touches, self.chosen, self.costs, self.panel), prepend=0.0),
            }
        )

    @cached_property
    def gains(self) -> pd.DataFrame:
        """Every candidate with the information that it would give alone, and how often it was chosen."""
        import pandas as pd

        index = np.arange(len(self.touches.load))
        return pd.DataFrame(
            {
                **_columns(self.touches, index),
                "gain_nats": self.gain,
                "p_silent": self.touches.silent,
                "chosen": np.bincount(np.array(self.chosen, np.intp), minlength=index.size),
            }
        )

    @property
    def record(self) -> dict[str, object]:
        """The batch in numbers, for a file."""
        b = self.bracket
        return {
            "about": list(self.about),
            "raters": {"number": self.panel.number, "new": self.panel.new},
            "gain_nats": {"low": b.low, "high": b.high, "mcse": b.se, "normal_law": self.normal_gain},
            "effective_draws": b.effective,
            "sd_ratio": self.sd_ratio,
            "cost": float(_cumulative_cost(self.touches, self.chosen, self.costs, self.panel)[-1]),
            "candidates": len(self.touches.load),
        }

    @property
    def notes(self) -> list[str]:
        """Sentences on what the plan cannot promise."""
        found = []
        width = self.bracket.high - self.bracket.low
        if width > WIDE_BRACKET:
            found.append(f"the gain is known only within {width:.1f} nats: too few draws explain so many ratings")
        if self.bracket.effective < LEAST_EFFECTIVE:
            found.append("predicted standard deviations are those of a normal law, for the same reason")
        return found


def choose(
    touches: Touches,
    level: Array,
    level_variance: Array,
    noise: Array,
    quantities: dict[str, Array],
    about: Sequence[str],
    conditions: int,
    panel: Panel,
    costs: Costs,
    rng: np.random.Generator,
) -> Plan:
    """Choose touches to rate.

    Parameters
    ----------
    touches
        The candidates.
    level, level_variance
        Mean and variance of the mean level of the raters at each draw, shape (draws,).
    noise
        Standard deviation of one rating's error at each draw, shape (draws,).
    quantities
        Quantities by name, each (draws,), NaN where a draw has none.
    about
        Names of those to be learnt; none for everything.
    conditions
        Largest number of touches.
    panel
        The raters.
    costs
        Costs and budget: a touch is chosen by what it adds for each unit of its cost, while the budget lasts.
    rng
        Random generator of simulated outcomes.

    Raises
    ------
    InputError
        If the budget does not pay for a single touch.
    """
    noise2 = noise**2 / panel.number
    mean = touches.response + level[:, None]
    wanted = [quantities[name] for name in about]
    gain = _single(touches, mean, noise2, level_variance, wanted)
    covariance = np.atleast_2d(np.cov(mean.T, bias=True))
    scores = _whitened(wanted)
    with_scores = None if scores is None else (mean - mean.mean(axis=0)).T @ scores / len(mean)
    errors = _Errors(touches, noise2, level_variance)
    average = errors.average()
    chosen: list[int] = []
    steps, before = [], 0.0
    while len(chosen) < conditions:
        costs_now = _cumulative_cost(touches, chosen, costs, panel)[-1] if chosen else 0.0
        best, best_step, best_rate = -1, 0.0, -np.inf
        for k in range(len(touches.load)):
            if chosen.count(k) >= MOST_REPEATS:
                continue
            tried = [*chosen, k]
            cost = _cumulative_cost(touches, tried, costs, panel)[-1]
            if costs.budget is not None and cost > costs.budget:
                continue
            index = np.array(tried)
            whole = linear_gain(
                covariance[np.ix_(index, index)],
                _of_repeats(average, noise2.mean(), index),
                None if with_scores is None else with_scores[index],
            )
            rate = (whole - before) / (max(cost - costs_now, 1e-12) if costs.budget is not None else 1.0)
            if rate > best_rate:
                best, best_step, best_rate = k, whole - before, rate
        if best < 0:
            break
        chosen.append(best)
        steps.append(best_step)
        before += best_step
    if not chosen:
        least = min(_cumulative_cost(touches, [k], costs, panel)[-1] for k in range(len(touches.load)))
        raise InputError(f"design: a budget of {costs.budget:g} pays for no touch; the cheapest costs {least:g}")
    index = np.array(chosen)
    label = _joint_bins(wanted)
    bracket = nested_gain(rng, mean[:, index], errors.of(index), quantities, label, scores)
    ratios = dict(bracket.sd_ratio)
    if bracket.effective < LEAST_EFFECTIVE:
        whole_inverse = np.linalg.inv(covariance[np.ix_(index, index)] + _of_repeats(average, noise2.mean(), index))
        centred = mean[:, index] - mean[:, index].mean(axis=0)
        for name, values in quantities.items():
            slope = centred.T @ rank_scores(values) / len(mean)
            ratios[name] = float(np.sqrt(max(1.0 - slope @ whole_inverse @ slope, 0.0)))
    return Plan(
        touches, gain, tuple(chosen), np.array(steps), bracket, before, ratios, costs, panel, tuple(about) or ("all",)
    )


def _single(touches: Touches, mean: Array, noise2: Array, level_variance: Array, wanted: list[Array]) -> Array:
    """Return the information of one rating of each touch by every rater, about all or the sum over the quantities."""
    variance = noise2[:, None] + level_variance[:, None] + (touches.slope * touches.modulus_sd) ** 2 + touches.deviation
    histograms = Histograms(mean, np.sqrt(variance))
    if not wanted:
        return single_gains(histograms)
    return np.sum([single_gains(histograms, rank_bins(values)) for values in wanted], axis=0)


class _Errors:
    """Covariances of ratings given a draw: noise, the raters' common level, and what touches of a fabric share."""

    def __init__(self, touches: Touches, noise2: Array, level_variance: Array) -> None:
        self.touches, self.noise2, self.level_variance = touches, noise2, level_variance
        self.alike = np.array(touches.fabric)[:, None] == np.array(touches.fabric)

    def of(self, index: IndexArray) -> Array:
        """Return the covariance of ratings of some touches at each draw, shape (draws, k, k)."""
        t = self.touches
        slope = t.slope[:, index] * t.modulus_sd[index]
        shared = slope[:, :, None] * slope[:, None, :] + t.deviation[:, index, None]
        shared = shared * self.alike[np.ix_(index, index)] + self.level_variance[:, None, None]
        return np.asarray(shared + self.noise2[:, None, None] * np.eye(index.size))

    def average(self) -> Array:
        """Return the mean covariance without noise of all touches, shape (touches, touches)."""
        t = self.touches
        slope = t.slope * t.modulus_sd
        shared = slope.T @ slope / len(slope) + t.deviation.mean(axis=0)[:, None]
        return np.asarray(shared * self.alike + self.level_variance.mean())


def _of_repeats(average: Array, noise2: float, index: IndexArray) -> Array:
    """Return the mean covariance of ratings of some touches, each with a noise of its own."""
    return np.asarray(average[np.ix_(index, index)] + noise2 * np.eye(index.size))


def _whitened(wanted: list[Array]) -> Array | None:
    """Return uncorrelated scores of unit variance of some quantities and of whether draws have them; None if none."""
    if not wanted:
        return None
    columns = []
    for values in wanted:
        columns.append(rank_scores(values))
        there = np.isfinite(values)
        if not there.all() and there.any():
            columns.append(there.astype(float))
    scores = np.stack(columns, axis=1)
    left, size, _ = np.linalg.svd(scores - scores.mean(axis=0), full_matrices=False)
    kept = size > 1e-6 * size[0]
    return np.asarray(left[:, kept] * np.sqrt(len(scores)))


def _joint_bins(wanted: list[Array]) -> IndexArray | None:
    """Return the bin of each draw by one quantity, or by several together, each with fewer bins."""
    if not wanted:
        return None
    each = {1: BINS, 2: 5}.get(len(wanted), 3 if len(wanted) == 3 else 2)
    label = np.zeros(wanted[0].size, np.intp)
    for values in wanted:
        bins = rank_bins(values, each)
        label = label * (int(bins.max()) + 1) + bins
    return np.unique(label, return_inverse=True)[1].astype(np.intp)


def _columns(touches: Touches, index: IndexArray) -> dict[str, object]:
    forces = [isinstance(touches.load[k], Force) for k in index]
    value = [held(touches.load[k]) for k in index]
    return {
        "fabric": [touches.fabric[k] for k in index],
        "to_obtain": ~touches.owned[index],
        "e_fab_kpa": touches.modulus[index] * 1e-3,
        "indentation_mm": [np.nan if f else v * 1e3 for f, v in zip(forces, value, strict=True)],
        "force_n": [v if f else np.nan for f, v in zip(forces, value, strict=True)],
    }


def _cumulative_cost(touches: Touches, chosen: Sequence[int], costs: Costs, panel: Panel) -> Array:
    """Return the cost of the first chosen touches, of any number, shape (chosen,)."""
    bought: set[str] = set()
    loads: set[Load] = set()
    total, found = 0.0, []
    for k in chosen:
        if not touches.owned[k] and touches.fabric[k] not in bought:
            bought.add(touches.fabric[k])
            total += costs.fabric
        if touches.load[k] not in loads:
            loads.add(touches.load[k])
            total += costs.load
        total += costs.rating * panel.number
        found.append(total)
    return np.array(found)
