"""The check for deviations between fabrics: uniform under its model, and not under any other."""

import itertools

import numpy as np
import pytest
from scipy.stats import chi2, kstest

from softness_bayes.checking.checks import NEEDED, NOTICED, FabricCheck, check_fabrics
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.magnitude import LogRatings, RatingParameters
from softness_bayes.likelihood.random_effects import Effects
from softness_bayes.touch.contact import Indentation
from softness_bayes.touch.readings import CLASSICAL, MENDED
from softness_bayes.touch.scene import Scene
from support.made_ratings import MODEL, PLAIN, RATE, design

DEVIATING = PLAIN._replace(omega=0.2)


def simulate(rng, truth, layout):
    """Ratings of new participants and new fabrics, as the model makes them."""
    effects = MODEL.draw_effects(rng, truth, (), layout.n_participants, layout.n_fabrics)
    return LogRatings(MODEL.draw_ratings(rng, layout, MODEL.drive(layout, RATE, truth), truth, effects), layout, MODEL)


def check(rng, observation, assumed, draws=1):
    """Check a data set at draws of the effects given the parameters that are assumed."""
    rate = np.broadcast_to(RATE, (draws, RATE.size))
    parameters = RatingParameters(*(np.full(draws, value) for value in assumed))
    return check_fabrics(observation, rate, parameters, observation.draw_effects(rng, rate, parameters))


def p_values(rng, truth, assumed, sets=150, of="p_value"):
    """One p-value for each of many data sets; of a single draw each, which the theory makes uniform."""
    layout = design()
    return np.array([getattr(check(rng, simulate(rng, truth, layout), assumed), of) for _ in range(sets)])


def off_uniform(values):
    return kstest(values, "uniform").pvalue


P_VALUES = ("p_value", "condition_p_value", "within_p_value")


@pytest.mark.parametrize("of", P_VALUES)
@pytest.mark.parametrize("truth", [PLAIN, DEVIATING], ids=["plain", "with an effect per fabric"])
def test_p_is_uniform_under_the_model(rng, truth, of):
    assert off_uniform(p_values(rng, truth, truth, of=of)) > 1e-3


@pytest.mark.parametrize(
    ("truth", "assumed"),
    [
        (DEVIATING, PLAIN),
        (PLAIN._replace(varsigma=0.6), PLAIN),  # noise understated
        (PLAIN._replace(varsigma=0.15), PLAIN),  # noise overstated
        (PLAIN, PLAIN._replace(gamma=1.4)),
    ],
    ids=["fabrics deviate", "noise too small", "noise too large", "another exponent"],
)
def test_p_is_not_uniform_under_another_model(rng, truth, assumed):
    for of in ("p_value", "condition_p_value"):
        assert off_uniform(p_values(rng, truth, assumed, of=of)) < 1e-6


def test_real_deviations_are_found_and_measured(rng):
    layout, shifts = design(30), 0.2 * np.array([1, -1, 1, -1, 1, -1])
    quiet = simulate(rng, PLAIN, layout)
    loud = LogRatings(quiet.values * np.exp(shifts[layout.fabric[layout.condition]]), layout, MODEL)
    assert check(rng, quiet, PLAIN, 400).p_value > NEEDED
    assert check(rng, quiet, PLAIN, 400).deviation < 0.06
    found = check(rng, loud, PLAIN, 400)
    assert found.p_value < 1e-4
    assert found.deviation == pytest.approx(0.2, abs=0.05)
    # with the effects in the model nothing is left to explain
    left = check(rng, loud, DEVIATING, 400)
    assert left.p_value > NEEDED
    assert left.deviation < 0.06


def test_p_is_what_the_definition_says(rng):
    """Written out row by row, for an unbalanced design in which a fabric has no rating."""
    rows, fabric = 40, np.array([0, 1, 3, 3])
    layout = Design(rng.integers(4, size=rows), rng.integers(3, size=rows), fabric, 3)
    ratings = rng.lognormal(3, 1, rows)
    rate, draws = rng.gamma(2, 1, (5, 4)), 5
    parameters = RatingParameters(*rng.uniform(0.5, 1.5, (5, draws)))
    effects = Effects(rng.normal(3, 1, draws), rng.normal(size=(draws, 3)), rng.normal(size=(draws, 4)))
    expected, excess, conditions, within, errors, mean = [], [], [], [], [], np.zeros((draws, 4))
    for d in range(draws):
        gamma, varsigma, eps = (float(getattr(parameters, n)[d]) for n in ("gamma", "varsigma", "eps"))
        x = np.log(rate[d] + eps)
        centre = np.mean([x[c] for c in layout.condition])
        residual: dict = {}
        for i in range(rows):
            c, p = layout.condition[i], layout.participant[i]
            known = effects.mu[d] + gamma * (x[c] - centre) + effects.participant[d, p]
            residual.setdefault((fabric[c], c), []).append(np.log(ratings[i]) - known - effects.fabric[d, fabric[c]])
        every = sum(len(r) * np.mean(r) ** 2 for r in residual.values())
        conditions.append(chi2.sf(every / varsigma**2, 4))
        mean[d] = [np.mean(residual[fabric[c], c]) for c in range(4)]
        errors.append([np.sqrt(len(residual[fabric[c], c])) * mean[d, c] / varsigma for c in range(4)])
        residual = {f: [x for (of, _), r in residual.items() for x in r if of == f] for f in (0, 1, 3)}
        between = sum(len(r) * np.mean(r) ** 2 for r in residual.values())
        expected.append(chi2.sf(between / varsigma**2, len(residual)))
        within.append(chi2.sf((every - between) / varsigma**2, 1))
        excess.append((between / len(residual) - varsigma**2) / (rows / len(residual)))
    found = check_fabrics(LogRatings(ratings, layout, MODEL), rate, parameters, effects)
    assert found.p_value == pytest.approx(np.mean(expected), rel=1e-9)
    assert found.deviation == pytest.approx(np.sqrt(max(np.median(excess), 0)), rel=1e-9)
    assert found.condition_p_value == pytest.approx(np.mean(conditions), rel=1e-9)
    assert found.within_p_value == pytest.approx(np.mean(within), rel=1e-9)
    assert found.worst == np.abs(np.mean(errors, axis=0)).argmax()
    assert found.worst_residual == pytest.approx(mean[:, found.worst].mean(), rel=1e-9)
    assert found.worst_errors == pytest.approx(np.mean(errors, axis=0)[found.worst], rel=1e-9)


