"""Which model predicts best: exact answers, simulated data with a right one, and data that cannot tell."""

import dataclasses
import itertools

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.special import logsumexp
from scipy.stats import multivariate_normal, norm

from softness_bayes.base import arviz_bridge
from softness_bayes.base.defaults import LEFT_OUT
from softness_bayes.base.errors import InputError
from softness_bayes.base.laws import HalfNormal
from softness_bayes.data import Experiment, Fabrics
from softness_bayes.likelihood.contract import Parameters
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.error_laws import ERROR_LAWS
from softness_bayes.likelihood.magnitude import LogRatings
from softness_bayes.likelihood.scales import FALLS, STANDARDISED
from softness_bayes.likelihood.z_scores import StandardisedRatings
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.scenes import usual_values
from softness_bayes.model.simulation import simulate_compression, simulate_ratings
from softness_bayes.results.fitted import differences
from softness_bayes.runs.comparison import clustered_error, compare, stacking_weights
from softness_bayes.runs.left_out import LEAVE, Refits, leave_by_weights
from softness_bayes.runs.run import sample
from softness_bayes.sampler.diagnostics import Goal
from softness_bayes.sampler.sampling import Settings
from softness_bayes.touch.contact import Indentation
from softness_bayes.touch.readings import MENDED
from support import report_runs
from support.points import rated
from support.report_runs import COARSE

CLOTH = Fabrics(
    ("gauze", "lawn", "drill", "felt"),
    effective_modulus=np.array([3e4, 8e4, 2e5, 6e5]),
    poisson_ratio=np.array([0.2, 0.3, 0.25, 0.3]),
)
LOADS = (Indentation(2e-3),)
HELD = {"b": 100.0, "m": 2.0, "alpha": 21.5, "beta": 0.6, "sigma_0": 6.0, "tau": 0.5, "eps": 0.1}
HELD |= {"c_Na": 1.05, "c_K": 1.16, "c_L": 1.0, "c_A": 1.5}
BRIEF = Settings(ensembles=2, max_steps=60, processes=1, pilot=(20,), optima=1, goal=Goal(lengths=1.0))


@pytest.fixture(scope="module", autouse=True)
def quickly():
    with report_runs.quickly():
        yield


def test_the_command_line_has_every_unit():
    assert tuple(LEAVE) == LEFT_OUT


# smoothed importance weights


@pytest.mark.parametrize("shape", [0.2, 0.9])
def test_k_is_the_shape_of_the_tail(rng, shape):
    """Ratios of a Pareto law: also a control of the sign, which the lines of ArviZ take differently."""
    log_ratios = shape * rng.exponential(size=(20, 20_000))
    weights, k = arviz_bridge.psis(log_ratios)
    assert_allclose(np.exp(weights).sum(axis=1), 1.0)
    assert k.mean() == pytest.approx(shape, abs=0.1)
    # larger ratios weigh more
    assert all(np.corrcoef(w, r)[0, 1] > 0.5 for w, r in zip(weights, log_ratios, strict=True))


def test_importance_weights_give_the_exact_density_of_what_is_left_out(rng):
    """Normal data of an unknown mean: the exact predictive density of each value is known."""
    y = rng.standard_normal(12) + 0.5
    precision = 1 + y.size
    theta = y.sum() / precision + rng.standard_normal(20_000) / np.sqrt(precision)
    found = leave_by_weights(norm(theta[:, None], 1).logpdf(y))
    others = (y.sum() - y) / y.size
    assert_allclose(found.log_density, norm(others, np.sqrt(1 + 1 / y.size)).logpdf(y), atol=0.02)
    assert (found.pareto_k < 0.5).all()


# densities of whole groups


def lab(rng, rows=40):
    design = Design(rng.integers(6, size=rows), np.arange(rows) % 5, np.arange(6) % 3, 5)
    return design, rng.gamma(1, 10, (3, 6)), rng.standard_normal(rows)


