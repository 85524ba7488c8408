"""Likelihood of rigid-plate forces on fingerpads, with the skin of each finger integrated out (model.md 9).

If people with plate forces are also raters, `PressedRaters` gives the law of each one's skin before any rating.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar, NamedTuple, Self

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from softness_bayes.base.errors import InputError
from softness_bayes.base.laws import LOG_TWO_PI, Prior
from softness_bayes.likelihood.contract import NO_RESPONSE, Effects, Levels, Likelihood, Parameters, RowsLeftOut, Shape
from softness_bayes.likelihood.design import Design, FloatArray
from softness_bayes.likelihood.error_laws import NORMAL, ErrorLaw
from softness_bayes.likelihood.pieces import backward, cholesky, forward, log_determinant
from softness_bayes.likelihood.scales import PLATE_FORCE, Scale
from softness_bayes.touch.contact import STRAIN, Finger, SkinDisplacement, plate_line
from softness_bayes.touch.finger_grid import SkinLaws

_LEAST_VARIANCE = 1e-20


PLATE_PARAMETERS = ("b", "m", "tau_b", "tau_m", "varsigma_f")
"""Skin of the typical finger, modulus at rest [Pa] and stiffening ([-] or [1/m], depending on the displacement
reading); spreads of ln b and m between fingers; standard deviation of a log force about the curve of its finger [-]."""


SKIN = ("b", "m")
"""Parameters of the forward model that rigid-plate forces depend on, too."""

OF_FORCES = (*SKIN, "varsigma_f")
"""Parameters of plate forces, also needed for ratings by people with plate forces."""

FORCES = "forces"
"""Name of the forces among the terms of a posterior."""


@dataclass(frozen=True)
class PlateModel:
    """ln F = ln b_j + m_j u + c + e, with ln b_j ~ N(ln b, tau_b²), m_j ~ N(m, tau_m²) and e ~ N(0, varsigma_f²).

    j is the finger; u and c are defined in `plate_line`. The effects are the fingers' deviations `log_b` and `m` from
    the typical one, both of shape (..., fingers).

    Parameters
    ----------
    shape, displacement
        Shape of the fingertip, and the displacement reading.
    """

    scale: ClassVar[Scale] = PLATE_FORCE
    error: ClassVar[ErrorLaw] = NORMAL
    needs: ClassVar[tuple[str, ...]] = PLATE_PARAMETERS
    levels: ClassVar[Mapping[str, Prior]] = MappingProxyType({})
    shape: Finger = Finger()
    displacement: SkinDisplacement = STRAIN

    def error_sd(self, parameters: Parameters) -> FloatArray:
        """Return the standard deviation of a log force about the curve of its finger, shape (...)."""
        return np.asarray(parameters.varsigma_f, float)

    def typical(self, effects: Effects, drive: FloatArray) -> FloatArray:
        """Return the typical finger's force [N], shape (..., k)."""
        return self.scale.natural(drive)

    def named_effects(self, effects: Effects) -> Mapping[str, tuple[FloatArray, tuple[str, ...]]]:
        """Return the fingers' deviations by their names in files, each with its axes after the batch axes."""
        return {"log_b_effect": (effects.log_b, ("finger",)), "m_effect": (effects.m, ("finger",))}


class FingerLaw(NamedTuple):
    """The normal law of each finger's deviations from the typical one given its forces."""

    mean: FloatArray
    """Means of ln b and m, shape (..., fingers, 2)."""
    root: FloatArray
    """Lower factor of the covariance: mean + root z for standard normal z, shape (..., fingers, 2, 2)."""


