"""Checks of residuals: p-values uniform under the model, by the definition, with power against what each looks for."""

import numpy as np
import pytest
from scipy.stats import chi2, kstest

from softness_bayes.base import arviz_bridge
from softness_bayes.checking.checks import (
    ALONG,
    CHECKS,
    CONDITIONS,
    DEVIATIONS,
    DRIFT,
    EXPONENTS,
    FABRICS,
    LEVEL,
    LOADS,
    NOISE,
    NOTICED,
    OMEGA,
    READINGS,
    SKINS,
    Residuals,
    check_drift,
    check_fabrics,
    check_noise,
    check_slope,
    check_spreads,
    likeness,
    loo_pit,
)
from softness_bayes.checking.provenance import Finding
from softness_bayes.checking.quantities import uniformity_p_value
from softness_bayes.checking.sentences import residual_sentence, residual_sentences
from softness_bayes.likelihood.aggregated import RaterSpreads, SpreadModel
from softness_bayes.likelihood.contract import NO_RESPONSE, Effects, Parameters
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.intervals import IntervalModel
from softness_bayes.likelihood.magnitude import LogRatings, RatingModel
from softness_bayes.likelihood.scales import RISES
from support.made_ratings import MODEL, PLAIN, RATE, design, ratings
from support.points import rated

DEVIATING = PLAIN.replace(omega=0.2)
NAMES = [f"{fabric} under {load} mm" for load in (1, 2) for fabric in "abcdef"]


def check_exponents(held, *how, **more):
    return check_slope(held, EXPONENTS, held.response, *how, **more)


def check_moduli(held, slope, *how):
    return check_slope(held, ALONG, slope, *how)


def check_fingers(held, slope, *how):
    return check_slope(held, SKINS, slope, *how)


def simulate(rng, truth, layout):
    """Ratings of new participants and new fabrics, as the model makes them."""
    effects = MODEL.draw_effects(rng, truth, (), layout.n_participants, layout.n_fabrics)
    return LogRatings(MODEL.draw_ratings(rng, layout, MODEL.drive(layout, RATE, truth), truth, effects), layout, MODEL)


def shifted(rng, layout, shift):
    """Ratings of the plain model, those of each condition moved by its shift in the log."""
    return LogRatings(simulate(rng, PLAIN, layout).values * np.exp(shift[layout.condition]), layout, MODEL)


def residuals(rng, observation, assumed, draws=1, rate=RATE):
    """Residuals of a data set at draws of the effects given the parameters that are assumed."""
    rate = np.broadcast_to(rate, (draws, rate.size))
    parameters = assumed.each(lambda value: np.full(draws, value))
    return Residuals(observation, rate, parameters, observation.draw_effects(rng, rate, parameters))


def check(rng, observation, assumed, draws=1):
    """Findings of the fabrics of a data set, by quantity."""
    return {one.quantity: one for one in check_fabrics(residuals(rng, observation, assumed, draws), NAMES)}


def off_uniform(values):
    return kstest(values, "uniform").pvalue


# fabrics and conditions


def p_values(rng, truth, assumed, sets=150):
    """P-values of many data sets, each at a single draw, which the theory makes uniform."""
    found = [check(rng, simulate(rng, truth, design()), assumed) for _ in range(sets)]
    return {name: np.array([one[name].p_value for one in found]) for name in (CONDITIONS, FABRICS, LOADS)}


@pytest.mark.parametrize("truth", [PLAIN, DEVIATING], ids=["plain", "with an effect per fabric"])
def test_p_is_uniform_under_the_model(rng, truth):
    assert all(off_uniform(values) > 1e-3 for values in p_values(rng, truth, truth).values())


