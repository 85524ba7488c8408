"""Calibration of all models of ratings: ``python -m softness_bayes.tools.model_ranks FILE.csv [--labs N] [--first K]``.

Parameters are drawn from the prior, and small laboratories of five raters, twelve fabrics and two loads are simulated.
Each is fitted by importance sampling: with its own model, and some also with known mistakes in the likelihood (negative
controls). The true values are ranked among the draws. Of the forward model only `b` is sampled;
``softness-bayes calibrate`` tests the other parameters. The file gets a row per fit, and `verdicts.csv` beside it one
per model and mistake, and a figure of each model's ranks. Existing rows are kept, so that a second call continues where
the first one ended; with ``--labs 0`` it writes verdicts and figures only.

``--agree FILE.csv`` instead compares importance sampling with the sampler of a run, for one laboratory of each model.
"""

from __future__ import annotations

import argparse
import csv
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.ranks import DRAWS, Calibration
from softness_bayes.data import Fabrics
from softness_bayes.likelihood.error_laws import LAPSES, NORMAL, STUDENT
from softness_bayes.likelihood.magnitude import RatingModel
from softness_bayes.likelihood.ratings import RatingParameters, RatingsLikelihood
from softness_bayes.likelihood.scales import AGGREGATED, CATEGORIES, PAIRS, RANKS, SLIDER
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.posterior import Posterior
from softness_bayes.model.scenes import usual_values
from softness_bayes.parameters.priors import HalfNormal
from softness_bayes.plotting.calibration import rank_ecdf_figure
from softness_bayes.plotting.style import save
from softness_bayes.runs.calibration_scene import CalibrationScene
from softness_bayes.runs.ranked_quantities import quantities, turning_point, turns
from softness_bayes.runs.replicate import independent, ranks, simulate
from softness_bayes.sampler.sampling import Settings, sample_until
from softness_bayes.tools.coverage import keep
from softness_bayes.tools.importance import TRUSTED, Effort, weighted
from softness_bayes.touch.readings import MENDED

Array = NDArray[np.float64]

SCENE = CalibrationScene(Fabrics(tuple("abcdefghijkl"), effective_modulus=np.geomspace(3e3, 6e5, 12)), participants=5)

HELD = ("m", "alpha", "beta", "sigma_0", "c_Na", "c_K", "c_L", "c_A")
"""Parameters of the forward model that are fixed at their usual values, in simulation and fit."""

USUAL, RETRY = Effort(1000, 1000.0), Effort(4000, 1000.0)
"""Effort of a fit, and the one spent where a right model's weights cannot be trusted."""

RUN = Settings(ensembles=2, processes=1)
"""The run with which importance sampling is compared."""

CONTROLLED = 10
FAINT = MappingProxyType(
    dict.fromkeys(
        (
            *("differences ignored", "tails ignored", "lapses ignored", "inner categories twice as wide"),
            "deviations ignored",
        ),
        40,
    )
)
"""Number of laboratories that are also fitted with each mistake; of those that are hard to see, by name."""

RIGHT = "right"
"""Name of the fit with the model of the simulation."""


class Mistaken:
    """A likelihood with a known mistake: it is computed for other parameters, or another response.

    Parameters
    ----------
    observation
        The correct likelihood.
    change
        Function of the parameters that returns those used instead.
    shift
        Number of conditions by which the response is displaced.
    """

    def __init__(
        self, observation: RatingsLikelihood, change: Callable[[RatingParameters], RatingParameters], shift: int = 0
    ) -> None:
        self._observation, self._change, self._shift = observation, change, shift

    def __getattr__(self, name: str) -> Any:
        return getattr(self._observation, name)

    def log_likelihood(self, mean_rate: Array, parameters: RatingParameters) -> Array:
        """Log density of all ratings at the changed parameters, shape (...)."""
        return self._observation.log_likelihood(np.roll(mean_rate, self._shift, axis=-1), self._change(parameters))


