"""Ratings of people whose fingers a plate has pressed, against sums over dense grids of their skins."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.special import logsumexp
from scipy.stats import multivariate_normal, norm

from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.individual import IndividualModel
from softness_bayes.likelihood.plate import CompressionForces, PressedRaters
from softness_bayes.touch.contact import plate_line
from softness_bayes.touch.finger_grid import FingerGrid, SkinLaws
from support.points import rated

DESIGN = Design([0, 1, 2, 0, 1, 2, 0, 2], [0, 0, 0, 1, 1, 1, 2, 2], [0, 1, 2], 3)
ANSWERS = np.exp(np.array([2.9, 3.4, 3.1, 2.2, 3.6, 3.0, 3.2, 2.7]))
LEVEL, OF_B, OF_M = np.array([1.0, 2.0, 0.3]), np.array([0.5, -0.9, 1.2]), np.array([0.2, 0.1, -0.3])
DEPTH, FINGER = np.array([0.5, 1.0, 1.5, 1.0, 2.0]) * 1e-3, np.array([0, 0, 0, 1, 1])
LINE = plate_line(DEPTH)
FORCE = np.exp(np.log(8e3) + np.array([0.5, 0.4, 0.6, -0.3, -0.2]) + 3.8 * LINE.slope + LINE.offset)
P = rated(gamma=1.1, tau=0.4, varsigma=0.3, tau_b=0.3, tau_m=0.5, tau_sigma=0.2, b=8e3, m=3.8, varsigma_f=0.15)
GRIDS = {
    ("b",): {"b": 65},
    ("m",): {"m": 65},
    ("b", "m"): {"b": 49, "m": 41},
    ("b", "sigma_0"): {"b": 49, "sigma_0": 41},
}
PRESSED = PressedRaters.of(CompressionForces(DEPTH, FORCE, FINGER, 2), ("Ada", "Bo", "Cy"), ("Cy", "Ada"))

X = np.linspace(-7.0, 7.0, 109)


def rate_of(log_b, m, log_sigma):
    """Response of fingers that deviate so much, shape (..., conditions): smooth, and unlike for each condition."""
    lean = log_b[..., None] * OF_B + m[..., None] * OF_M + 0.1 * (log_b[..., None] * OF_B) ** 2
    return np.exp(LEVEL + lean - 0.7 * log_sigma[..., None] * (1.0 + OF_M))


def observed(names, pressed=PRESSED):
    grid = FingerGrid(GRIDS[names], reach=7.0)
    return IndividualModel(grid=grid).observe(ANSWERS, DESIGN).with_pressed(pressed)


def response(likelihood, p=P):
    """Mean rates of the typical finger, of anybody's, and of each pressed person's."""
    grid, nothing = likelihood.model.grid, np.zeros(likelihood.model.grid.size)
    z_b, z_m, z_s = (grid.z.get(name, nothing) for name in ("b", "m", "sigma_0"))
    laws = [SkinLaws(0.0, 0.0, p.tau_b, 0.0, p.tau_m)]
    if likelihood.pressed is not None:
        known = likelihood.pressed.skins(grid.names, p)
        laws += [SkinLaws(*(value[k] for value in known)) for k in range(likelihood.pressed.size)]
    skins = [law.deviation(z_b, z_m) for law in laws]
    rates = [rate_of(np.zeros(1), np.zeros(1), np.zeros(1))]
    rates += [rate_of(log_b + nothing, m + nothing, p.tau_sigma * z_s) for log_b, m in skins]
    return np.concatenate([rate.ravel() for rate in rates])


def dense(names):
    """log p(forces, ratings) by sums over the level and over each person's ln b, m and ln sigma_0."""
    x = X if len(names) == 1 else X[::2]
    axes = [x if name in names else np.zeros(1) for name in ("b", "m", "sigma_0")]
    z_b, z_m, z_s = (z.ravel() for z in np.meshgrid(*axes, indexing="ij"))
    weight = sum(
        -0.5 * z**2 - np.log(np.exp(-0.5 * x**2).sum()) * (z.size > 1 and np.ptp(z) > 0) for z in (z_b, z_m, z_s)
    )
    rate = rate_of(P.tau_b * z_b, P.tau_m * z_m, P.tau_sigma * z_s)
    centre = np.log(rate_of(*np.zeros((3, 1)))[0] + P.eps)[DESIGN.condition].mean()
    level = np.linspace(-8.0, 8.0, 257)
    total = norm.logpdf(level, 0.0, 3.0) + np.log(level[1] - level[0])
    for rater in range(3):
        rows = DESIGN.participant == rater
        drive = P.gamma * (np.log(rate + P.eps) - centre)[:, DESIGN.condition[rows]]
        covariance = P.tau**2 + P.varsigma**2 * np.eye(rows.sum())
        law = multivariate_normal(cov=covariance)
        gap = np.log(ANSWERS[rows] / 20.0) - drive
        one = law.logpdf(gap[:, None] - level[:, None]) + weight[:, None]
        one = one + forces(rater, names, z_b, z_m)[:, None]
        total = total + logsumexp(one, axis=0)
    return logsumexp(total) - np.log(ANSWERS).sum() - np.log(FORCE).sum()


