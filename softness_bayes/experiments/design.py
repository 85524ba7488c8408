"""Touches to rate next, from a finished run, from two runs to tell apart, or before any rating.

Touches are chosen one after another, each the one that adds most to the information of those before (by the normal law
with their covariance over the draws). The information of the whole batch is then estimated without that law, between
two nested estimates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd

from softness_bayes.base.errors import InputError
from softness_bayes.base.files.outputs import write_outputs
from softness_bayes.base.files.records import as_json
from softness_bayes.base.files.spreadsheet import csv_of
from softness_bayes.base.ranges import PANEL, Count
from softness_bayes.data import Experiment
from softness_bayes.experiments.information import (
    LEAST_EFFECTIVE,
    Bracket,
    nested_gain,
    rank_bins,
    single_gains,
    told_of_mean,
)
from softness_bayes.experiments.outlook import DRAWS, Candidates, FurtherRatings, Outlook, load_named, outlook_of_run
from softness_bayes.likelihood.design import FloatArray, IndexArray
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.plotting.studies import gain_figure
from softness_bayes.plotting.style import USUAL, Style, files_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure


CONDITIONS = Count(1, 50)
"""Largest numbers of touches that a plan may have."""

MOST_REPEATS = 2
"""Largest number of times that a touch is chosen."""

WIDE_BRACKET = 0.2
"""Distance between both estimates of the information from which the plan says so [nats]."""

FILES = ("design.csv", "gain.csv", "design.json", "design.png", "design.pdf")
"""Files of a plan."""

TOUCH = ["fabric", "to_obtain", "e_fab_kpa", "indentation_mm", "force_n"]


class Costs(NamedTuple):
    """Costs of a batch in any unit, and the budget: a touch is chosen by what it adds for each unit of its cost."""

    budget: float | None = None
    fabric: float = 0.0
    """Cost of each fabric that has to be obtained."""
    load: float = 0.0
    """Cost of each load, for setting it up."""
    rating: float = 1.0
    """Cost of one rating."""

    def of_next(self, touches: pd.DataFrame, chosen: Sequence[int], raters: int) -> FloatArray:
        """Return the cost of each touch after those that are chosen, shape (touches,), if all raters rate it once."""
        had = touches.loc[list(chosen)]
        bought = touches["to_obtain"] & ~touches["fabric"].isin(had["fabric"])
        return np.asarray(self.fabric * bought + self.load * ~touches["load"].isin(had["load"]) + self.rating * raters)


@dataclass(frozen=True)
class Plan:
    """Touches to rate next.

    Parameters
    ----------
    table
        Chosen touches in the order of choice: order, fabric, to_obtain, e_fab_kpa, load, raters, gain_nats (alone),
        step_nats (what it adds to those before by the normal law; their sum is that of the batch) and cost.
    gains
        Every candidate: its gain alone (a rating by every rater), 5, 50 and 95 % limits of its response, the share of
        draws in which it is silent, and how often it was chosen.
    bracket
        Information of the whole batch, and the sd of each quantity after it.
    about
        What is to be learnt.
    new
        Whether the raters are new ones.
    """

    table: pd.DataFrame
    gains: pd.DataFrame
    bracket: Bracket
    about: tuple[str, ...]
    new: bool

    @property
    def record(self) -> dict[str, Any]:
        """The parts of the plan that its tables lack, for a file."""
        return {"about": list(self.about), "new_raters": self.new, "information": self.bracket._asdict()}

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
        width = self.bracket.high - self.bracket.low
        wide = f"the gain is known only within {width:.1f} nats: too few draws explain so many ratings"
        normal = "predicted standard deviations are those of a normal law, for the same reason"
        few = self.bracket.effective < LEAST_EFFECTIVE
        return [wide] * (width > WIDE_BRACKET) + [normal] * few


def design(
    source: Any,
    about: Sequence[str] = (),
    candidates: Candidates = Candidates(),
    *,
    conditions: int = 8,
    raters: int | None = None,
    costs: Costs = Costs(),
    options: ModelOptions = ModelOptions(),
    seed: int = 0,
) -> Plan:
    """Choose the touches whose ratings would tell most.

    Parameters
    ----------
    source
        A finished run (`Result`); several runs of the same table, such as under two readings, to tell apart; or an
        `Experiment`, whose ratings are then not used: the plan is made from the prior.
    about
        What is to be learnt: names of sampled parameters, "turning@2mm" or "turning@1N" for the modulus at the turning
        point under a load, "run" for which of several runs holds. Nothing stands for all parameters.
    candidates
        Touches that could be rated.
    conditions
        Largest number of touches.
    raters
        Number of new raters; None for the same raters as before. Each rates every touch once.
    costs
        Costs and budget; by default each rating costs 1, without limit.
    options
        Options of the model, for an `Experiment`.
    seed
        Seed of simulated outcomes.

    Raises
    ------
    InputError
        If a run is unfinished or its ratings have no level, a quantity does not exist, no candidate is within the
        model's range, or the budget pays for nothing.
    """
    rng = np.random.default_rng(seed)
    CONDITIONS.require("conditions", conditions)
    if raters is not None:
        PANEL.require("raters", raters)
    outlooks = _outlooks(source, options, rng)
    further, quantities = candidates.ratings(outlooks, raters), quantities_of(outlooks, about)
    touches, mean, wanted = further.table, further.mean, [quantities[name] for name in about]
    number = outlooks[0].level(raters)[2]
    chosen, steps = choose(further, wanted, conditions, number, costs)
    bracket = nested_gain(rng, mean[:, chosen], further.covariance(chosen), quantities, about)
    limits = zip(("low", "", "high"), np.quantile(further.response, [0.05, 0.5, 0.95], axis=0), strict=True)
    gains = touches[TOUCH].assign(
        gain_nats=single_gains(mean, further.sd, [rank_bins(values) for values in wanted]),
        **{f"response_{name}".rstrip("_"): values for name, values in limits},
        p_silent=touches["p_silent"],
        chosen=np.bincount(chosen, minlength=len(touches)),
    )
    table = gains.loc[chosen, [*TOUCH, "gain_nats"]].reset_index(drop=True)
    table.insert(0, "order", np.arange(1, len(chosen) + 1))
    table.insert(len(TOUCH) + 1, "raters", number)
    table[["step_nats", "cost"]] = steps
    new = raters is not None or not outlooks[0].rated
    return Plan(table, gains, bracket, tuple(about) or ("all",), new)


def _outlooks(source: Any, options: ModelOptions, rng: np.random.Generator) -> list[Outlook]:
    """Return the outlook of a run, of each of several, or of the prior of an experiment."""
    if isinstance(source, Experiment):
        model = build(source, options)
        theta = model.posterior.space.draw_prior(rng, DRAWS)
        return [Outlook(model, theta, rated=False)]
    every = source if isinstance(source, (list, tuple)) else [source]
    found = [outlook_of_run(one, DRAWS // len(every)) for one in every]
    if len({one.provenance.rating_data.digest_ratings for one in every}) > 1:
        raise InputError("design: the runs are of different tables of ratings; expected runs of the same")
    return found


def quantities_of(outlooks: Sequence[Outlook], about: Sequence[str]) -> dict[str, FloatArray]:
    """Return sampled parameters (their logs if all are positive) and the turning points that are asked for.

    Of several outlooks, the common ones, one outlook after another, and which outlook it is.

    Raises
    ------
    InputError
        If a quantity that is asked for does not exist.
    """
    turning = {
        name: load_named(name.removeprefix("turning@"), "about: turning@: ")
        for name in about
        if name.startswith("turning")
    }
    each = [one.quantities(turning) for one in outlooks]
    common = {name: np.concatenate([one[name] for one in each]) for name in each[0] if all(name in one for one in each)}
    if len(outlooks) > 1:
        common["run"] = np.repeat(np.arange(float(len(outlooks))), [len(one.theta) for one in outlooks])
    for name in about:
        if name not in common:
            known = ", ".join([*common, "turning@2mm"])
            raise InputError(f"about: {name!r} is no quantity of this run, expected one of {known}")
        if not np.isfinite(common[name]).any():
            raise InputError(f"about: {name}: in no draw does the response turn over under this load")
    return common


def choose(
    further: FurtherRatings, wanted: Sequence[FloatArray], conditions: int, raters: int, costs: Costs
) -> tuple[IndexArray, FloatArray]:
    """Return the chosen touches in their order, and what each adds to those before [nats] and costs, (touches, 2).

    Parameters
    ----------
    further
        Ratings of the candidates.
    wanted
        Quantities to be learnt, each (draws,), NaN where a draw has none; none for everything.
    conditions
        Largest number of touches.
    raters
        Number of raters.
    costs
        Costs and budget.

    Raises
    ------
    InputError
        If the budget does not pay for a single touch.
    """
    centred, noise2 = further.mean - further.mean.mean(axis=0), (further.noise**2).mean(axis=0)
    told, draws = told_of_mean(centred, wanted), len(centred)
    whole = centred.T @ centred / draws + further.mean_shared()
    rest = whole - told.T @ told / draws
    left = np.inf if costs.budget is None else costs.budget
    chosen: list[int] = []
    steps: list[tuple[float, float]] = []
    while len(chosen) < conditions:
        cost = costs.of_next(further.table, chosen, raters)
        step = 0.5 * np.log((whole.diagonal() + noise2) / (rest.diagonal() + noise2))
        possible = (cost <= left) & (np.bincount(chosen, minlength=len(cost)) < MOST_REPEATS)
        if not possible.any():
            break
        k = int(np.where(possible, step / np.maximum(cost, 1e-12), -np.inf).argmax())
        for covariance in (whole, rest):  # given the rating
            covariance -= np.outer(covariance[k], covariance[k]) / (covariance[k, k] + noise2[k])
        chosen.append(k)
        steps.append((step[k], cost[k]))
        left -= cost[k]
    if not chosen:
        raise InputError(f"design: a budget of {left:g} pays for no touch; the cheapest costs {cost.min():g}")
    return np.array(chosen), np.array(steps)
