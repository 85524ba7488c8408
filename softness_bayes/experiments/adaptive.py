"""An experiment that chooses each next touch from the answers so far, for use while people rate.

The draws of a finished run are weighted by the answers as they come. Given a draw, the level of each rater is normal;
an answer moves it and weights the draw by the probability of the answer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from scipy.special import logsumexp

from softness_bayes.base.errors import InputError
from softness_bayes.base.files.records import as_json, from_json, parse_json, to_json
from softness_bayes.base.files.whole import write_whole
from softness_bayes.experiments.design import quantities_of
from softness_bayes.experiments.information import rank_bins, single_gains
from softness_bayes.experiments.outlook import Candidates, FurtherRatings, Outlook, load_named, outlook_of_run
from softness_bayes.likelihood.design import Design, FloatArray, IndexArray
from softness_bayes.likelihood.row_laws import RowLaw, Rows
from softness_bayes.touch.contact import Load

WORN = 0.1
"""Share of effective draws below which the draws are worn, and a new run of all ratings is due."""

MOST_IN_A_ROW = 2
"""Largest number of times that a fabric under a load is suggested in a row."""

NODES = 7
"""Points of the sum over a rater's level."""


class Answer(NamedTuple):
    """A rating that was given; the load as texts have it, such as 2 mm."""

    rater: str
    fabric: str
    load: str
    rating: float


class Suggestion(NamedTuple):
    """The touch to present next."""

    fabric: str
    load: Load
    gain: float
    """Information that one rating of it is expected to give [nats]."""


class Session(NamedTuple):
    """The part of an adaptive experiment that a file keeps: its run, its question and its answers."""

    source: str
    digest: str
    """Digest of the ratings of the run."""
    about: tuple[str, ...]
    candidates: Candidates
    answers: tuple[Answer, ...] = ()