def forces(rater, names, z_b, z_m):
    """log p(a person's log forces | ln b, m), what the ratings share being summed over the spreads of forces."""
    x = X
    own = {0: FINGER == 1, 2: FINGER == 0}.get(rater)  # Ada is the second finger, Cy the first, Bo was not pressed
    if own is None:
        return np.zeros(z_b.size)
    terms = []
    others_b, others_m = np.zeros(1) if "b" in names else x, np.zeros(1) if "m" in names else x
    for more_b in others_b:
        for more_m in others_m:
            log_b, m = np.log(P.b) + P.tau_b * (z_b + more_b), P.m + P.tau_m * (z_m + more_m)
            mean = log_b[:, None] + m[:, None] * LINE.slope[own] + LINE.offset[own]
            free = [z for z, axis in ((more_b, others_b), (more_m, others_m)) if axis.size > 1]
            lost = sum(-0.5 * z**2 - np.log(np.exp(-0.5 * x**2).sum()) for z in free)
            terms.append(norm.logpdf(np.log(FORCE[own]), mean, P.varsigma_f).sum(axis=1) + lost)
    return logsumexp(terms, axis=0)


@pytest.mark.parametrize("names", list(GRIDS), ids=",".join)
def test_forces_and_ratings_together_agree_with_dense_sums(names):
    likelihood = observed(names)
    found = likelihood.log_likelihood(response(likelihood), P) + PRESSED.forces.log_likelihood(np.empty(0), P)
    expected = dense(names)
    assert_allclose(found, expected, rtol=0, atol=1e-6)
    apart = observed(names, None)
    alone = apart.log_likelihood(response(apart), P) + PRESSED.forces.log_likelihood(np.empty(0), P)
    assert abs(alone - expected) > 0.05  # the forces do say something of the raters


def test_nobody_in_common_changes_nothing():
    assert PressedRaters.of(PRESSED.forces, ("Ada", "Bo", "Cy"), ("F1", "F2")) is None
    apart, strangers = observed(("b",), None), observed(("b",), PRESSED.as_strangers())
    assert_allclose(
        strangers.log_likelihood(response(strangers), P), apart.log_likelihood(response(apart), P), rtol=1e-13
    )


def test_densities_given_the_others_are_ratios_of_joint_ones():
    likelihood = observed(("b",))
    rate = response(likelihood)
    for found, block in (
        (likelihood.left_out(rate, P).log_density, np.arange(DESIGN.n_rows)),
        (likelihood.log_likelihood_participants(rate, P), DESIGN.participant),
    ):
        assert_allclose(found, likelihood.log_likelihood_blocks(rate, P, block), atol=1e-7)


def test_fingers_are_drawn_from_what_forces_and_ratings_say():
    """Means and spreads of drawn ln b against the same sums, for a pressed rater and one who was not."""
    likelihood, size = observed(("b",)), 10_000
    p = P.each(lambda value: np.full(size, value))
    rate = np.broadcast_to(response(likelihood), (size, response(likelihood).size))
    drawn = likelihood.draw_effects(np.random.default_rng(0), rate, p)
    x = X[::3]
    grid = likelihood.model.grid
    for rater in (0, 1):
        terms = []
        for z in x:
            fixed = rate_of(np.array([P.tau_b * z]), np.zeros(1), np.zeros(1))[0]
            # everybody else as they are, this rater with this finger alone
            one = response(likelihood).reshape(1 + likelihood.n_blocks * grid.size, -1).copy()
            block = likelihood._block[rater]
            own = observed(("b",)) if block else likelihood
            part = slice(1 + block * grid.size, 1 + (block + 1) * grid.size)
            if not block:
                strangers = PressedRaters(PRESSED.forces, np.append(PRESSED.rater, rater), np.append(PRESSED.finger, 0))
                own = likelihood.with_pressed(strangers)
                one = np.vstack([one, np.tile(fixed, (grid.size, 1))])
            else:
                one[part] = fixed
            terms.append(
                own.log_likelihood(one.ravel(), P) - 0.5 * z**2 + forces(rater, ("b",), np.array([z]), np.zeros(1))[0]
            )
        weight = np.exp(terms - logsumexp(terms))
        mean = P.tau_b * weight @ x
        sd = P.tau_b * np.sqrt(weight @ (x - mean / P.tau_b) ** 2)
        found = drawn.deviation[:, rater, 0]
        assert_allclose(found.mean(), mean, atol=5 * sd / np.sqrt(size))
        assert_allclose(found.std(), sd, rtol=0.03)
    assert_array_equal(drawn.finger[:, 1] < grid.size, True)
    assert (drawn.finger[:, 0] >= grid.size).all()
