"""Designs in simulated laboratories: what they teach beside random and usual sets.

A laboratory begins with four fabrics under 2 mm and ten raters, and rates eight further conditions. Posteriors are
importance samples from a Student law that is fitted to them in a few rounds, so that one takes a second.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import binom, multivariate_t

from softness_bayes.checking.inflection import CurveShape, turning_points
from softness_bayes.data import Experiment, Fabrics, Ratings
from softness_bayes.data.fabrics import log_sd
from softness_bayes.experiments import design as module
from softness_bayes.experiments.design import design
from softness_bayes.experiments.information import nested_gain
from softness_bayes.experiments.outlook import Candidates, Outlook
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.runs.replicate import independent
from softness_bayes.sampler.sampling import Settings, sample_until
from softness_bayes.touch.contact import Indentation
from softness_bayes.touch.neuron.membrane import PAPER_CHANNELS

LOADS = (Indentation(1e-3), Indentation(2e-3), Indentation(3e-3))
MODULI = np.append(np.geomspace(3e4, 6e5, 4), np.geomspace(1e4, 2e6, 12))
"""E_fab [Pa] of four owned fabrics, and of those that could be obtained."""
NAMES = tuple(f"cloth {k:02d}" for k in range(MODULI.size))
RATERS, CONDITIONS = 10, 8
BEGIN = [(k, 1) for k in range(4)]
"""Fabric and load of the first conditions."""
ABOUT = ("b", "m", "sigma_0", "turning@2mm")
HELD = {"eps": 0.1, "omega": 0.0, **PAPER_CHANNELS._asdict()}


def laboratory(rng, raters=RATERS):
    """Return three ratings of every touch by every rater, (raters, fabrics, loads, 3), and the true quantities.

    Parameters are drawn from the prior, such that the response turns over under 2 mm.
    """
    every = [(k, j) for k in range(MODULI.size) for j in range(3)]
    model = model_of(np.ones((raters, MODULI.size, 3, 3)), every)
    space = model.posterior.space
    rate = np.empty((MODULI.size, 3))
    for theta in space.draw_prior(rng, 1000):
        values = space.values(theta)
        touch = space.touch(theta[None]).broadcast(1)
        turn = turning_points(model.scene, touch, 0.0, loads=[LOADS[1]])
        touched = model.scene.fabric, model.scene.load
        rate[touched] = model.scene.total_rate(touch, MODULI[None])[0] / model.scene.n_receptors
        turns = turn.outcome[0, 0] == CurveShape.INTERIOR and 1e4 < turn.modulus[0, 0] < 2e6
        if turns and (rate[:4, 1] > 0).sum() > 2:
            break
    of = values["gamma"] * np.log(rate + HELD["eps"])
    scale, noise = values["tau"] * rng.standard_normal((raters, 1, 1, 1)), rng.standard_normal((raters, *of.shape, 3))
    log_rating = np.log(20.0) + scale + (of - of[:4, 1].mean())[..., None] + values["varsigma"] * noise
    return np.exp(log_rating), np.log([*(values[name] for name in ABOUT[:3]), turn.modulus[0, 0]])


def model_of(ratings, conditions, stated=MODULI, cv=None):
    """Return the model of the ratings of some conditions, each rated once by every rater, or twice."""
    used = sorted({fabric for fabric, _ in conditions})
    loads = sorted({load for _, load in conditions})
    raters = range(len(ratings))
    rows = [(who, f, j, conditions[:k].count((f, j))) for k, (f, j) in enumerate(conditions) for who in raters]
    who, fabric, load, again = np.array(rows).T
    table = Ratings(
        tuple(f"rater {k}" for k in raters),
        tuple(NAMES[k] for k in used),
        tuple(LOADS[k] for k in loads),
        who,
        np.searchsorted(used, fabric),
        np.searchsorted(loads, load),
        ratings[who, fabric, load, again],
        np.arange(who.size) + 2,
    )
    cloth = Fabrics(table.fabrics, effective_modulus=stated[used])
    return build(Experiment(table, cloth, ()), ModelOptions(fix=HELD, modulus_cv=cv))


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
    return Outlook(model, theta, rated=True)


def effective(log_weight):
    """Return the effective number of draws."""
    return float(np.exp(2 * logsumexp(log_weight) - logsumexp(2 * log_weight)))


def quantities(outlook):
    """Return the draws of each quantity, of turning points NaN where a draw has none."""
    return [*(np.log(outlook.named[name]) for name in ABOUT[:3]), outlook.quantities({"turning": LOADS[1]})["turning"]]


def spreads(outlook):
    """Return the standard deviation of each quantity, of turning points over the draws that have one."""
    return np.array([np.nanstd(value) for value in quantities(outlook)])


def candidates_of(stated=MODULI, cv=0.0):
    """Return all fabrics under all loads."""
    return Candidates(Fabrics(NAMES, effective_modulus=stated), loads=tuple(map(str, LOADS)), modulus_cv=cv)


def designed(outlook, about, stated=MODULI, cv=0.0):
    """Return the conditions of a plan about a quantity."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "_outlooks", lambda *_: [outlook])
        plan = design(None, (about,), candidates_of(stated, cv), conditions=CONDITIONS)
    return [(NAMES.index(row.fabric), round(row.indentation_mm) - 1) for row in plan.table.itertuples()]


