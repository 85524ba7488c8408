"""What the data taught, on a conjugate normal model whose every answer is known."""

import numpy as np
import pandas as pd
import pytest
from scipy import integrate
from scipy.stats import halfnorm, lognorm, norm, truncnorm, uniform

from softness_bayes.base import arviz_bridge
from softness_bayes.base.laws import HalfNormal, LogNormal, Normal, Signed, Uniform
from softness_bayes.checking.identifiability import (
    DETERMINED,
    INFORMED,
    POWERS,
    SENSITIVE,
    contraction,
    direction_table,
    distances,
    find_directions,
    find_products,
    information_table,
    power_scaling,
    prior_moments,
)
from softness_bayes.checking.sentences import direction_sentences, information_sentences, modulus_sentences
from softness_bayes.sampler.chain_statistics import jackknife
from support.arviz_types import for_arviz

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
    found, _ = power_scaling(model.draws, getattr(model, f"log_{component}"))
    assert found == pytest.approx(np.mean(rates), rel=0.03)
    # negative control: a component that has nothing to do with the quantity moves nothing
    stranger = rng.permutation(getattr(model, f"log_{component}"))
    assert power_scaling(model.draws, stranger)[0] < max(0.1 * found, 0.01)


def test_distance_is_none_between_equals_and_largest_far_apart():
    draws = np.linspace(0, 1, 501)
    assert distances(draws, np.full(501, 1 / 501)) == pytest.approx((0, 0), abs=1e-7)
    first, last = np.zeros(501), np.zeros(501)
    first[0], last[-1] = 1, 1
    assert distances(draws, last)[0] == pytest.approx(1)
    assert distances(draws, last)[1] < 0.9
    assert distances(np.zeros(5), np.full(5, 0.2)) == (0, 0)


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
    data = for_arviz(tree)
    for kind, component in (("prior", log_prior.sum(-1)), ("likelihood", log_likelihood)):
        if hasattr(arviz, "psense"):
            theirs = arviz.psense(data, group=kind)
        else:
            theirs = arviz.psens(data, component=kind, delta=0.01)
        for k, name in enumerate("xy"):
            found, _ = power_scaling(draws[..., k].ravel(), component.ravel())
            assert found == pytest.approx(float(theirs[name]), rel=0.02)


def test_contraction_is_the_data_share_of_a_conjugate_model():
    for error in (0.1, 1.0, 3.0):
        sd = (1 + error**-2) ** -0.5
        assert contraction(1.0, sd) == pytest.approx(error**-2 / (1 + error**-2))
    # a posterior of so many prior widths holds so much information of the data for each of the prior's
    assert [width**-2 - 1 for width in (DETERMINED, INFORMED)] == pytest.approx([8, 0.5625])
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
    product, *others = find_products(PRIORS, learnt(rng), found)
    assert product.written(["b", "m", "gamma"]) == "b · m"
    limit = norm.isf(0.05)
    assert product.factor == pytest.approx(np.exp(limit * 0.01), abs=4 * product.error)
    assert product.prior_factor == pytest.approx(np.exp(limit * np.sqrt(0.34)), rel=0.02)
    assert product.width == pytest.approx(0.01 / np.sqrt(0.34), rel=0.03)
    assert others == [None, None]


ROWS = np.array([[1.0, -0.6, 0.25], [0.3, 1.0, 0.8]])
"""What the data of another model tell of the logarithms, to errors of 0.02 and 0.1."""
ERRORS = np.array([0.02, 0.1])


def told(rng, size=20_000):
    """Posterior draws of that model, and their exact covariance."""
    precision = np.diag(np.array([0.5, 0.3, 0.2]) ** -2.0) + (ROWS.T / ERRORS**2) @ ROWS
    covariance = np.linalg.inv(precision)
    logs = rng.multivariate_normal(np.zeros(3), covariance, size)
    return np.exp(logs + np.log([100.0, 2.0, 1.0])), covariance


def test_a_product_is_known_as_closely_as_is_printed_and_no_product_of_these_parameters_more_closely(rng):
    theta, covariance = told(rng)
    found = find_directions(PRIORS, theta)
    product = find_products(PRIORS, theta, found)[0]
    kept = [k for k in range(3) if product.exponents[k]]
    assert len(kept) == 2  # the third component is small, not none
    first, second = product.order
    limit = norm.isf(0.05)
    exact = np.sqrt(product.exponents @ covariance @ product.exponents)
    assert product.factor == pytest.approx(np.exp(limit * exact), abs=4 * product.error)
    # two digits of the best exponent: the printed product is within a hundredth of the best one's width
    best = -covariance[first, second] / covariance[second, second]
    assert product.exponents[second] == pytest.approx(best, rel=0.06)
    least = np.sqrt(covariance[first, first] - covariance[first, second] ** 2 / covariance[second, second])
    assert least <= exact < 1.05 * least
    # negative control: the precision of the whole direction, which used to be printed, is another number
    whole = np.sqrt(max(1 - found.contraction[0], 0)) / abs(found.vectors[0, first] / found.prior_sd[first])
    assert np.exp(limit * whole) < product.factor - 10 * product.error


