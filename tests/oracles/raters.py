"""Densities of rating tables by brute force: every effect on a dense, evenly spaced grid (model.md 9).

Nothing here uses the package. The model is

    z = mu + s_p + exp(tau_gamma u_p) (drive + f_fabric) + varsigma exp(tau_varsigma w_p) e

with z the log rating (its log odds on a slider, the latent softness of categories), mu ~ N(centre, spread²),
s ~ N(0, tau²), f ~ N(0, omega²), u and w ~ N(0, 1). Integrals are trapezoidal sums over mu and a = mu + s, and over f,
u and w where they differ from 0. Such sums converge faster than any power of the step once it is below the width of
what is integrated; `make_likelihood_goldens` compares grids of two steps.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
from scipy import special, stats

LEVELS = {"magnitude": (math.log(20.0), 3.0), "slider": (0.0, 1.5), "categories": (0.0, 3.0)}
"""Mean and standard deviation of mu."""

BY_GRIDS = (*LEVELS, "erring loads")
"""Kinds of cases that `Posterior` integrates."""


def additive(scale, y):
    """Return log ratings, or log odds on a slider."""
    with np.errstate(divide="ignore"):
        return np.log(y) - np.log1p(-y) if scale == "slider" else np.log(y)


def intervals(case, p):
    """Return both ends of what each rating stands for on the additive scale, (rows,) each; equal for exact numbers."""
    y = np.array(case["y"], float)
    if case["scale"] == "categories":
        gaps = [p[f"gap_{k}"] for k in range(2, case["categories"])]
        ends = np.concatenate([[-np.inf, 0.0], np.cumsum(gaps), [np.inf]])
        return ends[y.astype(int) - 1], ends[y.astype(int)]
    step, limit, most = (np.array(case[name], float) for name in ("step", "limit", "most"))
    top = 1.0 if case["scale"] == "slider" else np.inf
    low = np.where(y == 0.0, 0.0, np.where(y == top, most, np.maximum(y - step / 2, limit)))
    high = np.where(y == 0.0, limit, np.where(y == top, top, np.minimum(y + step / 2, most)))
    return additive(case["scale"], low), additive(case["scale"], high)


def log_lapse(case, low, high):
    """Return the log probability of each interval as a lapse; of exact numbers, the log density on the additive scale.

    Categories are equally probable, a slider's positions uniform; logs of magnitude estimates are uniform from half a
    rater's smallest number to twice the largest, 0 counting as the largest number that is called 0.
    """
    exact = low == high
    if case["scale"] == "categories":
        return np.full(low.size, -math.log(case["categories"]))
    if case["scale"] == "slider":
        share_low, share_high = special.expit(low), special.expit(high)
        return np.log(np.where(exact, share_low * (1.0 - share_low), share_high - share_low))
    found = np.empty(low.size)
    for rater in set(case["participant"]):
        own = np.array(case["participant"]) == rater
        least = np.where(np.isinf(low), high, low)[own].min() - math.log(2.0)
        most = high[own].max() + math.log(2.0)
        inside = np.where(exact, 1.0, np.minimum(high, most) - np.maximum(low, least))[own]
        found[own] = np.log(inside / (most - least))
    return found


def log_jacobian(case, low, high):
    """Return the log derivative of z with respect to the rating as in the file: 0 for intervals."""
    if case["scale"] == "categories":
        return np.zeros(low.size)
    y = np.where(low == high, np.array(case["y"], float), 0.5)
    slope = -np.log(y) - np.log1p(-y) if case["scale"] == "slider" else -np.log(y)
    return np.where(low == high, slope, 0.0)


def log_attentive(law, low, high, expected, spread, nu):
    """Return the log density, or the log probability of an interval, of a rating that is no lapse."""
    if low == high:
        error = (low - expected) / spread
        density = stats.t.logpdf(error, nu) if law == "student" else stats.norm.logpdf(error)
        return density - np.log(spread)
    one, other = (low - expected) / spread, (high - expected) / spread
    above = one + other > 0.0  # there, both probabilities are near 1: take those of the other side
    one, other = np.where(above, -other, one), np.where(above, -one, other)
    with np.errstate(divide="ignore", invalid="ignore"):
        if law == "student":
            return np.log(special.stdtr(nu, other) - special.stdtr(nu, one))
        tail, nearer = special.log_ndtr(one), special.log_ndtr(other)
        return np.where(np.isneginf(nearer), -np.inf, nearer + np.log1p(-np.exp(tail - nearer)))


class Grid:
    """Evenly spaced nodes of all effects, on the axes (fabrics..., u, w, a or mu)."""

    def __init__(self, case, p, finer=1):
        self.fabrics = max(case["fabric"]) + 1 if p.get("omega", 0.0) > 0.0 else 0
        low, high, step = case["grid"]
        self.level = np.linspace(low, high, round((high - low) / step) * finer + 1)
        self.step = self.level[1] - self.level[0]
        nodes = case.get("nodes", 41) * finer
        z = np.linspace(-5.5, 5.5, nodes + 1)
        self.f = p.get("omega", 0.0) * z
        self.u = z if p.get("tau_gamma", 0.0) > 0.0 else np.zeros(1)
        self.w = z if p.get("tau_varsigma", 0.0) > 0.0 else np.zeros(1)
        self.log_z = stats.norm.logpdf(z) + math.log(z[1] - z[0])
        axes = self.fabrics + 3
        self.along = lambda values, axis: np.reshape(values, [-1 if k == axis % axes else 1 for k in range(axes)])
        centre, spread = LEVELS[case["scale"]]
        self.log_prior = stats.norm.logpdf(self.level, centre, spread) + math.log(self.step)
        tau = p["tau"]
        self.from_level = (
            np.exp(stats.norm.logpdf(self.level[:, None], self.level, tau)) * self.step
            if tau > 0.0
            else np.eye(self.level.size)
        )


class Posterior:
    """All densities of one table at one vector of parameters.

    Parameters
    ----------
    case
        The table: `scale`, `law`, `sign`, `y`, `participant`, `condition`, `fabric` of each condition, `rate` of each
        condition [Hz], `grid` (lowest and highest level and their step), and `step`, `limit`, `most` of each rating.
    p
        Values of the parameters by name.
    finer
        Number by which the steps of all grids are divided.
    """

    def __init__(self, case, p, finer=1):
        self.case, self.p, self.grid = case, p, Grid(case, p, finer)
        grid, condition = self.grid, np.array(case["condition"])
        self.rater = np.array(case["participant"])
        x = np.log(np.array(case["rate"]) + p["eps"])
        drive = case["sign"] * p["gamma"] * (x - x[condition].mean())
        low, high = intervals(case, p)
        lapse, jacobian = log_lapse(case, low, high), log_jacobian(case, low, high)
        exponent = np.exp(p.get("tau_gamma", 0.0) * grid.along(grid.u, -3))
        spread = p["varsigma"] * np.exp(p.get("tau_varsigma", 0.0) * grid.along(grid.w, -2))
        self.rows = []
        if case["kind"] == "erring loads":
            self.rows = [log_over_load(case, p, i, grid.level) + jacobian[i] for i in range(condition.size)]
            return
        for i, touch in enumerate(condition):
            deviation = grid.along(grid.f, case["fabric"][touch]) if grid.fabrics else 0.0
            expected = grid.along(grid.level, -1) + exponent * (drive[touch] + deviation)
            found = log_attentive(case["law"], low[i], high[i], expected, spread, p.get("nu"))
            if case["law"] == "lapses":
                found = np.logaddexp(math.log1p(-p["lapse"]) + found, math.log(p["lapse"]) + lapse[i])
            self.rows.append(found + jacobian[i])

    def of_rater(self, rater, rows, factor=1.0):
        """Return the log of the integral of `factor` times the density of some of a rater's rows.

        Over u, w and a given mu and all fabrics, shape (fabrics..., mu).
        """
        grid, total = self.grid, 0.0
        for i in rows:
            if self.rater[i] == rater:
                total = total + self.rows[i]
        if np.ndim(total) == 0:
            return np.zeros(1)
        for nodes, axis in ((grid.u, -3), (grid.w, -2)):
            total = total + (grid.along(grid.log_z, axis) if nodes.size > 1 else 0.0)
        largest = total.max(axis=(-3, -2, -1), keepdims=True)
        summed = (np.exp(total - largest) * factor).sum(axis=(-3, -2))
        with np.errstate(divide="ignore"):
            return np.log(summed @ grid.from_level) + largest[..., 0, 0]

    def log_prior(self):
        """Return the log prior weights of all fabrics and mu, shape (fabrics..., mu)."""
        grid, total = self.grid, self.grid.log_prior
        for k in range(grid.fabrics):
            total = total + grid.log_z.reshape([-1 if j == k else 1 for j in range(grid.fabrics + 1)])
        return total

    def log_density(self, rows):
        """Return the log density of some rows."""
        raters = (self.of_rater(rater, rows) for rater in sorted(set(self.rater)))
        return float(special.logsumexp(sum(raters, self.log_prior())))

    def densities(self):
        """Return the log density of all rows, of each given the others, and of each rater's given the others'."""
        every = range(len(self.rows))
        of_raters = {rater: self.of_rater(rater, every) for rater in sorted(set(self.rater))}
        total = sum(of_raters.values(), self.log_prior())
        whole = float(special.logsumexp(total))
        with np.errstate(invalid="ignore"):
            others = {r: np.nan_to_num(total - own, nan=-np.inf, neginf=-np.inf) for r, own in of_raters.items()}
        loo = []
        for i in every:
            rest = self.of_rater(self.rater[i], [j for j in every if j != i])
            loo.append(whole - float(special.logsumexp(others[self.rater[i]] + rest)))
        if len(others) == 1:  # the prior of the level alone is wider than the grid
            return whole, loo, [whole]
        return whole, loo, [whole - float(special.logsumexp(one)) for one in others.values()]

    def moments(self):
        """Return mean and sd of mu, of raters' scales and other effects and of fabrics' deviations, given all rows."""
        grid, every = self.grid, range(len(self.rows))
        raters = sorted(set(self.rater))
        of_raters = [self.of_rater(rater, every) for rater in raters]
        log_weight = sum(of_raters, self.log_prior())
        weight = np.exp(log_weight - special.logsumexp(log_weight))
        mu, found = grid.level, {}
        found["mu"] = [_moments((weight * mu).sum(), (weight * mu**2).sum())]

        def given(rater, own, factor):
            return np.exp(self.of_rater(rater, every, factor) - own)

        found["participant"], found["log_gamma"], found["log_varsigma"] = [], [], []
        # far from the data, where no rater's density can be told from 0, the weight is 0
        known = weight > 0.0
        base = mu[0] - 1.0  # so that factors are positive
        a = grid.along(mu - base, -1)
        for rater, own in zip(raters, of_raters, strict=True):
            with np.errstate(invalid="ignore"):
                first, second = given(rater, own, a), given(rater, own, a**2)
                first, second = (np.where(known, one, 0.0) for one in (first, second))
            mean = (weight * (first - (mu - base))).sum()
            square = (weight * (second - 2.0 * (mu - base) * first + (mu - base) ** 2)).sum()
            found["participant"].append(_moments(mean, square))
            for name, nodes, axis in (("log_gamma", grid.u, -3), ("log_varsigma", grid.w, -2)):
                spread = self.p.get(name.replace("log", "tau"), 0.0)
                if spread > 0.0:
                    shifted = grid.along(nodes + 7.0, axis)
                    with np.errstate(invalid="ignore"):
                        parts = (np.where(known, given(rater, own, shifted**k), 0.0) for k in (1, 2))
                    one, two = ((weight * part).sum() for part in parts)
                    found[name].append([spread * value for value in _moments(one - 7.0, two - 14.0 * one + 49.0)])
        found["fabric"] = []
        for k in range(grid.fabrics):
            marginal = weight.sum(axis=tuple(j for j in range(weight.ndim) if j != k))
            found["fabric"].append(_moments(marginal @ grid.f, marginal @ grid.f**2))
        return {name: values for name, values in found.items() if values}


def _moments(mean, square):
    return [float(mean), float(math.sqrt(max(square - mean**2, 0.0)))]


def log_order(case, p, rows):
    """Return the log probability of the order of some rows of each list: all orders that agree with the places."""
    x = np.log(np.array(case["rate"]) + p["eps"])[np.array(case["condition"])]
    worth = np.exp(case["sign"] * p["gamma"] * x * math.pi / math.sqrt(6.0) / p["varsigma"])
    total, y = 0.0, np.array(case["y"])
    for one in sorted(set(case["lists"])):
        own = [i for i in rows if case["lists"][i] == one]
        chance = 0.0
        for order in itertools.permutations(own):
            if (np.diff(y[list(order)]) <= 0).all():
                chance += np.prod([worth[i] / worth[list(order[k:])].sum() for k, i in enumerate(order)])
        total += math.log(chance)
    return total


def log_pair(case, p, rows):
    """Return the log probability of answers to pairs; a pair with one row, or with equal ones, says nothing."""
    x = np.log(np.array(case["rate"]) + p["eps"])[np.array(case["condition"])]
    total = 0.0
    for one in sorted(set(case["lists"])):
        own = sorted((i for i in rows if case["lists"][i] == one), key=lambda i: case["y"][i])
        if len(own) < 2 or case["y"][own[0]] == case["y"][own[1]]:
            continue
        apart = case["sign"] * p["gamma"] * (x[own[1]] - x[own[0]])
        told = stats.norm.cdf(apart / (math.sqrt(2.0) * p["varsigma"]))
        guessed = p["lapse"] if case["law"] == "lapses" else 0.0
        total += math.log((1.0 - guessed) * told + 0.5 * guessed)
    return total


def log_z_scores(case, p, rows):
    """Return the log density of z-scores on a line: a level N(0, 1) and a slope that is half normal."""
    x = np.array(case["rate"])[np.array(case["condition"])]
    x = ((x - x.mean()) / x.std())[rows]
    y = np.array(case["y"])[rows]
    law = stats.multivariate_normal(np.zeros(y.size), 1.0 + p["varsigma"] ** 2 * np.eye(y.size))
    slope = np.linspace(0.0, 9.0, 20001)
    density = law.logpdf(y - case["sign"] * slope[:, None] * x) + stats.halfnorm.logpdf(slope)
    ends = np.where((slope == slope[0]) | (slope == slope[-1]), 0.5, 1.0)
    return float(special.logsumexp(density, b=ends * (slope[1] - slope[0])))


def log_means(case, p, rows):
    """Return the log density of geometric means of n raters: the mean of n vectors of log ratings."""
    n, rows = case["raters"], list(rows)
    condition = np.array(case["condition"])
    x = np.log(np.array(case["rate"]) + p["eps"])[condition]
    fabric, panel = np.array(case["fabric"])[condition][rows], np.array(case["participant"])[rows]
    covariance = 9.0 + (p["tau"] ** 2 * (panel[:, None] == panel) + p["varsigma"] ** 2 * np.eye(len(rows))) / n
    covariance = covariance + p["omega"] ** 2 * (fabric[:, None] == fabric)
    mean = math.log(20.0) + (case["sign"] * p["gamma"] * (x - x.mean()))[rows]
    z = np.log(np.array(case["y"])[rows])
    return float(stats.multivariate_normal(mean, covariance).logpdf(z) - z.sum())


def log_spreads(case, p, rows):
    """Return the log density of panels' standard deviations: noncentral chi-squares given what a panel shares."""
    freedom, variance, total = case["raters"] - 1, p["varsigma"] ** 2, 0.0
    u = np.linspace(0.0, 12.0, 4001)[1:]  # root of the shared chi-square, for a smooth integrand
    for panel in sorted(set(case["participant"])):
        own = [case["y"][i] for i in rows if case["participant"][i] == panel]
        density = stats.chi.logpdf(u, freedom) + math.log(u[1] - u[0])
        for s in own:
            density = density + stats.ncx2.logpdf(freedom * s**2 / variance, freedom, u**2 * p["tau"] ** 2 / variance)
            density = density + math.log(2.0 * freedom * s / variance)
        total += special.logsumexp(density)
    return float(total)


