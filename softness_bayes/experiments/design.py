"""Touches to rate next, from a finished run, from two runs to tell apart, or before any rating."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes.base.errors import InputError
from softness_bayes.base.ranges import PANEL, require_kind
from softness_bayes.data import Experiment, Fabrics
from softness_bayes.experiments.choice import Costs, PanelRatings, Plan, choose
from softness_bayes.experiments.outlook import DRAWS, Outlook, Touches, outlook_of_prior, outlook_of_run
from softness_bayes.model.options import ModelOptions
from softness_bayes.touch.contact import Force, Indentation, Load, held, require_loads

Array = NDArray[np.float64]

GRID = 12
"""Number of moduli to obtain, over the range of the rated ones."""

SPREADS = ("tau", "varsigma", "omega", "nu", "lapse")
"""Parameters that are learnt from differences between ratings of one touch, which the plan averages."""

TURNING = "turning"
WHICH = "run"
"""Name of the quantity that tells two runs apart."""

_LOAD = re.compile(r"\s*([0-9.eE+-]+)\s*(mm|N)\s*")


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
    experiment = first.model.data
    fabrics = candidates_of(first, candidates, moduli)
    pressed = require_loads("loads", tuple(loads)) if loads is not None else tuple(experiment.ratings.loads)
    if largest_load is not None:
        most = held(largest_load) * (1.0 + 1e-9)
        # of the other kind, every load stays
        pressed = tuple(load for load in pressed if type(load) is not type(largest_load) or held(load) <= most)
        if not pressed:
            raise InputError(f"largest load: every load is larger than {largest_load}; choose a larger one")
    parts = [one.touches(fabrics, pressed, modulus_cv) for one in outlooks]
    within = np.all([part.table["within"] for part in parts], axis=0)
    if not within.any():
        raise InputError(
            "design: no candidate is within the model's range: under every load the contact radius exceeds half the "
            "fingertip's radius; choose smaller loads"
        )
    each = [quantities_of(one, about) for one in outlooks]
    quantities = {name: np.concatenate([one[name] for one in each]) for name in each[0] if all(name in q for q in each)}
    if len(outlooks) > 1:
        quantities[WHICH] = np.repeat(np.arange(float(len(outlooks))), [len(one.theta) for one in outlooks])
    for name in about:
        if name not in quantities:
            known = ", ".join([*quantities, "turning@2mm"])
            raise InputError(f"about: {name!r} is no quantity of this run, expected one of {known}")
    number = len(experiment.ratings.participants) if raters is None else raters
    new = raters is not None or not first.rated
    level = zip(*(one.level(number if new else None) for one in outlooks), strict=True)
    touches = Touches(
        parts[0].table.assign(p_silent=np.mean([part.table["p_silent"] for part in parts], axis=0)),
        *(np.concatenate([getattr(p, name) for p in parts]) for name in ("response", "slope", "deviation")),
    )
    mean, variance = (np.concatenate(part) for part in level)
    noise = np.concatenate([one.noise for one in outlooks])
    panel = PanelRatings(touches.take(within), mean, variance, noise, number)
    return choose(panel, quantities, about, conditions, costs or Costs(), rng, new)


def _outlooks(source: Any, options: ModelOptions, rng: np.random.Generator) -> list[Outlook]:
    """Return the outlook of a run, of each of several, or of the prior of an experiment."""
    if isinstance(source, Experiment):
        return [outlook_of_prior(source, options, rng)]
    every = list(source) if isinstance(source, (list, tuple)) else [source]
    for one in every:
        require_run(one)
    if len({one.provenance.rating_data.digest_ratings for one in every}) > 1:
        raise InputError("design: the runs are of different tables of ratings; expected runs of the same")
    return [outlook_of_run(one, DRAWS // len(every)) for one in every]


def require_run(result: Any) -> None:
    """Raise an error for a run whose draws would mislead the choice.

    Raises
    ------
    InputError
        If it is no run on ratings, or has not converged.
    """
    from softness_bayes.results.result import Result

    require_kind("design", result, Result, "a Result, two of them, or an Experiment")
    if not result.has_ratings:
        raise InputError(f"{result.source}: a run without ratings cannot tell what ratings would add")
    if result.is_first_look or not result.provenance.ending.converged:
        raise InputError(
            f"{result.source}: the run has not converged, and its draws would mislead the choice; continue it with "
            "'resume'"
        )


def candidates_of(outlook: Outlook, candidates: Fabrics | None, moduli: Sequence[float] | None) -> Fabrics:
    """Return the fabrics that could be rated: given or owned ones, and those of moduli to obtain."""
    base = outlook.model.data.fabrics if candidates is None else candidates
    if moduli is None:
        rated = outlook.model.scene.fabric_modulus
        wanted = np.geomspace(rated.min(), rated.max(), GRID if candidates is None else 0)
    else:
        wanted = np.asarray(moduli, float)
        if not ((wanted > 0) & np.isfinite(wanted)).all():
            raise InputError("moduli: expected numbers above 0 [Pa]")
    names = (*base.names, *(f"E_fab {value / 1e3:.3g} kPa" for value in wanted))
    measured = {one.name: getattr(base, one.name) for one in fields(base)}
    arrays: dict[str, Any] = {
        name: np.append(value, np.full(wanted.size, np.nan))
        for name, value in measured.items()
        if isinstance(value, np.ndarray)
    }
    arrays["effective_modulus"][len(base) :] = wanted
    return replace(base, names=names, rows=(), **arrays)


def quantities_of(outlook: Outlook, about: Sequence[str]) -> dict[str, Array]:
    """Return sampled parameters (their logs if all are positive) and the turning points that are asked for."""
    space = outlook.posterior.space
    found = dict(zip(space.names[: space.n_chain], outlook.theta.T, strict=False))
    found = {k: np.log(v) if (v > 0).all() else v for k, v in found.items() if k not in SPREADS}
    for name in about:
        if name.startswith(TURNING):
            load = load_named(name.removeprefix(f"{TURNING}@"))
            if load is None:
                raise InputError(f"about: expected a load such as turning@2mm or turning@1N, got {name!r}")
            found[name] = outlook.turning(load)
            if not np.isfinite(found[name]).any():
                raise InputError(f"about: {name}: in no draw does the response turn over under this load")
    return found


def load_named(text: str) -> Load | None:
    """Return the load of a text such as 2mm or 1N; None if it is none."""
    match = _LOAD.fullmatch(text)
    try:
        value = float(match[1]) if match else float("nan")
    except ValueError:
        value = float("nan")
    if match is None or not 0 < value < float("inf"):
        return None
    return Indentation(value * 1e-3) if match[2] == "mm" else Force(value)
