"""Proposals of walkers.

emcee is imported only where its proposals are drawn. It imports `scipy.stats`, which takes a third of a second, and is
needed only in the processes that move walkers.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from softness_bayes.sampler.adaptation import TriangularMap

FloatArray = NDArray[np.float64]

Proposed = tuple[FloatArray, FloatArray]
"""Proposed points (walkers, dimension), and the log ratio of proposal densities, old over new, shape (walkers,)."""


class Proposal(Protocol):
    """A kind of proposal, whose ``repr`` contains everything that affects the draws."""

    in_halves: ClassVar[bool]
    """True if one half of the walkers moves at a time, as proposed from the positions of the other half."""

    def __call__(self, y: FloatArray, random: np.random.RandomState, others: FloatArray) -> Proposed:
        """Propose points for walkers.

        Parameters
        ----------
        y
            Map coordinates of the walkers, shape (walkers, dimension).
        random
            Random generator.
        others
            Map coordinates of the other half; without halves, of no walker.
        """


Moves = tuple[tuple[Proposal, float], ...]
"""Proposals with their probabilities."""


@dataclass(frozen=True)
class DifferentialEvolution:
    """Steps of ``factor`` times the difference of two other walkers; by default 2.38 / √(2 dimension)."""

    factor: float | None = None
    in_halves: ClassVar[bool] = True

    def __call__(self, y: FloatArray, random: np.random.RandomState, others: FloatArray) -> Proposed:
        """Propose a point for every walker."""
        from emcee.moves import DEMove

        move = DEMove(gamma0=self.factor)
        move.setup(y)
        return move.get_proposal(y, [others], random)


@dataclass(frozen=True)
class Student:
    """Proposals from Student's t about the origin, independent of the current positions.

    Its tails are heavier than normal, so that a walker in a tail not captured by the map does not get stuck.
    """

    freedom: float = 5.0
    in_halves: ClassVar[bool] = False

    def __call__(
        self, y: FloatArray, random: np.random.RandomState | np.random.Generator, others: FloatArray | None = None
    ) -> Proposed:
        """Propose a point for every walker."""
        shape = y.shape
        spread = np.sqrt(random.chisquare(self.freedom, shape[0]) / self.freedom)
        proposed = random.standard_normal(shape) / spread[:, None]
        return proposed, self.log_density(y) - self.log_density(proposed)

    def log_density(self, y: FloatArray) -> FloatArray:
        """Return the log density of Student's t up to a constant, shape (...), at ``y`` of shape (..., dimension)."""
        return -0.5 * (self.freedom + y.shape[-1]) * np.log1p((y**2).sum(axis=-1) / self.freedom)


@dataclass(frozen=True)
class StudentBlocks:
    """Proposals of new values for a random share of the coordinates of each walker; the others stay.

    The values are from Student's t about the origin. In many dimensions, a proposal of all coordinates at once is
    rarely accepted: one poorly mapped coordinate is enough to reject it. Most blocks do not contain that coordinate.
    """

    share: float = 0.2
    law: Student = Student()
    in_halves: ClassVar[bool] = False

    def __call__(self, y: FloatArray, random: np.random.RandomState, others: FloatArray | None = None) -> Proposed:
        """Propose a point for every walker."""
        walkers, dimension = y.shape
        # the choice of a block does not depend on the position, so that its probability cancels in the ratio
        block = random.uniform(size=y.shape) < self.share
        block[np.arange(walkers), random.randint(dimension, size=walkers)] = True
        proposed, _ = self.law(y, random)
        ratio = self._log_density(y, block) - self._log_density(proposed, block)
        return np.where(block, proposed, y), ratio

    def _log_density(self, y: FloatArray, block: NDArray[np.bool_]) -> FloatArray:
        """Log density of Student's t in the dimension of each block, up to a constant, shape (walkers,)."""
        freedom, size = self.law.freedom, block.sum(axis=-1)
        return -0.5 * (freedom + size) * np.log1p(np.where(block, y**2, 0.0).sum(axis=-1) / freedom)


