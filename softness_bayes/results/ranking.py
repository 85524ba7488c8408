"""Ranking of fabrics by predicted softness: places, pairs and ties under each load, as tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.base.defaults import ANSWER_DRAWS
from softness_bayes.base.ranges import RANKED
from softness_bayes.checking.agreement import Pairs, Places, agreement, pairs, places, ties
from softness_bayes.data import Fabrics
from softness_bayes.likelihood.scales import Scale
from softness_bayes.people.free_means import word_of
from softness_bayes.people.verdicts import Verdicts, decided_sentence, verdicts
from softness_bayes.plotting.style import USUAL, Style
from softness_bayes.results import rating_table
from softness_bayes.results.fitted import Fitted
from softness_bayes.results.stored import Stored
from softness_bayes.touch.contact import Load

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

SILENT = 0.5
"""Share of draws without spikes above which a fabric is called silent."""


class Ranked(NamedTuple):
    """The order of the fabrics under one load, the softest first."""

    load: Load
    order: NDArray[np.intp]
    """Index of the fabric at each place of the order, by mean place."""
    places: Places
    pairs: Pairs
    tie: NDArray[np.intp]
    """Index of each fabric's group of ties, 0 for none, shape (fabrics,)."""
    typical: Array
    """Draws of the typical rater's median rating, shape (draws, fabrics)."""
    reasons: pd.DataFrame
    """Reasons for unusual predictions, a row per fabric (`rating_table.reasons`)."""
    people: Mapping[str, Array]
    """People's own mean rating of each fabric and its 90 % limits, by column; NaN for fabrics that were not rated."""
    verdicts: Verdicts

    @property
    def p_silent(self) -> Array:
        """Share of the draws in which no receptor fires, shape (fabrics,)."""
        return self.reasons["p_silent"].to_numpy()


@dataclass(frozen=True)
class Ranking:
    """Fabrics ranked by predicted softness.

    Parameters
    ----------
    fabrics
        Their names.
    modulus
        E_fab of the fabrics [Pa]; the median if it is uncertain.
    scale
        The scale of the ratings.
    loads
        Their order under each load.
    word
        What the highest rating means: softest, hardest, or highest rated.
    cautions
        Reasons for not carrying the predictions of the run to these fabrics.
    """

    fabrics: tuple[str, ...]
    modulus: Array
    scale: Scale
    loads: tuple[Ranked, ...]
    word: str = "highest rated"
    cautions: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        """Sentence on how many pairs are decided, and why not the others; cautions come first."""
        first = f"CAUTION: {'; '.join(self.cautions)}. " if self.cautions else ""
        return first + decided_sentence([one.verdicts for one in self.loads])

    @property
    def table(self) -> pd.DataFrame:
        """A row per load and fabric, the softest first (docs/files.md 11)."""
        return self._of_each_load(self._rows)

    @property
    def place_table(self) -> pd.DataFrame:
        """A row per load, fabric and possible place, with its probability."""
        return self._of_each_load(self._places)

    @property
    def pair_table(self) -> pd.DataFrame:
        """A row per load and pair of fabrics, the softer one of the order first, with the probability of its order."""
        return self._of_each_load(self._pairs)

    def _of_each_load(self, columns: Callable[[Ranked], dict[str, Any]]) -> pd.DataFrame:
        import pandas as pd

        each = [pd.DataFrame({"load": str(one.load), **columns(one)}) for one in self.loads]
        return pd.concat(each, ignore_index=True)

    def _rows(self, one: Ranked) -> dict[str, Any]:
        rating, place, k = rating_table.limits(one.typical), rating_table.limits(one.places.place), one.order
        return {
            "order": np.arange(1, k.size + 1),
            "fabric": [self.fabrics[i] for i in k],
            "e_fab_kpa": self.modulus[k] / 1e3,
            "typical_rating_low": rating["_low"][k],
            "typical_rating": rating[""][k],
            "typical_rating_high": rating["_high"][k],
            "place_low": place["_low"][k],
            "place": one.places.place.mean(axis=0)[k],
            "place_high": place["_high"][k],
            **{name: values[k] for name, values in one.people.items()},
            "p_softer_than_next": np.append(one.pairs.softer[k[:-1], k[1:]], np.nan),
            "tie": [str(number) if number else "" for number in one.tie[k]],
            **{name: one.reasons[name].to_numpy()[k] for name in ("p_silent", "remarks")},
        }

    def _places(self, one: Ranked) -> dict[str, Any]:
        probability = one.places.probability[one.order]
        # sums of shares that should cancel leave rounding errors
        row, place = np.nonzero(probability > 1e-9)
        names = [self.fabrics[one.order[k]] for k in row]
        return {"fabric": names, "place": place + 1, "probability": probability[row, place]}

    def _pairs(self, one: Ranked) -> dict[str, Any]:
        above, below = np.triu_indices(one.order.size, 1)
        first, second, names = one.order[above], one.order[below], np.array(self.fabrics, object)
        return {
            "fabric": names[first],
            "other": names[second],
            "p_softer": one.pairs.softer[first, second],
            "p_tie": one.pairs.tie[first, second],
            "p_harder": one.pairs.softer[second, first],
            "verdict": one.verdicts.words(first, second, self.word),
            "because": one.verdicts.reasons(first, second),
        }

    def figure(self, style: Style = USUAL) -> Figure:
        """Return the figure of places and ratings under each load."""
        from softness_bayes.plotting.ranking import Order, ranking_figure

        shown = []
        for one in self.loads:
            k, rating = one.order, rating_table.limits(one.typical)
            ends = np.stack([rating[end][k] for end in ("_low", "", "_high")])
            names, silent = [self.fabrics[i] for i in k], one.p_silent[k] >= SILENT
            shown.append(Order(one.load, names, one.places.probability[k], ends, silent, one.tie[k]))
        return ranking_figure(shown, self.scale, style=style)

    def against(self, observed: Mapping[str, float]) -> pd.DataFrame:
        """Return the agreement with observed ranks by fabric (1 the softest): a row per load and measure.

        Raises
        ------
        InputError
            If too few fabrics are in both.
        """
        import pandas as pd

        here = [k for k, name in enumerate(self.fabrics) if name in observed]
        seen = np.array([observed[self.fabrics[k]] for k in here])
        rows = []
        for one in self.loads:
            # places among the fabrics in both
            among = places(one.typical[:, here]).place if here else np.empty((1, 0))
            for name, found in agreement(among, seen).items():
                rows.append({"load": str(one.load), "measure": name, **found._asdict(), "fabrics": len(here)})
        return pd.DataFrame(rows)