@pytest.mark.parametrize("omega", [0.0, 0.4])
def test_blocks_of_log_ratings_by_the_dense_normal_law(rng, omega):
    design, rate, noise = lab(rng)
    observed, point = LogRatings(np.exp(3 + noise), design), rated(0.8, 0.5, 0.3, omega)
    fabric = design.fabric[design.condition]
    same, alike = (index[:, None] == index for index in (design.participant, fabric))
    covariance = 9.0 + 0.25 * same + omega**2 * alike + 0.09 * np.eye(noise.size)
    for block in (design.participant, fabric):
        found = observed.log_likelihood_blocks(rate, point, block)
        assert found.shape == (3, block.max() + 1)
        for d in range(3):
            x = np.log(rate[d] + 0.1)[design.condition]
            residual = 3 + noise - np.log(20) - 0.8 * (x - x.mean())
            for k in range(block.max() + 1):
                own, rest = block == k, block != k
                gain = covariance[np.ix_(own, rest)] @ np.linalg.inv(covariance[np.ix_(rest, rest)])
                law = multivariate_normal(
                    gain @ residual[rest], covariance[np.ix_(own, own)] - gain @ covariance[rest][:, own]
                )
                expected = law.logpdf(residual[own]) - (3 + noise[own]).sum()
                assert found[d, k] == pytest.approx(expected, rel=1e-8)


def test_a_block_of_one_rating_is_that_rating_left_out(rng):
    design, rate, noise = lab(rng, rows=15)
    each = np.arange(15)
    for observed, point in (
        (LogRatings(np.exp(noise), design), rated(0.8, 0.5, 0.3)),
        (StandardisedRatings(noise, design), Parameters(varsigma=0.7)),
    ):
        alone = observed.left_out(rate, point).log_density
        assert_allclose(observed.log_likelihood_blocks(rate, point, each), alone, rtol=1e-7, atol=1e-9)
        # one block of everything leaves nothing to condition on
        whole = observed.log_likelihood_blocks(rate, point, np.zeros(15, int))
        assert_allclose(whole[:, 0], observed.log_likelihood(rate, point))


# runs


def made(seed, participants=12, **options):
    values = usual_values(MENDED, given={**HELD, "gamma": 0.9, "varsigma": 0.3})
    return simulate_ratings(
        np.random.default_rng(seed), CLOTH, LOADS, values, participants=participants, **options
    ).ratings


@pytest.fixture(scope="module")
def experiment():
    return Experiment(dataclasses.replace(made(1), digest="d1"), CLOTH, ())


@pytest.fixture(scope="module")
def results(experiment):
    """The model that made the ratings, it with a skin hardly any stiffer, and the opposite direction."""
    options = {"fix": HELD, "max_steps": 120, "processes": 1, "discretisation": COARSE}
    return {
        "right": sample(experiment, **options),
        "as good": sample(experiment, **options | {"fix": HELD | {"b": 100.5}}),
        "upside down": sample(experiment, **options | {"direction": FALLS}),
    }


def test_what_sets_models_apart(results):
    assert differences(results) == {
        "right": "direction=rises-with-firing, b=100",
        "as good": "direction=rises-with-firing, b=100.5",
        "upside down": "direction=falls-with-firing, b=100",
    }


@pytest.mark.parametrize("leave", ["rating", "participant", "fabric"])
def test_the_generating_model_is_picked(results, leave):
    pair = {label: results[label] for label in ("upside down", "right")}
    found = compare(pair, LEAVE[leave], BRIEF)
    assert found.table.index.tolist() == ["right", "upside down"]
    best, worst = found.table.loc["right"], found.table.loc["upside down"]
    assert best["elpd_diff"] == 0
    assert worst["elpd_diff"] < -10
    assert best["units"] == {"rating": 48, "participant": 12, "fabric": 4}[leave]
    if leave == "fabric":  # four units say little of their own spread
        assert found.sentence.startswith(("right predicts best", "the data do not distinguish right from upside down"))
    else:
        assert worst["elpd_diff"] < -2 * worst["se_diff"]
        assert found.sentence.startswith("right predicts better than upside down")
    assert np.isnan(best["pareto_k_max"]) == (leave == "fabric")


@pytest.mark.parametrize("leave", ["rating", "participant"])
def test_data_that_cannot_tell(results, leave):
    pair = {label: results[label] for label in ("as good", "right")}
    found = compare(pair, LEAVE[leave])
    assert abs(found.table.iloc[1]["elpd_diff"]) < 1
    assert found.sentence.startswith("the data do not distinguish ")