Mistake = Callable[[RatingsLikelihood], Any]


def scaled(**factors: float) -> Mistake:
    """Return the mistake that takes some parameters times a factor."""

    def change(parameters: RatingParameters) -> RatingParameters:
        return parameters._replace(**{name: getattr(parameters, name) * by for name, by in factors.items()})

    return lambda observation: Mistaken(observation, change)


def displaced(observation: RatingsLikelihood) -> Mistaken:
    """Return the likelihood that attributes every rating to the next fabric."""
    return Mistaken(observation, lambda parameters: parameters, 1)


def exact(observation: RatingsLikelihood) -> Mistaken:
    """Return the likelihood that takes whole numbers as exact, and 0 as the middle of its interval."""
    taken = RatingModel(observation.model.direction).observe(observation.values, observation.design)
    return Mistaken(taken, lambda parameters: parameters._replace(omega=0.0))


WRONG_SIGN = MappingProxyType({"ratings fall where they rise": scaled(gamma=-1.0)})
TOO_PRECISE = MappingProxyType({**WRONG_SIGN, "noise 1.5 times too small": scaled(varsigma=1 / 1.5)})
ORDERED = MappingProxyType(
    {
        **WRONG_SIGN,
        "noise 3 times too small": scaled(varsigma=1 / 3),
        "each touch taken for the next fabric's": displaced,
    }
)
"""Mistakes by model; in orders, only the exponent divided by the noise matters, so that 1.5 is a small mistake."""


class Case(NamedTuple):
    """One observation model, and mistakes in it that the ranks must detect."""

    options: Mapping[str, Any]
    """Options of the model."""
    mistakes: Mapping[str, Mistake]


_WHOLE, _OWN = {"resolution": 1.0}, {"resolution": 0.0, "errors": NORMAL}
_GAPS = scaled(gap_2=2.0, gap_3=2.0, gap_4=2.0)
_SAME_FABRICS = {"deviations ignored": scaled(omega=0.0)}
CASES: Mapping[str, Case] = {
    "whole numbers, normal": Case({**_WHOLE, "errors": NORMAL}, {**TOO_PRECISE, "taken as exact": exact}),
    "whole numbers, Student": Case({**_WHOLE, "errors": STUDENT}, {**TOO_PRECISE, "tails ignored": scaled(nu=1e4)}),
    "whole numbers, lapses": Case({**_WHOLE, "errors": LAPSES}, {**TOO_PRECISE, "lapses ignored": scaled(lapse=1e-6)}),
    "fabrics' deviations, normal": Case(
        {**_WHOLE, "errors": NORMAL, "priors": {"omega": HalfNormal(0.3)}}, {**TOO_PRECISE, **_SAME_FABRICS}
    ),
    "slider": Case({"scale": SLIDER}, TOO_PRECISE),
    "categories": Case(
        {"scale": CATEGORIES, "n_categories": 5}, {**WRONG_SIGN, "inner categories twice as wide": _GAPS}
    ),
    "pairs": Case({"scale": PAIRS}, ORDERED),
    "ranks": Case({"scale": RANKS}, ORDERED),
    "aggregated": Case({"scale": AGGREGATED}, TOO_PRECISE),
    "raters' own gamma": Case(
        {**_OWN, "individual": ("gamma",)}, {**TOO_PRECISE, "differences ignored": scaled(tau_gamma=0.0)}
    ),
    "raters' own varsigma": Case(
        {**_OWN, "individual": ("varsigma",)}, {**TOO_PRECISE, "differences ignored": scaled(tau_varsigma=0.0)}
    ),
    "own gamma and fabrics' deviations": Case(
        {**_WHOLE, "errors": NORMAL, "individual": ("gamma",), "priors": {"omega": HalfNormal(0.3)}},
        {**TOO_PRECISE, "differences ignored": scaled(tau_gamma=0.0), **_SAME_FABRICS},
    ),
}

