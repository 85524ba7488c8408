"""Faults injected into the inference on purpose, and the check that detects each of them.

A calibration without alarms is convincing only if it detects known faults. Each fault is patched into the package's
code while posteriors are computed, but not while ratings are simulated. The controls are changes that leave all
posteriors unchanged; no check may report them.

``python -m softness_bayes.tools.injected_faults``, in a clone, writes ``notebooks/results/injected_faults.csv``, from
which ``tools.doc_tables`` makes the table of the page on calibration.
"""

from __future__ import annotations

import csv
import io
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, ExitStack
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from scipy.stats import kstest, loggamma, norm

from softness_bayes.checking.ranks import DRAWS, Calibration
from softness_bayes.data import Fabrics
from softness_bayes.errors import NumericalError
from softness_bayes.files.whole import write_whole
from softness_bayes.likelihood import magnitude
from softness_bayes.likelihood.random_effects import RandomEffects
from softness_bayes.likelihood.ratings import RatingsLikelihood
from softness_bayes.model import posterior as posteriors
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.posterior import Density, Posterior
from softness_bayes.model.scenes import usual_values
from softness_bayes.parameters.space import ParameterSpace
from softness_bayes.runs.calibration_scene import CalibrationScene
from softness_bayes.runs.ranked_quantities import LOG_LIKELIHOOD
from softness_bayes.runs.replicate import independent, ranks, simulate
from softness_bayes.sampler import diagnostics
from softness_bayes.sampler.diagnostics import Goal, Verdict
from softness_bayes.sampler.moves import Student
from softness_bayes.sampler.sampling import Settings, sample_until
from softness_bayes.touch.contact import Indentation
from softness_bayes.touch.scene import Discretisation

FloatArray = NDArray[np.float64]

TABLE = Path("notebooks/results/injected_faults.csv")

REPLICATES = 300
"""Number of simulated tables of a calibration with draws on grids; some faults need fewer."""

CHANCE = 1e-4
"""P-value below which the draws of a sampler run contradict their target distribution."""

_SIDE, _NEGLIGIBLE = 25, 1e-5  # grid points per parameter; densities below this share of the peak are ignored
_TEMPERED = 30.0, 4.0, 1.0, 1.0  # divisors of the log density in successive, ever narrower grids
_COARSE = Discretisation(nodes=8, saturation=6.0, field_tolerance=1e-3)
_SAMPLED = ("gamma", "varsigma")


class InjectedFault(NamedTuple):
    """A fault, or a control."""

    what: str
    """Description of the fault."""
    check: str
    """Name of the check that must find it, one of `CHECKS`."""
    patches: Callable[[], tuple[AbstractContextManager[Any], ...]]
    """Makes the patches; they are in force while a posterior is computed."""
    replicates: int = REPLICATES
    """Simulated tables, if the check is a calibration."""

    def found(self) -> str:
        """Return the message of the check; empty if it detects nothing."""
        return CHECKS[self.check](self)


@cache
def _model(raters: int, fabrics: int) -> Posterior:
    """Return the posterior of exponent and error size, all else fixed, with placeholder ratings."""
    values = usual_values(ModelOptions().readings)
    held = {name: value for name, value in values.items() if name not in _SAMPLED}
    names = tuple("abcdefgh"[:fabrics])
    scene = CalibrationScene(
        Fabrics(names, effective_modulus=np.geomspace(3e4, 1e6, fabrics)), (Indentation(2.5e-3),), raters
    )
    return scene.model(ModelOptions(fix=held, discretisation=_COARSE)).posterior


def on_grid(density: Callable[[FloatArray], FloatArray], low: FloatArray, high: FloatArray, rng: Any) -> FloatArray:
    """Return `DRAWS` draws of a density of two coordinates that lies within a box, by refined grids."""
    for temper in _TEMPERED:
        step = (high - low) / _SIDE
        axes = [low[k] + step[k] * (np.arange(_SIDE) + 0.5) for k in range(2)]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
        value = density(points)
        if np.isnan(value).any():
            raise NumericalError("the density could not be computed")
        weight = np.exp((value - value.max()) / temper)
        kept = points[weight > _NEGLIGIBLE]
        low, high = np.maximum(low, kept.min(axis=0) - step), np.minimum(high, kept.max(axis=0) + step)
    drawn = points[rng.choice(len(points), DRAWS, p=weight / weight.sum())]
    return np.asarray(drawn + step * (rng.random(drawn.shape) - 0.5))


