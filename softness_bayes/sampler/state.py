"""State of a run: all values needed to continue it with bitwise identical draws."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.sampler.adaptation import TriangularMap
from softness_bayes.sampler.chains import Chains, Segment
from softness_bayes.sampler.diagnostics import Verdict
from softness_bayes.sampler.nonfinite import Nonfinite
from softness_bayes.sampler.starts import NO_STARTS, Starts

FloatArray = NDArray[np.float64]


class EnsembleState(NamedTuple):
    """All values needed to continue an ensemble with bitwise identical draws, except the map and the moves."""

    coordinates: FloatArray
    """Map coordinates y of the walkers, shape (walkers, dimension)."""
    log_density: FloatArray
    """Their log density in sampler coordinates, shape (walkers,)."""
    random: tuple[Any, ...]
    """State of the generator, from `numpy.random.RandomState.get_state`."""


@dataclass(frozen=True)
class RunState:
    """A run between two steps.

    Parameters
    ----------
    phase
        Number of completed stages of the pilot run, including runs that were too slow; in the final run, at least the
        number of stages in the schedule.
    steps
        Number of steps in this phase.
    stride
        Number of steps per stored step.
    due
        Step of the next convergence check.
    ensembles
        States of the ensembles.
    map
        Coordinates in which the moves are made.
    parts
        Segments drawn by each ensemble in this phase.
    before
        The last scheduled check, with which the next one is compared.
    verdict
        The most recent check, possibly made because a limit was reached.
    modes
        Maps of the separate modes, if there are several, ordered by decreasing number of draws.
    starts
        Result of the search for starting points.
    nonfinite
        Points at which the density could not be computed.
    seconds
        Time spent so far, including earlier sessions.
    ended
        Whether the run has converged or reached a limit.
    relearnt
        Number of steps of the slow run from which the map was learnt; 0 if it was learnt from the pilot run.
    """

    phase: int
    steps: int
    stride: int
    due: int
    ensembles: tuple[EnsembleState, ...]
    map: TriangularMap
    parts: tuple[tuple[Segment, ...], ...]
    before: Verdict | None = None
    verdict: Verdict | None = None
    modes: tuple[TriangularMap, ...] = ()
    starts: Starts = NO_STARTS
    nonfinite: Nonfinite = field(default_factory=Nonfinite)
    seconds: float = 0.0
    ended: bool = False
    relearnt: int = 0

    @property
    def chains(self) -> Chains:
        """Draws of the ensembles in this phase, which must have at least one step."""
        return Chains.of((Segment.join(part) for part in self.parts), self.steps, self.stride)