def test_the_sum_over_ratings_is_that_of_their_densities_as_filed(results, experiment):
    """Brute force: the average over draws without each rating, at the draws that importance weights stand for."""
    result = results["right"]
    values = result.group("log_likelihood")["rating"].values[0]
    ratio = -values - logsumexp(-values, axis=0)
    plain = logsumexp(ratio + values, axis=0)  # unsmoothed importance sampling
    table = compare({"a": result, "b": results["as good"]}).table
    assert table.loc["a", "elpd"] == pytest.approx(plain.sum(), abs=0.5)
    assert table.loc["a", "se"] == pytest.approx(np.sqrt(48) * plain.std(ddof=1), rel=0.05)
    # of the ratings, not of their logarithms
    filed = np.log(experiment.ratings.rating).sum()
    assert abs(table.loc["a", "elpd"] + filed) < abs(table.loc["a", "elpd"] - 2)


@pytest.mark.parametrize("leave", ["fabric", "condition"])
def test_a_group_left_out_by_hand(results, experiment, leave):
    """p(y_k | y_-k) = p(y) / p(y_-k), both integrated on a grid over the two sampled parameters.

    Under one load fabrics are the conditions. Fabrics are fitted anew, conditions where no weight is trusted.
    """
    posterior = build(experiment, ModelOptions(fix=HELD, discretisation=COARSE)).posterior
    assert posterior.names == ("gamma", "varsigma")
    group = experiment.ratings.fabric if leave == "fabric" else experiment.ratings.conditions.of_rating
    axes = np.linspace(0.4, 1.6, 61), np.linspace(0.2, 0.5, 61)
    theta = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    prior, whole = posterior.log_prior(theta), posterior.log_likelihood(theta)
    found = LEAVE[leave].predict(results["right"], Refits(dataclasses.replace(BRIEF, max_steps=200)))
    for k in range(4):
        rest = posterior.with_term(posterior.observation.without(group == k))
        expected = logsumexp(prior + whole) - logsumexp(prior + rest.log_likelihood(theta))
        assert found.log_density[k] == pytest.approx(expected, abs=0.15)


def test_clustered_errors_by_brute_force(rng):
    """The variance of a sum of correlated values, each product of deviations counted within clusters alone."""
    values, cluster = rng.normal(0.3, 1.0, 40), np.arange(40) % 7
    deviation = values - values.mean()
    squared = sum(deviation[i] * deviation[j] for i in range(40) for j in range(40) if cluster[i] == cluster[j])
    assert clustered_error(values, cluster) == pytest.approx(np.sqrt(7 / 6 * squared))
    # every value its own cluster: independent units
    assert clustered_error(values, np.arange(40)) == pytest.approx(np.sqrt(40) * values.std(ddof=1))
    assert np.isnan(clustered_error(values, np.zeros(40, int)))


def test_stacking_weights_by_a_grid(rng):
    log_density = rng.normal(-1.0, 0.7, (60, 2)) + np.array([0.1, 0.0])
    grid = np.linspace(0.0, 1.0, 10_001)
    score = logsumexp(log_density[:, None, :] + np.log(np.stack([grid, 1 - grid], axis=-1) + 1e-300), axis=2).sum(
        axis=0
    )
    found = stacking_weights(log_density)
    assert found.sum() == pytest.approx(1.0)
    assert found[0] == pytest.approx(grid[score.argmax()], abs=2e-4)
    # a model that is worse everywhere gets nothing, and one given twice shares its weight
    worse = np.column_stack([log_density[:, 0], log_density[:, 0] - 3.0])
    assert_allclose(stacking_weights(worse), [1.0, 0.0], atol=1e-6)
    twice = stacking_weights(log_density[:, [0, 1, 1]])
    assert_allclose(twice, [found[0], found[1] / 2, found[1] / 2], atol=1e-4)