USUAL = [(k, 1) for k in np.linspace(4, 15, CONDITIONS).round().astype(int)]
"""Fabrics that are evenly spaced over the range of moduli, under the load of the first ratings."""


class Begun:
    """A laboratory after its first ratings, of some conditions by some raters."""

    def __init__(self, seed, begin=BEGIN, raters=RATERS, draws=4000):
        self.rng, self.begin, self.draws = np.random.default_rng(seed), begin, draws
        self.ratings, _ = laboratory(self.rng, raters)
        self.first = outlook_of(model_of(self.ratings, begin), self.rng, draws)
        self.panel = candidates_of().ratings([self.first], None)
        rows = self.panel.table.itertuples()
        self.column = {(NAMES.index(row.fabric), round(row.indentation_mm) - 1): row.Index for row in rows}
        self.quantities = dict(zip(ABOUT, quantities(self.first), strict=True))

    def random_sets(self, number):
        """Return sets of touches within the model's range, none more than twice."""
        every = [*self.column] * 2
        chosen = (self.rng.choice(len(every), CONDITIONS, replace=False) for _ in range(number))
        return [[every[k] for k in index] for index in chosen]

    def foretold(self, conditions, outcomes=256):
        """Return the expected ratio of sds after and before the ratings of some conditions, of each quantity."""
        index = np.array([self.column[one] for one in conditions])
        mean, errors = self.panel.mean[:, index], self.panel.covariance(index)
        found = nested_gain(np.random.default_rng(5), mean, errors, self.quantities, outcomes=outcomes)
        return np.array([found.sd_ratio[name] for name in ABOUT])

    def realised(self, conditions, ratings=None):
        """Return the ratio of sds after and before, once the conditions are rated."""
        model = model_of(self.ratings if ratings is None else ratings, self.begin + conditions)
        return spreads(outlook_of(model, self.rng, self.draws)) / spreads(self.first)

    def ratings_of_draw(self, s, conditions):
        """Return the ratings with those of some conditions replaced by simulated ones, for one draw as the truth."""
        mean, variance = (part[s] for part in self.first.levels[:2])
        raters = len(self.ratings)
        level = mean + np.sqrt(variance) * self.rng.standard_normal(raters)
        noise = np.broadcast_to(np.asarray(self.first.parameters.varsigma, float), len(self.first.theta))[s]
        simulated = self.ratings.copy()
        for k, (fabric, load) in enumerate(conditions):
            again = (self.begin + conditions[:k]).count((fabric, load))
            typical = self.panel.response[s, self.column[fabric, load]] + level
            simulated[:, fabric, load, again] = np.exp(typical + noise * self.rng.standard_normal(raters))
        return simulated