# deviations of a fabric that differ between loads

NAMES = [f"{fabric} under {load} mm" for load in (1, 2) for fabric in "abcdef"]


def shifted(rng, layout, shift):
    """Ratings of the plain model, those of each condition moved by its shift in the log."""
    return LogRatings(simulate(rng, PLAIN, layout).values * np.exp(shift[layout.condition]), layout, MODEL)


def test_deviations_that_cancel_over_loads_are_found_and_named(rng):
    layout, shift = design(30), 0.15 * np.tile([1.0, -1.0], 6)
    shift[6:] *= -1
    shift[9] -= 0.6
    found = check(rng, shifted(rng, layout, shift), PLAIN, 100)
    assert found.condition_p_value < 1e-6
    assert found.condition_deviation == pytest.approx(shift.std(), rel=0.25)
    assert (found.worst, found.worst_residual) == (9, pytest.approx(shift[9], abs=0.15))
    sentence = found.sentence(NAMES)
    assert "most of all d under 2 mm" in sentence
    assert "below it" in sentence
    assert "try other readings" in sentence
    assert "omega" not in sentence
    # between fabrics alone they cancel but for the one that was moved further
    shift[9] += 0.6
    found = [check(rng, shifted(rng, layout, shift), PLAIN, 100) for _ in range(20)]
    assert np.mean([one.p_value < NEEDED for one in found]) < 0.3
    assert np.mean([one.condition_p_value < NEEDED for one in found]) == 1


def test_false_alarms_are_rare(rng):
    """The mean of p over draws errs towards silence; either of the two checks may raise an alarm."""
    layout = design()
    said = [check(rng, simulate(rng, PLAIN, layout), PLAIN, 40).sentence(NAMES) for _ in range(120)]
    assert np.mean(["no mean rating deviates" not in sentence for sentence in said]) <= 0.1


def test_what_is_said_to_be_noticed_is_noticed(rng):
    layout = design()
    size = check(rng, simulate(rng, PLAIN, layout), PLAIN).noticed

    def share(factor):
        shifts = factor * size * rng.standard_normal((100, 12))
        return np.mean([check(rng, shifted(rng, layout, s), PLAIN, 20).condition_p_value < NEEDED for s in shifts])

    assert share(1.0) == pytest.approx(NOTICED, abs=0.12)
    assert share(0.3) < 0.3  # negative control: smaller ones are not


def test_a_wrong_reading_of_the_pressure_is_found_by_its_conditions(rng, smooth_firing, paper):
    """Ratings under a pressure that turns over, fitted with one that cannot, and the other way round."""
    modulus, loads = np.geomspace(3e3, 2e6, 10), (Indentation(1e-3), Indentation(2e-3), Indentation(3e-3))
    scenes = {kind: Scene(modulus, 0.3, loads, smooth_firing(), readings=kind) for kind in (MENDED, CLASSICAL)}
    conditions = 30
    layout = Design(
        np.tile(np.arange(conditions), 20), np.repeat(np.arange(20), conditions), np.tile(np.arange(10), 3), 20
    )
    touched = paper()
    some = type(touched)(*(np.asarray(v) * np.exp(0.4 * rng.standard_normal(400)) for v in touched[:5]), *touched[5:])
    for made, fitted in itertools.product(scenes, scenes):
        rate = scenes[made].total_rate(touched) / scenes[made].n_receptors
        effects = MODEL.draw_effects(rng, PLAIN, (), 20, 10)
        drive = MODEL.drive(layout, rate, PLAIN)
        observation = LogRatings(MODEL.draw_ratings(rng, layout, drive, PLAIN, effects), layout, MODEL)
        rates = scenes[fitted].total_rate(some) / scenes[fitted].n_receptors
        best = rates[observation.log_likelihood(rates, PLAIN).argmax()] if made is not fitted else rate
        draws = np.broadcast_to(best, (100, conditions))
        parameters = RatingParameters(*(np.full(100, value) for value in PLAIN))
        found = check_fabrics(observation, draws, parameters, observation.draw_effects(rng, draws, parameters))
        assert (found.condition_p_value < 1e-4) == (made is not fitted), (made, fitted)


def test_the_sentence_says_what_to_do():
    needed = FabricCheck(0.001, 0.21, within_p_value=0.4)
    assert "alike under every load, by about 0.21" in needed.sentence(NAMES)
    assert "--prior omega='halfnormal(0.5)'" in needed.sentence(NAMES)
    assert "one load per fabric" not in needed.sentence(NAMES)
    assert "one load per fabric" in FabricCheck(0.001, 0.21).sentence(NAMES)
    assert "z-scores have none" in FabricCheck(0.001, 0.21, unit="z-score", remedy=False).sentence(NAMES)
    fine = FabricCheck(0.4, 0.0, 0.93, 0.0, 0.9, 0.07).sentence(NAMES)
    assert "--prior" not in fine
    assert "p = 0.93, 12 means; power: deviations of about 0.07 (sd)" in fine
