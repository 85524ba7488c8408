"""Touches to rate next, from a finished run, from two runs to tell apart, or before any rating.

Touches are chosen one after another, each the one that adds most to the information of those before (by the normal law
with their covariance over the draws). The information of the whole batch is then estimated without that law, between
two nested estimates.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from softness_bayes.base.errors import InputError
from softness_bayes.base.files.outputs import write_outputs
from softness_bayes.base.files.records import as_json
from softness_bayes.base.files.spreadsheet import csv_of
from softness_bayes.base.ranges import PANEL
from softness_bayes.data import Experiment, Fabrics
from softness_bayes.experiments.information import (
    BINS,
    Bracket,
    linear_gain,
    nested_gain,
    rank_bins,
    rank_scores,
    single_gains,
)
from softness_bayes.experiments.outlook import DRAWS, Outlook, Touches, outlook_of_run, touches_within
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.plotting.studies import gain_figure
from softness_bayes.plotting.style import USUAL, Style, files_of
from softness_bayes.touch.contact import Force, FreeTouch, Indentation, Load, held, require_loads

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
IndexArray = NDArray[np.intp]

GRID = 12
"""Number of moduli to obtain, over the range of the rated ones."""

SPREADS = ("tau", "varsigma", "omega", "nu", "lapse")
"""Parameters that are learnt from differences between ratings of one touch, which the plan averages."""

TURNING = "turning"
WHICH = "run"
"""Name of the quantity that tells two runs apart."""

_LOAD = re.compile(r"\s*(\d+\.?\d*(?:e[+-]?\d+)?|\.\d+)\s*(mm|N)\s*")

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

    @cached_property
    def _effects(self) -> list[tuple[IndexArray, Array]]:
        """Errors that ratings share: the group of each touch, and the sd of its effect, shape (draws, touches)."""
        t = self.touches
        fabric = pd.factorize(t.table["fabric"])[0]
        level = np.broadcast_to(np.sqrt(self.level_variance)[:, None], self.mean.shape)
        modulus = t.slope * t.table["modulus_sd"].to_numpy()
        return [(np.zeros_like(fabric), level), (fabric, modulus), (fabric, np.sqrt(t.deviation))]

    @cached_property
    def shared(self) -> Array:
        """Mean over the draws of the covariance of ratings of the touches by effects, shape (touches, touches)."""
        return np.asarray(sum((sd.T @ sd / len(sd)) * (group[:, None] == group) for group, sd in self._effects))

    def errors(self, index: IndexArray) -> Array:
        """Return the covariance of ratings of some touches at each draw, shape (draws, k, k)."""
        found = (self.noise**2 / self.raters)[:, None, None] * np.eye(index.size)
        for group, sd in self._effects:
            some = sd[:, index]
            found = found + some[:, :, None] * some[:, None, :] * (group[index][:, None] == group[index])
        return np.asarray(found)

    def sd(self) -> Array:
        """Return the standard deviation of each touch's rating at each draw, shape (draws, touches)."""
        return np.sqrt((self.noise**2 / self.raters)[:, None] + sum(sd**2 for _, sd in self._effects))


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
        Information of the whole batch.
    sd_ratio
        Expected posterior sd relative to the present one, of each quantity, after the whole batch.
    about
        What is to be learnt.
    new
        Whether the raters are new ones.
    """

    table: pd.DataFrame
    gains: pd.DataFrame
    bracket: Bracket
    sd_ratio: Mapping[str, float]
    about: tuple[str, ...]
    new: bool

    @property
    def record(self) -> dict[str, Any]:
        """The batch in numbers, for a file."""
        b = self.bracket
        return {
            "about": list(self.about),
            "raters": {"number": int(self.table["raters"].iloc[0]), "new": self.new},
            "gain_nats": {"low": b.low, "high": b.high, "mcse": b.se, "normal_law": self.table["step_nats"].sum()},
            "effective_draws": b.effective,
            "sd_ratio": dict(self.sd_ratio),
            "cost": self.table["cost"].sum(),
            "candidates": len(self.gains),
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


def design(
    source: Any,
    about: Sequence[str] = (),
    *,
    candidates: Fabrics | None = None,
    moduli: Sequence[float] | None = None,
    loads: Sequence[Load] | None = None,
    largest_load: Load | None = None,
    conditions: int = 8,
    raters: int | None = None,
    costs: Costs | None = None,
    modulus_cv: float | None = None,
    options: ModelOptions = ModelOptions(),
    seed: int = 0,
) -> Plan:
    """Choose the touches whose ratings would tell most.

    Parameters
    ----------
    source
        A finished run (`Result`); two runs of the same table, such as under two readings, to tell apart; or an
        `Experiment`, whose ratings are then not used: the plan is made from the prior.
    about
        What is to be learnt: names of sampled parameters, "turning@2mm" or "turning@1N" for the modulus at the turning
        point under a load, "run" for which of two runs holds. Nothing stands for all parameters.
    candidates
        Fabrics that could be rated; those with the name of a rated one are owned. By default the rated fabrics and
        `moduli`.
    moduli
        Effective moduli [Pa] of fabrics to obtain; by default `GRID` values over the range of the rated ones, none if
        there are candidates.
    loads
        Loads; by default those of the experiment.
    largest_load
        Larger loads of its kind, indentations or forces, are left out.
    conditions
        Largest number of touches.
    raters
        Number of new raters; None for the same raters as before. Each rates every touch once.
    costs
        Costs and budget; by default each rating costs 1, without limit.
    modulus_cv
        Relative standard error of moduli; by default that of the run, and `USUAL_CV` where it took moduli as exact.
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
    if conditions < 1:
        raise InputError(f"conditions: expected 1 or more, got {conditions}")
    if raters is not None and not PANEL.low <= raters <= PANEL.high:
        raise InputError(f"raters: expected {PANEL}, got {raters}")
    outlooks = _outlooks(source, options, rng)
    first = outlooks[0]
    ratings = first.model.data.ratings
    pressed = require_loads("loads", tuple(loads)) if loads is not None else tuple(ratings.loads)
    if largest_load is not None:
        most = held(largest_load) * (1.0 + 1e-9)
        # of the other kind, every load stays
        pressed = tuple(load for load in pressed if type(load) is not type(largest_load) or held(load) <= most)
        if not pressed:
            raise InputError(f"largest load: every load is larger than {largest_load}; choose a larger one")
    touches = touches_within(outlooks, candidates_of(first, candidates, moduli), pressed, modulus_cv)
    quantities = quantities_of(outlooks, about)
    number = len(ratings.participants) if raters is None else raters
    new = raters is not None or not first.rated
    levels = [(*one.level(number if new else None), one.noise) for one in outlooks]
    level, variance, noise = (np.concatenate(part) for part in zip(*levels, strict=True))
    panel = PanelRatings(touches, level, variance, noise, number)
    return choose(panel, quantities, about, conditions, costs or Costs(), rng, new)


