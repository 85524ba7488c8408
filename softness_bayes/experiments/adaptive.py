"""An experiment that chooses each next touch from the answers so far, for use while people rate.

The draws of a finished run are weighted by the answers as they come. Given a draw, the level of each rater is normal;
an answer moves it and weights the draw by the probability of the answer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from softness_bayes.data import Fabrics
from softness_bayes.errors import InputError
from softness_bayes.experiments.design import USUAL_CV, candidates_of, quantities_of, require_run
from softness_bayes.experiments.information import Histograms, rank_bins, single_gains
from softness_bayes.experiments.outlook import Outlook, Touches, outlook_of_run
from softness_bayes.likelihood.row_laws import Rows, log_probability
from softness_bayes.touch.contact import Force, Indentation, Load, held

Array = NDArray[np.float64]

WORN = 0.1
"""Share of effective draws below which the draws are worn, and a new run of all ratings is due."""

MOST_IN_A_ROW = 2
"""Largest number of times that a fabric under a load is suggested in a row."""

NODES = 7
"""Points of the sum over a rater's level."""


@dataclass(frozen=True)
class Suggestion:
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
    answers: list[dict[str, Any]] = field(default_factory=list)
    log_weight: Array = field(default_factory=lambda: np.empty(0))
    candidates: Fabrics | None = None
    _laws: dict[tuple[str, str], tuple[Array, Array]] = field(default_factory=dict)
    _others: dict[tuple[str, Load], Touches] = field(default_factory=dict)

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
        seed: int = 0,
    ) -> Self:
        """Return an experiment that begins with the draws of a finished run; arguments as for `design`.

        Raises
        ------
        InputError
            As `design` does.
        """
        require_run(result)
        outlook = outlook_of_run(result, np.random.default_rng(seed))
        fabrics = candidates_of(outlook, candidates, moduli)
        pressed = tuple(outlook.model.experiment.ratings.loads if loads is None else loads)
        touches = outlook.touches(fabrics, pressed, modulus_cv, USUAL_CV)
        if not touches.within.any():
            raise InputError("adaptive: no candidate is within the model's range; choose smaller loads")
        quantities = quantities_of(outlook, about)
        request = {
            "source": str(result.source),
            "digest": result.provenance.rating_data.digest_ratings,
            "about": list(about),
            "moduli": None if moduli is None else [float(value) for value in moduli],
            "loads": [_written(load) for load in pressed],
            "modulus_cv": modulus_cv,
            "seed": seed,
        }
        found = cls(outlook, touches.take(touches.within), [rank_bins(quantities[name]) for name in about], request)
        found.log_weight, found.candidates = np.zeros(len(outlook.theta)), candidates
        return found

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
        t = self.touches
        expected, variance = np.empty_like(t.response), np.empty_like(t.response)
        for k, fabric in enumerate(t.fabric):
            expected[:, k], variance[:, k], _ = self._expected(rater, fabric, t, k)
        sd = np.sqrt(variance + self.outlook.noise[:, None] ** 2)
        histograms = Histograms(expected, sd, self.weight)
        if self.bins:
            gain = np.sum([single_gains(histograms, bins) for bins in self.bins], axis=0)
        else:
            gain = single_gains(histograms)
        last = [(one["fabric"], _load(one["load"])) for one in self.answers if one["rater"] == rater][-MOST_IN_A_ROW:]
        allowed = np.array([last.count(touch) < MOST_IN_A_ROW for touch in zip(t.fabric, t.load, strict=True)])
        k = int(np.where(allowed, gain, -np.inf).argmax())
        return Suggestion(t.fabric[k], t.load[k], float(gain[k]))

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
        model = self.outlook.model
        scale = model.options.scale
        end = model.interpretation.intervals.end
        if not (np.isfinite(rating) and 0 < rating < end):
            limit = f" and below {end:g}" if np.isfinite(end) else ""
            raise InputError(f"adaptive: expected a rating above 0{limit}, got {rating:g}")
        touch, k = self._touch(fabric, load)
        mean, variance, effects = self._expected(rater, fabric, touch, k)
        parameters = self.outlook.posterior.rating_parameters(self.outlook.theta)
        value = float(scale.additive(np.array(rating)))
        at, weights = np.polynomial.hermite_e.hermegauss(NODES)
        expected = mean[:, None] + np.sqrt(variance)[:, None] * at
        law = model.posterior.observation.model.error
        rows = Rows(*(np.full(NODES, part) for part in (value, value, _log_lapse(model))))
        spread = np.broadcast_to(np.asarray(parameters.varsigma, float), mean.shape)[:, None]
        likely = log_probability(law, rows, expected, spread, parameters) + np.log(weights / weights.sum())
        total = logsumexp(likely, axis=1)
        self.log_weight = self.log_weight + total
        # the law of each effect is normal again, with the moments that it has given the answer
        share = np.exp(likely - total[:, None])
        moved = share @ at
        left = np.maximum(share @ at**2 - moved**2, 1e-12)
        for key, loading in effects:
            own, own_variance = self._law(key)
            pull = own_variance * loading / np.sqrt(variance)
            self._laws[key] = own + pull * moved, own_variance - pull**2 * (1.0 - left)
        self.answers.append({"rater": rater, "fabric": fabric, "load": _written(load), "rating": float(rating)})

    def refresh(self, result: Any) -> Self:
        """Return an experiment with the draws of a new run of all ratings, these answers among them."""
        again = type(self).start(
            result,
            self.request["about"],
            candidates=self.candidates,
            moduli=self.request["moduli"],
            loads=[_load(one) for one in self.request["loads"]],
            modulus_cv=self.request["modulus_cv"],
            seed=self.request["seed"],
        )
        again.answers = list(self.answers)
        return again

    def save(self, path: str | Path) -> None:
        """Write the request and the answers to a small file, from which `load` continues."""
        from softness_bayes.files.json_text import as_json
        from softness_bayes.files.whole import write_whole

        kept = {"adaptive": 1, "request": self.request, "answers": self.answers}
        text = as_json(kept, "adaptive experiment", indent=1)
        write_whole(Path(path), text.encode())

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
        from softness_bayes.files.json_text import parse_json

        kept = parse_json(Path(path).read_bytes())
        if not isinstance(kept, dict) or kept.get("adaptive") != 1:
            raise InputError(f"{path}: this is no adaptive experiment")
        request = kept["request"]
        if request["digest"] != result.provenance.rating_data.digest_ratings:
            raise InputError(f"{path}: the experiment began with {request['source']}, a run of other ratings")
        found = cls.start(
            result,
            request["about"],
            candidates=candidates,
            moduli=request["moduli"],
            loads=[_load(one) for one in request["loads"]],
            modulus_cv=request["modulus_cv"],
            seed=request["seed"],
        )
        for one in kept["answers"]:
            found.tell(one["rater"], one["fabric"], _load(one["load"]), one["rating"])
        return found

    def _law(self, key: tuple[str, str]) -> tuple[Array, Array]:
        """Return mean and variance at each draw of a rater's level, or of a fabric's error or deviation."""
        if key not in self._laws:
            what, name = key
            zero, levels = np.zeros(self.log_weight.size), self.outlook.levels
            names = self.outlook.model.experiment.ratings.participants
            k = self.touches.fabric.index(name) if what != "rater" else -1
            if what == "modulus":
                law = zero, zero + self.touches.modulus_sd[k] ** 2
            elif what == "deviation":
                law = zero, self.touches.deviation[:, k]
            elif name in names:
                law = levels.mean[:, names.index(name)], levels.variance[:, names.index(name)]
            else:
                law = levels.new_mean, levels.new_variance + levels.spread**2
            self._laws[key] = law
        return self._laws[key]

    def _expected(
        self, rater: str, fabric: str, touch: Touches, k: int
    ) -> tuple[Array, Array, list[tuple[tuple[str, str], Array]]]:
        """Return mean and variance of a rating without its own error, and the effects in it with their loadings.

        Effects are treated as independent given the draw.
        """
        one = np.ones(self.log_weight.size)
        effects = [(("rater", rater), one), (("modulus", fabric), touch.slope[:, k]), (("deviation", fabric), one)]
        laws = [(loading, *self._law(key)) for key, loading in effects]
        mean = touch.response[:, k] + sum(loading * own for loading, own, _ in laws)
        return mean, sum(loading**2 * variance for loading, _, variance in laws) + np.zeros(one.size), effects

    def _touch(self, fabric: str, load: Load) -> tuple[Touches, int]:
        """Return the touches that contain one of a fabric under a load, and its index among them."""
        t = self.touches
        here = [k for k, name in enumerate(t.fabric) if name == fabric]
        if not here:
            raise InputError(
                f"adaptive: {fabric!r} is no candidate, expected one of {', '.join(sorted(set(t.fabric)))}"
            )
        for k in here:
            if t.load[k] == load:
                return t, k
        if (fabric, load) not in self._others:
            alone = Fabrics((fabric,), effective_modulus=t.modulus[here[:1]])
            self._others[fabric, load] = self.outlook.touches(alone, (load,), self.request["modulus_cv"], USUAL_CV)
        return self._others[fabric, load], 0


def _log_lapse(model: Any) -> float:
    """Return the log density of a lapse on the additive scale: uniform over twice the range of the ratings."""
    values = model.options.scale.additive(np.maximum(model.interpretation.intervals.values, 1e-12))
    return float(-np.log(max(values.max() - values.min(), 1.0) + np.log(4.0)))


def _written(load: Load) -> list[Any]:
    return ["force_n" if isinstance(load, Force) else "indentation_m", float(held(load))]


def _load(written: Sequence[Any]) -> Load:
    kind, value = written
    return Force(value) if kind == "force_n" else Indentation(value)
