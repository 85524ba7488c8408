"""Proposals of walkers, as values that make emcee's moves when a walk begins.

emcee is imported only when a walk begins. It imports SciPy's statistics, which takes a third of a second, and only
the processes in which walkers walk need it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from softness_bayes.sampler.adaptation import TriangularMap

if TYPE_CHECKING:
    from emcee.moves import Move

FloatArray = NDArray[np.float64]


class Mode(NamedTuple):
    """A mode of the density, for walkers that move in the coordinates of a map."""

    walkers: TriangularMap
    """The map that defines the walkers' coordinates y."""
    own: TriangularMap
    """The mode's own map, in whose coordinates u the mode is near a standard normal law."""

    def forward(self, u: FloatArray) -> FloatArray:
        """Return the walkers' coordinates y of points in the mode's coordinates."""
        return self.walkers.inverse(self.own.forward(u))

    def inverse(self, y: FloatArray) -> FloatArray:
        """Return the mode's coordinates of walkers at ``y``."""
        return self.own.inverse(self.walkers.forward(y))


class Proposal(Protocol):
    """A kind of proposal, whose ``repr`` contains everything that affects the draws."""

    def made(self) -> Move:
        """Return emcee's move for this proposal; a new one each time, because emcee stores state in it."""


Moves = tuple[tuple[Proposal, float], ...]
"""Proposals with their probabilities."""


@dataclass(frozen=True)
class Stretch:
    """Goodman and Weare's stretch along the line to another walker; emcee's own default."""

    def made(self) -> Move:
        """Make emcee's move."""
        from emcee.moves import StretchMove

        return StretchMove()


@dataclass(frozen=True)
class DifferentialEvolution:
    """Steps along the difference of two other walkers, ``factor`` times as long; 2.38 / √(2 dimension) if left out."""

    factor: float | None = None

    def made(self) -> Move:
        """Make emcee's move."""
        from emcee.moves import DEMove

        return DEMove(gamma0=self.factor)


@dataclass(frozen=True)
class Student:
    """Proposals from Student's law about the origin, independent of the walkers' places.

    Its tails are heavier than those of a normal law, so that a walker in a tail that the map misses is not stuck.
    """

    freedom: float = 5.0

    def made(self) -> Move:
        """Make emcee's move, which takes this as its proposals."""
        from emcee.moves import MHMove

        return MHMove(self)

    def __call__(self, coordinates: FloatArray, random: np.random.RandomState) -> tuple[FloatArray, FloatArray]:
        """Propose a point for every walker; return also the log ratio of the proposal's densities, old over new."""
        shape = coordinates.shape
        spread = np.sqrt(random.chisquare(self.freedom, shape[0]) / self.freedom)
        proposed = random.standard_normal(shape) / spread[:, None]
        return proposed, self.log_density(coordinates) - self.log_density(proposed)

    def log_density(self, y: FloatArray) -> FloatArray:
        """Return the log density of Student's law up to a constant, shape (...), at ``y`` of shape (..., dimension)."""
        return -0.5 * (self.freedom + y.shape[-1]) * np.log1p((y**2).sum(axis=-1) / self.freedom)


@dataclass(frozen=True)
class StudentModes:
    """Proposals from a mixture of Student's laws, one about each mode and all of the same weight.

    They carry walkers from one mode to any other, at any distance and of any width, so that each mode gets walkers
    in proportion to its mass.
    """

    law: Student
    modes: tuple[Mode, ...]

    def made(self) -> Move:
        """Make emcee's move, which takes this as its proposals."""
        from emcee.moves import MHMove

        return MHMove(self)

    def __call__(self, coordinates: FloatArray, random: np.random.RandomState) -> tuple[FloatArray, FloatArray]:
        """Propose a point for every walker; return also the log ratio of the proposal's densities, old over new."""
        chosen = random.randint(len(self.modes), size=len(coordinates))
        u, _ = self.law(coordinates, random)
        proposed = np.empty_like(coordinates)
        for k, mode in enumerate(self.modes):
            proposed[chosen == k] = mode.forward(u[chosen == k])
        return proposed, self._log_density(coordinates) - self._log_density(proposed)

    def _log_density(self, y: FloatArray) -> FloatArray:
        of_each = [self.law.log_density(mode.inverse(y)) - mode.own.log_volume for mode in self.modes]
        return np.asarray(np.logaddexp.reduce(of_each, axis=0))


def leaping(moves: Moves, modes: Sequence[Mode]) -> Moves:
    """Return the moves on a density with several modes: proposals about the origin become proposals about each mode."""
    return tuple(
        (StudentModes(proposal, tuple(modes)) if modes and isinstance(proposal, Student) else proposal, share)
        for proposal, share in moves
    )


FIRST_MOVES: Moves = ((DifferentialEvolution(), 0.9), (DifferentialEvolution(1.0), 0.1))
"""Moves before the density's shape is known."""

STRETCH: Moves = ((Stretch(), 1.0),)
"""Moves for comparison in the benchmark."""

MOVES: Moves = (
    (Student(), 0.6),
    (DifferentialEvolution(), 0.27),
    (DifferentialEvolution(0.12), 0.1),  # short steps for a walker in a tail that the map misses
    (DifferentialEvolution(1.0), 0.03),  # carries a walker from one mode to another
)
"""In the coordinates of the learnt map.

emcee's snooker move is not among them: up to emcee 3.1.6 its acceptance takes half of the Jacobian's exponent,
which narrows what it samples (`tests/sampler/test_invariance.py` shows both).
"""

MANY_DIMENSIONS = 20
"""Number of dimensions above which `MANY_DIMENSIONS_MOVES` are taken."""

MANY_DIMENSIONS_MOVES: Moves = ((Student(20.0), MOVES[0][1]), *MOVES[1:])
"""As `MOVES`, with lighter tails: in 25 dimensions proposals of 5 degrees of freedom are mostly too far out, and a run
takes twice as many steps."""
