"""An experiment that chooses each next touch from the answers so far, for use while people rate.

The draws of a finished run are weighted by the answers as they come. Given a draw, the level of each rater is normal;
an answer moves it and weights the draw by the probability of the answer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from softness_bayes.base.errors import InputError
from softness_bayes.data import Fabrics
from softness_bayes.experiments.design import candidates_of, load_named, quantities_of
from softness_bayes.experiments.information import rank_bins, single_gains
from softness_bayes.experiments.outlook import Outlook, Touches, outlook_of_run, touches_within
from softness_bayes.likelihood.row_laws import RowLaw, Rows
from softness_bayes.touch.contact import Load

Array = NDArray[np.float64]
Key = tuple[str, str]

WORN = 0.1
"""Share of effective draws below which the draws are worn, and a new run of all ratings is due."""

MOST_IN_A_ROW = 2
"""Largest number of times that a fabric under a load is suggested in a row."""

NODES = 7
"""Points of the sum over a rater's level."""


class Answer(NamedTuple):
    """A rating that was given."""

    rater: str
    fabric: str
    load: Load
    rating: float


class Suggestion(NamedTuple):
    """The touch to present next."""

    fabric: str
    load: Load
    gain: float
    """Information that one rating of it is expected to give [nats]."""


@dataclass
class Adaptive:
    """An adaptive experiment; make one with `start` or `load`.

    The number of trials is the experimenter's: nothing stops early, because an answer that ends the session would
    depend on the answers.
    """

    outlook: Outlook
    touches: Touches
    bins: list[NDArray[np.intp]]
    request: dict[str, Any]
    """Arguments of `start`, after the run."""
    origin: dict[str, str]
    """The run from which it began: its file and the digest of its ratings."""
    answers: list[Answer] = field(default_factory=list)
    log_weight: Array = field(default_factory=lambda: np.empty(0))
    _laws: dict[Key, tuple[Array, Array]] = field(default_factory=dict)

    @classmethod
    def start(
        cls,
        result: Any,
        about: Sequence[str] = (),
        *,
        candidates: Fabrics | None = None,
        moduli: Sequence[float] | None = None,
        loads: Sequence[Load] | None = None,
        modulus_cv: float | None = None,
    ) -> Self:
        """Return an experiment that begins with the draws of a finished run; arguments as for `design`.

        Raises
        ------
        InputError
            As `design` does.
        """
        outlook = outlook_of_run(result)
        pressed = outlook.model.data.ratings.loads if loads is None else loads
        touches = touches_within([outlook], candidates_of(outlook, candidates, moduli), pressed, modulus_cv)
        bins = [rank_bins(quantities_of([outlook], about)[name]) for name in about]
        request = {
            "about": tuple(about),
            "candidates": candidates,
            "moduli": None if moduli is None else [float(value) for value in moduli],
            "loads": loads,
            "modulus_cv": modulus_cv,
        }
        origin = {"source": str(result.source), "digest": result.provenance.rating_data.digest_ratings}
        return cls(outlook, touches, bins, request, origin, log_weight=np.zeros(len(outlook.theta)))

    @property
    def weight(self) -> Array:
        """Weights of the draws, shape (draws,)."""
        return np.exp(self.log_weight - logsumexp(self.log_weight))

    @property
    def effective(self) -> float:
        """Effective share of the draws."""
        return float(1.0 / (self.weight**2).sum() / self.log_weight.size)

    @property
    def worn(self) -> bool:
        """True if the answers leave fewer than `WORN` of the draws: sample all ratings again and `refresh`."""
        return self.effective < WORN

    def next(self, rater: str) -> Suggestion:
        """Return the touch of which one rating by this rater would tell most."""
        table = self.touches.table
        expected = [self._effects(rater, self.touches, k)[1:] for k in range(len(table))]
        mean, variance = (np.stack(part, axis=1) for part in zip(*expected, strict=True))
        gain = single_gains(mean, np.sqrt(variance + self.outlook.noise[:, None] ** 2), self.bins, self.weight)
        last = [(one.fabric, one.load) for one in self.answers if one.rater == rater][-MOST_IN_A_ROW:]
        often = [last.count(touch) for touch in zip(table["fabric"], table["load"], strict=True)]
        k = int(np.where(np.array(often) < MOST_IN_A_ROW, gain, -np.inf).argmax())
        return Suggestion(table["fabric"][k], table["load"][k], float(gain[k]))

    def tell(self, rater: str, fabric: str, load: Load, rating: float) -> None:
        """Take an answer into account.

        Parameters
        ----------
        rater
            Name of the rater; one that the run does not have is a new one.
        fabric
            Name of a candidate.
        load
            The load that was really shown, whether or not it is among the candidates'.
        rating
            The rating as given.

        Raises
        ------
        InputError
            If there is no such fabric, or the rating is not on the scale.
        """
        touches, k = self._touch(fabric, load)
        rows, parameters = self._rows(rating), self.outlook.parameters
        effects, mean, variance = self._effects(rater, touches, k)
        at, weights = np.polynomial.hermite_e.hermegauss(NODES)
        expected = mean[:, None] + np.sqrt(variance)[:, None] * at
        law = self.outlook.posterior.observation.model.error
        spread = np.broadcast_to(np.asarray(parameters.varsigma, float), mean.shape)[:, None]
        likely = RowLaw(law, rows, expected, spread, parameters).log_probability() + np.log(weights / weights.sum())
        total = logsumexp(likely, axis=1)
        self.log_weight = self.log_weight + total
        # the law of each effect is normal again, with the moments that it has given the answer
        share = np.exp(likely - total[:, None])
        moved = share @ at
        left = np.maximum(share @ at**2 - moved**2, 1e-12)
        for key, (loading, own, own_variance) in effects.items():
            pull = own_variance * loading / np.sqrt(variance)
            self._laws[key] = own + pull * moved, own_variance - pull**2 * (1.0 - left)
        self.answers.append(Answer(rater, fabric, touches.table["load"][k], float(rating)))

    def refresh(self, result: Any) -> Self:
        """Return an experiment with the draws of a new run, whose ratings include the answers so far."""
        return type(self).start(result, **self.request)

    def save(self, path: str | Path) -> None:
        """Write the request and the answers to a small file, from which `load` continues."""
        from softness_bayes.base.files.records import as_json
        from softness_bayes.base.files.whole import write_whole

        loads = self.request["loads"] and [str(load) for load in self.request["loads"]]
        kept = {
            "adaptive": 1,
            **self.origin,
            "request": self.request | {"loads": loads, "candidates": None},
            "answers": [one._asdict() | {"load": str(one.load)} for one in self.answers],
        }
        write_whole(Path(path), as_json(kept, "adaptive experiment", indent=1).encode())

    @classmethod
    def load(cls, path: str | Path, result: Any, candidates: Fabrics | None = None) -> Self:
        """Return the experiment of a file, with the same suggestions.

        Parameters
        ----------
        path
            File of `save`.
        result, candidates
            The run and the candidates of `start`.

        Raises
        ------
        InputError
            If the file is of something else, or of another run.
        """
        from softness_bayes.base.files.records import parse_json

        kept = parse_json(Path(path).read_bytes())
        if not isinstance(kept, dict) or kept.get("adaptive") != 1:
            raise InputError(f"{path}: this is no adaptive experiment")
        if kept["digest"] != result.provenance.rating_data.digest_ratings:
            raise InputError(f"{path}: the experiment began with {kept['source']}, a run of other ratings")
        request = kept["request"] | {"candidates": candidates}
        again = cls.start(result, **request | {"loads": request["loads"] and [*map(load_named, request["loads"])]})
        for one in kept["answers"]:
            again.tell(**one | {"load": load_named(one["load"])})
        return again

    def _rows(self, rating: float) -> Rows:
        """Return a rating as the interval that ratings of this run represent, once for each node."""
        model, stated = self.outlook.model, self.outlook.model.interpretation.intervals
        start, end = model.options.slider_ends
        share, half = (rating - start) / (end - start), 0.5 * float(np.median(stated.step))
        if not 0 < share < stated.end:
            limit = f" and below {end:g}" if np.isfinite(stated.end) else ""
            raise InputError(f"adaptive: expected a rating above {start:g}{limit}, got {rating:g}")
        additive = model.options.scale.additive
        with np.errstate(divide="ignore"):
            low, high = additive(np.array([max(share - half, 0.0), min(share + half, stated.end)]))
        known = additive(np.maximum(stated.values, 1e-12))
        # a lapse is uniform over twice the range of the ratings
        lapse = -np.log(max(np.ptp(known), 1.0) + np.log(4.0)) + (np.log(min(high - low, 1e3)) if high > low else 0.0)
        return Rows(*(np.full(NODES, part) for part in (low, high, lapse)))

    def _effects(
        self, rater: str, touches: Touches, k: int
    ) -> tuple[dict[Key, tuple[Array, Array, Array]], Array, Array]:
        """Return what a rating of a touch shares with others, and its mean and variance without its own error.

        Shared are the rater's level, the error of the fabric's modulus and the fabric's deviation: independent given
        the draw, each with its loading, mean and variance at the draws.
        """
        zero, fabric = np.zeros(self.log_weight.size), touches.table["fabric"][k]
        first = {
            ("rater", rater): (zero + 1.0, *self.outlook.level(rater)),
            ("modulus", fabric): (touches.slope[:, k], zero, zero + touches.table["modulus_sd"][k] ** 2),
            ("deviation", fabric): (zero + 1.0, zero, touches.deviation[:, k]),
        }
        found = {key: (loading, *self._laws.get(key, law)) for key, (loading, *law) in first.items()}
        mean = touches.response[:, k] + sum(loading * own for loading, own, _ in found.values())
        return found, mean, np.asarray(sum(loading**2 * variance for loading, _, variance in found.values()))

    def _touch(self, fabric: str, load: Load) -> tuple[Touches, int]:
        """Return the touches that contain one of a fabric under a load, and its index among them."""
        table = self.touches.table
        here = np.flatnonzero(table["fabric"] == fabric)
        if not here.size:
            known = ", ".join(sorted(set(table["fabric"])))
            raise InputError(f"adaptive: {fabric!r} is no candidate, expected one of {known}")
        for k in here:
            if str(table["load"][k]) == str(load):
                return self.touches, int(k)
        alone = Fabrics((fabric,), effective_modulus=1e3 * table["e_fab_kpa"].to_numpy()[here[:1]])
        return self.outlook.touches(alone, (load,), self.request["modulus_cv"]), 0
