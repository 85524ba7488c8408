"""Convergence diagnostics of ensembles of walkers, as numbers and as one sentence."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.base.defaults import STEPS_PER_TAU
from softness_bayes.base.readable import counted, percent
from softness_bayes.sampler.chain_statistics import (
    Estimate,
    autocorrelation_time,
    ess_between,
    ess_bulk,
    ess_tail,
    own_time,
    pooled_time,
    r_hat_between,
)

FloatArray = NDArray[np.float64]

LOG_POSTERIOR = "log posterior"
"""Name of the log density, which is checked together with the parameters."""

_APART = 1.1  # R-hat of long ensembles above which they are in separate modes
_ALONE = 50.0  # least length in times about individual means, which shorter runs underestimate, to tell modes apart
_LONGER = 10.0  # ratio of the times about the common and individual means above which walkers are in separate modes
_TELLING = 4.0  # autocorrelation times after which a run provides a bound on its total length
_UNSEEN = 0.05  # probability of missing a mode for which `Starts.missed` is reported
_ROUGH = 4.0  # factor within which the effective sample size from the differences of four ensembles is right
_AT_MOST = 2.0  # largest ratio of the final length to the one estimated from there on


class Starts(NamedTuple):
    """Result of the search for starting points."""

    climbs: int = 0
    """Optimised points."""
    hopeless: int = 0
    """Number of optimised points with negligible mass."""
    modes: int = 0
    """Number of separate modes among the optimised points of larger mass."""

    @property
    def missed(self) -> float:
        """Share p of the basin of a mode that all optimisations miss with probability 5 %: (1 - p)^climbs = 0.05."""
        return 1.0 if not self.climbs else float(1.0 - _UNSEEN ** (1.0 / self.climbs))


NO_STARTS = Starts()
"""Result for starting points without a search."""


@dataclass(frozen=True)
class Goal:
    """Criteria of convergence.

    A single ensemble needs 50 autocorrelation times (emcee's rule), because its estimate of that time is too short in a
    short run. Here the differences between independent ensembles measure the error of the time and that of the means.

    Parameters
    ----------
    lengths
        Kept steps of each ensemble, in autocorrelation times of its worst quantity. A standard error is added to this
        time, because it is uncertain.
    r_hat
        Largest R-hat between ensembles.
    ess
        Smallest effective sample size, bulk and tail: with 1600, quantiles of 5 % have errors of 0.05 to 0.06 sd. A
        quarter of it is required of the rough sizes from the differences between ensembles.
    burn_in
        Steps dropped at the start, in autocorrelation times of the second half of the run; at most half of the run.
    """

    lengths: float = STEPS_PER_TAU
    r_hat: float = 1.01
    ess: float = 1600.0
    burn_in: float = 5.0


@dataclass(frozen=True)
class Verdict:
    """Result of one convergence check.

    Parameters
    ----------
    names
        Checked quantities: the parameters, the log posterior, and the shares of the modes if there are several.
    steps, burn_in, kept
        Numbers of steps of each ensemble: in total, dropped at the start, and retained.
    ensembles, walkers
        Ensembles, and walkers of each.
    tau
        Autocorrelation time of each quantity in steps, about the mean of the walkers of all ensembles, shape
        (quantities,).
    tau_error
        Relative standard error of the longest time, from its differences between ensembles.
    r_hat
        R-hat between ensembles, shape (quantities,).
    ess_bulk, ess_tail
        Effective sample sizes, shape (quantities,); NaN as long as length or R-hat fails.
    ess_between
        The smaller one of bulk and tail from the differences between ensembles, shape (quantities,).
    stuck
        Number of walkers that never moved after the burn-in.
    goal
        The criteria.
    shares
        Share of each mode, if there are several.
    starts
        Result of the search for starting points.
    own
        Longest autocorrelation time, in steps, of any quantity and ensemble about the mean of each walker.
    """

    names: tuple[str, ...]
    steps: int
    burn_in: int
    kept: int
    ensembles: int
    walkers: int
    tau: FloatArray
    tau_error: float
    r_hat: FloatArray
    ess_bulk: FloatArray
    ess_tail: FloatArray
    ess_between: FloatArray
    stuck: int
    goal: Goal
    shares: tuple[Estimate, ...] = ()
    starts: Starts = NO_STARTS
    own: float = math.inf

    @property
    def converged(self) -> bool:
        """True if all criteria are met."""
        return self.agrees and bool(min(self.ess, _ROUGH * self.ess_between.min()) >= self.goal.ess)

    @property
    def agrees(self) -> bool:
        """True if length and R-hat meet the criteria, so that sample sizes are worth computing."""
        return bool(self.lengths >= self.needed and self.r_hat.max() <= self.goal.r_hat)

    @property
    def worst(self) -> int:
        """Index of the quantity with the longest autocorrelation time."""
        return int(self.tau.argmax())

    @property
    def lengths(self) -> float:
        """Retained steps divided by the longest autocorrelation time."""
        return self.kept / float(self.tau.max())

    @property
    def needed(self) -> float:
        """Required ratio of retained steps to the longest autocorrelation time, with the error of this time."""
        return self.goal.lengths * (1.0 + self.tau_error)

    @property
    def ess(self) -> float:
        """Smallest effective sample size; until computed, an estimate from the longest autocorrelation time."""
        known = float(np.min([*self.ess_bulk, *self.ess_tail]))
        return known if math.isfinite(known) else self.ensembles * self.walkers * self.lengths

    @property
    def more_steps(self) -> int:
        """Estimated number of further steps; 0 when converged."""
        if self.converged:
            return 0
        goal, tau = self.goal, float(self.tau.max())
        if not math.isfinite(tau):
            return self.steps
        needs = [
            1.02 * (goal.lengths * (1.0 + min(self.tau_error, 0.5)) + goal.burn_in) * tau - self.steps,
            self.kept * (goal.ess / self.ess - 1.0),
            self.kept * (goal.ess / (_ROUGH * float(np.nanmin([*self.ess_between, math.inf]))) - 1.0),
            # R-hat² - 1 is inversely proportional to the length if ensembles sample the same target
            self.kept * ((float(self.r_hat.max()) ** 2 - 1.0) / (goal.r_hat**2 - 1.0) - 1.0),
            0.05 * self.steps,
        ]
        return math.ceil(min(max(needs), 20.0 * self.steps))

    @property
    def foreseen(self) -> tuple[int, float]:
        """Estimated total number of steps, and the largest one to be expected.

        The first is too small if slow movements are not yet visible in a short run; the second is then infinite.
        """
        steps = self.steps + self.more_steps
        return steps, _AT_MOST * steps if self.lengths >= _TELLING else math.inf

    def sentence(self) -> str:
        """Return the verdict in one line, with the unmet criteria and the estimated number of further steps."""
        head = f"after {self.steps} steps of {self.ensembles} x {self.walkers} walkers"
        if self.converged:
            return (
                f"Converged {head}: {self.lengths:.0f} autocorrelation times ({self.slowest}), R-hat <= "
                f"{self.r_hat.max():.3f}, ESS >= {self.ess_bulk.min():.0f} (bulk) and "
                f"{self.ess_tail.min():.0f} (tail).{self._starts()}"
            )
        shortfalls = "; ".join(self._shortfalls())
        return f"Not converged {head}: {shortfalls}; about {self.more_steps} more steps are needed.{self._starts()}"

    @property
    def slowest(self) -> str:
        """The longest autocorrelation time in words."""
        return f"{self.tau.max():.0f} steps for the slowest quantity, {self.names[self.worst]}"

    def _starts(self) -> str:
        """Describe the number of modes, and how well the search for them covers the prior."""
        climbs, hopeless, _ = self.starts
        if self.shares:
            held = [f"{share.value:.3f} ± {share.error:.3f}" for share in self.shares if share.value > 0]
            left = len(self.shares) - len(held)
            also = (
                f"; {left} more, found by optimisation from prior draws, contain{'s' * (left == 1)} none"
                if left
                else ""
            )
            if len(held) == 1:
                return f" All draws are in one mode{also}."
            return f" {len(held)} modes contain {' and '.join(held)} of the draws{also}."
        if not climbs:
            return ""
        found = f"All {climbs} optimisations" if not hopeless else f"{climbs - hopeless} of {climbs} optimisations"
        others = ", the others to negligible mass" if hopeless else ""
        missed = f"a mode that fewer than {percent(self.starts.missed)} of optimisations reach may have been missed"
        return f" {found} from prior draws led to one mode{others}; {missed}."

    def _shortfalls(self) -> list[str]:
        goal, found = self.goal, []
        if self.stuck:
            found.append(f"{counted(self.stuck, 'walker')} never moved")
        if not self.lengths >= self.needed and not self.stuck:
            kept = f"{self.lengths:.1f} autocorrelation times, {self.needed:.1f} needed"
            found.append(f"{kept} ({self.slowest})")
        if not self.r_hat.max() <= goal.r_hat:
            apart = self.names[int(self.r_hat.argmax())]
            found.append(f"ensembles disagree about {apart} (R-hat {self.r_hat.max():.2f})")
        for kind, ess in (("bulk", self.ess_bulk), ("tail", self.ess_tail)):
            if ess.min() < goal.ess:
                found.append(f"{kind} ESS of {self.names[int(ess.argmin())]} is {ess.min():.0f}, {goal.ess:.0f} needed")
        if self.ess_between.min() < goal.ess / _ROUGH:
            apart, size = self.names[int(self.ess_between.argmin())], self.ess_between.min()
            found.append(f"ensembles differ in {apart} as if ESS were {size:.0f}, {goal.ess / _ROUGH:.0f} needed")
        if self.modes:
            long = f"although each is longer than {_ALONE:.0f} of its autocorrelation times"
            found.append(f"{self.modes}, {long}: more steps may not help")
        return found

    @property
    def modes(self) -> str:
        """Description of ensembles or walkers that seem to be in separate modes; empty if there are none.

        Indications are ensembles that disagree strongly, or an autocorrelation time about the common mean that is many
        times longer than about individual means, although the run is long in terms of the latter.
        """
        if not self.kept >= _ALONE * self.own:
            return ""
        if self.r_hat.max() > _APART:
            return f"the ensembles are in separate modes of {self.names[int(self.r_hat.argmax())]}"
        if self.tau.max() > _LONGER * self.own:
            return f"walkers of an ensemble are in separate modes of {self.names[self.worst]}"
        return ""


def look(
    names: tuple[str, ...],
    values: FloatArray,
    stride: int = 1,
    goal: Goal = Goal(),
    inside: NDArray[np.bool_] | None = None,
    starts: Starts = NO_STARTS,
) -> Verdict:
    """Check the chains for convergence.

    Parameters
    ----------
    names
        Names of the quantities.
    values
        Their stored values since the first step, shape (ensembles, stored, walkers, quantities).
    stride
        Number of steps per stored step.
    goal
        Criteria of convergence.
    inside
        If the density has several modes, whether each draw is in each mode, shape (ensembles, stored, walkers,
        modes). Their shares are checked like the other quantities.
    starts
        Result of the search for starting points, for the record.
    """
    _, stored, walkers, _ = values.shape
    walks = np.moveaxis(values, -1, 1)
    late = _times(walks[:, :, stored // 2 :])
    reach = np.where(np.isfinite(late), late, np.inf).max()
    first = int(min(math.ceil(goal.burn_in * min(reach, stored)), stored // 2))
    walks = walks[..., first:, :]
    kept, tau, own = stored - first, _times(walks), float(own_time(walks).max())
    moved = (np.ptp(walks, axis=-2) > 0).any(axis=1)
    shares: tuple[Estimate, ...] = ()
    if inside is not None:
        held = np.moveaxis(inside[:, first:], -1, 1).astype(float)
        share = held.mean(axis=(0, 2, 3))
        mixed = np.flatnonzero((share > 0) & (share < 1))  # the others cannot be judged
        times = np.ones(share.size)
        times[mixed] = _times(held[:, mixed], pooled_time)
        error = np.sqrt(share * (1.0 - share) * times / held[:, 0].size)
        shares = tuple(Estimate(*one) for one in zip(share.tolist(), error.tolist(), strict=True))
        walks, tau = np.concatenate([walks, held[:, mixed]], axis=1), np.concatenate([tau, times[mixed]])
        names = (*names, *(f"the share of mode {k + 1}" for k in mixed))
    worst, missing = int(tau.argmax()), np.full(len(names), math.nan)
    of_each = pooled_time(walks[:, worst])
    known = math.isfinite(tau[worst]) and np.isfinite(of_each).all()
    tau_error = float(of_each.std(ddof=1) / math.sqrt(of_each.size) / of_each.mean()) if known else math.inf
    verdict = Verdict(
        names=names,
        steps=stored * stride,
        burn_in=first * stride,
        kept=kept * stride,
        ensembles=len(values),
        walkers=walkers,
        tau=tau * stride,
        tau_error=tau_error,
        r_hat=r_hat_between(walks),
        ess_bulk=missing,
        ess_tail=missing,
        ess_between=missing,
        stuck=int((~moved).sum()),
        goal=goal,
        shares=shares,
        starts=starts,
        own=own * stride,
    )
    if not verdict.agrees:
        return verdict
    # effective sample sizes take longest, and are computed only if all other criteria hold
    bulk, quantities = ess_bulk(walks, tau), values.shape[-1]
    # a share is a mean of zeros and ones, which has no tails
    tail = np.concatenate([ess_tail(walks[:, :quantities], tau[:quantities]), bulk[quantities:]])
    return replace(verdict, ess_bulk=bulk, ess_tail=tail, ess_between=ess_between(walks))


def _times(walks: FloatArray, time: Callable[[FloatArray], FloatArray] = autocorrelation_time) -> FloatArray:
    """Return the autocorrelation time of each quantity, from walks of shape (ensembles, quantities, stored, walkers).

    The walkers of all ensembles share one mean: their times are of one chain, and known twice as well from all of them.
    """
    return np.array([float(time(np.concatenate([*walks[:, k]], axis=-1))) for k in range(walks.shape[1])])
