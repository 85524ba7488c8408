"""Ranking of fabrics by predicted softness: places, pairs, ties and verdicts under each load, as tables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from softness_bayes.base.defaults import ANSWER_DRAWS
from softness_bayes.base.files.run_files import RULER
from softness_bayes.base.ranges import RANKED
from softness_bayes.base.readable import counted
from softness_bayes.checking.agreement import agreement, pairs, places, ties
from softness_bayes.data import Fabrics
from softness_bayes.people.free_means import word_of
from softness_bayes.people.ruler import fit_of
from softness_bayes.people.sentences import DECIDED
from softness_bayes.plotting.style import USUAL, Style
from softness_bayes.results import rating_table
from softness_bayes.results.fitted import Fitted
from softness_bayes.results.stored import Stored
from softness_bayes.touch.contact import Load

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
IntArray = NDArray[np.intp]

SILENT = 0.5
"""Share of draws without spikes above which a fabric is called silent."""

REASONS = (
    "people's own ratings",
    "the chain",
    "no receptor fires",
    "the contact is beyond Hertz's geometry",
    "the modulus is beyond those rated",
    "the load is beyond those rated",
    "the chain does not follow the ratings",
    "neither order is 95 % sure",
)
"""Reasons of a verdict: the first two decide, all others do not; a pair has the first that holds."""

WORDS = {"softest": ("softer", "stiffer"), "hardest": ("harder", "softer")}
"""Words for the first fabric of a pair, by what the highest rating means."""


class Ranking:
    """Fabrics ranked by the predicted rating of the typical rater in a finished run; higher ratings are softer.

    Parameters
    ----------
    result
        The run, on ratings.
    fabrics, loads
        Fabrics to rank, and the loads under which to rank them.
    draws
        Number of posterior draws for the probabilities.
    seed
        Seed of quantities drawn given the posterior draws.

    Attributes
    ----------
    table
        A row per load and fabric, the softest first (docs/files.md 11).
    place_table
        A row per load, fabric and possible place, with its probability.
    pair_table
        A row per load and pair of fabrics, the softer one of the order first, with the probability of its order.
    fabrics, scale
        Names of the fabrics, and the scale of the ratings.
    typical
        Draws of the typical rater's median rating under each load, shape (draws, fabrics).
    word
        What the highest rating means: softest, hardest, or highest rated.
    cautions
        Reasons for not carrying the predictions of the run to these fabrics.

    Raises
    ------
    InputError
        If there are too many fabrics, the run had no ratings, or the result is incomplete.
    """

    def __init__(
        self, result: Stored, fabrics: Fabrics, loads: tuple[Load, ...], draws: int = ANSWER_DRAWS, seed: int = 0
    ) -> None:
        RANKED.require("rank: number of fabrics", len(fabrics))
        fitted, rng = Fitted(result, draws), np.random.default_rng(seed)
        scene, modulus = fitted.scene(fabrics, loads), fitted.modulus(rng, fabrics)
        found = fitted.touches(fabrics, scene).ratings(rng, fitted.theta, 0, modulus)
        why = rating_table.reasons(fitted, scene, found.rate, modulus)
        unreached = [why[name].to_numpy() >= rating_table.NOTICED for name in ("p_silent", "p_beyond_radius")]
        unreached += [why[name].to_numpy() != "" for name in ("beyond_moduli", "beyond_loads")]
        against = fit_of(result.tree, result.tables.get(RULER)).follows.rejected
        self.fabrics, self.scale = fabrics.names, result.scale
        self.word = word_of(result.provenance.rating_data.rating_column, result.scale)
        words = np.array(["cannot decide", *WORDS.get(self.word, ("rated higher", "rated lower"))], object)
        middle = scene.fabric_modulus if modulus is None else np.median(modulus, axis=0)
        names, parts, typical = np.array(fabrics.names, object), [], dict[Load, Array]()
        above, below = np.triu_indices(len(fabrics), 1)
        for k, load in enumerate(loads):
            here, told = np.flatnonzero(scene.load == k), str(load)
            ratings = typical[load] = found.typical[:, here]
            (place, probability), (softer, tie) = places(ratings), pairs(ratings)
            order = np.argsort(place.mean(axis=0), kind="stable")
            tied, first, second = ties(tie, order), order[above], order[below]
            barred = [one[here] for one in unreached]
            higher, reason = verdicts(rating_table.people_orders(result, fabrics, load), softer, barred, against)
            beside = {
                **{f"typical_rating{end}": values for end, values in rating_table.limits(ratings).items()},
                **{f"place{end}": values for end, values in rating_table.limits(place).items()},
                "place": place.mean(axis=0),
                **rating_table.beside(result, fabrics, load),
                "p_softer_than_next": np.full(len(fabrics), np.nan),
                "tie": np.where(tied > 0, tied.astype(str), ""),
                **{name: why[name].to_numpy()[here] for name in ("p_silent", "remarks")},
            }
            beside["p_softer_than_next"][order[:-1]] = softer[order[:-1], order[1:]]
            rows = pd.DataFrame({"load": told, "fabric": names, "e_fab_kpa": middle / 1e3, **beside}).iloc[order]
            rows.insert(1, "order", np.arange(1, order.size + 1))
            # sums of shares that should cancel leave rounding errors
            row, at = np.nonzero(probability[order] > 1e-9)
            held = {"fabric": names[order[row]], "place": at + 1, "probability": probability[order[row], at]}
            both = {
                "fabric": names[first],
                "other": names[second],
                "p_softer": softer[first, second],
                "p_tie": tie[first, second],
                "p_harder": softer[second, first],
                "verdict": words[higher[first, second]],
                "because": np.array(REASONS, object)[reason[first, second]],
            }
            parts.append((rows, pd.DataFrame({"load": told, **held}), pd.DataFrame({"load": told, **both})))
        table, self.place_table, self.pair_table = (
            pd.concat(each, ignore_index=True) for each in zip(*parts, strict=True)
        )
        self.table = table[[name for name in table if not name.endswith("_50")]]
        self.typical, self.cautions = typical, tuple(rating_table.cautions(result, fabrics))

    @property
    def sentence(self) -> str:
        """Sentence on how many pairs are decided, and why not the others; cautions come first."""
        first = f"CAUTION: {'; '.join(self.cautions)}. " if self.cautions else ""
        return first + decided_sentence(self.pair_table["because"])

    def figure(self, style: Style = USUAL) -> Figure:
        """Return the figure of places and ratings under each load."""
        from softness_bayes.plotting.ranking import Order, ranking_figure

        shown, every = [], self.place_table.pivot_table("probability", ["load", "fabric"], "place", fill_value=0.0)
        for load in self.typical:
            rows = self.table[self.table["load"] == str(load)]
            names, tie = rows["fabric"].tolist(), rows["tie"].replace("", "0").to_numpy(np.intp)
            ends = rows[["typical_rating_low", "typical_rating", "typical_rating_high"]].to_numpy().T
            probability = every.loc[str(load)].reindex(names).to_numpy()
            shown.append(Order(load, names, probability, ends, rows["p_silent"].to_numpy() >= SILENT, tie))
        return ranking_figure(shown, self.scale, style=style)

    def against(self, observed: Mapping[str, float]) -> pd.DataFrame:
        """Return the agreement with observed ranks by fabric (1 the softest): a row per load and measure.

        Raises
        ------
        InputError
            If too few fabrics are in both.
        """
        here = [k for k, name in enumerate(self.fabrics) if name in observed]
        seen = np.array([observed[self.fabrics[k]] for k in here])
        rows = []
        for load, typical in self.typical.items():
            # places among the fabrics in both
            among = places(typical[:, here])[0] if here else np.empty((1, 0))
            for name, found in agreement(among, seen).items():
                rows.append({"load": str(load), "measure": name, **found, "fabrics": len(here)})
        return pd.DataFrame(rows)


def verdicts(
    people: Array, chain: Array, barred: Sequence[NDArray[np.bool_]], rejected: bool
) -> tuple[IntArray, IntArray]:
    """Return the verdicts on all pairs of fabrics under one load.

    Parameters
    ----------
    people, chain
        Probability that the fabric of the row is rated higher than that of the column, by people's own means (NaN for
        pairs that people did not rate both) and by the chain, shape (fabrics, fabrics).
    barred
        For silence, geometry, modulus and load, in the order of `REASONS`: the fabrics of which the chain cannot speak
        for that reason, each (fabrics,).
    rejected
        True if the chain does not follow the ratings, so that nothing rests on it.

    Returns
    -------
    higher, reason : ndarray
        1 if the fabric of the row is rated higher than that of the column, -1 if lower, 0 if that cannot be decided;
        and the index of the reason in `REASONS`.
    """
    either = [one[:, None] | one for one in barred]
    known = ~np.isnan(people)
    sure = np.maximum(chain, chain.T) >= DECIDED
    told = known & (np.fmax(people, people.T) >= DECIDED)
    conditions = [told, *(~known & one for one in either), ~known & rejected, ~known & sure]
    reason = np.select(conditions, [0, 2, 3, 4, 5, 6, 1], len(REASONS) - 1)
    return np.where(reason < 2, np.where(np.where(told, people, chain) > 0.5, 1, -1), 0), reason


def decided_sentence(because: Iterable[str]) -> str:
    """Return how many pairs are decided under all loads together, by whom, and why not the others."""
    reasons = [*because]
    counts = [reasons.count(reason) for reason in REASONS]
    total, decided = len(reasons), sum(counts[:2])
    by = [f"{counts[k]} by {REASONS[k]}" for k in range(2) if counts[k]]
    why = [f"{counts[k]} because {REASONS[k]}" for k in range(2, len(REASONS)) if counts[k]]
    return (
        f"{decided} of {counted(total, 'pair')} of fabrics {'is' if decided == 1 else 'are'} decided"
        + (f" ({', '.join(by)})" if by else "")
        + (f"; {counted(total - decided, 'pair is', 'pairs are')} not: {', '.join(why)}" if why else "")
    )