@pytest.mark.parametrize(
    ("truth", "assumed"),
    [
        (DEVIATING, PLAIN),
        (PLAIN.replace(varsigma=0.6), PLAIN),  # noise understated
        (PLAIN.replace(varsigma=0.15), PLAIN),  # noise overstated
        (PLAIN, PLAIN.replace(gamma=1.4)),
    ],
    ids=["fabrics deviate", "noise too small", "noise too large", "another exponent"],
)
def test_p_is_not_uniform_under_another_model(rng, truth, assumed):
    found = p_values(rng, truth, assumed)
    assert off_uniform(found[FABRICS]) < 1e-6
    assert off_uniform(found[CONDITIONS]) < 1e-6


def test_p_is_what_the_definition_says(rng):
    """Written out row by row, for an unbalanced design in which a fabric has no rating."""
    rows, fabric, draws = 40, np.array([0, 1, 3, 3]), 5
    layout = Design(rng.integers(4, size=rows), rng.integers(3, size=rows), fabric, 3)
    values, rate = rng.lognormal(3, 1, rows), rng.gamma(2, 1, (draws, 4))
    parameters = rated(*rng.uniform(0.5, 1.5, (5, draws)))
    effects = Effects(
        mu=rng.normal(3, 1, draws), participant=rng.normal(size=(draws, 3)), fabric=rng.normal(size=(draws, 4))
    )
    slope = rng.normal(size=(draws, 4))
    expected = {name: [] for name in (FABRICS, CONDITIONS, LOADS, ALONG, EXPONENTS, SKINS)}
    excess, errors, mean = [], [], np.zeros((draws, 4))
    for d in range(draws):
        gamma, varsigma, eps = (float(getattr(parameters, n)[d]) for n in ("gamma", "varsigma", "eps"))
        x = np.log(rate[d] + eps)
        centre = np.mean([x[c] for c in layout.condition])
        r = np.array(
            [
                np.log(values[i]) - effects.mu[d] - gamma * (x[c] - centre) - effects.participant[d, p]
                - effects.fabric[d, fabric[c]]
                for i, (c, p) in enumerate(zip(layout.condition, layout.participant, strict=True))
            ]
        )  # fmt: skip

        def squares(group, along, centred=False, r=r):
            """Sum over groups of the squared projections of the residuals, and the number of groups."""
            found = []
            for g in np.unique(group):
                here = group == g
                a = along[layout.condition[here]]
                a = a - a.mean() if centred else a
                found.append((a @ r[here]) ** 2 / (a @ a))
            return sum(found), len(found)

        of_row, ones = fabric[layout.condition], np.ones(4)
        every, between = squares(layout.condition, ones), squares(of_row, ones)
        tests = {
            CONDITIONS: every,
            FABRICS: between,
            LOADS: (every[0] - between[0], 1),
            ALONG: squares(of_row, slope[d]),
            SKINS: squares(layout.participant, slope[d], centred=True),
            EXPONENTS: squares(layout.participant, x, centred=True),
        }
        for name, (value, freedom) in tests.items():
            expected[name].append(chi2.sf(value / varsigma**2, freedom))
        excess.append((between[0] / 3 - varsigma**2) / (rows / 3))
        mean[d] = [r[layout.condition == c].mean() for c in range(4)]
        errors.append(np.sqrt(np.bincount(layout.condition)) * mean[d] / varsigma)
    held = Residuals(LogRatings(values, layout, MODEL), rate, parameters, effects)
    every = [*check_fabrics(held, "abcd"), check_moduli(held, slope), check_fingers(held, slope), check_exponents(held)]
    found = {one.quantity: one for one in every}
    for name, values in expected.items():
        assert found[name].p_value == pytest.approx(np.mean(values), rel=1e-8), name
    assert found[FABRICS].estimate == pytest.approx(np.sqrt(max(np.median(excess), 0)), rel=1e-9)
    worst = int(np.abs(np.mean(errors, axis=0)).argmax())
    assert found[CONDITIONS].worst == "abcd"[worst]
    assert found[CONDITIONS].worst_estimate == pytest.approx(mean[:, worst].mean(), rel=1e-9)
    assert found[CONDITIONS].worst_errors == pytest.approx(np.mean(errors, axis=0)[worst], rel=1e-9)