RANKED = (
    *("b", "gamma", "tau", "varsigma", "eps", "nu", "lapse", "gap_2", "gap_3", "gap_4", "tau_gamma", "tau_varsigma"),
    *("omega", "mu", "log_likelihood", "participant_effect", "participant_spread", "fabric_effect", "fabric_spread"),
    *(name(load) for load in SCENE.loads for name in (turns, turning_point)),
)
COLUMNS = ("lab", "case", "k", *RANKED)
"""`case`: model and fit; `k`: Pareto's shape of the weights; then the number of draws below the true value for every
ranked quantity of the model."""


@cache
def posterior_of(case: str) -> Posterior:
    """Return the posterior of a model, with placeholder ratings."""
    usual = usual_values(MENDED)
    options = ModelOptions(fix={name: usual[name] for name in HELD}, **CASES[case].options)
    return SCENE.model(options).posterior


def laboratory(case: str, number: int) -> tuple[Posterior, Array, Any]:
    """Return the posterior of simulated ratings, the true parameters and the true effects."""
    posterior, rng = posterior_of(case), np.random.default_rng((20261123, number))
    theta = posterior.space.draw_prior(rng, 1)[0]
    observation, effects = simulate(posterior.observation, posterior, theta, rng)
    return posterior.with_term(observation), theta, effects


def fit(posterior: Posterior, number: int, right: bool = True) -> tuple[Array, float]:
    """Return draws of a posterior by importance sampling, and Pareto's k; with more draws if a right model needs them.

    Nothing is told about the truth. Posteriors of mistaken models may be far from the ratings. They only have to be
    wrong, so that their weights need not be good.
    """
    rng = np.random.default_rng((number, 1))
    found = weighted(posterior, rng, {}, USUAL)
    if right and not found.k <= TRUSTED:
        found = weighted(posterior, rng, {}, RETRY)
    return found.resampled(rng, DRAWS), found.k


def ranked(number: int, case: str) -> Iterator[dict[str, Any]]:
    """Yield the row of one fit; `case` names model and fit, as in `names_of_fits`."""
    model, _, name = case.partition(" / ")
    if name != RIGHT and number >= FAINT.get(name, CONTROLLED):
        return
    made, truth, true_effects = laboratory(model, number)
    fitted = made
    if name != RIGHT:
        fitted = made.with_term(CASES[model].mistakes[name](made.observation))
    theta, k = fit(fitted, number, name == RIGHT)
    rng = np.random.default_rng((number, 3))
    response, parameters = fitted.response(theta), fitted.rating_parameters(theta)
    effects = made.observation.draw_effects(rng, response, parameters)
    true, drawn = quantities(fitted, truth[None], true_effects), quantities(fitted, theta, effects)
    rank = ranks(np.concatenate([*true.values()]), np.column_stack([*drawn.values()]), rng)
    placed = dict(zip(true, rank.tolist(), strict=True))
    row = {"lab": number, "case": case, "k": round(k, 3)}
    yield row | {name: placed[name] for name in RANKED if name in placed}


def names_of_fits() -> Iterator[str]:
    """Yield model and fit of every case of the file."""
    for model, case in CASES.items():
        for name in (RIGHT, *case.mistakes):
            yield f"{model} / {name}"


def calibrations(rows: Iterable[Mapping[str, str]]) -> dict[str, Calibration]:
    """Return the ranks of each case, from rows of the file."""
    of: dict[str, list[Mapping[str, str]]] = {}
    for row in rows:
        of.setdefault(row["case"], []).append(row)
    found = {}
    for case, own in of.items():
        names = tuple(name for name in RANKED if str(own[0].get(name, "")) != "")
        found[case] = Calibration(names, np.array([[int(row[name]) for name in names] for row in own]))
    return found


