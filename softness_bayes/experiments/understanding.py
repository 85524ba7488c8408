"""Interpretation of an experiment before any sampling: numbers and text in one documented schema."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.inflection import curve_scene, response_curves
from softness_bayes.data import Experiment, Measurements, Ratings
from softness_bayes.data.columns import CURVATURE, DISTANCE, RATE
from softness_bayes.data.oddities import oddities
from softness_bayes.data.ratings import FREE_TOUCH, load_column, rank, with_few_loads
from softness_bayes.experiments.design_information import Expected, as_it_is, foresee, others
from softness_bayes.likelihood.layout import Layout, merge
from softness_bayes.likelihood.scales import CATEGORIES, PAIRS, RANKS
from softness_bayes.model.build import COARSE, ExperimentModel, build, people_notes
from softness_bayes.model.direction import odd_raters
from softness_bayes.model.options import ModelOptions
from softness_bayes.touch.load_groups import groups_of

Array = NDArray[np.float64]

SCHEMA = 1
"""Version of the schema of `understood`, which files.md documents."""

MOST_LOADS = 8
"""Largest number of loads of one kind in an expected design; more loads are merged with their neighbours."""

LIMITS = (0.1, 0.5, 0.9)
"""Reported quantiles over true parameter vectors."""


def warnings(model: ExperimentModel) -> list[str]:
    """Return warnings about odd or wrong values in the ratings, besides the notes from reading the files."""
    ratings, options, conditions = model.data.ratings, model.requested, model.data.ratings.conditions
    modulus = np.array(model.moduli.middle)[conditions.fabric]
    layout = Layout(model.design, modulus, conditions.load, scale=options.scale)
    groups = groups_of(ratings.loads)
    odd = odd_raters(merge(layout, groups.of)[0], model.interpretation.intervals.values)
    names = ratings.participants
    found = [
        f"looks wrong: {names[k]} rates against all others (rank correlation {r:+.2f} with their means): was "
        "the scale reversed?"
        for k, r in odd.against.items()
    ]
    if odd.constant:
        same = ", ".join(names[k] for k in odd.constant)
        found.append(f"looks wrong: all ratings of {same} are equal, so they contain no information about fabrics")
    if odd.copies:
        same = ", ".join(names[k] for k in odd.copies)
        found.append(f"looks wrong: all ratings of {same} are copies of another rater's")
    return [
        *found,
        *people_notes(model.data, options),
        *oddities(ratings, options.scale not in (CATEGORIES, RANKS, PAIRS)),
    ]


def understood(model: ExperimentModel, notes: list[str]) -> dict[str, Any]:
    """Return the full interpretation of an experiment as JSON data.

    Parameters
    ----------
    model
        The model, which need not be compiled.
    notes
        Notes from reading the files, and `warnings`.
    """
    experiment, options, meaning = model.data, model.requested, model.interpretation
    ratings, conditions, direction = experiment.ratings, experiment.ratings.conditions, model.direction
    pairs = len(ratings.fabrics) * len(ratings.loads)
    cells = len(set(zip(ratings.participant.tolist(), conditions.of_rating.tolist(), strict=True)))
    answers = np.bincount(ratings.participant)
    step = options.slider_width * meaning.intervals.step
    steps = [float(step[ratings.participant == k].max()) for k in range(len(ratings.participants))]
    laws, rated = model.moduli.laws, np.bincount(ratings.fabric)
    limits = [(None, None) if law is None else tuple(map(float, law.quantile([0.05, 0.95]))) for law in laws]
    return {
        "schema": SCHEMA,
        "source": ratings.source,
        "ratings": {
            "count": len(ratings),
            "missing": ratings.n_missing,
            "zeros": int((ratings.rating == 0).sum()),
            "least": float(ratings.rating.min()),
            "greatest": float(ratings.rating.max()),
        },
        "participants": [
            {
                "name": name,
                "ratings": int(answers[k]),
                "step": steps[k],
                "covariates": {title: own[k] for title, own in ratings.covariates.items()},
            }
            for k, name in enumerate(ratings.participants)
        ],
        "fabrics": [
            {
                "name": name,
                "e_fab_kpa": float(model.moduli.middle[k]) / 1e3,
                "e_fab_low_kpa": limits[k][0],
                "e_fab_high_kpa": limits[k][1],
                "modulus_from": experiment.fabrics.basis[k] or None,
                "poisson_ratio": float(experiment.fabrics.poisson_ratio[k]),
                "ratings": int(rated[k]),
            }
            for k, name in enumerate(experiment.fabrics.names)
        ],
        "loads": _understood_loads(ratings),
        "conditions": {
            "rated": len(conditions.fabric),
            "possible": pairs,
            "by_participants": cells,
            "possible_by_participants": len(ratings.participants) * pairs,
            "repeats": len(ratings) - cells,
        },
        "forces": None,
        "notes": notes,
        "model": {
            "scale": options.scale.name,
            "readings": dict(options.readings.names),
            "numbers": meaning.note,
            "errors": meaning.law.name,
            "errors_because": meaning.errors_note,
            "direction": direction.direction.name,
            "direction_because": direction.evidence.lines,
        },
        "design": None,
    } | understood_measurements(experiment)


def _understood_loads(ratings: Ratings) -> list[dict[str, Any]]:
    """Return each load in its unit, and its number of ratings."""
    counts, found = np.bincount(ratings.load), []
    for k, load in enumerate(ratings.loads):
        column, _, value = load_column(load)
        number = None if load == FREE_TOUCH else float(column.write(value(load)))
        found.append({"kind": column.label, "value": number, "unit": column.unit, "ratings": int(counts[k])})
    return found


def understood_measurements(data: Experiment | Measurements) -> dict[str, Any]:
    """Return the interpretation of forces and of recorded afferents as JSON data, where there are any."""
    found: dict[str, Any] = {}
    if (pressed := data.compression) is not None:
        found["forces"] = {
            "count": len(pressed),
            "zeros": pressed.n_zero,
            "least_n": float(pressed.force.min()),
            "greatest_n": float(pressed.force.max()),
            "fingers": list(pressed.participants),
            "least_indentation_mm": float(pressed.indentation.min()) * 1e3,
            "greatest_indentation_mm": float(pressed.indentation.max()) * 1e3,
        }
    if (recorded := data.afferents) is not None:
        found["afferents"] = {
            "rates": int((~recorded.counted).sum()),
            "counts": int(recorded.counted.sum()),
            "afferents": list(recorded.names),
            "species": list(recorded.species),
            "loads": [str(load) for load in sorted({*recorded.loads}, key=rank)],
            "ranges": {
                column.name: [float(values.min() / column.factor), float(values.max() / column.factor)]
                for column, values in recorded.columns.items()
                if column in (RATE, CURVATURE, DISTANCE)
            },
        }
    return found


def foreseen(experiment: Experiment, options: ModelOptions) -> dict[str, Any]:
    """Return the expected information of a design and of alternative designs as JSON data.

    Raises
    ------
    InputError
        As for `build` and `foresee`.
    """
    few = with_few_loads(experiment.ratings, MOST_LOADS)
    grouped = experiment._replace(ratings=few)
    model = build(grouped, options if options.discretisation else options.decide(discretisation=COARSE))
    now = as_it_is(model)
    expected = foresee(model, now)
    more = []
    for planned in others(model):
        other = foresee(model, planned)
        more.append(
            {
                "design": planned.name,
                "further_ratings": planned.n_answers - now.n_answers,
                "bits": round(float(np.median(other.bits - expected.bits)), 3),
                **_ratios(other),
            }
        )
    return {
        "truths": len(expected.bits),
        "loads": [len(experiment.ratings.loads), len(few.loads)],
        "bits": _quantiles(expected.bits),
        **_ratios(expected),
        "not_foreseen": [name for name in model.posterior.space.names if name not in expected.names],
        "others": sorted(more, key=lambda one: -one["bits"]),
    }


def prior_responses(
    experiment: Experiment, options: ModelOptions, loads: list[int], draws: int
) -> tuple[Array, Array, Array]:
    """Return the response under the prior along a grid of fabrics, and the modulus of every fabric.

    Parameters
    ----------
    experiment, options
        As for `understood`.
    loads
        Indices of the loads.
    draws
        Number of draws.

    Returns
    -------
    tuple of ndarray
        E_fab [Pa] of the grid (points,), total rates (draws, loads, points), and E_fab [Pa] (fabrics,).
    """
    model = build(experiment, options if options.discretisation else options.decide(discretisation=COARSE))
    held = [experiment.ratings.loads[k] for k in loads]
    fabrics = np.unique(model.scene.fabric)
    pairs = np.repeat(fabrics, len(held)), np.tile(np.arange(len(held)), fabrics.size)
    grid = curve_scene(model.scene.under(held, *pairs))
    space = model.posterior.space
    curves = response_curves(grid, space.touch(space.draw_prior(np.random.default_rng(0), draws)))
    return curves.modulus, curves.total_rate, np.array(model.moduli.middle)


def _ratios(expected: Expected) -> dict[str, Any]:
    places = []
    for k, load in enumerate(expected.loads):
        seen = np.isfinite(expected.place[:, k])
        places.append(
            {
                "load": load,
                "prior_share": round(float(expected.turns[k]), 3),
                "truths": int(seen.sum()),
                "sd_ratio": _quantiles(expected.place[seen, k]),
                "factor_90": _quantiles(expected.factor[seen, k]),
            }
        )
    ratios = {name: _quantiles(expected.ratio[:, k]) for k, name in enumerate(expected.names)}
    return {"sd_ratio": ratios, "turning_points": places}


def _quantiles(values: Any) -> list[float] | None:
    """Return limits and median over true parameter vectors, to four digits; None if there are none."""
    return [float(f"{x:.4g}") for x in np.quantile(values, LIMITS)] if values.size else None
