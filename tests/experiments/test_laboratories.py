"""Designs in simulated laboratories: what they teach beside random and usual sets.

A laboratory begins with four fabrics under 2 mm and ten raters, and rates eight further conditions. Posteriors are
importance samples from a Student law that is fitted to them in a few rounds, so that one takes a second.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_t

from softness_bayes.checking.inflection import CurveShape, turning_points
from softness_bayes.data import Experiment, Fabrics, Ratings
from softness_bayes.experiments import design as module
from softness_bayes.experiments.design import design
from softness_bayes.experiments.outlook import Outlook
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.touch.contact import Indentation
from softness_bayes.touch.neuron.membrane import PAPER_CHANNELS

LOADS = (Indentation(1e-3), Indentation(2e-3), Indentation(3e-3))
MODULI = np.append(np.geomspace(3e4, 6e5, 4), np.geomspace(1e4, 2e6, 12))
"""E_fab [Pa] of four owned fabrics, and of those that could be obtained."""
NAMES = tuple(f"cloth {k:02d}" for k in range(MODULI.size))
RATERS, CONDITIONS = 10, 8
BEGIN = [(k, 1) for k in range(4)]
"""Fabric and load of the first conditions."""
ABOUT = ("b", "sigma_0", "turning@2mm")
HELD = {"eps": 0.1, "omega": 0.0, **PAPER_CHANNELS._asdict()}


def laboratory(rng):
    """Return three ratings of every touch by every rater, (raters, fabrics, loads, 3), for parameters of the prior.

    They are such that the response turns over under 2 mm.
    """
    model = model_of(np.ones((RATERS, MODULI.size, 3, 3)), BEGIN + [(k, j) for k in range(4, 16) for j in range(3)])
    space, _ = model.posterior.space, rng.standard_normal(MODULI.size)
    for theta in space.draw_prior(rng, 1000):
        values = space.values(theta)
        touch = space.touch(theta[None]).broadcast(1)
        turn = turning_points(model.scene, touch, 0.0, loads=[LOADS[1]])
        rate = model.scene.total_rate(touch, MODULI[None])[0] / model.scene.n_receptors
        if turn.outcome[0, 0] == CurveShape.INTERIOR and 1e4 < turn.modulus[0, 0] < 2e6 and (rate[:4] > 0).sum() > 2:
            break
    of = np.zeros((MODULI.size, 3))
    of[model.scene.fabric, model.scene.load] = values["gamma"] * np.log(rate + HELD["eps"])
    scale, noise = values["tau"] * rng.standard_normal((RATERS, 1, 1, 1)), rng.standard_normal((RATERS, *of.shape, 2))
    noise = np.concatenate([noise, np.random.default_rng(1).standard_normal((RATERS, *of.shape, 1))], axis=-1)
    log_rating = np.log(20.0) + scale + (of - of[:4, 1].mean())[..., None] + values["varsigma"] * noise
    return np.exp(log_rating)


def model_of(ratings, conditions):
    """Return the model of the ratings of some conditions, each rated once by every rater, or twice."""
    used = sorted({fabric for fabric, _ in conditions})
    loads = sorted({load for _, load in conditions})
    rows = [(who, f, j, conditions[:k].count((f, j))) for k, (f, j) in enumerate(conditions) for who in range(RATERS)]
    who, fabric, load, again = np.array(rows).T
    table = Ratings(
        tuple(f"rater {k}" for k in range(RATERS)),
        tuple(NAMES[k] for k in used),
        tuple(LOADS[k] for k in loads),
        who,
        np.searchsorted(used, fabric),
        np.searchsorted(loads, load),
        ratings[who, fabric, load, again],
        np.arange(who.size) + 2,
    )
    cloth = Fabrics(table.fabrics, effective_modulus=MODULI[used])
    return build(Experiment(table, cloth, ()), ModelOptions(fix=HELD))


def outlook_of(model, rng, size=4000, rounds=25):
    """Return an outlook of the posterior: draws of a Student law in the sampler's coordinates, by their weights.

    The law is fitted to draws with tempered weights, of which enough stay effective, until no tempering is needed.
    """
    posterior = model.posterior
    theta = posterior.space.draw_prior(rng, 4 * size)
    z, log_weight = posterior.space.coordinates(theta), posterior.log_likelihood(theta)
    settled = 0
    for _ in range(rounds):
        power = 1.0
        while effective(power * log_weight) < 20 * z.shape[1]:
            power *= 0.8
        settled += power == 1.0
        if settled == 3:
            break
        weight = np.exp(power * log_weight - logsumexp(power * log_weight))
        law = multivariate_t(weight @ z, np.cov(z.T, aweights=weight), df=8, allow_singular=True)
        z = law.rvs(4 * size, random_state=rng)
        with np.errstate(over="ignore", invalid="ignore"):
            log_weight = posterior(z) - law.logpdf(z)
    assert settled == 3, effective(log_weight)
    chosen = z[rng.choice(len(z), size, p=np.exp(log_weight - logsumexp(log_weight)))]
    theta = posterior.natural(chosen)
    return Outlook(model, theta, posterior.space.values(theta), rated=True)


def effective(log_weight):
    """Return the effective number of draws."""
    return float(np.exp(2 * logsumexp(log_weight) - logsumexp(2 * log_weight)))


def spreads(outlook):
    """Return the standard deviation of each quantity, of turning points over the draws that have one."""
    values = [*(np.log(outlook.named[name]) for name in ABOUT[:2]), outlook.turning(LOADS[1])]
    return np.array([np.nanstd(value) for value in values])


def designed(outlook, about):
    """Return the conditions of a plan about a quantity."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "_outlooks", lambda *_: [outlook])
        cloth = Fabrics(NAMES, effective_modulus=MODULI)
        plan = design(None, (about,), candidates=cloth, loads=LOADS, conditions=CONDITIONS, modulus_cv=0.0)
    return [(NAMES.index(row.fabric), round(row.indentation_mm) - 1) for row in plan.table.itertuples()]


USUAL = [(k, 1) for k in np.linspace(4, 15, CONDITIONS).round().astype(int)]
"""Fabrics that are evenly spaced over the range of moduli, under the load of the first ratings."""


def taught(seed, sets=6):
    """Return log ratios of sds after and before, of designs about each quantity, of random sets, and of a usual one."""
    rng = np.random.default_rng(seed)
    ratings = laboratory(rng)
    first = outlook_of(model_of(ratings, BEGIN), rng)
    before = spreads(first)

    def after(conditions):
        return np.log(spreads(outlook_of(model_of(ratings, BEGIN + conditions), rng)) / before)

    every = [(k, j) for k in range(MODULI.size) for j in range(3)] * 2
    found = [after(designed(first, name))[k] for k, name in enumerate(ABOUT)]
    others = [[every[k] for k in rng.choice(len(every), CONDITIONS, replace=False)] for _ in range(sets)]
    return np.array(found), np.mean([after(one) for one in others], axis=0), after(USUAL)


@pytest.mark.slow
def test_designs_teach_more_than_random_and_usual_sets():
    """In eleven laboratories, sds shrank to 0.62, 0.56 and 0.65; by random sets to 0.70, 0.76, 0.78, usual ones to 0.8.

    The best of twenty random sets, chosen afterwards in each laboratory, shrank them to 0.43, 0.35 and 0.37.
    """
    found, random, usual = (np.array(part) for part in zip(*(taught(seed) for seed in range(100, 112)), strict=True))
    for others in (random, usual):
        assert np.nanmean(found - others) < -0.1