def test_the_largest_error_judges(results, experiment):
    found = compare({label: results[label] for label in ("upside down", "right")})
    worst = found.table.loc["upside down"]
    stored = [results[label].group("log_likelihood")["rating"].values[0] for label in ("upside down", "right")]
    one, other = (leave_by_weights(values).log_density for values in stored)
    for by, index in (("fabric", experiment.ratings.fabric), ("participant", experiment.ratings.participant)):
        assert worst[f"se_by_{by}"] == pytest.approx(clustered_error(one - other, index))
    errors = worst[["se_diff", "se_by_fabric", "se_by_condition", "se_by_participant"]]
    assert f"standard error {errors.max():.1f}" in found.sentence
    # under one load fabrics are the conditions
    assert worst["se_by_fabric"] == pytest.approx(worst["se_by_condition"])
    assert found.table["weight"].sum() == pytest.approx(1.0)
    assert found.table.loc["right", "weight"] > 0.95
    expected = sum(
        found.table.loc[label, "weight"] * results[label].inflection()["p_interior"] for label in found.table.index
    )
    assert_allclose(found.interior, expected)


def test_what_is_not_comparable_is_refused(results, experiment):
    right = results["right"]
    quick = {"fix": HELD, "max_steps": 2, "processes": 1, "discretisation": COARSE}
    with pytest.raises(InputError, match="expected at least two"):
        compare({"a": right})
    other = sample(experiment._replace(ratings=dataclasses.replace(made(2), digest="d2")), **quick)
    with pytest.raises(InputError, match=r"b: fitted to other data than a \(digest of ratings\)"):
        compare({"a": right, "b": other})
    # also where no file gave them a digest
    same = sample(experiment._replace(ratings=dataclasses.replace(made(2), digest="d1")), **quick)
    with pytest.raises(InputError, match=r"other data than a \(rating\)"):
        compare({"a": right, "b": same})
    scores = (np.log(experiment.ratings.rating) - 3) / 2
    scores = experiment._replace(ratings=dataclasses.replace(experiment.ratings, rating=scores))
    held = {name: value for name, value in HELD.items() if name not in ("tau", "eps")}
    fitted = sample(scores, **quick | {"fix": held, "scale": STANDARDISED})
    with pytest.raises(InputError, match="fits to standardised ratings cannot be ranked against fits to magnitude"):
        compare({"a": right, "b": fitted})
    fingers = simulate_compression(np.random.default_rng(1), usual_values(MENDED, n_fingers=3), fingers=3).compression
    with pytest.raises(InputError, match="b: a run without ratings"):
        compare({"a": right, "b": sample(fingers, max_steps=2, processes=1)})


WHOLE = {f"whole numbers, {law.name}": {"resolution": 1.0, "errors": law} for law in ERROR_LAWS.values()}
WHOLE |= {"deviating fabrics, whole numbers": {"priors": {"omega": HalfNormal(0.5)}, "resolution": 1.0}}
EXACT = {f"exact, {law.name}": {"resolution": 0.0, "errors": law} for law in ERROR_LAWS.values()}
EXACT |= {f"individual {name}": {"individual": (name,), "resolution": 0.0} for name in ("gamma", "varsigma")}
EXACT |= {"deviating fabrics": {"priors": {"omega": HalfNormal(0.5)}, "resolution": 0.0}}
FIXED = {name: value for name, value in HELD.items() if name != "tau"}


@pytest.fixture(scope="module")
def of_whole_numbers(experiment):
    """Fits of every observation model to one small table of whole numbers; they need not have converged."""
    ratings = made(1, participants=4)
    table = dataclasses.replace(ratings, rating=np.maximum(np.round(ratings.rating), 1.0))
    whole, brief = experiment._replace(ratings=table), {"max_steps": 2, "processes": 1, "discretisation": COARSE}
    return {name: sample(whole, fix=FIXED, **brief, **options) for name, options in (WHOLE | EXACT).items()}


@pytest.mark.parametrize("leave", ["rating", "participant"])
def test_models_of_the_same_events_are_compared_and_all_other_pairs_are_refused(of_whole_numbers, leave):
    """Probabilities of intervals with each other, densities with each other; a density is no probability.

    Those of one kind are compared at once, which compares each with the best.
    """
    for kind in (WHOLE, EXACT):
        table = compare({name: of_whole_numbers[name] for name in kind}, leave).table
        assert {*table.index} == {*kind}
        assert np.isfinite(table[["elpd", "elpd_diff"]].to_numpy()).all()
    for names in itertools.product(WHOLE, EXACT):
        with pytest.raises(InputError, match="whose probabilities are not densities: use --resolution 0 for both"):
            compare({name: of_whole_numbers[name] for name in names}, leave)
