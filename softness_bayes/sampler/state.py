"""State of a run: all that is needed to continue it bit by bit, as values."""

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
    """All that is needed to continue an ensemble bit by bit, besides the map and the moves."""

    coordinates: FloatArray
    """Map coordinates y of the walkers, shape (walkers, dimension)."""
    log_density: FloatArray
    """Their log density in sampler coordinates, shape (walkers,)."""
    random: tuple[Any, ...]
    """State of the generator, as `numpy.random.RandomState.get_state` gives it."""


@dataclass(frozen=True)
class RunState:
    """A run between two steps.

    Parameters
    ----------
    phase
        Completed stages of the pilot walk, including walks that were too slow; in the walk that counts at least as many
        as the schedule has.
    steps
        Steps walked in this phase.
    stride
        Steps of the walk for one stored.
    due
        Step of the next convergence check.
    ensembles
        States of the ensembles.
    map
        Coordinates in which the moves are made.
    parts
        Segments that each ensemble has drawn in this phase.
    before
        The last scheduled check, with which the next is compared.
    verdict
        The last check of all, which may have been made because a limit was reached.
    modes
        Maps of the separate modes, if there are several, the one with most draws first.
    starts
        Result of the search for starting points.
    nonfinite
        Points at which the density could not be computed.
    seconds
        Time spent so far, earlier sessions included.
    ended
        Whether the run has converged or reached a limit.
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

    @property
    def chains(self) -> Chains:
        """Draws of the ensembles in this phase, which must have a step."""
        return Chains.of((Segment.join(part) for part in self.parts), self.steps, self.stride)
