"""The fast firing-rate surface: rate curves for a whole batch of channel multipliers from one table of polynomials.

Over the box of the multipliers, the rheobase, the rate just above it and the coefficients of the curve
(:class:`~.firing.RateCurve`) are smooth; each is one polynomial of bounded total degree in the multipliers. In a thin
corner of the Connor-Stevens box firing begins at a jump instead of a fold. Its border is one more polynomial, and a
channel vector beyond it gets its own exact curve, as does one outside the box.
"""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property, lru_cache
from importlib import resources
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from softness_bayes.errors import InputError, NumericalError
from softness_bayes.touch.firing import CurveError, RateCurve, exact_curve
from softness_bayes.touch.limit_cycle import AGREEMENT, TOLERANCE
from softness_bayes.touch.membrane import (
    CONNOR_STEVENS,
    HODGKIN_HUXLEY,
    PAPER_CHANNELS,
    PRINTED,
    Channels,
    Membrane,
    lanes,
)

FloatArray = NDArray[np.float64]

DATA = "firing_surface.npz"
"""Name of the data file beside this module."""

ERRORS = "firing_surface_error.json"
"""Name of the file with the measured errors, written by the check."""


@dataclass(frozen=True)
class Border:
    """Declared inputs of the border of the corner: ``c_K`` at which firing stops beginning at the fold.

    Parameters
    ----------
    degree : int
        Total degree in the other multipliers.
    points : int
        Points that the polynomial is fitted to.
    distance : float
        Root of the current above the fold at which firing decides [sqrt(µA/cm²)].
    margin : float
        Strip beside the border that counts as the corner, in units of the box's half-width.
    """

    degree: int = 5
    points: int = 400
    distance: float = 0.005
    margin: float = 1e-3


@dataclass(frozen=True)
class Design:
    """Declared inputs of one surface.

    Parameters
    ----------
    membrane : Membrane
        Constants.
    max_current : float
        Largest current [µA/cm²].
    degree : int
        Total degree in the multipliers.
    points : int
        Channel vectors that the polynomials are fitted to.
    nodes : int
        Nodes in ``s``, the root of the current above the rheobase.
    closest : float
        First node, as a share of the largest ``s``; 0 where the limit is known analytically.
    border : Border or None
        Where there is a corner.
    channels : Channels
        Centre of the box.
    half_width : float
        Half-width of the box, relative to its centre.
    """

    membrane: Membrane
    max_current: float
    degree: int
    points: int
    nodes: int
    closest: float
    border: Border | None = None
    channels: Channels = PAPER_CHANNELS
    half_width: float = 0.1

    @property
    def axes(self) -> tuple[int, ...]:
        """Multipliers that matter, as indices into ``Channels``: without an A-current, ``c_A`` does not."""
        return (0, 1, 2, 3) if self.membrane.gating.a_current else (0, 1, 2)

    @property
    def nodes_w(self) -> FloatArray:
        """Nodes in ``w = 2 s / s_max - 1``, Chebyshev points between ``closest`` and 1."""
        share = 0.5 * (1.0 - np.cos(np.pi * np.arange(self.nodes) / (self.nodes - 1)))
        return 2.0 * (self.closest + (1.0 - self.closest) * share) - 1.0

    def place(self, channels: FloatArray) -> FloatArray:
        """Where multipliers of shape (4, n) lie in the box, in units of its half-width, shape (axes, n)."""
        axes = list(self.axes)
        centre = np.array(self.channels)[axes, None]
        return (np.asarray(channels)[axes] / centre - 1.0) / self.half_width

    def channels_at(self, place: FloatArray) -> Channels:
        """Multipliers at places of shape (axes, n); multipliers that do not matter at the centre."""
        full = np.zeros((4, place.shape[1]))
        full[list(self.axes)] = place
        return Channels(*(np.array(self.channels)[:, None] * (1.0 + self.half_width * full)))

    @property
    def digest(self) -> str:
        """SHA-256 of everything declared that the surface is made from."""
        declared = json.dumps([asdict_declared(self), TOLERANCE, AGREEMENT], sort_keys=True)
        return hashlib.sha256(declared.encode()).hexdigest()


def asdict_declared(design: Design) -> dict[str, object]:
    """The design as plain numbers and words, arrays derived from them left out."""
    plain = asdict(design)
    plain["membrane"]["gating"] = {
        key: value for key, value in plain["membrane"]["gating"].items() if not key.startswith("_")
    }
    return plain


DESIGNS: Mapping[str, Design] = MappingProxyType(
    {
        design.membrane.name: design
        for design in (
            Design(CONNOR_STEVENS, max_current=60.0, degree=10, points=4096, nodes=20, closest=0.0, border=Border()),
            Design(HODGKIN_HUXLEY, max_current=60.0, degree=10, points=1200, nodes=20, closest=0.03),
            Design(PRINTED, max_current=80.0, degree=8, points=2400, nodes=20, closest=0.03),
        )
    }
)
"""The surfaces that are shipped."""