def test_deviations_that_cancel_over_loads_are_found_and_named(rng):
    layout, shift = design(30), 0.15 * np.tile([1.0, -1.0], 6)
    shift[6:] *= -1
    shift[9] -= 0.6
    found = check(rng, shifted(rng, layout, shift), PLAIN, 100)
    conditions = found[CONDITIONS]
    assert conditions.p_value < 1e-6
    assert conditions.estimate == pytest.approx(shift.std(), rel=0.25)
    assert (conditions.worst, conditions.worst_estimate) == (NAMES[9], pytest.approx(shift[9], abs=0.15))
    (said,) = residual_sentences(found, [CONDITIONS])
    assert "most of all d under 2 mm" in said
    assert "below it" in said
    assert "try other readings" in said
    assert "omega" not in said
    # between fabrics alone they cancel but for the one that was moved further
    shift[9] += 0.6
    found = [check(rng, shifted(rng, layout, shift), PLAIN, 100) for _ in range(20)]
    assert np.mean([one[FABRICS].p_value < LEVEL for one in found]) < 0.3
    assert np.mean([one[CONDITIONS].p_value < LEVEL for one in found]) == 1


def test_what_is_said_to_be_noticed_is_noticed(rng):
    layout = design()
    size = check(rng, simulate(rng, PLAIN, layout), PLAIN)[CONDITIONS].noticed

    def share(factor):
        shifts = factor * size * rng.standard_normal((100, 12))
        found = [check(rng, shifted(rng, layout, s), PLAIN, 20)[CONDITIONS].p_value for s in shifts]
        return np.mean(np.array(found) < LEVEL / CHECKS)

    assert share(1.0) == pytest.approx(NOTICED, abs=0.12)
    assert share(0.3) < 0.3  # negative control: smaller ones are not


@pytest.mark.parametrize("seed", range(4))
def test_another_reading_is_the_remedy_only_of_deviations_that_similar_fabrics_share(seed):
    """A bend along the modulus against an effect of each fabric of the same size, with as many conditions."""
    rng = np.random.default_rng(seed)
    layout = Design(np.tile(np.arange(20), 15), np.repeat(np.arange(15), 20), np.tile(np.arange(10), 2), 15)
    modulus, rate = np.tile(np.geomspace(3e3, 2e6, 10), 2), np.tile(np.geomspace(9.0, 1.0, 10), 2)
    x = np.linspace(-1.0, 1.0, 10)
    bend = np.concatenate([x**2 - (x**2).mean(), x**3 - 0.6 * x])  # another one under each load
    alone = np.tile(rng.permutation(np.repeat([1.0, -1.0], 5)), 2)
    for shift, remedy in ((bend, READINGS), (alone, OMEGA)):
        shift = 0.3 * shift / shift.std()
        effects = MODEL.draw_effects(rng, PLAIN, (), 15, 10)
        made = MODEL.draw_ratings(rng, layout, MODEL.drive(layout, rate, PLAIN), PLAIN, effects)
        observation = LogRatings(made * np.exp(shift[layout.condition]), layout, MODEL)
        held = residuals(rng, observation, PLAIN, 100, rate)
        found, *_ = check_fabrics(held, ["any"] * 20, likeness(modulus, np.repeat([0, 1], 10)))
        assert found.p_value < 1e-4
        assert found.advice == (remedy,)


# exponents and noise of raters

RATERS, TOUCHES = 15, 16
WHO = Design(
    np.tile(np.arange(TOUCHES), RATERS), np.repeat(np.arange(RATERS), TOUCHES), np.arange(TOUCHES) // 2, RATERS
)