def drive_at_load(case, p, t):
    """Return the drive of each condition if its load is off by t standard deviations of its log."""
    rate, condition = np.array(case["rate"]), np.array(case["condition"])
    centre = np.log(rate + p["eps"])[condition].mean()
    other = rate * np.exp(np.array(case["load_slope"]) * t)
    return case["sign"] * p["gamma"] * (np.log(other + p["eps"]) - centre)


def log_over_load(case, p, i, level):
    """Return the log density of log rating i at each level, integrated over the error of its own load."""
    t = np.linspace(-7.0, 7.0, 141)
    touch, z = case["condition"][i], math.log(case["y"][i])
    drive = np.array([drive_at_load(case, p, one)[touch] for one in t])
    density = stats.norm.logpdf(z, level[:, None] + drive, p["varsigma"]) + stats.norm.logpdf(t)
    return special.logsumexp(density, axis=1)[None, None] + math.log(t[1] - t[0])


def log_shared_loads(case, p, rows):
    """Return the log density of magnitude estimates, summed over the errors of both loads, which all touches share."""
    rows, condition = list(rows), np.array(case["condition"])
    load = np.array(case["shared"])[condition][rows]
    z, t, terms = np.log(np.array(case["y"])[rows]), np.linspace(-6.0, 6.0, 61), []
    law = stats.multivariate_normal(cov=_covariance(case, p, rows))
    drive = np.array([drive_at_load(case, p, one)[condition][rows] for one in t])
    for first, second in itertools.product(range(t.size), repeat=2):
        mean = math.log(20.0) + np.where(load == 0, drive[first], drive[second])
        terms.append(law.logpdf(z - mean) + stats.norm.logpdf(t[[first, second]]).sum())
    return float(special.logsumexp(terms) + 2.0 * math.log(t[1] - t[0]) - z.sum())