@dataclass(frozen=True)
class OneParameter:
    """Proposals of a new value for one parameter of each walker, in sampler coordinates; the others stay.

    The value is from a Cauchy law about all draws. The rating may be the same at two values of a modulus, on either
    side of the turning point, with nothing between them: no step along the map leads from one to the other.

    Parameters
    ----------
    walkers
        The map that defines the walkers' coordinates y, which is known once it has been learnt.
    """

    walkers: TriangularMap | None = field(default=None, repr=False)
    in_halves: ClassVar[bool] = False

    def __call__(self, y: FloatArray, random: np.random.RandomState, others: FloatArray | None = None) -> Proposed:
        """Propose a point for every walker."""
        assert self.walkers is not None, "the sampler gives the map"
        centre, width = self.walkers.centre, np.sqrt((self.walkers.axes**2).sum(axis=1))
        before = self.walkers.forward(y)
        after, each, chosen = before.copy(), np.arange(len(y)), random.randint(y.shape[1], size=len(y))
        after[each, chosen] = (centre + width * random.standard_cauchy(len(y))[:, None])[each, chosen]
        proposed = self.walkers.inverse(after)
        # the law is one in sampler coordinates
        old, new = (-np.log1p((((z - centre) / width)[each, chosen]) ** 2) for z in (before, after))
        return proposed, old + self.walkers.log_volume(y) - new - self.walkers.log_volume(proposed)


@dataclass(frozen=True)
class StudentModes:
    """Proposals from an equally weighted mixture of Student's t laws, one about each mode.

    They move walkers between modes of any distance and width, so that the share of walkers in each mode is proportional
    to its mass.

    Parameters
    ----------
    law
        The law in the coordinates of a mode's own map, in which the mode is nearly standard normal.
    walkers, modes
        The map that defines the walkers' coordinates y, and those of the modes.
    """

    law: Student
    walkers: TriangularMap
    modes: tuple[TriangularMap, ...]
    in_halves: ClassVar[bool] = False

    def __call__(self, y: FloatArray, random: np.random.RandomState, others: FloatArray | None = None) -> Proposed:
        """Propose a point for every walker."""
        chosen = random.randint(len(self.modes), size=len(y))
        u, _ = self.law(y, random)
        proposed = np.empty_like(y)
        for k, mode in enumerate(self.modes):
            proposed[chosen == k] = self.walkers.inverse(mode.forward(u[chosen == k]))
        return proposed, self._log_density(y) - self._log_density(proposed)

    def _log_density(self, y: FloatArray) -> FloatArray:
        """Return the log density of the mixture in the walkers' coordinates, up to a constant, shape (walkers,)."""
        z = self.walkers.forward(y)
        each = ((mode, mode.inverse(z)) for mode in self.modes)
        of_each = [self.law.log_density(u) - mode.log_volume(u) for mode, u in each]
        return np.asarray(np.logaddexp.reduce(of_each, axis=0) + self.walkers.log_volume(y))


FIRST_MOVES: Moves = ((DifferentialEvolution(), 0.9), (DifferentialEvolution(1.0), 0.1))
"""Moves before the shape of the density is known."""

MOVES: Moves = (
    (Student(), 0.6),
    (DifferentialEvolution(), 0.27),
    (DifferentialEvolution(0.12), 0.1),  # short steps for walkers in a tail not captured by the map
    (DifferentialEvolution(1.0), 0.03),  # moves a walker from one mode to another
)
"""In the coordinates of the learnt map.

emcee's snooker move is not used: up to emcee 3.1.6 its acceptance uses half of the Jacobian's exponent, so that the
sampled distribution is too narrow (`tests/sampler/test_invariance.py` demonstrates both).
"""

MANY_DIMENSIONS = 20
"""Number of dimensions above which `MANY_DIMENSIONS_MOVES` are used."""

MANY_DIMENSIONS_MOVES: Moves = (
    (Student(20.0), 0.3),
    (OneParameter(), 0.25),
    (StudentBlocks(0.2), 0.15),
    (DifferentialEvolution(), 0.15),
    (DifferentialEvolution(0.12), 0.1),
    (DifferentialEvolution(1.0), 0.05),
)
"""`MOVES` with lighter tails, and with moves of some of the coordinates.

In 25 dimensions, proposals with 5 degrees of freedom are mostly too far out and double the number of steps of a run. In
30 dimensions (16 materials in brackets), walkers without moves of some coordinates waited so long, where the map was
poor, that no better map could be learnt. In few dimensions, such moves only take steps from better ones.
"""