def shares(tau_gamma, tau_varsigma, differ=(), tables=60):
    """Shares of tables in which differing noise, and differing exponents, are found."""
    found = []
    for seed in range(tables):
        rng = np.random.default_rng(seed)
        p = rated(*(np.full(1, v) for v in (1.0, 0.5, 0.3, 0.0, 0.1)), tau_gamma=tau_gamma, tau_varsigma=tau_varsigma)
        rate = np.exp(rng.normal(1.0, 0.8, (1, TOUCHES)))
        truth = IntervalModel(RISES, differ=("gamma", "varsigma"))
        effects = truth.draw_effects(rng, p, (1,), RATERS, WHO.n_fabrics)
        y = truth.draw_ratings(rng, WHO, truth.drive(WHO, rate, p), p, effects)[0]
        fitted = IntervalModel(RISES, differ=differ).observe(y, WHO) if differ else LogRatings(y, WHO, RatingModel())
        held = Residuals(fitted, rate, p, fitted.draw_effects(rng, rate, p))
        found.append([one(held).p_value < LEVEL for one in (check_noise, check_exponents)])
    return np.mean(found, axis=0)


def test_each_check_sees_its_own_kind():
    """Power at a spread of 0.4, and alarms where raters are alike: 5 % with parameters known."""
    noise, exponents = shares(0.0, 0.4)
    assert noise > 0.9
    assert noise - exponents > 0.3  # noise of one's own makes steep slopes by chance, which the other check may see
    assert shares(0.3, 0.0)[1] > 0.9
    assert (shares(0.0, 0.0) <= 0.15).all()


def test_a_model_of_it_silences_the_check():
    assert (shares(0.3, 0.4, ("gamma", "varsigma"), 40) <= 0.15).all()


@pytest.mark.slow
def test_power_over_many_tables():
    """400 tables: 5 % of alarms with raters alike; half of the tables show a spread of about 0.2."""
    assert (np.abs(shares(0.0, 0.0, tables=400) - 0.05) < 0.035).all()
    assert 0.4 < shares(0.0, 0.2, tables=400)[0] < 0.95
    assert shares(0.0, 0.4, tables=400)[0] > 0.97


def test_exponents_that_differ_are_measured(rng):
    def found(draws=1, **made):
        return check_exponents(
            residuals(rng, LogRatings(ratings(rng, design(30), **made), design(30), MODEL), PLAIN, draws)
        )

    real = found(300, own=0.3)
    assert real.p_value < 1e-3
    assert real.estimate == pytest.approx(0.3 * PLAIN.gamma, rel=0.4)


def test_what_cannot_be_compared_is_not(rng):
    """A silent response has no slopes, and raters of few ratings no scatter."""
    held = residuals(rng, LogRatings(ratings(rng, design()), design(), MODEL), PLAIN, 3, np.zeros(12))
    few = Design([0, 1, 2, 0], [0, 0, 0, 1], [0, 1, 2], 2)
    noise = check_noise(residuals(rng, LogRatings([1.0, 2.0, 3.0, 4.0], few, RatingModel()), PLAIN, 1, np.ones(3)))
    found = [check_exponents(held), noise, check_fingers(held, np.zeros((3, 12)))]
    assert all(np.isnan(one.p_value) for one in found)
    said = residual_sentences({one.quantity: one for one in found}, ())
    assert [words.partition(":")[0] for words in said] == ["participants", "noise", "fingers"]
    assert "cannot be compared" in said[0]
    assert "fewer than two" in said[1]
    assert "fewer than two raters" in said[2]
    assert "do not show" in residual_sentence(check_moduli(held, np.zeros((3, 12))), ())
    once = np.zeros(held.observation.design.n_rows)
    assert np.isnan(check_drift(held, once).p_value)


def in_order(rng, drift, blocks=False):
    """Residuals of ratings that drift over the trials of a rater, and the order of these."""
    who = design(15)
    order = np.argsort(rng.random((15, 12)), axis=1).ravel() / 11.0
    if blocks:  # each condition has its own place, the same for all
        order = np.tile(np.arange(12) / 11.0, 15)
    made = LogRatings(simulate(rng, PLAIN, who).values * np.exp(drift * order), who, MODEL)
    return residuals(rng, made, PLAIN, 40), order


