"""Whole runs of several samplers on one posterior: ``python -m softness_bayes.tools.benchmark_samplers FILE.csv``.

Samples the posterior of the shipped ratings, with fixed channels, with this package's sampler, with emcee's default
move, and with nested samplers by other authors: dynesty (random walks) and nautilus (importance nested sampling with
neural networks). Each runs in one process, to its own end or to a limit. A row has the evaluations of the posterior,
the processor time of the whole run, everything included, the effective draws of the worst quantity, these per second,
and how far means and standard deviations lie from those of the first sampler with the same seed. Samplers that are not
installed are left out, which is said.

The nested samplers are not dependencies of the project. Install them in an environment of their own.
"""

from __future__ import annotations

import argparse
import csv
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import softness_bayes
from softness_bayes.data import read_experiment
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.posterior import NEGLIGIBLE, Posterior
from softness_bayes.sampler.moves import STRETCH
from softness_bayes.sampler.sampling import Settings, sampled_of, walk
from softness_bayes.touch.scene import Discretisation

Array = NDArray[np.float64]

RATINGS = Path(softness_bayes.__file__).parent.parent / "data" / "ratings.csv"
CHANNELS = {"c_Na": 1.05, "c_K": 1.16, "c_L": 1.0, "c_A": 1.5}
OPTIONS = ModelOptions(fix=CHANNELS, discretisation=Discretisation(8, 6.0, 1e-4, field_source=1e-5))
"""Nine parameters, at the default accuracy: with the channels free, nautilus did not end within six minutes."""

NO_DENSITY = -1e300
"""Log-likelihood for nested samplers where the prior has no density, which they do not know."""

LIVE = 250
"""Live points of dynesty, half its default: its time and its effective draws are proportional to them."""

LENIENT = {"n_live": 500, "n_networks": 1}
"""Settings of nautilus: a quarter of its default live points, and one network instead of four."""

EFFECTIVE = 1000
"""Effective draws at which nautilus ends, a tenth of its default."""

MOST_STEPS = 3000
"""Limit of emcee's default move."""


class Weighted(NamedTuple):
    """Draws with weights."""

    theta: Array
    """Points in natural units, shape (draws, parameters)."""
    weight: Array
    """Weights that sum to 1, shape (draws,)."""
    effective: float
    """Effective draws of the worst quantity."""
    ended: bool
    """True if the sampler reached its own end, not a limit."""


class Counted:
    """The log-likelihood for points of the unit cube's image, counted; batches or single points."""

    def __init__(self, posterior: Posterior) -> None:
        self.posterior, self.evaluations = posterior, 0
        self._priors = [parameter.prior for parameter in posterior.space.sampled]

    @property
    def dimension(self) -> int:
        """Number of parameters."""
        return len(self._priors)

    def theta(self, u: Array) -> Array:
        """Return points in natural units at points of the unit cube, shape (..., parameters)."""
        parts = [np.asarray(prior.quantile(u[..., k])) for k, prior in enumerate(self._priors)]
        return np.stack(parts, axis=-1)

    def batch(self, theta: Array) -> Array:
        """Return log-likelihoods of points (n, parameters)."""
        self.evaluations += len(theta)
        value = np.full(len(theta), NO_DENSITY)
        inside = (self.posterior.space.log_prior(theta) > NEGLIGIBLE).all(axis=-1)
        if inside.any():
            value[inside] = self.posterior.log_likelihood(theta[inside])
        return value

    def single(self, theta: Array) -> float:
        """Return the log-likelihood of one point (parameters,)."""
        return float(self.batch(np.asarray(theta)[None])[0])


def weighted(theta: Array, log_weight: Array, ended: bool = True) -> Weighted:
    """Return weighted draws with the smallest effective number for the mean of any parameter.

    For each parameter it is its variance over the variance of its weighted mean. It counts draws as independent, which
    those of a nested sampler's random walks are not quite.
    """
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    away = theta - weight @ theta
    effective = (weight @ away**2) / (weight**2 @ away**2)
    return Weighted(theta, weight, float(min(effective.min(), 1.0 / (weight**2).sum())), ended)


def _ensembles(target: Counted, settings: Settings, seed: int) -> Weighted:
    end = deque(walk(target.posterior, settings, seed), maxlen=1).pop()
    chains, verdict = sampled_of(end)
    target.evaluations += end.nonfinite.evaluations
    theta = target.posterior.natural(chains.kept(verdict.burn_in).coordinates).reshape(-1, target.dimension)
    draws = verdict.ensembles * verdict.walkers * verdict.lengths
    return Weighted(theta, np.full(len(theta), 1.0 / len(theta)), draws, verdict.converged)


def ours(target: Counted, seed: int) -> Weighted:
    """Sample as `softness-bayes sample` does, in one process."""
    return _ensembles(target, Settings(processes=1), seed)


