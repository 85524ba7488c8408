"""Further touches to rate, chosen by the information that their ratings are expected to give.

Touches are chosen one after another, each the one that adds most to the information of those before (by the normal law
with their covariance over the draws). The information of the whole batch is then estimated without that law, between
two nested estimates.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from softness_bayes.base.errors import InputError
from softness_bayes.base.files.json_text import as_json
from softness_bayes.base.files.outputs import write_outputs
from softness_bayes.base.files.spreadsheet import csv_of
from softness_bayes.experiments.information import (
    BINS,
    Bracket,
    Histograms,
    gains_about,
    linear_gain,
    nested_gain,
    rank_bins,
    rank_scores,
)
from softness_bayes.plotting.studies import gain_figure
from softness_bayes.plotting.style import USUAL, Style, files_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from softness_bayes.experiments.outlook import Touches

Array = NDArray[np.float64]
IndexArray = NDArray[np.intp]

MOST_REPEATS = 2
"""Largest number of times that a touch is chosen."""

LEAST_EFFECTIVE = 20.0
"""Effective number of draws below which predicted standard deviations are those of the normal law."""

WIDE_BRACKET = 0.2
"""Distance between both estimates of the information from which the plan says so [nats]."""

FILES = ("design.csv", "gain.csv", "design.json", "design.png", "design.pdf")
"""Files of a plan."""

TOUCH = ["fabric", "to_obtain", "e_fab_kpa", "indentation_mm", "force_n"]


class Costs(NamedTuple):
    """Costs of a batch in any unit, and the budget."""

    budget: float | None = None
    fabric: float = 0.0
    """Cost of each fabric that has to be obtained."""
    load: float = 0.0
    """Cost of each load, for setting it up."""
    rating: float = 1.0
    """Cost of one rating."""

    def of(self, touches: pd.DataFrame, raters: int) -> float:
        """Return the cost of some touches that a number of raters rate once each."""
        bought = touches.loc[touches["to_obtain"], "fabric"].nunique()
        return self.fabric * bought + self.load * touches["load"].nunique() + self.rating * raters * len(touches)


@dataclass(frozen=True)
class PanelRatings:
    """Mean ratings of touches by a panel, normal given a draw.

    Parameters
    ----------
    touches
        The touches.
    level, level_variance
        Mean and variance of the mean level of the raters at each draw, shape (draws,).
    noise
        Standard deviation of the error of one rating at each draw, shape (draws,).
    raters
        Number of raters.
    """

    touches: Touches
    level: Array
    level_variance: Array
    noise: Array
    raters: int

    @cached_property
    def mean(self) -> Array:
        """Expected mean rating of each touch at each draw, shape (draws, touches)."""
        return self.touches.response + self.level[:, None]

    @property
    def noise2(self) -> Array:
        """Variance of the errors of the mean rating, shape (draws,)."""
        return np.asarray(self.noise**2 / self.raters)

    @cached_property
    def _effects(self) -> list[tuple[IndexArray, Array]]:
        """Errors that ratings share: the group of each touch, and the sd of its effect, shape (draws, touches)."""
        t = self.touches
        fabric = pd.factorize(t.table["fabric"])[0]
        level = np.broadcast_to(np.sqrt(self.level_variance)[:, None], self.mean.shape)
        modulus = t.slope * t.table["modulus_sd"].to_numpy()
        return [(np.zeros_like(fabric), level), (fabric, modulus), (fabric, np.sqrt(t.deviation))]

    @cached_property
    def _average(self) -> Array:
        """Mean over the draws of the covariance that ratings of all touches share, shape (touches, touches)."""
        shared = [(sd.T @ sd / len(sd)) * (group[:, None] == group) for group, sd in self._effects]
        return np.asarray(sum(shared))

    @cached_property
    def covariance_of_means(self) -> Array:
        """Covariance of the expected ratings over the draws, shape (touches, touches)."""
        return np.atleast_2d(np.cov(self.mean.T, bias=True))

    def sd(self) -> Array:
        """Return the standard deviation of each touch's rating at each draw, shape (draws, touches)."""
        return np.sqrt(self.noise2[:, None] + sum(sd**2 for _, sd in self._effects))

    def errors(self, index: IndexArray) -> Array:
        """Return the covariance of ratings of some touches at each draw, shape (draws, k, k)."""
        found = self.noise2[:, None, None] * np.eye(index.size)
        for group, sd in self._effects:
            some = sd[:, index]
            found = found + some[:, :, None] * some[:, None, :] * (group[index][:, None] == group[index])
        return np.asarray(found)

    def average_errors(self, index: IndexArray) -> Array:
        """Return the mean of `errors` over the draws, shape (k, k)."""
        return np.asarray(self._average[np.ix_(index, index)] + self.noise2.mean() * np.eye(index.size))


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
        Information that each adds to those before, by the normal law [nats]; their sum is that of the batch.
    cost
        Cost that each adds.
    bracket
        Information of the whole batch.
    sd_ratio
        Expected posterior sd relative to the present one, of each quantity, after the whole batch.
    about
        What is to be learnt.
    raters, new
        Number of raters, and whether they are new ones.
    """

    touches: Touches
    gain: Array
    chosen: tuple[int, ...]
    step: Array
    cost: Array
    bracket: Bracket
    sd_ratio: Mapping[str, float]
    about: tuple[str, ...]
    raters: int
    new: bool

    @property
    def table(self) -> pd.DataFrame:
        """Chosen touches in order: fabric, to_obtain, e_fab_kpa, load, raters, gain_nats (alone), step_nats, cost."""
        index = list(self.chosen)
        table = self.touches.table.loc[index, TOUCH].reset_index(drop=True)
        table.insert(0, "order", np.arange(1, len(index) + 1))
        return table.assign(raters=self.raters, gain_nats=self.gain[index], step_nats=self.step, cost=self.cost)

    @property
    def gains(self) -> pd.DataFrame:
        """Every candidate: its gain alone, 5, 50 and 95 % limits of its response, and how often it was chosen."""
        table = self.touches.table
        often = np.bincount(np.array(self.chosen, np.intp), minlength=len(table))
        limits = np.quantile(self.touches.response, [0.05, 0.5, 0.95], axis=0)
        response = dict(zip(("response_low", "response", "response_high"), limits, strict=True))
        return table[TOUCH].assign(gain_nats=self.gain, **response, p_silent=table["p_silent"], chosen=often)

    @property
    def record(self) -> dict[str, Any]:
        """The batch in numbers, for a file."""
        b = self.bracket
        return {
            "about": list(self.about),
            "raters": {"number": self.raters, "new": self.new},
            "gain_nats": {"low": b.low, "high": b.high, "mcse": b.se, "normal_law": float(self.step.sum())},
            "effective_draws": b.effective,
            "sd_ratio": dict(self.sd_ratio),
            "cost": float(self.cost.sum()),
            "candidates": len(self.touches.table),
        }

    def figure(self, style: Style = USUAL) -> Figure:
        """Draw the gain of every candidate over the expected response."""
        return gain_figure(self.gains, self.about, style=style)

    def save(self, directory: str | Path) -> None:
        """Write the tables, the record and the figure (`FILES`) to a directory, replacing no file of others."""
        contents: dict[str, bytes | str] = {
            FILES[0]: csv_of(self.table, index=False),
            FILES[1]: csv_of(self.gains, index=False),
            FILES[2]: as_json(self.record, FILES[2], indent=1) + "\n",
        }
        write_outputs(Path(directory), contents | files_of(self.figure(), "design", ("png", "pdf")), "design")

    @property
    def notes(self) -> list[str]:
        """Sentences on what the plan cannot promise."""
        notes = []
        width = self.bracket.high - self.bracket.low
        if width > WIDE_BRACKET:
            notes.append(f"the gain is known only within {width:.1f} nats: too few draws explain so many ratings")
        if self.bracket.effective < LEAST_EFFECTIVE:
            notes.append("predicted standard deviations are those of a normal law, for the same reason")
        return notes


def choose(
    panel: PanelRatings,
    quantities: Mapping[str, Array],
    about: Sequence[str],
    conditions: int,
    costs: Costs,
    rng: np.random.Generator,
    new: bool,
) -> Plan:
    """Choose touches to rate.

    Parameters
    ----------
    panel
        Ratings of the candidates.
    quantities
        Quantities by name, each (draws,), NaN where a draw has none.
    about
        Names of those to be learnt; none for everything.
    conditions
        Largest number of touches.
    costs
        Costs and budget: a touch is chosen by what it adds for each unit of its cost, while the budget lasts.
    rng
        Random generator of simulated outcomes.
    new
        Whether the raters are new ones.

    Raises
    ------
    InputError
        If the budget does not pay for a single touch.
    """
    mean, touches = panel.mean, panel.touches.table
    wanted = [quantities[name] for name in about]
    scores = _whitened(wanted)
    with_scores = None if scores is None else (mean - mean.mean(axis=0)).T @ scores / len(mean)

    def information(index: IndexArray) -> float:
        covariance = panel.covariance_of_means[np.ix_(index, index)]
        return linear_gain(covariance, panel.average_errors(index), None if with_scores is None else with_scores[index])

    chosen: list[int] = []
    gained, spent = [0.0], [0.0]
    while len(chosen) < conditions:
        best: tuple[float, int, float, float] | None = None
        for k in range(len(touches)):
            tried = [*chosen, k]
            cost = costs.of(touches.loc[tried], panel.raters)
            if chosen.count(k) >= MOST_REPEATS or (costs.budget is not None and cost > costs.budget):
                continue
            whole = information(np.array(tried))
            rate = (whole - gained[-1]) / (1.0 if costs.budget is None else max(cost - spent[-1], 1e-12))
            if best is None or rate > best[0]:
                best = rate, k, whole, cost
        if best is None:
            break
        chosen.append(best[1])
        gained.append(best[2])
        spent.append(best[3])
    if not chosen:
        least = min(costs.of(touches.loc[[k]], panel.raters) for k in range(len(touches)))
        raise InputError(f"design: a budget of {costs.budget:g} pays for no touch; the cheapest costs {least:g}")
    index = np.array(chosen)
    bracket = nested_gain(rng, mean[:, index], panel.errors(index), quantities, _joint_bins(wanted), scores)
    ratios = bracket.sd_ratio
    if bracket.effective < LEAST_EFFECTIVE:
        whole = panel.covariance_of_means[np.ix_(index, index)] + panel.average_errors(index)
        centred = mean[:, index] - mean[:, index].mean(axis=0)
        slopes = {name: centred.T @ rank_scores(values) / len(mean) for name, values in quantities.items()}
        ratios = {n: float(np.sqrt(max(1.0 - s @ np.linalg.solve(whole, s), 0.0))) for n, s in slopes.items()}
    gain = gains_about(Histograms(mean, panel.sd()), [rank_bins(values) for values in wanted])
    steps = np.diff(gained), np.diff(spent)
    return Plan(
        panel.touches, gain, tuple(chosen), *steps, bracket, ratios, tuple(about) or ("all",), panel.raters, new
    )


def _whitened(wanted: Sequence[Array]) -> Array | None:
    """Return uncorrelated scores of unit variance of some quantities and of whether draws have them; None if none."""
    if not wanted:
        return None
    there = [np.isfinite(values) for values in wanted]
    columns = [rank_scores(values) for values in wanted]
    columns += [one.astype(float) for one in there if one.any() and not one.all()]
    scores = np.stack(columns, axis=1)
    left, size, _ = np.linalg.svd(scores - scores.mean(axis=0), full_matrices=False)
    return np.asarray(left[:, size > 1e-6 * size[0]] * np.sqrt(len(scores)))


def _joint_bins(wanted: Sequence[Array]) -> IndexArray | None:
    """Return the bin of each draw by one quantity, or by several together, each with fewer bins."""
    if not wanted:
        return None
    each = {1: BINS, 2: 5, 3: 3}.get(len(wanted), 2)
    bins = np.stack([rank_bins(values, each) for values in wanted])
    return np.unique(bins, axis=1, return_inverse=True)[1].astype(np.intp).ravel()
