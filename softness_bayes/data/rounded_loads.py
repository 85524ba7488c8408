"""Loads made equal: rounded on request, or few in place of many."""

from __future__ import annotations

from dataclasses import replace
from decimal import ROUND_HALF_EVEN, Decimal

import numpy as np

from softness_bayes.data.loads import LOAD_COLUMNS
from softness_bayes.data.names import listing
from softness_bayes.data.ratings import Ratings
from softness_bayes.errors import InputError
from softness_bayes.ranges import LOAD_STEPS
from softness_bayes.touch.contact import Load

SHOWN = 3
"""Number of groups of loads that a note lists."""


def with_few_loads(ratings: Ratings, most: int) -> Ratings:
    """Return ratings whose loads of each kind are at most so many: neighbours become their geometric mean."""
    loads: list[Load] = []
    place = np.empty(len(ratings.loads), dtype=np.intp)
    for _, kind, value in LOAD_COLUMNS:
        own = [k for k, load in enumerate(ratings.loads) if isinstance(load, kind)]
        for group in np.array_split(own, min(len(own), most)) if own else []:
            values = [value(ratings.loads[k]) for k in group]
            place[group] = len(loads)
            loads.append(kind(values[0] if len(values) == 1 else float(f"{np.exp(np.mean(np.log(values))):.4g}")))
    return replace(ratings, loads=tuple(loads), load=place[ratings.load])


def with_rounded_loads(ratings: Ratings, step: float) -> Ratings:
    """Return ratings whose loads are the nearest multiples of a step, with a note that says what was merged.

    Parameters
    ----------
    ratings
        The ratings.
    step
        Step, in N for forces and in mm for indentations.

    Raises
    ------
    InputError
        If the step is not positive, or a load would become 0 or leave its range.
    """
    LOAD_STEPS.require("round_load", step)
    unit = Decimal(repr(float(step)))
    rounded: list[Load] = []
    groups: dict[Load, list[str]] = {}
    for load in ratings.loads:
        column, kind, value = next(entry for entry in LOAD_COLUMNS if isinstance(load, entry.kind))
        count = (Decimal(column.write(value(load))) / unit).to_integral_value(ROUND_HALF_EVEN)
        try:
            rounded.append(kind(column.parse(f"{(count * unit).normalize():f}")))
        except ValueError as error:
            raise InputError(
                f"round_load {step:g}: {load} would become {count * unit} {column.unit}, which is not a load "
                f"({error}); give a smaller step"
            ) from None
        groups.setdefault(rounded[-1], []).append(str(load))
    # rounding keeps the order of loads
    order = {load: k for k, load in enumerate(groups)}
    told = [f"{load} from {listing(members, 3)}" for load, members in groups.items() if len(members) > 1]
    note = f"loads rounded to multiples of {step:g}: {len(ratings.loads)} became {len(groups)}"
    if told:
        more = f"; and {len(told) - SHOWN} more" if len(told) > SHOWN else ""
        note += f": {'; '.join(told[:SHOWN])}{more}"
    places = np.array([order[load] for load in rounded], dtype=np.intp)
    return replace(ratings, loads=tuple(order), load=places[ratings.load], notes=(*ratings.notes, note))