def rank(
    result: Stored, fabrics: Fabrics, loads: tuple[Load, ...], draws: int = ANSWER_DRAWS, seed: int = 0
) -> Ranking:
    """Rank fabrics by the predicted rating of the typical rater in a finished run; higher ratings are softer.

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

    Raises
    ------
    InputError
        If there are too many fabrics, the run had no ratings, or the result is incomplete.
    """
    RANKED.require("rank: number of fabrics", len(fabrics))
    fitted, rng = Fitted(result, draws), np.random.default_rng(seed)
    scene, modulus = fitted.scene(fabrics, loads), fitted.modulus(rng, fabrics)
    found = fitted.touches(fabrics, scene).ratings(rng, fitted.theta, 0, modulus)
    why = rating_table.reasons(fitted, scene, found.rate, modulus)
    unreached = [why[name].to_numpy() >= rating_table.NOTICED for name in ("p_silent", "p_beyond_radius")]
    unreached += [why[name].to_numpy() != "" for name in ("beyond_moduli", "beyond_loads")]
    against, ranked = rating_table.rejected(result), []
    for k, load in enumerate(loads):
        here = np.flatnonzero(scene.load == k)
        rating = found.typical[:, here]
        put, two = places(rating), pairs(rating)
        order = np.argsort(put.place.mean(axis=0), kind="stable")
        people = rating_table.people_orders(result, fabrics, load)
        decided = verdicts(people, two.softer, [one[here] for one in unreached], against)
        means = rating_table.beside(result, fabrics, load)
        ranked.append(Ranked(load, order, put, two, ties(two.tie, order), rating, why.iloc[here], means, decided))
    middle = scene.fabric_modulus if modulus is None else np.median(modulus, axis=0)
    word = word_of(result.provenance.rating_data.rating_column, result.scale)
    return Ranking(
        fabrics.names, middle, result.scale, tuple(ranked), word, tuple(rating_table.cautions(result, fabrics))
    )