def test_drift_is_found_with_the_power_that_is_stated_and_no_drift_is_not(rng):
    seen = check_drift(*in_order(rng, 0.0)).noticed
    assert seen == pytest.approx(0.27, abs=0.1)
    found = {size: [check_drift(*in_order(rng, size * seen)) for _ in range(60)] for size in (0.0, 1.0)}
    share = {size: np.mean([one.p_value < LEVEL / CHECKS for one in some]) for size, some in found.items()}
    assert share[1.0] == pytest.approx(NOTICED, abs=0.17)  # the effects of raters take a little up
    assert share[0.0] < 0.05
    assert np.mean([one.p_value < LEVEL for one in found[0.0]]) < 0.13
    assert np.mean([one.estimate for one in found[1.0]]) == pytest.approx(seen, rel=0.2)


def test_drift_that_conditions_determine_is_not_judged(rng):
    """Loads or fabrics that always came late cannot be told from a drift."""
    assert np.isnan(check_drift(*in_order(rng, 1.0, blocks=True)).p_value)


# standard deviations of cells

CELLS, PANEL, DRAWS = 20, 12, 40


def spreads(rng, noise=0.3, raters=PANEL):
    """Standard deviations of the log ratings of one panel in every cell, from the ratings themselves."""
    log = 0.5 * rng.standard_normal((raters, 1)) + noise * rng.standard_normal((raters, CELLS))
    return log.std(axis=0, ddof=1)


def spread_finding(rng, values):
    term = RaterSpreads(values, Design(np.arange(CELLS), np.zeros(CELLS, int), np.arange(CELLS), 1), SpreadModel(PANEL))
    drawn = Parameters(tau=np.full(DRAWS, 0.5), varsigma=np.full(DRAWS, 0.3))
    return check_spreads(term, np.broadcast_to(NO_RESPONSE, (DRAWS, 0)), drawn, rng)


def test_spreads_are_uniform_under_the_model():
    """At the true parameters, the panel's scatter being drawn given its deviations."""
    rng = np.random.default_rng(3)
    assert off_uniform([spread_finding(rng, spreads(rng)).p_value for _ in range(120)]) > 0.01


@pytest.mark.parametrize("kind", ["noise grows from cell to cell", "half of the cells have fewer raters"])
def test_cells_that_differ_are_noticed(kind):
    rng = np.random.default_rng(4)
    few = np.arange(CELLS) % 2 == 0

    def made():
        if kind.startswith("noise"):
            return spreads(rng, np.geomspace(0.1, 0.9, CELLS))
        return np.where(few, spreads(rng, raters=3), spreads(rng))

    found = [spread_finding(rng, made()) for _ in range(20)]
    assert np.mean([one.p_value < 0.01 for one in found]) > 0.9
    assert np.mean([one.estimate for one in found]) > 1.3


# sentences

PRIOR = ("--prior omega='halfnormal(0.5)'",)
BOTH = ("--individual varsigma", "--errors lapses or student")
SAID = {
    "no evidence that their exponents differ (p = 0.5)": Finding(EXPONENTS, 0.5),
    "differ by about 0.3 (standard deviation) (p = 0.001)": Finding(EXPONENTS, 0.001, 0.3),
    "one exponent for all: add --individual gamma": Finding(EXPONENTS, 0.001, 0.3, advice=("--individual gamma",)),
    "no evidence that raters' noise differs (p = 0.5)": Finding(NOISE, 0.5),
    "by about 0.42 (sd of its log": Finding(NOISE, 0.001, 0.42),
    "look the same: add --individual varsigma or --errors lapses or student": Finding(NOISE, 0.001, 0.42, advice=BOTH),
    "raters' skin differs (p = 0.5)": Finding(SKINS, 0.5),
    "one skin for all: add --individual b": Finding(SKINS, 0.001, advice=("--individual b",)),
    "differ no more than they should (p = 0.4)": Finding(DEVIATIONS, 0.4, 1.0),
    "scatter 1.6 times as much": Finding(DEVIATIONS, 0.001, 1.6),
    "do not drift with the order of trials (p = 0.5); 0.2 (sd in the log rating) would be detected": Finding(
        DRIFT, 0.5, 0.1, 0.2, unit="log rating"
    ),
    "ratings drift by -0.31 over the trials of a rater (p = 0.001)": Finding(DRIFT, 0.001, -0.31),
    "late: add --drift": Finding(DRIFT, 0.001, -0.31, advice=("--drift",)),
    "show no errors of the moduli (p = 0.4). This check has little power": Finding(ALONG, 0.4),
    "no errors of the moduli more than the model allows": Finding(ALONG, 0.4, modelled=True),
    "errors of your measurement: add --modulus-cv 0.15": Finding(ALONG, 0.001, advice=("--modulus-cv 0.15",)),
    "larger than stated": Finding(ALONG, 0.001, modelled=True),
    **{
        f"more than the model allows (p = {p})": Finding(name, p, 0.3, modelled=True)
        for name, p in ((EXPONENTS, 0.5), (EXPONENTS, 0.001), (NOISE, 0.02), (SKINS, 0.03))
    },
}


