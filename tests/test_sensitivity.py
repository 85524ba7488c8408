"""What the data taught, on a conjugate normal model whose every answer is known."""

import numpy as np
import pandas as pd
import pytest
from scipy import integrate
from scipy.stats import halfnorm, lognorm, norm, truncnorm, uniform

from softness_bayes import arviz_bridge
from softness_bayes.inference.priors import HalfNormal, LogNormal, Normal, Uniform
from softness_bayes.inference.sensitivity import (
    POWERS,
    PRIOR_DRIVEN,
    SENSITIVE,
    contraction,
    distance,
    find_directions,
    in_words,
    power_scaling,
    prior_moments,
)
from softness_bayes.learning import direction_table, learning_sentences, learning_table

DRAWS = 40_000


@pytest.mark.parametrize(
    ("prior", "oracle"),
    [
        (Normal(3.0, 2.0), norm(3, 2)),
        (HalfNormal(0.5), halfnorm(scale=0.5)),
        (Uniform(1.0, 4.0), uniform(1, 3)),
        (LogNormal(100.0, 0.5), lognorm(0.5, scale=100)),
        (LogNormal(0.1, 1.0), lognorm(1.0, scale=0.1)),
    ],
    ids=["normal", "half-normal", "uniform", "log-normal", "wide log-normal"],
)
def test_moments_of_priors(prior, oracle):
    assert prior_moments(prior) == pytest.approx((oracle.mean(), oracle.std()), rel=2e-3)


def test_moments_of_logarithms():
    assert prior_moments(LogNormal(20.3, 0.1), np.log) == pytest.approx((np.log(20.3), 0.1), rel=1e-6)
    low, high = np.log([0.9, 1.1]) / 0.03
    cut = truncnorm(low, high, loc=np.log(1.16), scale=0.03)
    assert prior_moments(LogNormal(1.16, 0.03, 0.1), np.log) == pytest.approx((cut.mean(), cut.std()), rel=1e-5)
    # the logarithm of a squared standard normal deviate has variance pi²/2
    assert prior_moments(HalfNormal(0.5), np.log)[1] == pytest.approx(np.pi / np.sqrt(8), rel=2e-3)


class Conjugate:
    """x ~ N(0, 1) and one datum y ~ N(x, error²): posterior draws with their log prior and log-likelihood."""

    def __init__(self, datum, error, rng):
        self.datum, self.error = datum, error
        mean, sd = self.law(1.0, 1.0)
        self.draws = mean + sd * norm.ppf((np.arange(DRAWS) + 0.5) / DRAWS)
        rng.shuffle(self.draws)
        self.log_prior = norm.logpdf(self.draws)
        self.log_likelihood = norm.logpdf(datum, self.draws, error)

    def law(self, prior_power, likelihood_power):
        """Mean and sd of the posterior with powers on prior and likelihood."""
        precision = prior_power + likelihood_power / self.error**2
        return likelihood_power * self.datum / self.error**2 / precision, precision**-0.5


def exact_distance(one, other, sign):
    """The distance between two normal laws by adaptive quadrature, over the range that the draws cover."""
    (mean, sd), (mean_2, sd_2) = one, other
    reach = sd * norm.isf(0.5 / DRAWS)

    def both(x):
        p, q = norm.cdf(sign * x, sign * mean, sd), norm.cdf(sign * x, sign * mean_2, sd_2)
        return p * np.log2(2 * p / (p + q)) + q * np.log2(2 * q / (p + q)), p + q

    limits = mean - reach, mean + reach
    top, bottom = (integrate.quad(lambda x, k=k: both(x)[k], *limits, epsabs=1e-13)[0] for k in (0, 1))
    return np.sqrt(top / bottom)