def stretch(target: Counted, seed: int) -> Weighted:
    """Sample with emcee's default move from the same starts, without a pilot, to the same criteria."""
    settings = Settings(processes=1, moves=STRETCH, pilot=(), relearning=0, max_steps=MOST_STEPS)
    return _ensembles(target, settings, seed)


def dynesty(target: Counted, seed: int) -> Weighted:
    """Sample with dynesty's static nested sampler and random walks; it evaluates points one at a time.

    Its default in fewer than ten dimensions, uniform draws from ellipsoids, did not end within 17 minutes here.
    """
    from dynesty import NestedSampler

    rng = np.random.default_rng(seed)
    sampler = NestedSampler(target.single, target.theta, target.dimension, nlive=LIVE, sample="rwalk", rstate=rng)
    sampler.run_nested(print_progress=False)
    return weighted(sampler.results.samples, sampler.results.logwt)


def nautilus(target: Counted, seed: int) -> Weighted:
    """Sample with nautilus in batches, with `LENIENT` settings, and drop the draws of its exploration."""
    from nautilus import Sampler

    plain = {"vectorized": True, "pass_dict": False, "seed": seed}
    sampler = Sampler(target.theta, target.batch, target.dimension, **plain, **LENIENT)
    ended = sampler.run(discard_exploration=True, n_eff=EFFECTIVE)
    theta, log_weight, _ = sampler.posterior()
    return weighted(theta, log_weight, bool(ended))


class Way(NamedTuple):
    """One sampler."""

    sample: Callable[[Counted, int], Weighted]
    needs: str
    """The package that it needs."""


WAYS: Mapping[str, Way] = {
    "softness-bayes": Way(ours, "emcee"),
    "emcee, default move": Way(stretch, "emcee"),
    f"nautilus, {LENIENT['n_live']} live points": Way(nautilus, "nautilus"),
    f"dynesty, {LIVE} live points": Way(dynesty, "dynesty"),
}

SEEDS = (1, 2)

COLUMNS = (
    "sampler",
    "seed",
    "reached_its_end",
    "evaluations",
    "processor_s",
    "effective_draws",
    "effective_draws_per_second",
    "largest_shift_of_a_mean_in_sd",
    "least_ratio_of_sds",
    "largest_ratio_of_sds",
)


def moments(draws: Weighted) -> tuple[Array, Array]:
    """Return mean and standard deviation of each parameter."""
    mean = draws.weight @ draws.theta
    return mean, np.sqrt(draws.weight @ (draws.theta - mean) ** 2)


def row(name: str, seed: int, draws: Weighted, spent: float, evaluations: int, other: Weighted) -> tuple[str, ...]:
    """Return a row of the table; means and standard deviations are compared with those of `other`."""
    (mean, sd), (usual, width) = moments(draws), moments(other)
    shift, ratio = np.abs(mean - usual) / width, sd / width
    numbers = f"{shift.max():.3f}", f"{ratio.min():.3f}", f"{ratio.max():.3f}"
    speed = f"{spent:.1f}", f"{draws.effective:.0f}", f"{draws.effective / spent:.3g}"
    return name, str(seed), str(draws.ended), str(evaluations), *speed, *numbers


def kept_rows(path: Path) -> dict[tuple[str, str], tuple[str, ...]]:
    """Return the rows of an earlier file, by sampler and seed."""
    if not path.exists():
        return {}
    with path.open(encoding="utf-8", newline="") as file:
        return {(one[0], one[1]): tuple(one) for one in list(csv.reader(file))[1:]}


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a row for each sampler and seed, and write them; other rows of the file are kept."""
    parser = argparse.ArgumentParser(description="Compare whole runs of several samplers on the shipped ratings.")
    parser.add_argument("file", type=Path, metavar="FILE.csv", help="file to write")
    parser.add_argument("--seeds", type=int, nargs="+", default=SEEDS, help="seeds of the runs")
    parser.add_argument("--samplers", nargs="+", choices=WAYS, default=[*WAYS], help="samplers beside the first")
    given = parser.parse_args(arguments)
    posterior, rows = build(read_experiment(RATINGS), OPTIONS).posterior, kept_rows(given.file)
    chosen = {name: way for name, way in WAYS.items() if name in given.samplers or way.sample is ours}
    there = {name: way for name, way in chosen.items() if find_spec(way.needs) is not None}
    for name in chosen.keys() - there.keys():
        print(f"left out: {name}: {chosen[name].needs} is not installed")
    print(" | ".join(COLUMNS))
    for seed in given.seeds:
        usual = None
        for name, way in there.items():
            target, begun = Counted(posterior), time.process_time()
            draws = way.sample(target, seed)
            spent = time.process_time() - begun
            usual = usual or draws
            rows[name, str(seed)] = row(name, seed, draws, spent, target.evaluations, usual)
            print(" | ".join(rows[name, str(seed)]), flush=True)
            with given.file.open("w", encoding="utf-8", newline="") as file:
                csv.writer(file, lineterminator="\n").writerows([COLUMNS, *rows.values()])


if __name__ == "__main__":
    main()