def _outlooks(source: Any, options: ModelOptions, rng: np.random.Generator) -> list[Outlook]:
    """Return the outlook of a run, of each of several, or of the prior of an experiment."""
    if isinstance(source, Experiment):
        model = build(source, options)
        theta = model.posterior.space.draw_prior(rng, DRAWS)
        return [Outlook(model, theta, model.posterior.space.values(theta), rated=False)]
    every = list(source) if isinstance(source, (list, tuple)) else [source]
    found = [outlook_of_run(one, DRAWS // len(every)) for one in every]
    if len({one.provenance.rating_data.digest_ratings for one in every}) > 1:
        raise InputError("design: the runs are of different tables of ratings; expected runs of the same")
    return found


def candidates_of(outlook: Outlook, candidates: Fabrics | None, moduli: Sequence[float] | None) -> Fabrics:
    """Return the fabrics that could be rated: given or owned ones, and those of moduli to obtain."""
    base = outlook.model.data.fabrics if candidates is None else candidates
    rated = outlook.model.scene.fabric_modulus
    usual = np.geomspace(rated.min(), rated.max(), GRID if candidates is None else 0)
    wanted = usual if moduli is None else np.asarray(moduli, float)
    if not ((wanted > 0) & np.isfinite(wanted)).all():
        raise InputError("moduli: expected numbers above 0 [Pa]")
    names = (*base.names, *(f"E_fab {value / 1e3:.3g} kPa" for value in wanted))
    measured = {one.name: getattr(base, one.name) for one in fields(base)}
    unknown = np.full(wanted.size, np.nan)
    arrays: dict[str, Any] = {k: np.append(v, unknown) for k, v in measured.items() if isinstance(v, np.ndarray)}
    arrays["effective_modulus"][len(base) :] = wanted
    return replace(base, names=names, rows=(), batch=(*base.batch, *[""] * wanted.size), **arrays)


def quantities_of(outlooks: Sequence[Outlook], about: Sequence[str]) -> dict[str, Array]:
    """Return sampled parameters (their logs if all are positive) and the turning points that are asked for.

    Of several outlooks, the common ones, one outlook after another, and which outlook it is.

    Raises
    ------
    InputError
        If a quantity that is asked for does not exist.
    """
    each = []
    for one in outlooks:
        space = one.posterior.space
        draws = zip(space.names[: space.n_chain], one.theta.T, strict=False)
        found = {name: np.log(x) if (x > 0).all() else x for name, x in draws if name not in SPREADS}
        for name in about:
            if name.startswith(TURNING):
                found[name] = one.turning(load_named(name.removeprefix(f"{TURNING}@"), f"about: {TURNING}@: "))
                if not np.isfinite(found[name]).any():
                    raise InputError(f"about: {name}: in no draw does the response turn over under this load")
        each.append(found)
    common = {name: np.concatenate([one[name] for one in each]) for name in each[0] if all(name in one for one in each)}
    if len(outlooks) > 1:
        common[WHICH] = np.repeat(np.arange(float(len(outlooks))), [len(one.theta) for one in outlooks])
    for name in about:
        if name not in common:
            known = ", ".join([*common, "turning@2mm"])
            raise InputError(f"about: {name!r} is no quantity of this run, expected one of {known}")
    return common


def load_named(text: str, what: str = "") -> Load:
    """Return the load of a text such as 2mm or 1N, or as loads are written.

    Raises
    ------
    InputError
        If it is none; the message begins with `what`.
    """
    match = _LOAD.fullmatch(text)
    if match is None and text != str(FreeTouch()):
        raise InputError(f"{what}expected a load such as 2mm or 1N, got {text!r}")
    if match is None:
        return FreeTouch()
    return Indentation(float(match[1]) / 1e3) if match[2] == "mm" else Force(float(match[1]))


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
    centred = mean - mean.mean(axis=0)
    wanted = [quantities[name] for name in about]
    scores, noise2 = _whitened(wanted), float((panel.noise**2).mean()) / panel.raters
    whole = centred.T @ centred / len(mean) + panel.shared
    known = None if scores is None else centred.T @ scores / len(mean)
    rest = panel.shared if known is None else whole - known @ known.T

    def rated(covariance: Array, index: Sequence[int]) -> Array:
        return covariance[np.ix_(index, index)] + noise2 * np.eye(len(index))

    chosen: list[int] = []
    rows = [(0.0, 0.0)]
    while len(chosen) < conditions:
        tried = []
        for k in range(len(touches)):
            index = [*chosen, k]
            cost = costs.of(touches.loc[index], panel.raters)
            if chosen.count(k) < MOST_REPEATS and (costs.budget is None or cost <= costs.budget):
                information = linear_gain(rated(whole, index), rated(rest, index))
                per = 1.0 if costs.budget is None else max(cost - rows[-1][1], 1e-12)
                tried.append(((information - rows[-1][0]) / per, -k, (information, cost)))
        if not tried:
            break
        _, k, row = max(tried)
        chosen.append(-k)
        rows.append(row)
    if not chosen:
        least = min(costs.of(touches.loc[[k]], panel.raters) for k in range(len(touches)))
        raise InputError(f"design: a budget of {costs.budget:g} pays for no touch; the cheapest costs {least:g}")
    best = np.array(chosen)
    bracket = nested_gain(rng, mean[:, best], panel.errors(best), quantities, _joint_bins(wanted), scores)
    ratios = bracket.sd_ratio
    if bracket.effective < LEAST_EFFECTIVE:
        slopes = {name: centred[:, best].T @ rank_scores(values) / len(mean) for name, values in quantities.items()}
        ratios = {
            name: float(np.sqrt(max(1.0 - slope @ np.linalg.solve(rated(whole, chosen), slope), 0.0)))
            for name, slope in slopes.items()
        }
    limits = zip(("low", "", "high"), np.quantile(panel.touches.response, [0.05, 0.5, 0.95], axis=0), strict=True)
    gains = touches[TOUCH].assign(
        gain_nats=single_gains(mean, panel.sd(), [rank_bins(values) for values in wanted]),
        **{f"response_{name}".rstrip("_"): values for name, values in limits},
        p_silent=touches["p_silent"],
        chosen=np.bincount(best, minlength=len(touches)),
    )
    table = gains.loc[chosen, [*TOUCH, "gain_nats"]].reset_index(drop=True)
    table.insert(0, "order", np.arange(1, len(chosen) + 1))
    table.insert(len(TOUCH) + 1, "raters", panel.raters)
    table[["step_nats", "cost"]] = np.diff(rows, axis=0)
    return Plan(table, gains, bracket, ratios, tuple(about) or ("all",), new)


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