def _covariance(case, p, rows):
    """Return the covariance of log ratings: of mu, raters' scales, fabrics' deviations and errors."""
    fabric = np.array(case["fabric"])[np.array(case["condition"])][rows]
    rater = np.array(case["participant"])[rows]
    covariance = 9.0 + p["tau"] ** 2 * (rater[:, None] == rater) + p["omega"] ** 2 * (fabric[:, None] == fabric)
    return covariance + p["varsigma"] ** 2 * np.eye(len(rows))


def log_load_errors(case, p, rows):
    """Return the log density of magnitude estimates under loads with errors, in the approximation of the model.

    Errors of loads are independent between rows, or shared by all touches of a load (`shared`). The response's law is
    replaced by a normal one, or by a line in t, with the moments of three loads at t = -root 3, 0, root 3.
    """
    rows, condition = list(rows), np.array(case["condition"])
    low, stated, high = (drive_at_load(case, p, t)[condition][rows] for t in (-math.sqrt(3.0), 0.0, math.sqrt(3.0)))
    mean = low / 6 + 2 * stated / 3 + high / 6
    covariance = _covariance(case, p, rows)
    if "shared" in case:
        load, lean = np.array(case["shared"])[condition][rows], (high - low) / math.sqrt(12.0)
        covariance = covariance + (load[:, None] == load) * np.outer(lean, lean)
    else:
        variance = ((low - mean) ** 2 + 4 * (stated - mean) ** 2 + (high - mean) ** 2) / 6
        covariance = covariance + np.diag(variance)
    z = np.log(np.array(case["y"])[rows])
    return float(stats.multivariate_normal(math.log(20.0) + mean, covariance).logpdf(z) - z.sum())


