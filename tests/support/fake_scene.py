"""A forward model in one line, and the posterior of ratings that it made: for tests of inference alone."""

import numpy as np

from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.magnitude import LogRatings, RatingModel
from softness_bayes.model.posterior import Posterior
from softness_bayes.parameters.choice import parameter_space
from softness_bayes.touch.neuron.membrane import PAPER_CHANNELS
from support.points import rated

FABRICS, LOADS, PARTICIPANTS = 6, 2, 8
TRUTH = rated(0.9, 0.5, 0.3)


class FakeScene:
    """Rates that rise with load and stiffness and vanish below a threshold that alpha lowers."""

    n_receptors = 250.0

    def __init__(self, rheobase=18.0):
        self.rheobase = rheobase

    def total_rate(self, parameters):
        b, m, alpha, beta, sigma_0 = (np.asarray(p, float)[..., None] for p in parameters[:5])
        stiffness = np.tile(np.geomspace(0.1, 10, FABRICS), LOADS)
        load = np.repeat(np.linspace(1, 2, LOADS), FABRICS)
        stress = b * load**1.5 * stiffness / (stiffness + 0.3 * m)
        current = alpha / (1 + np.exp(-np.clip(beta * (0.1 * stress - sigma_0), -500, 500)))
        return 250.0 * 12.0 * np.sqrt(np.maximum(current - self.rheobase, 0.0))


def fake_posterior(scene=None, fix=None, **choices):
    """Posterior of ratings that the fake scene made at the priors' medians.

    Channels mean nothing there; they are held, and so is eps unless it is given a prior.
    """
    source, rng, model = FakeScene(), np.random.default_rng(0), RatingModel()
    conditions = FABRICS * LOADS
    rows = np.arange(PARTICIPANTS * conditions)
    design = Design(rows % conditions, rows // conditions, np.tile(np.arange(FABRICS), LOADS), PARTICIPANTS)
    space = parameter_space()
    rate = source.total_rate(space.touch(space.median)) / source.n_receptors
    effects = model.draw_effects(rng, TRUTH, (), PARTICIPANTS, FABRICS, {"mu": np.log(20)})
    ratings = model.draw_ratings(rng, design, model.drive(design, rate, TRUTH), TRUTH, effects)
    fix = {**PAPER_CHANNELS._asdict(), "eps": 0.1, **(fix or {})}
    fix = {name: value for name, value in fix.items() if name not in choices.get("priors", {})}
    return Posterior(parameter_space(fix=fix, **choices), (LogRatings(ratings, design),), scene or source)