@dataclass
class Adaptive:
    """An adaptive experiment; make one with `start` or `load`.

    The number of trials is the experimenter's: nothing stops early, because an answer that ends the session would
    depend on the answers.
    """

    outlook: Outlook
    expected: FurtherRatings
    """Ratings of the candidates before any answer."""
    bins: list[IndexArray]
    session: Session
    log_weight: FloatArray
    _laws: dict[tuple[int, str], tuple[FloatArray, FloatArray]] = field(default_factory=dict)
    """Mean and variance at the draws of effects that an answer has changed, by their kind and whose they are."""

    @classmethod
    def start(cls, result: Any, about: Sequence[str] = (), candidates: Candidates = Candidates()) -> Self:
        """Return an experiment that begins with the draws of a finished run; arguments as for `design`.

        Raises
        ------
        InputError
            As `design` does.
        """
        outlook = outlook_of_run(result)
        every = candidates.resolved(outlook)
        expected, quantities = every.ratings([outlook], ""), quantities_of([outlook], about)
        bins = [rank_bins(quantities[name]) for name in about]
        run = str(result.source), result.provenance.rating_data.digest_ratings
        return cls(outlook, expected, bins, Session(*run, tuple(about), every), np.zeros(len(outlook.theta)))

    @property
    def weight(self) -> FloatArray:
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
        ratings, table = self._given(rater, self.expected), self.expected.table
        gain = single_gains(ratings.mean, ratings.sd, self.bins, self.weight)
        last = [(one.fabric, one.load) for one in self.session.answers if one.rater == rater][-MOST_IN_A_ROW:]
        often = [last.count(touch) for touch in zip(table["fabric"], table["load"].map(str), strict=True)]
        k = int(np.where(np.array(often) < MOST_IN_A_ROW, gain, -np.inf).argmax())
        return Suggestion(table["fabric"][k], table["load"][k], float(gain[k]))

    def tell(self, rater: str, fabric: str, load: Load | str, rating: float) -> None:
        """Take an answer into account.

        Parameters
        ----------
        rater
            Name of the rater; one that the run does not have is a new one.
        fabric
            Name of a candidate.
        load
            The load that was really shown, whether or not it is among the candidates'; also its text, such as 2mm.
        rating
            The rating as given.

        Raises
        ------
        InputError
            If there is no such fabric, or the rating is not on the scale.
        """
        every, rows, parameters = self.session.candidates, self._rows(rating), self.outlook.parameters
        assert every.fabrics is not None
        if fabric not in every.fabrics.names:
            known = ", ".join(every.fabrics.names)
            raise InputError(f"adaptive: {fabric!r} is no candidate, expected one of {known}")
        pressed = load_named(load)
        touch = replace(every, fabrics=every.fabrics.take((fabric,)), loads=(str(pressed),))
        shown = self._given(rater, self.outlook.ratings(touch, rater))
        at, weights = np.polynomial.hermite_e.hermegauss(NODES)
        expected = shown.mean + shown.shared * at
        law = self.outlook.posterior.observation.model.error
        spread = np.broadcast_to(np.asarray(parameters.varsigma, float), len(expected))[:, None]
        likely = RowLaw(law, rows, expected, spread, parameters).log_probability() + np.log(weights / weights.sum())
        total = logsumexp(likely, axis=1)
        self.log_weight = self.log_weight + total
        # the law of each effect is normal again, with the moments that it has given the answer
        share = np.exp(likely - total[:, None])
        moved = share @ at
        left = np.maximum(share @ at**2 - moved**2, 1e-12)
        pull = (shown.loading * shown.variance / shown.shared)[..., 0]
        centre, variance = shown.centre[..., 0] + pull * moved, shown.variance[..., 0] - pull**2 * (1.0 - left)
        self._laws |= {(kind, name): (centre[kind], variance[kind]) for kind, name in enumerate(shown.of[:, 0])}
        answer = Answer(rater, fabric, str(pressed), float(rating))
        self.session = self.session._replace(answers=(*self.session.answers, answer))

    def _given(self, rater: str, expected: FurtherRatings) -> FurtherRatings:
        """Return the ratings of some touches by a rater, given the answers so far."""
        of, centre, variance = expected.of.copy(), expected.centre.copy(), expected.variance.copy()
        of[0] = rater
        centre[0], variance[0] = self.outlook.level(rater)[:2]
        for (kind, name), law in self._laws.items():
            centre[kind][:, of[kind] == name], variance[kind][:, of[kind] == name] = (one[:, None] for one in law)
        return replace(expected, of=of, centre=centre, variance=variance)

    def refresh(self, result: Any) -> Self:
        """Return an experiment with the draws of a new run, whose ratings include the answers so far."""
        return self.start(result, self.session.about, self.session.candidates)

    def save(self, path: str | Path) -> None:
        """Write what was asked and the answers to a small file, from which `load` continues."""
        write_whole(Path(path), as_json(to_json(self.session), "adaptive experiment", indent=1).encode())

    @classmethod
    def load(cls, path: str | Path, result: Any) -> Self:
        """Return the experiment of a file, with the same suggestions.

        Parameters
        ----------
        path
            File of `save`.
        result
            The run of `start`.

        Raises
        ------
        InputError
            If the file is of something else, or of another run.
        """
        try:
            kept: Session = from_json(Session, parse_json(Path(path).read_bytes()))
        except (AttributeError, KeyError, TypeError, ValueError):
            raise InputError(f"{path}: this is no adaptive experiment") from None
        if kept.digest != result.provenance.rating_data.digest_ratings:
            raise InputError(f"{path}: the experiment began with {kept.source}, a run of other ratings")
        again = cls.start(result, kept.about, kept.candidates)
        for answer in kept.answers:
            again.tell(*answer)
        return again

    def _rows(self, rating: float) -> Rows:
        """Return a rating as the interval that ratings of this run represent, once for each node."""
        model, stated = self.outlook.posterior.observation.model, self.outlook.model.interpretation.intervals
        start, end = self.outlook.model.options.slider_ends
        share, half = (rating - start) / (end - start), 0.5 * float(np.median(stated.step))
        if not 0 < share < stated.end:
            limit = f" and below {end:g}" if np.isfinite(stated.end) else ""
            raise InputError(f"adaptive: expected a rating above {start:g}{limit}, got {rating:g}")
        values, one = np.append(stated.values, share), np.zeros(stated.values.size + 1, np.intp)
        low, high = np.maximum(values - half, 0.0), np.minimum(values + half, stated.end)
        lapse = np.full(values.size, -np.inf)
        if model.error.lapses:  # over the range of all ratings
            lapse = model.lapses(low, high, Design(one, one, one[:1], 1)).log_probability(low, high, model.scale)
        with np.errstate(divide="ignore"):
            return Rows(model.scale.additive(low), model.scale.additive(high), lapse).take([-1] * NODES)
