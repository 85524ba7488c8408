"""Small tables of numbers on grids, with their likelihoods, mean rates and parameters."""

import numpy as np

from softness_bayes.likelihood.contract import Parameters
from softness_bayes.likelihood.design import Design, Stated
from softness_bayes.likelihood.error_laws import NORMAL
from softness_bayes.likelihood.intervals import IntervalModel, IntervalRatings
from softness_bayes.likelihood.magnitude import RatingModel
from softness_bayes.likelihood.scales import RISES

CONDITIONS, POINTS = 6, 3


def design_of(people, repeats):
    condition = np.tile(np.repeat(np.arange(CONDITIONS), repeats), people)
    return Design(condition, np.repeat(np.arange(people), CONDITIONS * repeats), np.arange(CONDITIONS), people)


def points_of(rng, **values):
    def around(value, spread=0.2):
        return value * np.exp(spread * rng.standard_normal(POINTS))

    named = {"gamma": around(1.0), "tau": around(0.5), "varsigma": around(0.35), "eps": np.full(POINTS, 0.1)}
    named |= {"nu": around(5.0), "lapse": around(0.03)} | {k: np.full(POINTS, v) for k, v in values.items()}
    return Parameters(omega=0.0, **named)


def rates_of(rng):
    return np.linspace(0.0, 30.0, CONDITIONS) * np.exp(0.1 * rng.standard_normal((POINTS, CONDITIONS)))


def on_grid(values, step):
    return Stated(values, np.full(values.size, step), np.full(values.size, step / 2), np.full(values.size, np.inf))


def table(seed, people, repeats, law=NORMAL, step=0.0, outliers=0.0, tau=0.5, spread=0.35):
    """Ratings with their likelihood, mean rates and parameters; typical ratings are near 5."""
    rng = np.random.default_rng(seed)
    design, rate, points = design_of(people, repeats), rates_of(rng), points_of(rng, tau=tau)
    drive = RatingModel(RISES).drive(design, rate[0], points.replace(gamma=np.ones(POINTS)))[0]
    rows = design.n_rows
    log = np.log(5.0) + drive[design.condition] + (tau * rng.standard_normal(people))[design.participant]
    log = log + spread * rng.standard_normal(rows) + 2.3 * (rng.random(rows) < outliers)
    said = on_grid(np.exp(log), step)
    values = said.rounded(np.exp(log))
    model = IntervalModel(RISES, law=law)
    return IntervalRatings(values, design, model, stated=said if step else None), rate, points
