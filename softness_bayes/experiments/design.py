"""Touches to rate next, from a finished run, from two runs to tell apart, or before any rating."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes.data import Experiment, Fabrics
from softness_bayes.errors import InputError
from softness_bayes.experiments.choice import Costs, Panel, Plan, choose
from softness_bayes.experiments.outlook import DRAWS, Outlook, Touches, outlook_of_prior, outlook_of_run
from softness_bayes.model.options import ModelOptions
from softness_bayes.ranges import PANEL, require_kind
from softness_bayes.touch.contact import Force, Indentation, Load, held, require_loads

Array = NDArray[np.float64]

USUAL_CV = 0.15
"""Relative standard error of moduli that a run took as exact."""

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
    largest_load: float | None = None,
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
        Largest load, in N or m as the loads are.
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
    experiment = first.model.experiment
    fabrics = candidates_of(first, candidates, moduli)
    pressed = require_loads("loads", tuple(loads)) if loads is not None else tuple(experiment.ratings.loads)
    if largest_load is not None:
        pressed = tuple(load for load in pressed if held(load) <= largest_load * (1.0 + 1e-9))
        if not pressed:
            raise InputError(f"largest load: every load is larger than {largest_load:g}; choose a larger one")
    parts = [one.touches(fabrics, pressed, modulus_cv, USUAL_CV) for one in outlooks]
    within = np.all([part.within for part in parts], axis=0)
    if not within.any():
        raise InputError(
            "design: no candidate is within the model's range: under every load the contact radius exceeds half the "
            "fingertip's radius; choose smaller loads"
        )
    quantities = _joined([quantities_of(one, about) for one in outlooks])
    if len(outlooks) > 1:
        quantities[WHICH] = np.repeat(np.arange(float(len(outlooks))), [len(one.theta) for one in outlooks])
    for name in about:
        if name not in quantities:
            known = ", ".join([*quantities, "turning@2mm"])
            raise InputError(f"about: {name!r} is no quantity of this run, expected one of {known}")
    new = raters is not None or not first.rated
    panel = Panel(len(experiment.ratings.participants) if raters is None else raters, new)
    levels = [one.levels.of_panel(panel.number if new else None) for one in outlooks]
    mean, variance = (np.concatenate(part) for part in zip(*levels, strict=True))
    noise = np.concatenate([one.noise for one in outlooks])
    touches = _side_by_side(parts).take(within)
    return choose(touches, mean, variance, noise, quantities, about, conditions, panel, costs or Costs(), rng)


def _outlooks(source: Any, options: ModelOptions, rng: np.random.Generator) -> list[Outlook]:
    """Return the outlook of a run, of each of several, or of the prior of an experiment."""
    if isinstance(source, Experiment):
        return [outlook_of_prior(source, options, rng)]
    every = list(source) if isinstance(source, (list, tuple)) else [source]
    for one in every:
        require_run(one)
    if len({one.provenance.rating_data.digest_ratings for one in every}) > 1:
        raise InputError("design: the runs are of different tables of ratings; expected runs of the same")
    return [outlook_of_run(one, rng, DRAWS // len(every)) for one in every]


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
    own = outlook.model.experiment.fabrics
    base = own if candidates is None else candidates
    scene = outlook.model.scene.fabric_modulus
    if moduli is None:
        wanted = np.geomspace(scene.min(), scene.max(), GRID) if candidates is None else np.empty(0)
    else:
        wanted = np.asarray(moduli, float)
        if not ((wanted > 0) & np.isfinite(wanted)).all():
            raise InputError("moduli: expected numbers above 0 [Pa]")
    if not wanted.size:
        return base
    named = [f"E_fab {value / 1e3:.3g} kPa" for value in wanted]
    blank = np.full(len(base) + wanted.size, np.nan)
    fields: dict[str, Any] = {}
    for name in Fabrics.__dataclass_fields__:
        value = getattr(base, name)
        if isinstance(value, np.ndarray):
            fields[name] = np.concatenate([value, blank[len(base) :]])
    fields["effective_modulus"][len(base) :] = wanted
    return replace(base, names=(*base.names, *named), rows=(), **fields)


def quantities_of(outlook: Outlook, about: Sequence[str]) -> dict[str, Array]:
    """Return sampled parameters (their logs if all are positive) and the turning points that are asked for."""
    found = {}
    space = outlook.posterior.space
    for k in (k for k in range(space.n_chain) if space.names[k] not in SPREADS):
        values = outlook.theta[:, k]
        found[space.names[k]] = np.log(values) if (values > 0).all() else values
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


def _joined(every: Sequence[dict[str, Array]]) -> dict[str, Array]:
    """Return the quantities that all outlooks have, with the draws of one after the other."""
    names = [name for name in every[0] if all(name in one for one in every)]
    return {name: np.concatenate([one[name] for one in every]) for name in names}


def _side_by_side(parts: Sequence[Touches]) -> Touches:
    """Return the same touches at the draws of all outlooks."""
    first = parts[0]
    if len(parts) == 1:
        return first
    return replace(
        first,
        response=np.concatenate([part.response for part in parts]),
        slope=np.concatenate([part.slope for part in parts]),
        deviation=np.concatenate([part.deviation for part in parts]),
        silent=np.mean([part.silent for part in parts], axis=0),
    )