SHIPPED = [(fabric, load) for fabric in range(12) for load in range(3)]
"""Conditions of a table of the shipped size, by thirty raters."""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("truths", "settings"),
    [(25, (102,)), (25, (106,)), (25, (109,)), (8, (102, SHIPPED, 30, 1200))],
    ids=["102", "106", "109", "shipped size"],
)
def test_ratios_are_foretold(truths, settings):
    """Ratios of sds over ratings that are simulated from the posterior and fitted agree with those foretold.

    Over some truths, those of b, m and the turning point within a fifth; that of sigma_0 is foretold at least 0.9 of
    what it becomes. In single small laboratories they differ by up to a factor of two.
    """
    lab, errors = Begun(*settings), []
    for conditions in (*(designed(lab.first, name) for name in ABOUT), USUAL):
        drawn = lab.rng.choice(len(lab.first.theta), truths, replace=False)
        after = [lab.realised(conditions, lab.ratings_of_draw(s, conditions)) for s in drawn]
        realised = np.sqrt(np.nanmean(np.square(after), axis=0))
        errors.append(np.log(lab.foretold(conditions) / realised))
    b, m, sigma_0, turning = np.transpose(errors)
    assert np.abs(np.mean(errors)) < 0.1
    assert np.abs([b, m, turning]).max() < np.log(1.2)
    assert sigma_0.min() > np.log(0.9)


@pytest.mark.slow
def test_designs_teach_more_than_random_and_usual_sets():
    """In twelve laboratories, designs narrowed each quantity further than random sets and than usual ones.

    They are foretold to narrow it further than the best of twenty random sets. A set that is best in hindsight, once
    its ratings are known, owes that to their luck: nobody can choose it before.
    """
    log_ratios, foretold = [], []
    for seed in range(100, 112):
        lab = Begun(seed)
        designs = [designed(lab.first, name) for name in ABOUT]
        found = [np.log(lab.realised(one))[k] for k, one in enumerate(designs)]
        random = np.mean([np.log(lab.realised(one)) for one in lab.random_sets(6)], axis=0)
        log_ratios.append((found - random, found - np.log(lab.realised(USUAL))))
        best = np.min([lab.foretold(one, outcomes=64) for one in lab.random_sets(20)], axis=0)
        foretold.append(np.log([lab.foretold(one)[k] for k, one in enumerate(designs)] / best))
    assert (np.nanmean(log_ratios, axis=0) < -0.1).all()
    assert (np.mean(foretold, axis=0) < 0.0).all()


def sampled(ratings, conditions, stated, cv, seed):
    """Return an outlook of the posterior by the sampler: fabrics' true moduli are parameters too."""
    model = model_of(ratings, conditions, stated, cv)
    run = sample_until(model.posterior, Settings(ensembles=2, processes=1, max_steps=500), seed)
    theta = model.posterior.natural(independent(run, 2000, np.random.default_rng(seed)))
    return Outlook(model, theta, rated=True)


@pytest.mark.slow
def test_declared_errors_of_moduli_are_covered():
    """Moduli are 15 % off and declared so: 90 % intervals hold the truth after designs as after usual sets.

    It takes half an hour. The bar of a single share is what one in a hundred of such samples falls below.
    """
    covered, cv, labs = [], 0.15, 40
    for seed in range(200, 200 + labs):
        rng = np.random.default_rng(seed)
        ratings, truth = laboratory(rng)
        stated = MODULI * np.exp(log_sd(cv) * rng.standard_normal(MODULI.size))
        first = sampled(ratings, BEGIN, stated, cv, seed)
        for conditions in (*(designed(first, name, stated, cv) for name in ABOUT), USUAL):
            after = quantities(sampled(ratings, BEGIN + conditions, stated, cv, seed))
            low, high = np.nanquantile(after, [0.05, 0.95], axis=1)
            covered.append((low < truth) & (truth < high))
    each = np.reshape(covered, (labs, len(ABOUT) + 1, len(ABOUT))).astype(float)
    shares, further = each.mean(axis=0), each[:, :-1].mean(axis=(1, 2)) - each[:, -1].mean(axis=1)
    assert shares[:-1].mean() > 0.85
    assert further.mean() > -2.0 * further.std(ddof=1) / np.sqrt(labs)  # not below that of usual sets
    assert (labs * shares >= binom.ppf(0.01, labs, 0.9)).all(), shares
