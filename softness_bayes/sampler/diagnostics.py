"""Convergence diagnostics of ensembles of walkers, as numbers and as one sentence."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.readable import counted, percent
from softness_bayes.sampler.chain_statistics import (
    autocorrelation_time,
    ess_bulk,
    ess_tail,
    indicator_time,
    own_time,
    r_hat_between,
)

FloatArray = NDArray[np.float64]

LOG_POSTERIOR = "log posterior"
"""Name of the log density, which is checked together with the parameters."""

_APART = 1.1  # R-hat of long ensembles above which they are in separate modes
_LONGER = 10.0  # ratio of the times about the common and individual means above which walkers are in separate modes
_TELLING = 10.0  # autocorrelation times after which a run provides a bound on its total length
_UNSEEN = 0.05  # probability of missing a mode for which `Starts.missed` is reported
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

    Parameters
    ----------
    lengths
        Kept steps of each ensemble, in autocorrelation times of its worst quantity.
    tau_change
        Largest relative change of that time since the previous check; see `tau_change`.
    r_hat
        Largest R-hat between ensembles.
    ess
        Smallest effective sample size, bulk and tail.
    looks
        Number of successive checks at which all of this must hold.
    burn_in
        Steps dropped at the start, in autocorrelation times of the second half of the run; at most half of the run.
    """

    lengths: float = 50.0
    tau_change: float = 0.03
    r_hat: float = 1.01
    ess: float = 400.0
    looks: int = 2
    burn_in: float = 5.0


class ModeShare(NamedTuple):
    """Share of the draws in one of several modes."""

    share: float
    """From 0 to 1."""
    error: float
    """Its Monte-Carlo standard error."""