def log_fingers(case, p, rows):
    """Return the log density of magnitude estimates by raters whose finger is one of a few: summed over all choices."""
    rows, condition = list(rows), np.array(case["condition"])
    x = np.log(np.array(case["rate"]) + p["eps"])
    own = np.log(np.array(case["finger_rate"]) + p["eps"])  # (fingers, conditions)
    rater, z = np.array(case["participant"])[rows], np.log(np.array(case["y"])[rows])
    centre = x[condition].mean()
    covariance = 9.0 + p["tau"] ** 2 * (rater[:, None] == rater) + p["varsigma"] ** 2 * np.eye(len(rows))
    people, terms = sorted(set(case["participant"])), []
    for choice in itertools.product(range(len(own)), repeat=len(people)):
        drive = case["sign"] * p["gamma"] * (own[np.array(choice)[rater], condition[rows]] - centre)
        law = stats.multivariate_normal(math.log(20.0) + drive, covariance)
        terms.append(sum(math.log(case["finger_weight"][j]) for j in choice) + law.logpdf(z))
    return float(special.logsumexp(terms) - z.sum())


def log_forces(case, p, rows):
    """Return the log density of plate forces: ln F = ln b_j + m_j g + ln(4 a³ / (3 R (1 - nu²))) + e, g = a/R."""
    rows, radius, poisson = list(rows), case["radius"], case["poisson"]
    depth = np.array(case["indentation"])[rows]
    contact = np.sqrt(radius * depth)
    strain = contact / radius
    finger, z = np.array(case["participant"])[rows], np.log(np.array(case["y"])[rows])
    mean = math.log(p["b"]) + p["m"] * strain + np.log(4.0 * contact**3 / (3.0 * radius * (1.0 - poisson**2)))
    same = finger[:, None] == finger
    covariance = same * (p["tau_b"] ** 2 + p["tau_m"] ** 2 * np.outer(strain, strain))
    covariance = covariance + p["varsigma_f"] ** 2 * np.eye(len(rows))
    return float(stats.multivariate_normal(mean, covariance).logpdf(z) - z.sum())