def judged(rows: Iterable[Mapping[str, str]]) -> Iterator[dict[str, Any]]:
    """Yield what the ranks of each case say, from rows of the file: the verdict, and the power of a right model."""
    kept = [*rows]
    of = calibrations(kept)
    for case in (name for name in names_of_fits() if name in of):
        found, (model, _, name) = of[case], case.partition(" / ")
        each = found.judge().values()
        row = {
            "model": model,
            "fit": name,
            "labs": len(found.rank),
            "k_large": sum(row["case"] == case and float(row["k"]) > TRUSTED for row in kept),
            "quantities": len(found.names),
            "smallest_p": f"{max(0.0, min(min(one.uniform_p, one.spread_p) for one in each)):.2g}",
            "alarm_below": f"{found.threshold:.1g}",
            "says_first": next(iter(found.faults()), "nothing"),
        }
        if name == RIGHT:
            row |= {"width": f"{found.least_width.value:.2f}", "shift": f"{found.least_shift.value:.2f}"}
        yield row


VERDICTS = (
    *("model", "fit", "labs", "k_large", "quantities", "smallest_p", "alarm_below", "says_first"),
    *("width", "shift"),
)
"""`k_large`: number of fits with k above `importance.TRUSTED`; `says_first`: the first quantity with an alarm; `width`,
`shift`: factor by which a posterior must be too narrow, and shift in its standard deviations, to be detected nine times
in ten."""


def write_verdicts(path: Path) -> None:
    """Write the verdicts on a file of fits to `verdicts.csv` beside it."""
    with path.open(encoding="utf-8", newline="") as file:
        found = [*judged(csv.DictReader(file))]
    with path.with_name("verdicts.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, VERDICTS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(found)


def figure_name(model: str) -> str:
    """Return the name of a model's figure, without a suffix."""
    return re.sub(r"\W+", "_", model)


def draw(path: Path) -> None:
    """Draw the ranks of every model's right fits, from a file of fits, in PNG files beside it."""
    with path.open(encoding="utf-8", newline="") as file:
        found = calibrations(csv.DictReader(file))
    for model in CASES:
        if (calibration := found.get(f"{model} / {RIGHT}")) is not None:
            figure = rank_ecdf_figure(calibration.rank, calibration.draws, calibration.names)
            save(figure, path.with_name(figure_name(model)), ("png",))


def agreement(number: int, case: str) -> Iterator[dict[str, Any]]:
    """Yield the differences between importance sampling and a run for one laboratory, by parameter."""
    made = laboratory(case, number)[0]
    weighed, k = fit(made, number)
    run = made.natural(independent(sample_until(made, RUN, number), len(weighed), np.random.default_rng(number)))
    for name, one, other in zip(
        made.names, made.space.coordinates(weighed).T, made.space.coordinates(run).T, strict=True
    ):
        sd = other.std()
        yield {
            "lab": number,
            "case": case,
            "k": round(k, 3),
            "parameter": name,
            "shift": round(float((one.mean() - other.mean()) / sd), 3),
            "spread": round(float(one.std() / sd), 3),
        }


AGREEMENT = ("lab", "case", "k", "parameter", "shift", "spread")
"""`shift`: difference of the means, in the run's posterior standard deviations; `spread`: ratio of these deviations."""


def main() -> None:
    """Fit the laboratories that are missing in the file."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("file", type=Path, help="CSV file of the fits; what it holds is kept")
    parser.add_argument("--labs", type=int, default=200, help="number of laboratories of each model")
    parser.add_argument("--first", type=int, default=0, help="number of the first one")
    parser.add_argument("--models", default=",,".join(CASES), help="models, separated by two commas; by default all")
    parser.add_argument("--agree", action="store_true", help="compare importance sampling with runs instead")
    options = parser.parse_args()
    numbers, models = range(options.first, options.first + options.labs), options.models.split(",,")
    if options.agree:
        keep(options.file, AGREEMENT, numbers, models, agreement)
    else:
        fits = [name for name in names_of_fits() if name.partition(" / ")[0] in models]
        keep(options.file, COLUMNS, numbers, fits, ranked)
        write_verdicts(options.file)
        draw(options.file)


if __name__ == "__main__":
    main()