class Foreseen(NamedTuple):
    """Total number of steps that a run needs, as estimated at a check."""

    steps: int
    most: float
    """Largest number to be expected; infinite if the run is too short for a bound."""


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
    tau_change
        Relative change of the longest time since the previous check; infinite at the first.
    r_hat
        R-hat between ensembles, shape (quantities,).
    ess_bulk, ess_tail
        Effective sample sizes, shape (quantities,); NaN as long as length, R-hat or the change of the time fails.
    acceptance
        Share of accepted proposals.
    stuck
        Number of walkers that never moved after the burn-in.
    looks_passed
        Number of successive checks, including this one, at which the criteria were met.
    goal
        The criteria.
    shares
        Share of each mode, if there are several.
    starts
        Result of the search for starting points.
    own
        Longest autocorrelation time, in steps, of any quantity and ensemble about the mean of each walker, if that
        about the common mean is too long for the goal; otherwise NaN.
    """

    names: tuple[str, ...]
    steps: int
    burn_in: int
    kept: int
    ensembles: int
    walkers: int
    tau: FloatArray
    tau_change: float
    r_hat: FloatArray
    ess_bulk: FloatArray
    ess_tail: FloatArray
    acceptance: float
    stuck: int
    looks_passed: int
    goal: Goal
    shares: tuple[ModeShare, ...] = ()
    starts: Starts = NO_STARTS
    own: float = math.nan

    @property
    def converged(self) -> bool:
        """True if the criteria were met at enough successive checks."""
        return self.looks_passed >= self.goal.looks

    @property
    def worst(self) -> int:
        """Index of the quantity with the longest autocorrelation time."""
        return int(self.tau.argmax())

    @property
    def lengths(self) -> float:
        """Retained steps divided by the longest autocorrelation time."""
        return self.kept / float(self.tau.max())

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
            1.02 * (goal.lengths + goal.burn_in) * tau - self.steps,
            self.kept * (goal.ess / float(np.nanmin([*self.ess_bulk, *self.ess_tail, math.inf])) - 1.0),
            # R-hat² - 1 is inversely proportional to the length if ensembles sample the same target
            self.kept * ((float(self.r_hat.max()) ** 2 - 1.0) / (goal.r_hat**2 - 1.0) - 1.0),
            0.05 * self.steps,
        ]
        return math.ceil(min(max(needs), 20.0 * self.steps))

    @property
    def foreseen(self) -> Foreseen:
        """Estimated total number of steps; too small if slow movements are not yet visible in a short run."""
        steps = self.steps + self.more_steps
        return Foreseen(steps, _AT_MOST * steps if self.lengths >= _TELLING else math.inf)

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
            held = [f"{s.share:.3f} ± {s.error:.3f}" for s in self.shares if s.share > 0]
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
        if not self.lengths >= goal.lengths and not self.stuck:
            kept = f"{self.lengths:.0f} autocorrelation times, {goal.lengths:.0f} needed"
            found.append(f"{kept} ({self.slowest})")
        if not self.r_hat.max() <= goal.r_hat:
            apart = self.names[int(self.r_hat.argmax())]
            found.append(f"ensembles disagree about {apart} (R-hat {self.r_hat.max():.2f})")
        for kind, ess in (("bulk", self.ess_bulk), ("tail", self.ess_tail)):
            if ess.min() < goal.ess:
                found.append(f"{kind} ESS of {self.names[int(ess.argmin())]} is {ess.min():.0f}, {goal.ess:.0f} needed")
        if not found and not self.tau_change <= goal.tau_change:
            change = "not yet compared" if math.isinf(self.tau_change) else f"changed by {100 * self.tau_change:.0f} %"
            found.append(f"the autocorrelation time of {self.names[self.worst]} {change}")
        if self.modes:
            long = f"although each is longer than {goal.lengths:.0f} of its autocorrelation times"
            found.append(f"{self.modes}, {long}: more steps may not help")
        return found or [f"all criteria hold at this check, but {goal.looks} successive checks are required"]

    @property
    def modes(self) -> str:
        """Description of ensembles or walkers that seem to be in separate modes; empty if there are none.

        Indications are ensembles that disagree strongly, or an autocorrelation time about the common mean that is many
        times longer than about individual means, although the run is long in terms of the latter.
        """
        alone = float(self.tau.max()) if math.isnan(self.own) else self.own
        if not self.kept >= self.goal.lengths * alone:
            return ""
        if self.r_hat.max() > _APART:
            return f"the ensembles are in separate modes of {self.names[int(self.r_hat.argmax())]}"
        if self.tau.max() > _LONGER * alone:
            return f"walkers of an ensemble are in separate modes of {self.names[self.worst]}"
        return ""


def look(
    names: tuple[str, ...],
    values: FloatArray,
    stride: int = 1,
    acceptance: float = math.nan,
    before: Verdict | None = None,
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
    acceptance
        Share of accepted proposals, for the record.
    before
        Verdict of the previous check.
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
    first = _burn_in(walks, goal)
    walks = walks[..., first:, :]
    tau, r_hat = _times(walks), r_hat_between(walks)
    shares: tuple[ModeShare, ...] = ()
    if inside is not None:
        shares, times, apart = _shares(inside[:, first:])
        names = (*names, *(f"the share of mode {k}" for k in range(1, len(shares) + 1)))
        tau = np.concatenate([tau, times])
        r_hat = np.concatenate([r_hat, apart])
    kept, change = stored - first, math.inf
    if before is not None and np.isfinite(tau).all():
        change = tau_change(tau * stride, before.tau)
    missing = np.full(len(names), math.nan)
    ess = (missing, missing)
    # effective sample sizes take longest, and are computed only if all other criteria hold
    fits = kept >= goal.lengths * tau.max() and r_hat.max() <= goal.r_hat and change <= goal.tau_change
    if fits:
        count = values[..., 0].size * kept / stored / tau[walks.shape[1] :]  # of the modes' indicators
        ess = (np.concatenate([ess_bulk(walks, tau), count]), np.concatenate([ess_tail(walks, tau), count]))
    passed = bool(fits and min(ess[0].min(), ess[1].min()) >= goal.ess)
    own = float(own_time(walks).max()) * stride if kept < goal.lengths * tau.max() else math.nan
    moved = (np.ptp(walks, axis=-2) > 0).any(axis=1)
    return Verdict(
        names=names,
        steps=stored * stride,
        burn_in=first * stride,
        kept=kept * stride,
        ensembles=len(values),
        walkers=walkers,
        tau=tau * stride,
        tau_change=change,
        r_hat=r_hat,
        ess_bulk=ess[0],
        ess_tail=ess[1],
        acceptance=acceptance,
        stuck=int((~moved).sum()),
        looks_passed=(before.looks_passed if before is not None else 0) + 1 if passed else 0,
        goal=goal,
        shares=shares,
        starts=starts,
        own=own,
    )


def _times(walks: FloatArray) -> FloatArray:
    """Return the autocorrelation time of each quantity, from walks of shape (ensembles, quantities, stored, walkers).

    The walkers of all ensembles share one mean: their times are of one chain, and known twice as well from all of them.
    """
    return np.array([autocorrelation_time(np.concatenate([*walks[:, k]], axis=-1)) for k in range(walks.shape[1])])


def _burn_in(walks: FloatArray, goal: Goal) -> int:
    """Return how many stored steps to drop, of walks of shape (ensembles, quantities, stored, walkers)."""
    stored = walks.shape[2]
    late = _times(walks[:, :, stored // 2 :])
    reach = np.where(np.isfinite(late), late, np.inf).max()
    return int(min(math.ceil(goal.burn_in * min(reach, stored)), stored // 2))


def tau_change(tau: FloatArray, before: FloatArray) -> float:
    """Return the relative change of the longest autocorrelation time between two checks.

    Two quantities with almost the same time take turns as the slowest. The time of each may change although the longest
    does not, and the longest may change although the time of its quantity does not: the smaller change counts.

    Parameters
    ----------
    tau, before
        Time of each quantity at the two checks [steps], shape (quantities,).
    """
    worst = int(tau.argmax())
    return float(min(abs(tau[worst] / before[worst] - 1.0), abs(tau[worst] / before.max() - 1.0)))


def _shares(inside: NDArray[np.bool_]) -> tuple[tuple[ModeShare, ...], FloatArray, FloatArray]:
    """Return each mode's share, the autocorrelation time of being in it, and R-hat between ensembles.

    All walkers of all ensembles share one mean. If no walker moves between modes, the time is as long as the walk.
    A mode with no draws, or with all of them, cannot be judged and counts as well mixed.
    """
    walks = np.moveaxis(inside, -1, 1).astype(float)
    modes = walks.shape[1]
    share = walks.mean(axis=(0, 2, 3))
    mixed = (share > 0) & (share < 1)
    together = np.moveaxis(walks, 0, -2).reshape(modes, walks.shape[2], -1)
    times, apart = np.ones(modes), np.ones(modes)
    times[mixed] = indicator_time(together[mixed], np.full(int(mixed.sum()), 0.5))
    half = walks.shape[2] // 2
    halves = np.concatenate([walks[:, :, :half].mean(axis=(2, 3)), walks[:, :, half:].mean(axis=(2, 3))])
    # split R-hat; ranks and folding add nothing for a quantity that is 0 or 1
    within = (halves * (1.0 - halves)).mean(axis=0)
    with np.errstate(divide="ignore"):  # ensembles that never change modes
        apart[mixed] = np.sqrt(1.0 + halves.var(axis=0, ddof=1)[mixed] / within[mixed])
    error = np.sqrt(share * (1.0 - share) * times / walks[:, 0].size)
    return tuple(ModeShare(*one) for one in zip(share.tolist(), error.tolist(), strict=True)), times, apart
