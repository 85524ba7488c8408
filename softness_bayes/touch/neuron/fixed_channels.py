"""Rate curves of fixed channels: one curve for all parameter vectors, with or without noise."""

from __future__ import annotations

import copy
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from softness_bayes.errors import NumericalError
from softness_bayes.kinds import require_kind, require_members
from softness_bayes.touch.neuron.firing import RateCurve, known_curve
from softness_bayes.touch.neuron.membrane import CONNOR_STEVENS, PAPER_CHANNELS, Channels, Membrane
from softness_bayes.touch.neuron.noise import averaged_curve

LARGEST_CURRENT = 150.0
"""Largest alpha [µA/cm²] with a rate curve: depolarisation block starts at 154-210 (model.md 7)."""

USUAL_CURRENT = 40.0
"""Largest current [µA/cm²] of the default curve."""


class Firing(Protocol):
    """Source of a scene's rate curves: fixed channels, or a surface over the channels."""

    noise: float

    def curves(self, channels: Channels, alpha: ArrayLike) -> RateCurve:
        """Return the rate curves of channel multipliers up to currents alpha, of batch shape (batch,) or ()."""

    def exact(self) -> Firing:
        """Return a source of exact curves, the reference for the error of these."""

    def shortened(self, terms: int) -> Firing:
        """Return a source of curves with no more than some number of terms; exact curves keep theirs."""


class FixedChannels:
    """One rate curve for all parameter vectors, which ignores their channel multipliers.

    Parameters
    ----------
    channels, membrane
        Multipliers and membrane of the curve.
    max_current
        Largest current [µA/cm²] of the default curve. For larger alphas, a longer curve is computed once.
    noise
        Strength of a white-noise current [µA/cm² sqrt(ms)] over which the curve is averaged by simulation.
    nodes
        Number of exact rates that the default curve interpolates.
    """

    def __init__(
        self,
        channels: Channels = PAPER_CHANNELS,
        membrane: Membrane = CONNOR_STEVENS,
        max_current: float = USUAL_CURRENT,
        noise: float = 0.0,
        nodes: int = 18,
    ) -> None:
        require_members("channels", channels, Channels._fields, "Channels, as in PAPER_CHANNELS")
        require_kind("membrane", membrane, Membrane, "a Membrane, as in HODGKIN_HUXLEY")
        self.channels, self.membrane, self.noise, self.max_current = channels, membrane, noise, max_current
        self.nodes = nodes
        self.curve = self._made(max_current, nodes)
        # an averaged curve takes minutes: computed now, once for all processes of a run
        self._longer: RateCurve | None = self._made(LARGEST_CURRENT, nodes) if noise else None
        self._exact: FixedChannels | None = None

    def _made(self, max_current: float, nodes: int) -> RateCurve:
        if self.noise:
            return averaged_curve(self.noise, self.channels, self.membrane, max_current)
        return known_curve(self.channels, self.membrane, max_current, nodes)

    @property
    def averaged(self) -> tuple[RateCurve, ...]:
        """The default and the longer curve, if they are averages over noise."""
        return () if self._longer is None or not self.noise else (self.curve, self._longer)

    def exact(self) -> FixedChannels:
        """Return a cached source with more nodes, or this one if the curve is an average over noise."""
        if self.noise:
            return self
        if self._exact is None:
            self._exact = FixedChannels(self.channels, self.membrane, self.max_current, nodes=max(28, self.nodes + 6))
        return self._exact

    def shortened(self, terms: int) -> FixedChannels:
        """Return the same source with a shorter default curve; curves to larger currents stay as they are."""
        part = copy.copy(self)
        part.curve = self.curve.shortened(terms)
        return part

    def curves(self, channels: Channels, alpha: ArrayLike) -> RateCurve:
        """Return the common curve, of batch shape (), or one per vector if an alpha requires a longer curve.

        Raises
        ------
        NumericalError
            If an alpha exceeds `LARGEST_CURRENT`.
        """
        alpha = np.asarray(alpha, float)
        long = alpha > self.curve.max_current
        if not long.any():
            return self.curve
        if alpha.max() > LARGEST_CURRENT:
            raise NumericalError(
                f"alpha = {alpha.max():.6g} µA/cm² lies beyond {LARGEST_CURRENT:g}, where the membrane is near "
                "depolarisation block and no rate curve is kept"
            )
        if self._longer is None:
            self._longer = self._made(LARGEST_CURRENT, 28)
        # a vector's curve does not depend on the other vectors of its batch
        usual, longer = self.curve.coefficients, self._longer.coefficients
        size = max(usual.size, longer.size)
        padded, longer = (np.append(c, np.zeros(size - c.size)) for c in (usual, longer))
        return RateCurve(
            np.where(long, self._longer.rheobase, self.curve.rheobase),
            np.where(long, self._longer.onset_rate, self.curve.onset_rate),
            np.where(long[..., None], longer, padded),
            np.where(long, LARGEST_CURRENT, self.curve.max_current),
            self._longer.error,
        )
