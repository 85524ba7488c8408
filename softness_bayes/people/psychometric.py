"""Psychometric functions of pairs with a reference: threshold, Weber fraction, bias, guesses and lapses.

The probability that a comparison is judged softer than the reference is psi = guess + (1 - guess - lapse) Phi(z), where
z is linear in log E_fab. The posterior is summed over a grid, with psignifit's priors (Schütt et al., Vision Res. 122,
105, 2016): Beta(1, 10) for guesses and lapses, and threshold and width flat over the range of the comparisons.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from scipy.special import bdtr, ndtr, ndtri

from softness_bayes.base.readable import counted, interval, percent
from softness_bayes.checking.layout import values_in
from softness_bayes.checking.provenance import Provenance
from softness_bayes.data.ratings import Ratings
from softness_bayes.likelihood.lists import references
from softness_bayes.people.answers import told_pairs
from softness_bayes.people.free_means import groups_of_loads

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]

LEVEL = 0.75
"""Share of attentive answers at the threshold."""

NAMES = ("equal", "threshold", "weber", "bias", "guess", "lapse")
"""Names of the quantities."""

BELOW_CHANCE = 1e-3
"""Probability under guessing of as few answers with the majority, from which a participant is below chance."""

POINTS, DRAWS = (36, 36, 14, 14), 4000
"""Points of the grid for the parameters; draws from the posterior."""


def psychometric_table(
    ratings: Ratings, modulus: Array, first_won: Array | None = None, guess: float | None = None
) -> pd.DataFrame:
    """Return psychometric quantities of each reference under each load.

    Parameters
    ----------
    ratings
        A table of pairs.
    modulus
        E_fab of its fabrics, in any unit, shape (fabrics,).
    first_won
        Probability of the answer that was given, for each pair that is no tie, as a chain predicts it; by default 1,
        the answers themselves.
    guess
        Guess rate, if it is known from the task; by default it is estimated.

    Returns
    -------
    DataFrame
        Columns load, reference, pairs; then, each with 90 % limits in NAME_low and NAME_high: equal (E_fab judged equal
        to the reference), threshold (E_fab that is told from it in the share `LEVEL`), weber (fraction by which the
        threshold differs from `equal`), bias (of `equal` from the reference, as a fraction), guess, lapse.
    """
    names, load = groups_of_loads(ratings)
    pairs = told_pairs(ratings)
    won = np.ones(len(pairs)) if first_won is None else first_won
    fabric, at, rows = ratings.fabric[pairs], load[pairs[:, 0]], []
    sides = references(fabric, at, len(ratings.fabrics))
    for k, name in enumerate(names):
        for reference in np.unique(fabric[at == k][sides[at == k]]):
            here = (at == k) & ((fabric == reference) & sides).any(axis=1)
            lost = fabric[here, 0] == reference
            other = np.where(lost, fabric[here, 1], fabric[here, 0])
            x = np.log(modulus[other] / modulus[reference])
            found = _quantities(x, np.where(lost, 1.0 - won[here], won[here]), guess)
            found |= {one: np.exp(found[one]) * modulus[reference] for one in ("equal", "threshold")}
            row = {"load": name, "reference": ratings.fabrics[reference], "pairs": int(here.sum())}
            for one, draws in found.items():
                row |= dict(zip((f"{one}_low", one, f"{one}_high"), np.quantile(draws, (0.05, 0.5, 0.95)), strict=True))
            rows.append(row)
    return pd.DataFrame(rows)


def threshold_table(ratings: Ratings, tree: xr.DataTree) -> pd.DataFrame:
    """Return psychometric quantities of each reference (`psychometric_table`), of people's answers and of the chain's.

    Those of the chain are of the same pairs with the probabilities that it predicts; the column `answers` tells which.
    """
    modulus = values_in(tree, "constant_data", "effective_modulus_kpa").astype(float)
    density = values_in(tree, "log_likelihood", "rating")[0][:, told_pairs(ratings)[:, 0]]
    chance = np.exp(density.astype(float)).mean(axis=0)
    guess = Provenance(tree.attrs).asked.options.get("guess")
    known = None if isinstance(guess, str) else guess
    parts = {"people": None, "chain": chance}
    found = [psychometric_table(ratings, modulus, won, known).assign(answers=name) for name, won in parts.items()]
    return pd.concat(found, ignore_index=True)


def threshold_sentences(table: pd.DataFrame) -> list[str]:
    """Return a sentence on each row of `psychometric_table`."""
    said = []
    for _, row in table.iterrows():
        each = {name: interval(row, name) for name in NAMES}
        at = f" at {row['load']}" if row["load"] else ""
        said.append(
            f"against {row['reference']}{at} ({counted(row['pairs'], 'pair')}): judged equal at E_fab {each['equal']} "
            f"kPa, bias {each['bias']}; threshold ({percent(LEVEL)}) {each['threshold']} kPa, Weber fraction "
            f"{each['weber']}; guess rate {each['guess']}, lapse rate {each['lapse']}"
        )
    return said


def comparison_cautions(ratings: Ratings) -> list[str]:
    """Return what is wrong with comparisons: sets that are not connected, and participants below chance."""
    names, load = groups_of_loads(ratings)
    pairs, said, n = told_pairs(ratings), [], len(ratings.fabrics)
    fabric = ratings.fabric[pairs]
    wins = np.zeros((len(names), n, n))
    np.add.at(wins, (load[pairs[:, 0]], *fabric.T), 1.0)
    for name, won in zip(names, wins, strict=True):
        count, of = connected_components(won, directed=False)
        sizes = np.bincount(of[(won + won.T).any(axis=1)], minlength=count)
        if (sizes > 0).sum() > 1:
            at = f" at {name}" if name else ""
            said.append(
                f"the comparisons{at} fall into {(sizes > 0).sum()} sets that are not connected: no answer orders "
                "fabrics of different sets"
            )
    with_others = wins[load[pairs[:, 0]], fabric[:, 0], fabric[:, 1]] - 1.0
    against = wins[load[pairs[:, 0]], fabric[:, 1], fabric[:, 0]]
    known, agrees = with_others != against, with_others > against
    for who, name in enumerate(ratings.participants):
        own = known & (ratings.participant[pairs[:, 0]] == who)
        if own.any() and bdtr(agrees[own].sum(), own.sum(), 0.5) < BELOW_CHANCE:
            said.append(
                f"{name} answers below chance: with the majority of all other answers in {agrees[own].sum()} of "
                f"{counted(int(own.sum()), 'pair')}; are the answers reversed?"
            )
    return said


def _quantities(x: Array, softer: Array, guess: float | None) -> dict[str, Array]:
    """Return draws of all quantities from log ratios of moduli and (probabilities of) the answer softer, (pairs,)."""
    sign = 1.0 if np.polyfit(x, softer, 1)[0] > 0 else -1.0
    places, of = np.unique(sign * x, return_inverse=True)
    yes, total = np.bincount(of, softer), np.bincount(of)
    extent = max(float(np.ptp(places)), 1e-6)
    ends = [(places[0] - extent / 2, places[-1] + extent / 2), (0.02 * extent, 3.0 * extent), (1e-4, 0.5), (1e-4, 0.5)]
    if guess is not None:
        ends[2] = (guess, guess)
    for _ in range(3):  # the second and third time over the part that has nearly all of the probability
        grid = [
            np.linspace(*end, n) if end[0] < end[1] else np.array(end[:1]) for end, n in zip(ends, POINTS, strict=True)
        ]
        middle, width, low, high = np.meshgrid(*grid, indexing="ij", sparse=True)
        beyond = np.clip(np.maximum(places[0] - middle, middle - places[-1]) / (extent / 2), 0.0, 1.0)
        wider = np.clip((width / extent - 1.0) / 2.0, 0.0, 1.0)
        density = np.log(1e-12 + 1.0 + np.cos(np.pi * beyond)) + np.log(1e-12 + 1.0 + np.cos(np.pi * wider))
        density = density + 9.0 * (np.log1p(-high) + (np.log1p(-low) if guess is None else 0.0))
        for place, k, n in zip(places, yes, total, strict=True):
            psi = low + (1.0 - low - high) * ndtr(2.0 * ndtri(0.95) * (place - middle) / width)
            density = density + k * np.log(psi) + (n - k) * np.log1p(-psi)
        mass = np.exp(density - density.max())
        mass /= mass.sum()
        sides = [mass.sum(axis=tuple(j for j in range(4) if j != i)) for i in range(4)]
        kept = [np.flatnonzero(side > 1e-5 * side.max()) for side in sides]
        step = [one[1] - one[0] if one.size > 1 else 0.0 for one in grid]
        ends = [
            (max(one[some[0]] - d, end[0]), min(one[some[-1]] + d, end[1]))
            for one, some, d, end in zip(grid, kept, step, ends, strict=True)
        ]
    rng = np.random.default_rng(0)
    cell = np.unravel_index(rng.choice(mass.size, DRAWS, p=mass.ravel()), mass.shape)
    drawn = [one[i] + d * (rng.random(DRAWS) - 0.5) for one, i, d in zip(grid, cell, step, strict=True)]
    middle, width, low, high = drawn
    apart = width * ndtri(LEVEL) / (2.0 * ndtri(0.95))
    guessed, lapsed = (np.clip(one, 0.0, 0.5) for one in (low, high))
    return {
        "equal": sign * middle,
        "threshold": sign * (middle + apart),
        "weber": np.expm1(apart),
        "bias": np.expm1(sign * middle),
        "guess": guessed,
        "lapse": lapsed,
    }