@dataclass(frozen=True)
class TotalDegree:
    """Chebyshev products in some variables up to a total degree."""

    variables: int
    degree: int

    @cached_property
    def exponents(self) -> NDArray[np.intp]:
        """Degrees of every product, shape (variables, terms)."""
        every = itertools.product(range(self.degree + 1), repeat=self.variables)
        return np.array([e for e in every if sum(e) <= self.degree]).T

    def basis(self, x: FloatArray) -> FloatArray:
        """Values of all products at points of shape (variables, n), shape (n, terms)."""
        polynomials = chebyshev.chebvander(x, self.degree)
        product = polynomials[0][:, self.exponents[0]]
        for values, exponent in zip(polynomials[1:], self.exponents[1:], strict=True):
            product *= values[:, exponent]
        return product


class SurfaceError(NamedTuple):
    """Measured error of a surface on random points, against exact rates; see the check."""

    points: int
    """Points in all"""
    border_points: int
    """Of these, in the corner or within 1 % of its border"""
    hertz: float
    """Largest error [Hz]"""
    excess: float
    """Largest error over its allowance, max(0.1 Hz, 1e-3 of the rate)"""
    relative_median: float
    relative_999: float
    """99.9 % quantile of the relative error where the membrane fires"""


@dataclass(frozen=True)
class FiringSurface:
    """Firing rate as a function of current and channel multipliers.

    Parameters
    ----------
    design : Design
        What it was made from.
    coefficients : ndarray, shape (terms, 2 + nodes)
        Polynomial coefficients of the rheobase, the onset rate and the coefficients of the curve.
    border : ndarray, shape (terms,)
        Polynomial coefficients of the place of the border in ``c_K``; empty where there is no corner.
    error : CurveError
        Largest measured error.
    """

    design: Design
    coefficients: FloatArray
    border: FloatArray
    error: CurveError

    @classmethod
    def load(cls, membrane: Membrane = CONNOR_STEVENS) -> FiringSurface:
        """Surface of a membrane from the shipped data.

        Raises
        ------
        InputError
            If there is no surface for the membrane, or it was made from other inputs than are declared now.
        """
        design = DESIGNS.get(membrane.name)
        if design is None or design.membrane != membrane:
            raise InputError(f"no firing-rate surface is kept for the membrane {membrane.name}")
        folder = resources.files(__package__)
        with (folder / DATA).open("rb") as file, np.load(file) as data:
            digest = str(data[f"{membrane.name}/digest"])
            if digest != design.digest:
                raise InputError(
                    f"{DATA} was made from other inputs for {membrane.name}; "
                    "rebuild it with `python -m softness_bayes.touch.surface_build`"
                )
            coefficients, border = data[f"{membrane.name}/coefficients"], data[f"{membrane.name}/border"]
        return cls(design, coefficients, border, CurveError(np.nan, np.nan, np.nan))

    @cached_property
    def _terms(self) -> TotalDegree:
        return TotalDegree(len(self.design.axes), self.design.degree)

    def at_fold(self, place: FloatArray) -> NDArray[np.bool_]:
        """Whether places of shape (axes, n) lie on the near side of the corner's border."""
        border = self.design.border
        if border is None:
            return np.ones(place.shape[1], dtype=bool)
        limit = TotalDegree(3, border.degree).basis(place[[0, 2, 3]]) @ self.border
        return place[1] < limit - border.margin

    def curve(self, channels: Channels) -> RateCurve:
        """Rate curves of channel vectors.

        Parameters
        ----------
        channels : Channels
            Multipliers [-], broadcast to the batch shape.

        Raises
        ------
        InputError
            If a multiplier is negative or not finite.
        """
        shape, multipliers = lanes(channels)
        flat = np.array(multipliers)
        place = self.design.place(flat)
        usual = (np.abs(place) <= 1.0 + 1e-9).all(axis=0)
        usual[usual] = self.at_fold(place[:, usual])
        values = np.empty((flat.shape[1], self.coefficients.shape[1]))
        values[usual] = self._terms.basis(place[:, usual]) @ self.coefficients
        for i in np.flatnonzero(~usual):
            own = _own_curve(Channels(*flat[:, i].tolist()), self.design.membrane, self.max_current, self.design.nodes)
            values[i] = np.hstack([own.rheobase, own.onset_rate, own.coefficients])
        values = values.reshape(*shape, -1)
        return RateCurve(values[..., 0], values[..., 1], values[..., 2:], self.max_current, self.error)

    @property
    def max_current(self) -> float:
        """Largest current that the curves cover [µA/cm²]."""
        return self.design.max_current


@lru_cache(maxsize=4096)
def _own_curve(channels: Channels, membrane: Membrane, max_current: float, nodes: int) -> RateCurve:
    return exact_curve(channels, membrane, max_current, nodes)