class CompressionForces(Likelihood):
    """Rigid-plate forces under a `PlateModel`, with fingers and noise integrated out.

    An orthogonal transformation of a finger's forces concentrates all information about its skin in two components; the
    others contain only noise. The deviations of a finger then have a normal law in closed form. Fingers are the
    participants of the design, and each force is a separate condition.

    Parameters
    ----------
    indentation, force
        delta [m] and F [N] of every row, shape (rows,), positive.
    finger
        Index of each row's finger, shape (rows,).
    n_fingers
        Number of fingers.
    shape, displacement
        As for `PlateModel`.

    Raises
    ------
    InputError
        If there is no row, or an indentation or a force is not a positive number.
    """

    name: ClassVar[str] = FORCES

    def __init__(
        self,
        indentation: ArrayLike,
        force: ArrayLike,
        finger: ArrayLike,
        n_fingers: int,
        shape: Finger = Finger(),
        displacement: SkinDisplacement = STRAIN,
    ) -> None:
        self.indentation, self.values = np.array(indentation, float), np.array(force, float)
        self.finger, self.n_fingers = np.array(finger, np.intp), n_fingers
        rows = self.values.size
        if not rows:
            raise InputError("compression: there are no forces")
        for what, values in (("an indentation", self.indentation), ("a force", self.values)):
            if not (np.isfinite(values) & (values > 0)).all():
                raise InputError(f"compression: {what} is not a positive number")
        self.model = PlateModel(shape, displacement)
        self.design = Design(np.arange(rows), self.finger, np.zeros(rows, np.intp), n_fingers)
        self._line = plate_line(self.indentation, shape, displacement)
        self._log = self.model.scale.additive(self.values)
        known = self._log - self._line.offset
        self._turn = np.zeros((n_fingers, 2, 2))
        self._turned = np.zeros((n_fingers, 2))
        self._noise = np.zeros(n_fingers)
        for j in range(n_fingers):
            own = self.finger == j
            # two rows of zeros avoid a special case for fingers with fewer than two forces
            columns = np.vstack([np.column_stack([np.ones(own.sum()), self._line.slope[own]]), np.zeros((2, 2))])
            basis, self._turn[j] = np.linalg.qr(columns)
            padded = np.append(known[own], [0.0, 0.0])
            self._turned[j] = basis.T @ padded
            self._noise[j] = float(((padded - basis @ self._turned[j]) ** 2).sum())

    def with_values(self, values: ArrayLike) -> Self:
        """Return the likelihood of other forces at the same indentations of the same fingers."""
        shape, displacement = self.model.shape, self.model.displacement
        return type(self)(self.indentation, values, self.finger, self.n_fingers, shape, displacement)

    def without(self, rows: NDArray[np.bool_]) -> Self:
        """Return the likelihood of the other forces of the same fingers."""
        kept = self.indentation[~rows], self.values[~rows], self.finger[~rows]
        return type(self)(*kept, self.n_fingers, self.model.shape, self.model.displacement)

    def log_likelihood(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the log density of all forces [1/N each] at parameters of batch shape (...), shape (...)."""
        return self.log_likelihood_participants(mean_rate, parameters).sum(axis=-1)

    def log_likelihood_participants(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the log density of each finger's forces, shape (..., fingers); fingers are independent."""
        given, rows = self._given(mean_rate, parameters), self.design.cells.sum(axis=1)
        variance = given.variance[..., None]
        left = given.residual - (given.reach @ given.likely[..., None])[..., 0]
        quadratic = ((left**2).sum(axis=-1) + self._noise) / variance + (given.likely**2).sum(axis=-1)
        density = -0.5 * (rows * (LOG_TWO_PI + np.log(variance)) + log_determinant(given.root) + quadratic)
        return density - np.bincount(self.finger, self._log, self.n_fingers)

    def left_out(self, mean_rate: FloatArray, parameters: Parameters) -> RowsLeftOut:
        """Return the law of each force given all the others at its observation, arrays of shape (..., rows)."""
        law, typical = self.finger_law(parameters, mean_rate), self.drive(mean_rate, parameters)
        variance = np.maximum(self.model.error_sd(parameters) ** 2, _LEAST_VARIANCE)[..., None]
        z = np.column_stack([np.ones(self.values.size), self._line.slope])
        residual = self._log - typical - (z * law.mean[..., self.finger, :]).sum(axis=-1)
        reach = (z[..., None] * law.root[..., self.finger, :, :]).sum(axis=-2)
        spread = np.stack(np.broadcast_arrays(parameters.tau_b, parameters.tau_m), axis=-1)[..., None, :]
        least = 1.0 / (variance + ((spread * z) ** 2).sum(axis=-1))  # the precision without any other force
        precision = np.maximum((1.0 - (reach**2).sum(axis=-1) / variance) / variance, least)
        score = residual / variance / np.sqrt(precision)
        density = -0.5 * (score**2 + LOG_TWO_PI - np.log(precision)) - self._log
        return RowsLeftOut(density, ndtr(score))

    def drive(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the log force [ln N] of every row on the typical finger, shape (..., rows)."""
        b, m = (np.asarray(v, float)[..., None] for v in (parameters.b, parameters.m))
        return np.asarray(np.log(b) + m * self._line.slope + self._line.offset + np.zeros((*mean_rate.shape[:-1], 1)))

    def predictor(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return u of every row, the regressor of ln F with slope m, shape (rows,)."""
        return self._line.slope

    def new_effects(self, rng: Generator, parameters: Parameters, shape: Shape, levels: Levels = None) -> Effects:
        """Return deviations of the same number of new fingers, of batch ``shape``; there are no common effects."""
        spreads = (np.asarray(v, float)[..., None] for v in (parameters.tau_b, parameters.tau_m))
        log_b, m = (spread * rng.standard_normal((*shape, self.n_fingers)) for spread in spreads)
        return Effects(log_b=log_b, m=m)

    def draw_effects(self, rng: Generator, mean_rate: FloatArray, parameters: Parameters) -> Effects:
        """Return exact draws of the fingers' deviations given their forces, one for each point of the batch."""
        law = self.finger_law(parameters, mean_rate)
        drawn = law.mean + (law.root @ rng.standard_normal((*law.mean.shape, 1)))[..., 0]
        return Effects(log_b=drawn[..., 0], m=drawn[..., 1])

    def finger_law(self, parameters: Parameters, mean_rate: FloatArray = NO_RESPONSE) -> FingerLaw:
        """Return the law of each finger's deviations from the typical one given its forces, for batch shape (...)."""
        given = self._given(mean_rate, parameters)
        inverse = forward(given.root, np.broadcast_to(np.eye(2), given.root.shape))
        root = np.linalg.cholesky(np.swapaxes(inverse, -1, -2) @ inverse)
        return FingerLaw(given.spread * given.likely, given.spread[..., None] * root)

    def replicate(self, rng: Generator, drive: FloatArray, parameters: Parameters, effects: Effects) -> FloatArray:
        """Return a force [N] for every row, shape (..., rows)."""
        expected = drive + self._own(effects)
        noise = self.model.error.draw(rng, expected.shape, parameters)
        return self.model.scale.natural(expected + self.model.error_sd(parameters)[..., None] * noise)

    def residual(self, mean_rate: FloatArray, parameters: Parameters, effects: Effects) -> FloatArray:
        """Return each log force minus the expectation for its finger, shape (..., rows)."""
        return self._log - self.drive(mean_rate, parameters) - self._own(effects)

    def exponent(self, force: ArrayLike) -> FloatArray:
        """Return the least-squares exponent of force against indentation within fingers, shape (...).

        Forces have shape (..., rows). The exponent is NaN if no finger has two different indentations.
        """
        count = np.maximum(np.bincount(self.finger, minlength=self.n_fingers), 1)
        member = (self.finger[:, None] == np.arange(self.n_fingers)) / count
        x, y = np.log(self.indentation), np.log(np.asarray(force, float))
        x = x - (x @ member)[self.finger]
        total = float(x @ x)
        return np.asarray((y @ x) / total if total > 1e-12 else np.full(y.shape[:-1], np.nan))

    def _own(self, effects: Effects) -> FloatArray:
        """Return the finger's contribution to each log force, shape (..., rows)."""
        return effects.log_b[..., self.finger] + effects.m[..., self.finger] * self._line.slope

    def _given(self, mean_rate: FloatArray, parameters: Parameters) -> _Given:
        """Return the law of each finger's deviations given its forces."""
        b, m, tau_b, tau_m, varsigma = (np.asarray(getattr(parameters, name), float) for name in PLATE_PARAMETERS)
        shape = parameters.batch_shape(mean_rate.shape[:-1])
        variance = np.broadcast_to(np.maximum(varsigma**2, _LEAST_VARIANCE), shape)
        skin = np.stack([np.broadcast_to(np.log(b), shape), np.broadcast_to(m, shape)], axis=-1)
        residual = self._turned - np.einsum("jab,...b->...ja", self._turn, skin)
        spread = np.broadcast_to(np.stack(np.broadcast_arrays(tau_b, tau_m), axis=-1)[..., None, :], (*shape, 1, 2))
        reach = self._turn * spread[..., None, :]
        turned = np.swapaxes(reach, -1, -2) / variance[..., None, None, None]
        root = cholesky(np.eye(2) + turned @ reach, 1.0)
        likely = backward(root, forward(root, turned @ residual[..., None]))[..., 0]
        return _Given(variance, spread, residual, reach, likely, root)


@dataclass(frozen=True, eq=False)
class PressedRaters:
    """Raters for whom there are also plate forces.

    Parameters
    ----------
    forces
        The forces.
    rater, finger
        Index of each such person among the raters (-1 for people who are not raters) and among the fingers of the
        forces, shape (people,).
    """

    forces: CompressionForces
    rater: NDArray[np.intp]
    finger: NDArray[np.intp]

    @classmethod
    def of(cls, forces: CompressionForces, raters: Sequence[str], pressed: Sequence[str]) -> PressedRaters | None:
        """Return the people whose names occur in both lists; None if there are none."""
        place = {name: k for k, name in enumerate(pressed)}
        both = [(k, place[name]) for k, name in enumerate(raters) if name in place]
        if not both:
            return None
        rater, finger = np.array(both, np.intp).T
        return cls(forces, rater, finger)

    @property
    def size(self) -> int:
        """Number of people."""
        return self.rater.size

    def as_strangers(self) -> PressedRaters:
        """Return the same people as if none of them were raters."""
        return PressedRaters(self.forces, np.full_like(self.rater, -1), self.finger)

    def skins(self, names: Sequence[str], parameters: Parameters) -> SkinLaws:
        """Return the laws of their skins given the forces, for the quantities that differ between raters (`names`).

        Quantities that do not differ between raters have deviation 0. If m is one of them, a rater has the m of the
        typical finger, and the law of ln b is marginal over m in the forces.
        """
        law = self.forces.finger_law(parameters)
        mean, root = law.mean[..., self.finger, :], law.root[..., self.finger, :, :]
        nothing = np.zeros(mean.shape[:-1])
        if "m" not in names:
            return SkinLaws(mean[..., 0], nothing, root[..., 0, 0], nothing, nothing)
        if "b" not in names:
            sd = np.hypot(root[..., 1, 0], root[..., 1, 1])
            return SkinLaws(nothing, mean[..., 1], nothing, nothing, sd)
        return SkinLaws(mean[..., 0], mean[..., 1], root[..., 0, 0], root[..., 1, 0], root[..., 1, 1])


class _Given(NamedTuple):
    """Each finger's two transformed forces, and its deviations in standard deviations given them."""

    variance: FloatArray  # of the noise, (...)
    spread: FloatArray  # standard deviations of ln b and m between fingers, (..., 1, 2)
    residual: FloatArray  # transformed forces less those of the typical finger, (..., fingers, 2)
    reach: FloatArray  # effect of each deviation on them, (..., fingers, 2, 2)
    likely: FloatArray  # most probable deviations, (..., fingers, 2)
    root: FloatArray  # lower factor of their precision, (..., fingers, 2, 2)