def calibration(posterior: Posterior, fault: InjectedFault, count: int, seed: int = 0) -> Calibration:
    """Return the ranks of true values among draws of posteriors computed with a fault."""
    found, space = [], posterior.space
    prior = space.coordinates(space.draw_prior(np.random.default_rng(1), 4000))
    low, high = prior.min(axis=0) - 1.0, prior.max(axis=0) + 1.0
    for k in range(count):
        rng = np.random.default_rng([seed, k])
        truth = space.draw_prior(rng, 1)[0]
        observation, _ = simulate(posterior.observation, posterior, truth, rng)
        fitted = posterior.with_term(observation)
        with ExitStack() as injected:
            for each in fault.patches():
                injected.enter_context(each)
            draws = fitted.natural(on_grid(fitted, low, high, rng))
            points = np.vstack([truth, draws])
            table = np.column_stack([points, fitted.log_likelihood(points)])
        found.append(ranks(table[0], table[1:], rng))
    return Calibration((*posterior.names, LOG_LIKELIHOOD), np.array(found))


def _by_ranks(raters: int, fabrics: int) -> Callable[[InjectedFault], str]:
    def found(fault: InjectedFault) -> str:
        try:
            return "; ".join(calibration(_model(raters, fabrics), fault, fault.replicates).faults())
        except NumericalError as error:
            return str(error)

    return found


class _KnownLaw:
    """Joint distribution of two independent coordinates: a standard normal and the logarithm of a gamma variable."""

    names = ("normal", "log gamma")
    laws = norm(), loggamma(2.0)

    def __call__(self, z: FloatArray) -> FloatArray:
        return np.asarray(sum(law.logpdf(z[:, k]) for k, law in enumerate(self.laws)))

    def natural(self, z: FloatArray) -> FloatArray:
        return z

    def draw_start(self, rng: np.random.Generator, size: int) -> FloatArray:
        return 3.0 * rng.standard_normal((size, 2))


def _by_a_walk(fault: InjectedFault) -> str:
    """Compare the draws of a sampler run with a known distribution."""
    target, rng = _KnownLaw(), np.random.default_rng(0)
    goal = Goal(lengths=50.0, tau_change=np.inf, looks=1)
    settings = Settings(ensembles=2, pilot=(), optima=1, round_steps=5, max_steps=300, processes=1, goal=goal)
    with ExitStack() as injected:
        for each in fault.patches():
            injected.enter_context(each)
        draws = independent(sample_until(target, settings, 3), 800, rng)
    chance = [float(kstest(draws[:, k], law.cdf).pvalue) for k, law in enumerate(target.laws)]
    return "; ".join(f"{n} has p = {p:.1g}" for n, p in zip(target.names, chance, strict=True) if p < CHANCE)


MANY, FEW, WALK = "ranks, many ratings", "ranks, few ratings", "a walk over a known law"

CHECKS: Mapping[str, Callable[[InjectedFault], str]] = MappingProxyType(
    {MANY: _by_ranks(6, 6), FEW: _by_ranks(2, 3), WALK: _by_a_walk}
)
"""Checks by name: grid-based calibrations of exponent and error size with many ratings and with an influential prior,
and comparisons of a sampler run with its known target distribution."""


def _changed(owner: Any, name: str, change: Callable[..., Any]) -> Callable[[], tuple[AbstractContextManager[Any]]]:
    """Return a patch of a function; ``change`` receives the original's return value, followed by its arguments."""
    original = getattr(owner, name)

    def changed(*arguments: Any, **named: Any) -> Any:
        return change(original(*arguments, **named), *arguments)

    return lambda: (patch.object(owner, name, changed),)


def _without_density(self: Student, y: FloatArray) -> FloatArray:
    return np.zeros(y.shape[:-1])