@pytest.mark.parametrize(("datum", "error"), [(0.0, 1.0), (2.0, 1.0), (1.0, 5.0), (1.0, 0.1)])
@pytest.mark.parametrize("component", ["prior", "likelihood"])
def test_power_scaling_of_a_conjugate_model(rng, datum, error, component):
    model = Conjugate(datum, error, rng)
    plain = model.law(1.0, 1.0)
    rates = []
    for power in POWERS:
        other = model.law(power, 1.0) if component == "prior" else model.law(1.0, power)
        rates.append(max(exact_distance(plain, other, s) for s in (1, -1)) / abs(np.log2(power)))
    found = power_scaling(model.draws, getattr(model, f"log_{component}"))
    assert found == pytest.approx(np.mean(rates), rel=0.03)
    # negative control: a component that has nothing to do with the quantity moves nothing
    stranger = rng.permutation(getattr(model, f"log_{component}"))
    assert power_scaling(model.draws, stranger) < max(0.1 * found, 0.01)


def test_sensitivities_tell_prior_from_data(rng):
    weak, strong, conflict = Conjugate(1.0, 5.0, rng), Conjugate(1.0, 0.1, rng), Conjugate(6.0, 1.0, rng)
    tell = [(power_scaling(m.draws, m.log_prior), power_scaling(m.draws, m.log_likelihood)) for m in (weak, strong)]
    (prior_of_weak, data_of_weak), (prior_of_strong, data_of_strong) = tell
    assert prior_of_weak > SENSITIVE > data_of_weak
    assert data_of_strong > SENSITIVE > prior_of_strong
    assert min(power_scaling(conflict.draws, c) for c in (conflict.log_prior, conflict.log_likelihood)) > SENSITIVE


def test_distance_is_none_between_equals_and_largest_far_apart():
    draws = np.linspace(0, 1, 501)
    assert distance(draws, np.full(501, 1 / 501)) == pytest.approx(0, abs=1e-8)
    first, last = np.zeros(501), np.zeros(501)
    first[0], last[-1] = 1, 1
    assert distance(draws, last) == pytest.approx(1)
    assert distance(-draws, last) < 0.9
    assert distance(np.zeros(5), np.full(5, 0.2)) == 0


def test_power_scaling_agrees_with_arviz(rng):
    """On correlated draws of two parameters, through whichever line of ArviZ is installed."""
    import arviz

    draws = rng.multivariate_normal([0.5, -0.2], [[0.3, 0.1], [0.1, 0.6]], 8000).reshape(4, 2000, 2)
    log_prior = norm.logpdf(draws)
    log_likelihood = norm.logpdf(1.0, draws.sum(-1), 0.7)
    tree = arviz_bridge.to_tree(
        {
            "posterior": {"x": draws[..., 0], "y": draws[..., 1]},
            "log_prior": {"x": log_prior[..., 0], "y": log_prior[..., 1]},
            "log_likelihood": {"joint": log_likelihood},
        },
    )
    data = arviz_bridge.for_arviz(tree)
    for kind, component in (("prior", log_prior.sum(-1)), ("likelihood", log_likelihood)):
        if hasattr(arviz, "psense"):
            theirs = arviz.psense(data, group=kind)
        else:
            theirs = arviz.psens(data, component=kind, delta=0.01)
        for k, name in enumerate("xy"):
            assert power_scaling(draws[..., k].ravel(), component.ravel()) == pytest.approx(
                float(theirs[name]), rel=0.02
            )


def test_contraction_is_the_data_share_of_a_conjugate_model():
    for error in (0.1, 1.0, 3.0):
        sd = (1 + error**-2) ** -0.5
        assert contraction(1.0, sd) == pytest.approx(error**-2 / (1 + error**-2))
    # the prior weighs more than the datum exactly if its precision is the larger
    assert contraction(1.0, (1 + 0.99) ** -0.5) < PRIOR_DRIVEN < contraction(1.0, (1 + 1.01) ** -0.5)
    assert contraction(1.0, 2.0) == -3


PRIORS = (LogNormal(100.0, 0.5), LogNormal(2.0, 0.3), LogNormal(1.0, 0.2))