WITHOUT_LEVELS = {
    "ranks": log_order,
    "pairs": log_pair,
    "standardised": log_z_scores,
    "aggregated": log_means,
    "spreads": log_spreads,
    "load errors": log_load_errors,
    "shared loads": log_shared_loads,
    "fingers": log_fingers,
    "forces": log_forces,
}
"""Log density of some rows, by kind, where effects are integrated in closed form or there are none."""


def log_density(case, p, finer=1):
    """Return the log density of all rows."""
    every = range(len(case["y"]))
    if case["kind"] in BY_GRIDS:
        return Posterior(case, p, finer).log_density(every)
    return WITHOUT_LEVELS[case["kind"]](case, p, every)


def densities(case, p, finer=1):
    """Return the log density of all rows, of each row given the others, and of each participant's given the others'."""
    if case["kind"] in BY_GRIDS:
        return Posterior(case, p, finer).densities()
    density, every = WITHOUT_LEVELS[case["kind"]], range(len(case["y"]))
    whole = density(case, p, every)

    def given_others(left):
        rest = [i for i in every if i not in left]
        return whole - (density(case, p, rest) if rest else 0.0)

    people = [[i for i in every if case["participant"][i] == one] for one in sorted(set(case["participant"]))]
    return whole, [given_others([i]) for i in every], [given_others(left) for left in people]
