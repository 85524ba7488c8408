"""What a rigid plate's force on fingerpads says of the skin, every finger's own skin integrated out."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.errors import InputError
from softness_bayes.touch.contact import STRAIN, Finger, SkinDisplacement
from softness_bayes.touch.plate import plate_line

Array = NDArray[np.float64]

_LEAST_VARIANCE = 1e-100
_LOG_TWO_PI = math.log(2.0 * math.pi)

FEW_POINTS = 10
"""Forces of a finger below which a check of how they grow is called weak."""

HERTZ_EXPONENT = 1.5
"""Power of the indentation that force follows on skin that does not stiffen."""


class SkinParameters(NamedTuple):
    """Skin, and how fingers and single forces depart from it; numbers or arrays of the batch shape (...)."""

    b: ArrayLike
    """Modulus at rest of the typical finger [Pa]."""
    m: ArrayLike
    """Its stiffening ([-] or [1/m], as the reading of the displacement has it)."""
    tau_b: ArrayLike
    """Standard deviation of ln b between fingers [-]."""
    tau_m: ArrayLike
    """Standard deviation of m between fingers."""
    varsigma_f: ArrayLike
    """Standard deviation of a force's log about its finger's [-]."""


class FingerEffects(NamedTuple):
    """How fingers depart from the typical one, both of shape (..., fingers)."""

    log_b: Array
    """In ln b."""
    m: Array
    """In m."""


class CompressionForces:
    """Forces of a rigid plate, ln F = ln b_j + m_j u + c + e, fingers and noise integrated out.

    ln b_j ~ N(ln b, tau_b²), m_j ~ N(m, tau_m²), e ~ N(0, varsigma_f²); u and c are those of `plate_line`.
    The forces of a finger are turned so that two of them carry all that they say of its skin and the rest
    is noise: a 2 x 2 normal law for each finger, in closed form.

    Parameters
    ----------
    indentation, force
        delta [m] and F [N] of every row, shape (rows,), positive.
    finger
        Index of each row's finger, shape (rows,).
    n_fingers
        Their number.
    shape, displacement
        The fingertip, and the reading of its displacement.

    Raises
    ------
    InputError
        If there is no row, or an indentation or a force is not a positive number.
    """

    def __init__(
        self,
        indentation: ArrayLike,
        force: ArrayLike,
        finger: ArrayLike,
        n_fingers: int,
        shape: Finger = Finger(),
        displacement: SkinDisplacement = STRAIN,
    ) -> None:
        self.indentation, self.force = np.array(indentation, float), np.array(force, float)
        self.finger, self.n_fingers = np.array(finger, np.intp), n_fingers
        if not self.force.size:
            raise InputError("compression: no force at all, there is nothing to learn from")
        for what, values in (("an indentation", self.indentation), ("a force", self.force)):
            if not (np.isfinite(values) & (values > 0)).all():
                raise InputError(f"compression: {what} is not a positive number")
        self.displacement = displacement
        self._line = plate_line(self.indentation, shape, displacement)
        known = np.log(self.force) - self._line.offset
        self._turn = np.zeros((n_fingers, 2, 2))
        self._turned = np.zeros((n_fingers, 2))
        self._noise = 0.0
        for j in range(n_fingers):
            own = self.finger == j
            # two rows of zeros: fingers with fewer than two forces need no case of their own
            columns = np.vstack([np.column_stack([np.ones(own.sum()), self._line.slope[own]]), np.zeros((2, 2))])
            basis, self._turn[j] = np.linalg.qr(columns)
            padded = np.append(known[own], [0.0, 0.0])
            self._turned[j] = basis.T @ padded
            self._noise += float(((padded - basis @ self._turned[j]) ** 2).sum())

    @property
    def n_rows(self) -> int:
        """Number of forces."""
        return self.force.size

    def log_likelihood(self, parameters: SkinParameters) -> Array:
        """Log density of all forces [1/N each] at parameters of batch shape (...), shape (...)."""
        law = self._law(parameters)
        noise = (self.n_rows - 2 * self.n_fingers) * (_LOG_TWO_PI + np.log(law.variance)) + self._noise / law.variance
        determinant = np.log(law.second * law.first_given).sum(axis=-1) + 2 * self.n_fingers * _LOG_TWO_PI
        quadratic = (law.residual[..., 1] ** 2 / law.second + law.apart**2 / law.first_given).sum(axis=-1)
        return np.asarray(-0.5 * (noise + determinant + quadratic) - np.log(self.force).sum())

    def draw_effects(self, rng: np.random.Generator, parameters: SkinParameters) -> FingerEffects:
        """Exact draws of how the fingers depart, given their forces, one for each point of the batch.

        A draw without the forces is corrected by what it would have been taken for (Matheron's rule).
        """
        law = self._law(parameters)
        shape = law.residual.shape[:-1]
        blank = self.new_fingers(rng, parameters, shape[:-1])
        tau_b, tau_m = (np.asarray(v, float)[..., None] for v in (parameters.tau_b, parameters.tau_m))
        turn = self._turn
        noise = np.sqrt(law.variance)[..., None, None] * rng.standard_normal((*shape, 2))
        made = np.einsum("jab,...jb->...ja", turn, np.stack([blank.log_b, blank.m], axis=-1)) + noise
        gap = law.residual - made
        # the inverse of the 2 x 2 covariance applied to the gap
        first = (gap[..., 0] - law.gain * gap[..., 1]) / law.first_given
        solved = np.stack([first, gap[..., 1] / law.second - law.gain * first], axis=-1)
        pulled = np.einsum("jab,...ja->...jb", turn, solved)
        return FingerEffects(blank.log_b + tau_b**2 * pulled[..., 0], blank.m + tau_m**2 * pulled[..., 1])

    def new_fingers(
        self, rng: np.random.Generator, parameters: SkinParameters, shape: tuple[int, ...]
    ) -> FingerEffects:
        """Departures of as many new fingers, of batch ``shape``."""
        spreads = (parameters.tau_b, parameters.tau_m)
        return FingerEffects(
            *(np.asarray(v, float)[..., None] * rng.standard_normal((*shape, self.n_fingers)) for v in spreads)
        )

    def expected(self, parameters: SkinParameters, effects: FingerEffects) -> Array:
        """Log force [ln N] of every row without noise, shape (..., rows)."""
        b, m = (np.asarray(v, float)[..., None] for v in (parameters.b, parameters.m))
        level, stiffening = np.log(b) + effects.log_b, m + effects.m
        return level[..., self.finger] + stiffening[..., self.finger] * self._line.slope + self._line.offset

    def draw_forces(self, rng: np.random.Generator, parameters: SkinParameters, effects: FingerEffects) -> Array:
        """A force [N] for every row, shape (..., rows)."""
        expected = self.expected(parameters, effects)
        noise = np.asarray(parameters.varsigma_f, float)[..., None] * rng.standard_normal(expected.shape)
        return np.exp(expected + noise)

    def exponent(self, force: ArrayLike) -> Array:
        """Power of the indentation that forces (..., rows) follow, within fingers, by least squares; shape (...).

        NaN where no finger was pressed to two indentations.
        """
        count = np.maximum(np.bincount(self.finger, minlength=self.n_fingers), 1)
        member = (self.finger[:, None] == np.arange(self.n_fingers)) / count
        x, y = np.log(self.indentation), np.log(np.asarray(force, float))
        x = x - (x @ member)[self.finger]
        total = float(x @ x)
        return np.asarray((y @ x) / total if total > 1e-12 else np.full(y.shape[:-1], np.nan))

    def _law(self, parameters: SkinParameters) -> _Law:
        b, m, tau_b, tau_m, varsigma = (np.asarray(v, float) for v in parameters)
        shape = np.broadcast_shapes(*(v.shape for v in (b, m, tau_b, tau_m, varsigma)))
        variance = np.broadcast_to(np.maximum(varsigma**2, _LEAST_VARIANCE), shape)
        skin = np.stack([np.broadcast_to(np.log(b), shape), np.broadcast_to(m, shape)], axis=-1)
        residual = self._turned - np.einsum("jab,...b->...ja", self._turn, skin)
        (r11, r12), r22 = self._turn[:, 0].T, self._turn[:, 1, 1]
        s, g, h = variance[..., None], tau_b[..., None] ** 2, tau_m[..., None] ** 2
        second = s + h * r22**2
        # every term of the determinant is positive: nothing cancels
        first_given = ((s + g * r11**2) * second + s * h * r12**2) / second
        gain = h * r12 * r22 / second
        apart = residual[..., 0] - gain * residual[..., 1]
        return _Law(variance, residual, second, first_given, gain, apart)


class _Law(NamedTuple):
    """The normal law of each finger's two turned forces."""

    variance: Array  # of the noise
    residual: Array  # (..., fingers, 2)
    second: Array  # variance of the second
    first_given: Array  # variance of the first given the second
    gain: Array  # of the first on the second
    apart: Array  # residual of the first given the second


class ExponentCheck(NamedTuple):
    """Whether the fitted skin makes forces that grow with indentation as those that were seen."""

    observed: float
    """Power of the indentation in the data."""
    low: float
    high: float
    """Limits of 90 % of the replicates."""
    p_value: float
    """Two-sided predictive p-value."""
    points: float
    """Forces of a finger, on average."""

    @property
    def sentence(self) -> str:
        """One line for the user."""
        if not math.isfinite(self.observed):
            return "compression: no finger was pressed to two indentations, so how force grows cannot be checked"
        steeper = "steeper than" if self.observed > HERTZ_EXPONENT else "no steeper than"
        weak = f"; with {self.points:.2g} forces of a finger a weak check" if self.points < FEW_POINTS else ""
        return (
            f"compression: force grows as indentation to the power {self.observed:.2f} ({steeper} Hertz's "
            f"{HERTZ_EXPONENT}); replicated: {self.low:.2f} to {self.high:.2f} (90 %), p = {self.p_value:.2g}{weak}"
        )


def check_exponent(forces: CompressionForces, replicated: Array) -> ExponentCheck:
    """Compare how force grows with indentation with what the model replicates, forces (draws, rows) [N]."""
    observed, again = float(forces.exponent(forces.force)), forces.exponent(replicated)
    low, high = np.quantile(again, [0.05, 0.95])
    tail = min(float((again >= observed).mean()), float((again <= observed).mean()))
    return ExponentCheck(observed, float(low), float(high), min(1.0, 2.0 * tail), forces.n_rows / forces.n_fingers)