def learnt(rng, error=0.01):
    """Draws of three positive parameters of which the data tell only the product of the first two."""
    prior = np.diag([0.5, 0.3, 0.2]) ** 2
    row = np.array([[1.0, 1.0, 0.0]])
    gain = prior @ row.T / (row @ prior @ row.T + error**2)
    covariance = prior - gain @ row @ prior
    return np.exp(rng.multivariate_normal(np.log([100.0, 2.0, 1.0]), covariance, 20_000))


def test_directions_of_a_log_linear_model(rng):
    found = find_directions(PRIORS, learnt(rng))
    np.testing.assert_allclose(found.prior_sd, [0.5, 0.3, 0.2], rtol=1e-6)
    np.testing.assert_allclose(found.contraction, [1 - 1e-4 / (0.34 + 1e-4), 0, 0], atol=0.03)
    stiff = np.array([0.5, 0.3, 0.0]) / np.sqrt(0.34)  # log b + log m, in units of the prior sds
    np.testing.assert_allclose(found.vectors[0], stiff, atol=1e-3)
    np.testing.assert_allclose(found.vectors @ found.vectors.T, np.eye(3), atol=1e-12)
    words = in_words(["b", "m", "gamma"], found, 0)
    assert words.startswith("the data tell b · m^1 to a factor of 1.01 (prior: 1.79)")
    assert any(in_words(["b", "m", "gamma"], found, k).startswith("the data hardly tell") for k in (1, 2))


def tree_of(theta, log_prior, log_likelihood, **extra):
    names = ("b", "m", "gamma")
    groups = {
        "posterior": {**{n: theta[None, :, k] for k, n in enumerate(names)}, **extra},
        "log_prior": {n: log_prior[None, :, k] for k, n in enumerate(names)},
        "log_likelihood": {"ratings": log_likelihood[None]},
    }
    attributes = {f"prior_{n}": str(p) for n, p in zip(names, PRIORS, strict=True)}
    return arviz_bridge.to_tree(groups, attrs=attributes | {"prior_set": "default", "prior_mu": "normal(3,3)"})


def test_tables_of_a_result(rng):
    theta = learnt(rng, error=0.05)
    log_prior = np.stack([p.log_density(theta[:, k]) for k, p in enumerate(PRIORS)], axis=-1)
    log_likelihood = norm.logpdf(np.log(theta[:, :2]).sum(1), np.log(200), 0.05)
    tree = tree_of(theta, log_prior, log_likelihood, mu=rng.normal(3, 0.3, (1, len(theta))))
    table = learning_table(tree)
    assert list(table) == ["prior_mean", "prior_sd", "contraction", "psens_prior", "psens_likelihood"]
    assert table.index.tolist() == ["b", "m", "gamma", "mu"]
    assert table.loc["mu", "contraction"] == pytest.approx(0.99, abs=0.002)
    assert table.loc["mu", ["psens_prior", "psens_likelihood"]].isna().all()
    assert table.loc["gamma", "contraction"] == pytest.approx(0, abs=0.05)
    assert table.loc["gamma", "psens_prior"] > SENSITIVE > table.loc["gamma", "psens_likelihood"]
    assert table.loc["b", "prior_mean"] == pytest.approx(100 * np.exp(0.125), rel=1e-4)
    directions = direction_table(tree)
    assert directions.index.tolist() == [1, 2, 3]
    assert list(directions) == ["contraction", "b", "m", "gamma", "meaning"]
    assert "b · m" in directions.loc[1, "meaning"]


def test_sentences_name_the_parameters():
    table = pd.DataFrame(
        {"contraction": [0.9, 0.1, 0.9], "psens_prior": [0.01, 0.2, 0.08], "psens_likelihood": [0.1, 0.0, 0.1]},
        index=["b", "m", "gamma"],
    )
    first, second = learning_sentences(table)
    assert first.endswith("than the data: m")
    assert second.endswith("move them: gamma")
    (only,) = learning_sentences(table.loc[["b"]])
    assert only.startswith("no parameter is prior-driven")