@pytest.mark.parametrize("said", SAID)
def test_a_sentence_follows_from_the_values(said):
    one = SAID[said]
    sentence = residual_sentence(one, [one.quantity] * (one.p_value < LEVEL))
    assert said in sentence
    assert ("--" in sentence) == bool(one.advice) or one.modelled


@pytest.mark.parametrize(("loads", "said"), [(0.4, "narrow: add --prior omega="), (np.nan, "one load per fabric")])
def test_the_remedy_for_fabrics_depends_on_their_loads(loads, said):
    alike = Finding(CONDITIONS, 0.93, 0.0, noticed=0.07, groups=12, unit="log rating")
    for fabrics in (Finding(FABRICS, 0.001, 0.21, advice=PRIOR), Finding(FABRICS, 0.4, 0.0, advice=PRIOR)):
        found = {one.quantity: one for one in (alike, fabrics, Finding(LOADS, loads))}
        (sentence,) = residual_sentences(found, [FABRICS] * (fabrics.p_value < LEVEL))
        fine = "p = 0.93, 12 means; power: deviations of about 0.07 (sd)" in sentence
        assert fine != (said in sentence and "alike under every load, by about 0.21" in sentence)
        assert fine == (fabrics.p_value == 0.4)


# ranks of left-out ratings


def test_loo_pit_is_uniform_under_the_model_only(rng):
    who, points = design(25), np.arange(1, 50) / 50

    def pit(**made):
        observation = LogRatings(ratings(rng, who, **made), who, MODEL)
        draws = type(PLAIN)(*(np.full(100, value) for value in PLAIN))
        return loo_pit(observation.left_out(np.broadcast_to(RATE, (100, 12)), draws), observation.discrete)

    # ratings left out in turn balance each other: the test for independent values errs towards silence
    right = [uniformity_p_value(pit().value, points) for _ in range(30)]
    assert np.mean(np.array(right) < 0.05) <= 0.05
    assert off_uniform([pit().value[0] for _ in range(150)]) > 1e-3  # each of them is exactly uniform
    assert uniformity_p_value(pit(truth=PLAIN.replace(varsigma=0.5)).value, points) < 1e-3
    assert uniformity_p_value(pit(truth=PLAIN.replace(varsigma=0.15)).value, points) < 1e-3


def test_loo_weights_leave_the_rating_out(rng):
    """One unknown, y_i ~ N(theta, 1): weighted draws must follow the posterior of the other ratings."""
    y = np.array([0.0, 0.5, 2.5])
    draws = rng.normal(y.mean(), 3**-0.5, 40_000)
    log_weights, pareto_k = arviz_bridge.psis(0.5 * (y[:, None] - draws) ** 2)
    np.testing.assert_allclose(np.exp(log_weights).sum(axis=1), 1)
    others = [np.delete(y, i).mean() for i in range(3)]
    np.testing.assert_allclose(np.exp(log_weights) @ draws, others, atol=0.05)
    assert pareto_k.shape == (3,)
    # negative control: without weights the rating itself pulls
    assert abs(draws.mean() - others[2]) > 0.5