def _failing(value: FloatArray, self: Density, theta: FloatArray) -> FloatArray:
    return np.where(theta[..., self.names.index("gamma")] > 1.0, np.nan, value)


FAULTS: tuple[InjectedFault, ...] = (
    InjectedFault(
        "the sum of squares without its ½", MANY, _changed(RandomEffects, "_quadratic", lambda q, *_: 2.0 * q), 20
    ),
    InjectedFault(
        "the density of errors without log varsigma",
        MANY,
        _changed(RandomEffects, "log_density", lambda value, self, _, of: value + self.design.n_rows * np.log(of.row)),
        20,
    ),
    InjectedFault(
        "all ratings counted twice", MANY, _changed(Density, "data_density", lambda value, *_: 2.0 * value), 100
    ),
    InjectedFault(
        "raters' own scales forgotten",
        MANY,
        _changed(magnitude, "spreads_of", lambda of, *_: of._replace(participant=0.01 * np.asarray(of.participant))),
        20,
    ),
    InjectedFault(
        "ratings fall where they rise", MANY, _changed(RatingsLikelihood, "drive", lambda drive, *_: -drive), 20
    ),
    InjectedFault(
        "every rating given to the next fabric",
        MANY,
        _changed(Posterior, "mean_rate_of", lambda rate, *_: np.roll(rate, 1, axis=-1)),
        20,
    ),
    InjectedFault(
        "points that fail have probability 0",
        MANY,
        lambda: (
            *_changed(Density, "data_density", _failing)(),
            *_changed(posteriors, "_finite", lambda value, *_: np.where(np.isnan(value), -np.inf, value))(),
        ),
        20,
    ),
    InjectedFault(
        "the ratings ignored",
        FEW,
        _changed(Density, "__call__", lambda _, self, z: self.log_prior(self.natural(z)) + self.space.log_jacobian(z)),
        40,
    ),
    InjectedFault(
        "the walked coordinates' Jacobian forgotten",
        FEW,
        _changed(ParameterSpace, "log_jacobian", lambda value, *_: 0.0 * value),
    ),
    InjectedFault(
        "the prior ignored",
        FEW,
        _changed(ParameterSpace, "log_prior", lambda value, *_: np.where(np.isfinite(value), 0.0, value)),
        150,
    ),
    InjectedFault(
        "priors of twice the width", FEW, _changed(ParameterSpace, "log_prior", lambda value, *_: 0.25 * value)
    ),
    InjectedFault(
        "a proposal accepted without its density",
        WALK,
        lambda: (patch.object(Student, "log_density", _without_density),),
    ),
    InjectedFault(
        "walks that end at their first check, and keep their start",
        WALK,
        lambda: (
            patch.object(Verdict, "converged", property(lambda _: True)),
            patch.object(diagnostics, "_burn_in", lambda *_: 0),
        ),
    ),
)
"""The faults."""

CONTROLS: tuple[InjectedFault, ...] = (
    *(
        InjectedFault(
            "a constant added to the log-likelihood",
            check,
            _changed(Density, "data_density", lambda value, *_: value + 12.3),
        )
        for check in (MANY, FEW)
    ),
    InjectedFault("nothing", WALK, tuple),
)
"""Changes that alter no posterior."""


def measured() -> list[dict[str, str]]:
    """Return a row for each fault and control: description, intended check, its message and its run time."""
    rows = []
    CONTROLS[-1].found()  # warm-up: library imports do not count in the time of any fault
    for fault in (*FAULTS, *CONTROLS):
        begun = time.process_time()
        said = fault.found()
        seconds = f"{time.process_time() - begun:.1f}"
        tables = "" if fault.check == WALK else str(fault.replicates)
        found = {"fault": fault.what, "check": fault.check, "replicates": tables, "found": said or "nothing"}
        rows.append({**found, "seconds": seconds})
    return rows


def main() -> None:
    """Inject every fault and write the table."""
    rows, text = measured(), io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_whole(TABLE, text.getvalue().encode())
    print(text.getvalue())


if __name__ == "__main__":
    main()