def test_no_product_holds_a_slight_part():
    """Whatever the data tell: parts are compared in units of the priors' widths, as directions are."""
    sd = np.array([0.5, 0.3, 0.2, 0.4, 0.6, 0.3])
    priors = [LogNormal(1.0, width) for width in sd]
    for seed in range(60):
        rng = np.random.default_rng(seed)
        rows, errors = rng.standard_normal((4, 6)), rng.uniform(0.02, 0.2, 4)
        covariance = np.linalg.inv(np.diag(sd**-2) + (rows.T / errors**2) @ rows)
        theta = np.exp(rng.multivariate_normal(np.zeros(6), covariance, 500))
        for product in find_products(priors, theta, find_directions(priors, theta)):
            parts = np.abs(product.exponents * sd)[list(product.order)] if product else np.ones(2)
            assert (parts[1:] >= 0.095 * parts.max()).all()  # exponents have two digits


def test_a_jackknife_knows_correlation_within_chains(rng):
    """Against the spread over independent repetitions, of a mean and of a width."""
    for repeat in (1, 10):
        found, errors = [], []
        for _ in range(60):
            x = np.repeat(rng.standard_normal(4000 // repeat), repeat)
            found.append([x.mean(), x.std()])
            errors.append(jackknife(lambda kept, x=x: np.array([x[kept].mean(), x[kept].std()]), x.size))
        np.testing.assert_allclose(np.mean(errors, axis=0), np.std(found, axis=0), rtol=0.3)
    assert np.isnan(jackknife(lambda kept: 1.0, 30))


@pytest.mark.parametrize("component", ["prior", "likelihood"])
def test_errors_of_power_scaling(rng, component):
    found = []
    for _ in range(40):
        draws = 0.5 + 0.5**0.5 * rng.standard_normal(3000)
        log = norm.logpdf(draws) if component == "prior" else norm.logpdf(1.0, draws, 1.0)
        found.append(power_scaling(draws, log))
    sensitivity, error = np.array(found).T
    assert error.mean() == pytest.approx(sensitivity.std(), rel=0.35)


def tree_of(theta, log_prior, log_likelihood, **extra):
    names = ("b", "m", "gamma")
    groups = {
        "posterior": {**{n: theta[None, :, k] for k, n in enumerate(names)}, **extra},
        "log_prior": {n: log_prior[None, :, k] for k, n in enumerate(names)},
        "log_likelihood_joint": {"ratings": log_likelihood[None]},
    }
    attributes = {f"prior_{n}": str(p) for n, p in zip(names, PRIORS, strict=True)}
    return arviz_bridge.to_tree(groups, attrs=attributes | {"prior_set": "default", "prior_mu": "normal(3,3)"})


def test_tables_of_a_result(rng):
    theta = learnt(rng, error=0.05)
    log_prior = np.stack([p.log_density(theta[:, k]) for k, p in enumerate(PRIORS)], axis=-1)
    log_likelihood = norm.logpdf(np.log(theta[:, :2]).sum(1), np.log(200), 0.05)
    tree = tree_of(theta, log_prior, log_likelihood, mu=rng.normal(3, 0.3, (1, len(theta))))
    table = information_table(tree)
    sensitivities = ["psens_prior", "psens_likelihood"]
    errors = [f"{name}_mcse" for name in sensitivities]
    assert list(table) == ["prior_mean", "prior_sd", "contraction", "prior_shift", *sensitivities, *errors]
    assert (table.loc[["b", "m", "gamma"], errors] > 0).all(axis=None)
    assert table.index.tolist() == ["b", "m", "gamma", "mu"]
    assert table.loc["mu", "contraction"] == pytest.approx(0.99, abs=0.002)
    assert table.loc["mu", ["psens_prior", "psens_likelihood"]].isna().all()
    assert table.loc["gamma", "contraction"] == pytest.approx(0, abs=0.05)
    assert table.loc["gamma", "psens_prior"] > SENSITIVE > table.loc["gamma", "psens_likelihood"]
    assert table.loc["b", "prior_mean"] == pytest.approx(100 * np.exp(0.125), rel=1e-4)
    assert table.loc["b", "prior_shift"] == pytest.approx(np.mean(np.log(theta[:, 0] / 100) / 0.5), abs=1e-6)
    directions = direction_table(tree)
    assert directions.index.tolist() == [1, 2, 3]
    products = ["product", "factor_90", "factor_90_mcse", "prior_factor_90", "width"]
    assert list(directions) == ["contraction", "b", "m", "gamma", *products, "meaning"]
    assert "b · m" in directions.loc[1, "meaning"]
    said = directions.loc[2:, "meaning"]
    assert said.str.fullmatch("not informed: (9[0-9]|10[0-9]) % as wide as under the prior").all()
    head, product, rest = direction_sentences(directions)
    assert head.startswith("combinations determined by the data")
    assert product.startswith("  b · m")
    assert " within a factor of 1.08" in product
    assert rest.startswith("weakly identified: 2 further combinations of ")
    assert "-" not in "".join(f"{width:.2g}" for width in np.sqrt(np.maximum(1 - directions["contraction"], 0)))


def test_sensitivity_is_to_the_priors_of_moduli_too(rng):
    """b and a modulus inform each other only through their product, so that the law of the modulus matters for b."""
    modulus = LogNormal(2.0, 0.2)
    theta = learnt(rng, error=0.05)
    held = modulus.draw(rng, len(theta))
    theta[:, 0] /= held
    log_prior = np.stack([p.log_density(theta[:, k]) for k, p in enumerate(PRIORS)], axis=-1)
    log_likelihood = norm.logpdf(np.log(theta[:, :2]).sum(1) + np.log(held), np.log(200), 0.05)
    tree = tree_of(theta, log_prior, log_likelihood)
    without = information_table(tree).loc["b", "psens_prior"]
    of_moduli = modulus.log_density(held)
    density = tree["log_prior"].to_dataset()
    tree["log_prior"].dataset = density.assign(fabric_modulus=(("chain", "draw", "fabric"), of_moduli[None, :, None]))
    found = information_table(tree)
    expected, _ = power_scaling(theta[:, 0], log_prior.sum(axis=1) + of_moduli)
    assert found.loc["b", "psens_prior"] == pytest.approx(expected, rel=1e-9)
    assert abs(expected - without) > 0.01  # negative control: a table without them shows another number
    assert "fabric_modulus" not in found.index


def test_an_exponent_of_either_sign_belongs_to_no_product(rng):
    theta = learnt(rng, error=0.05)
    log_prior = np.stack([p.log_density(theta[:, k]) for k, p in enumerate(PRIORS)], axis=-1)
    tree = tree_of(theta * [1.0, 1.0, -1.0], log_prior, np.zeros(len(theta)))
    tree.attrs["prior_gamma"] = str(Signed(PRIORS[2]))
    assert list(direction_table(tree))[:3] == ["contraction", "b", "m"]
    assert "gamma" in direction_table(tree_of(theta, log_prior, np.zeros(len(theta))))  # negative control


def summary(**columns):
    return pd.DataFrame({"prior_shift": 0.0, "mean": 1.0} | columns, index=["b", "m", "gamma"])


def test_a_posterior_far_from_its_prior_is_said_first_whatever_its_width():
    """At four prior standard deviations, b is not 'weakly identified', though it is as wide as its prior."""
    columns = {"contraction": [-0.1, 0.9, 0.0], "psens_prior": [0.0] * 3, "psens_prior_mcse": [0.001] * 3}
    first, *rest = information_sentences(summary(**columns, prior_shift=[-4.0, 1.0, 2.4], mean=[12.0, 2.0, 1.0]))
    assert first.startswith("data and prior disagree about b (12, 4.0 prior standard deviations below")
    weak = next(line for line in rest if line.startswith("weakly identified"))
    assert weak.endswith(": gamma 1")
    # negative control
    lines = information_sentences(summary(**columns, prior_shift=[-2.4, 1.0, 2.4]))
    assert not any("disagree" in line for line in lines)
    assert lines[2].endswith(": b 1, gamma 1")


def test_sentences_name_the_parameters():
    table = summary(
        contraction=[0.99, -0.02, 0.5],
        psens_prior=[0.01, 0.2, 0.08],
        psens_prior_mcse=[0.001, 0.01, 0.01],
    )
    determined, informed, not_informed, moved = information_sentences(table)
    assert determined.startswith("determined by the data")
    assert determined.endswith(": b 0.1")
    assert informed.endswith(": gamma 0.71")
    assert not_informed.endswith(": m 1")  # of a contraction below 0, which is noise
    assert moved.startswith("informed, but prior-sensitive")
    assert ": gamma (0.08). Another prior" in moved
    assert not any("unclear" in line for line in information_sentences(table))
    *_, nothing = information_sentences(table.loc[["b"]])
    assert nothing.endswith("priors): none")


@pytest.mark.parametrize(
    ("pull", "said"),
    [(0.0507, "sensitivity unclear"), (0.062, "prior-sensitive"), (0.038, ""), (0.046, "sensitivity unclear")],
)
def test_a_sensitivity_within_its_error_of_the_line_is_not_judged(pull, said):
    table = summary(contraction=[0.9] * 3, psens_prior=[pull, 0.0, 0.0], psens_prior_mcse=[0.004] * 3)
    *_, last = information_sentences(table)
    assert (said in last and ": b (" in last) if said else last.startswith("weakly identified")


@pytest.mark.parametrize(("laws", "narrowed"), [(["uniform(1,9)"] * 3, False), (["a", "b", "b"], True)])
def test_brackets_that_are_one_for_all_are_not_narrowed_by_ratings(laws, narrowed):
    """Their order follows from the direction alone."""
    table = pd.DataFrame({"law": laws, "contraction": 0.9, "shift": 0.1}, index=["x", "y", "z"])
    (said,) = modulus_sentences(table)
    assert ("narrow 3 of 3" in said) == narrowed
    assert ("nothing was known that tells these fabrics apart" in said) != narrowed
