"""The fast firing-rate surface: rate curves for a whole batch of channel multipliers from one table of polynomials.

Over the box of the multipliers, the rheobase, the rate just above it and the coefficients of the curve
(:class:`~.rate_curve.RateCurve`) are smooth: each is one polynomial of bounded total degree in the multipliers, so that
a vector's curve costs one row of a matrix product. In a thin corner of the Connor-Stevens box firing begins at a jump
instead of a fold (model.md 7). Its border is another polynomial; channel vectors beyond it have exact curves.
Vectors outside the box raise an error; nothing is extrapolated.

The tables are built and measured by ``python -m softness_bayes.tools.surface_build``.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import cache, cached_property, lru_cache
from importlib import resources
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.base.errors import InputError, NumericalError
from softness_bayes.base.files.records import parse_json
from softness_bayes.touch.neuron.firing import exact_curve, exact_curves
from softness_bayes.touch.neuron.limit_cycle import AGREEMENT, TOLERANCE
from softness_bayes.touch.neuron.membrane import (
    CONNOR_STEVENS,
    HODGKIN_HUXLEY,
    PAPER_CHANNELS,
    PRINTED,
    Channels,
    Membrane,
    lanes,
    rows_of,
)
from softness_bayes.touch.neuron.polynomials import TotalDegree
from softness_bayes.touch.neuron.rate_curve import CurveError, RateCurve, shortening

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Border:
    """Inputs for the border of the corner: the ``c_K`` beyond which firing no longer starts at the fold.

    Parameters
    ----------
    degree : int
        Total degree in the other multipliers.
    points : int
        Number of points to which the polynomial is fitted.
    distance : float
        Root of the current above the fold at which the cell is tested for firing [sqrt(µA/cm²)].
    margin : float
        Width of the strip along the border that is treated as the corner, in units of the box's half-width.
    """

    degree: int = 6
    points: int = 600
    distance: float = 0.01
    margin: float = 3e-3


@dataclass(frozen=True)
class SurfaceInputs:
    """Inputs from which one surface is built.

    Parameters
    ----------
    membrane : Membrane
        Constants.
    max_current : float
        Largest current [µA/cm²].
    degree : int
        Total degree in the multipliers.
    points : int
        Number of channel vectors to which the polynomials are fitted.
    nodes : int
        Nodes in ``s``, the root of the current above the rheobase.
    closest : float
        First node, as a share of the largest ``s``; 0 if the limit is known analytically.
    border : Border or None
        Border of the corner, if there is one.
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
    closest: float = 0.0
    border: Border | None = None
    channels: Channels = PAPER_CHANNELS
    half_width: float = 0.1

    @property
    def axes(self) -> list[int]:
        """Multipliers that have an effect, as indices into ``Channels``; ``c_A`` has none without an A-current."""
        return [0, 1, 2, 3] if self.membrane.gating.a_current else [0, 1, 2]

    @property
    def nodes_w(self) -> FloatArray:
        """Nodes in ``w = 2 s / s_max - 1``, Chebyshev points between ``closest`` and 1."""
        share = 0.5 * (1.0 - np.cos(np.pi * np.arange(self.nodes) / (self.nodes - 1)))
        return 2.0 * (self.closest + (1.0 - self.closest) * share) - 1.0

    def place(self, channels: FloatArray) -> FloatArray:
        """Return the coordinates in the box of multipliers (4, n), in units of its half-width, shape (axes, n)."""
        return (np.asarray(channels)[: len(self._centre)] / self._centre - 1.0) / self.half_width

    @cached_property
    def _centre(self) -> FloatArray:
        return np.array(self.channels)[self.axes, None]

    def channels_at(self, place: FloatArray) -> Channels:
        """Return multipliers at coordinates of shape (axes, n); those without effect keep the value of the centre."""
        full = np.zeros((4, place.shape[1]))
        full[self.axes] = place
        return Channels(*(np.array(self.channels)[:, None] * (1.0 + self.half_width * full)))

    def interval(self, channel: str) -> tuple[float, float]:
        """Return the smallest and largest value of a multiplier in the box."""
        centre = self.channels[Channels._fields.index(channel)]
        return centre * (1 - self.half_width), centre * (1 + self.half_width)

    @property
    def digest(self) -> str:
        """SHA-256 of all inputs from which the surface is built."""
        declared = json.dumps([_declared(asdict(self)), TOLERANCE, AGREEMENT], sort_keys=True)
        return hashlib.sha256(declared.encode()).hexdigest()


def _declared(value: Any) -> Any:
    """Return the numbers and names of a design, without descriptions and derived private fields."""
    if isinstance(value, dict):
        return {key: _declared(item) for key, item in value.items() if not key.startswith("_") and key != "meaning"}
    return value


DESIGNS: Mapping[str, SurfaceInputs] = MappingProxyType(
    {
        design.membrane.name: design
        for design in (
            SurfaceInputs(CONNOR_STEVENS, max_current=60.0, degree=10, points=3072, nodes=20, border=Border()),
            SurfaceInputs(HODGKIN_HUXLEY, max_current=60.0, degree=9, points=384, nodes=20, closest=0.015),
        )
    }
)
"""Designs of the shipped surfaces, by membrane."""


NO_SURFACE: Mapping[str, str] = MappingProxyType(
    {
        PRINTED.name: "which is silent up to 38 µA/cm² for all multipliers, almost twice the paper's largest current, "
        "and begins to fire in more ways than one"
    }
)
"""Reasons why membranes have no surface. The printed membrane starts to fire at 39 to 67 µA/cm² at a fold of orbits,
but in a different way in a fiftieth of the box."""


TABLES = "firing_surface.npz"
"""Name of the data file beside this module."""

ERRORS = "firing_surface.json"
"""Name of the file with the measured errors beside it."""

FITTED = 3000
"""Channel vectors to which shorter surfaces are fitted."""

_own_curve = lru_cache(maxsize=4096)(exact_curve)
_CHECKING = 1e-6  # tolerance for batches of exact curves: rates within 1e-5 of the peak, in a third of the time
_AT_THE_EDGE = 1e-9  # relative to the box's half-width: allows for rounding at a prior's end


@dataclass(frozen=True)
class FiringSurface:
    """Firing rate as a function of current and channel multipliers.

    Parameters
    ----------
    design : Design
        Inputs from which the surface was built.
    table : ndarray, shape (terms, 2 + nodes)
        Polynomial coefficients of the rheobase [µA/cm²], the onset rate [Hz] and the coefficients of the curve.
    border : ndarray, shape (terms,)
        Polynomial coefficients of the place of the corner's border in ``c_K``; empty without a corner.
    error : CurveError
        Largest measured error.
    degree : int
        Total degree in the multipliers.
    """

    design: SurfaceInputs
    table: FloatArray
    border: FloatArray
    error: CurveError
    degree: int
    noise = 0.0

    @classmethod
    @cache
    def load(cls, membrane: Membrane = CONNOR_STEVENS) -> FiringSurface:
        """Return the surface of a membrane from the shipped tables.

        Raises
        ------
        InputError
            If there is no surface for the membrane, or it was built from inputs other than those now declared.
        """
        design = DESIGNS.get(membrane.name)
        if design is None or design.membrane != membrane:
            raise InputError(
                f"channel multipliers cannot be sampled with the membrane {membrane.name}, "
                f"{NO_SURFACE.get(membrane.name, 'for which no firing-rate surface is kept')}; hold c_Na, c_K, c_L and "
                f"c_A, or use a membrane that has a surface: {', '.join(DESIGNS)}"
            )
        folder = resources.files(__package__)
        with (folder / TABLES).open("rb") as file, np.load(file) as data:
            digest = data[f"{membrane.name}/digest"].item()
            table, border = data[f"{membrane.name}/table"], data[f"{membrane.name}/border"]
        if digest != design.digest:
            raise InputError(
                f"{TABLES} was made from other inputs for {membrane.name}; "
                "rebuild it with `python -m softness_bayes.tools.surface_build`"
            )
        measured = parse_json((folder / ERRORS).read_text())[membrane.name]
        return cls(design, table, border, CurveError(*(measured[name] for name in CurveError._fields)), design.degree)

    @property
    def max_current(self) -> float:
        """Largest current that the curves cover [µA/cm²]."""
        return self.design.max_current

    @cached_property
    def _terms(self) -> TotalDegree:
        return TotalDegree(len(self.design.axes), self.degree)

    def _values(self, place: FloatArray) -> FloatArray:
        """Return the values of the table's polynomials at places of shape (axes, n), shape (n, 2 + nodes)."""
        # in this order the values of a polynomial are next to each other in memory
        return (self.table.T @ self._terms.basis(place).T).T

    @cached_property
    def _border_terms(self) -> TotalDegree:
        return TotalDegree(3, self.design.border.degree if self.design.border is not None else 0)

    @cached_property
    def _quadratic_rheobase(self) -> tuple[TotalDegree, FloatArray]:
        """The terms of the rheobase up to second order, and their coefficients, so that the centre of the box has 0."""
        terms = TotalDegree(len(self.design.axes), 2)
        coefficients = self.table[self._terms.exponents.sum(axis=0) <= 2, 0]
        coefficients[0] -= float((terms.basis(np.zeros((terms.variables, 1))) @ coefficients).item())
        return terms, coefficients

    def corner(self, place: FloatArray) -> NDArray[np.bool_]:
        """Return True for points of shape (axes, n) in the corner or in the safety strip beside it."""
        border = self.design.border
        return np.zeros(place.shape[1], dtype=bool) if border is None else self.before_corner(place) < border.margin

    def rheobase_shift(self, channels: Channels) -> FloatArray:
        """Return the rheobase relative to that at the box's centre [µA/cm²], to second order."""
        shape, place = self._places(channels)
        terms, coefficients = self._quadratic_rheobase
        return (terms.basis(place) @ coefficients).reshape(shape)

    def _places(self, channels: Channels) -> tuple[tuple[int, ...], FloatArray]:
        """Return the batch shape of channel vectors and their box coordinates, shape (axes, n), not range-checked."""
        values = np.broadcast_arrays(*(np.asarray(c, float) for c in channels))
        return values[0].shape, self.design.place(np.array([v.reshape(-1) for v in values]))

    def answers(self, channels: Channels) -> NDArray[np.bool_]:
        """Return True for channel vectors inside the box and outside the corner, in their batch shape."""
        shape, place = self._places(channels)
        inside = np.flatnonzero((np.abs(place) <= 1.0 + _AT_THE_EDGE).all(axis=0))
        found = np.zeros(place.shape[1], dtype=bool)
        found[inside] = ~self.corner(place[:, inside])
        return found.reshape(shape)

    def before_corner(self, place: FloatArray) -> FloatArray:
        """Return distances from the corner's border along ``c_K``, negative in it, at places of shape (axes, n)."""
        if self.design.border is None:
            return np.full(place.shape[1], np.inf)
        return self._border_terms.basis(place[[0, 2, 3]]) @ self.border - place[1]

    def curve(self, channels: Channels) -> RateCurve:
        """Return rate curves of channel vectors.

        Parameters
        ----------
        channels : Channels
            Multipliers [-], broadcast to the batch shape.

        Raises
        ------
        InputError
            If a multiplier is not finite or lies outside the box.
        """
        shape, multipliers = lanes(channels)
        return self._curve(shape, np.array(multipliers))

    def _curve(self, shape: tuple[int, ...], flat: FloatArray) -> RateCurve:
        """Return the curves of multipliers (4, n), of a batch shape of n elements."""
        place = self.design.place(flat)
        self._require_inside(flat, place)
        values = self._values(place)
        for i in np.flatnonzero(self.corner(place)):
            own = _own_curve(Channels(*flat[:, i].tolist()), self.design.membrane, self.max_current, self.design.nodes)
            own = own.shortened(self.table.shape[1] - 2)
            values[i] = np.hstack([own.rheobase, own.onset_rate, own.coefficients])
        values = values.reshape(*shape, values.shape[-1])
        return RateCurve(values[..., 0], values[..., 1], values[..., 2:], self.max_current, self.error)

    def curves(self, channels: Channels, alpha: ArrayLike) -> RateCurve:
        """Return rate curves of channel multipliers up to currents alpha, of the multipliers' batch shape.

        Raises
        ------
        NumericalError
            If an alpha exceeds `max_current`.
        """
        alpha = np.asarray(alpha, float)
        if not (alpha <= self.max_current).all():
            raise NumericalError(
                f"alpha = {alpha.max():.6g} µA/cm² lies beyond the {self.max_current:g} that the firing-rate "
                "surface covers; fix the channel multipliers for larger currents"
            )
        return self._curve(*rows_of(channels))

    def exact(self) -> ExactRates:
        """Return the source of the exact curves that the surface approximates."""
        return ExactRates(self.design.membrane, self)

    def shortened(self, terms: int) -> FiringSurface:
        """Return a surface with fewer terms in the root of the current and a lower degree in the multipliers.

        The lower polynomials are fitted to this surface by least squares, at points all over the box and, as many,
        around its centre. Two further terms in the root of the current for each degree make both errors similar.
        """
        if terms not in self._shorter:
            self._shorter[terms] = self._fitted(terms)
        return self._shorter[terms]

    @cached_property
    def _shorter(self) -> dict[int, FiringSurface]:
        return {}

    def __getstate__(self) -> dict[str, Any]:
        # without the shorter surfaces, so that what is sent to other processes does not depend on those made before
        return {name: value for name, value in self.__dict__.items() if name != "_shorter"}

    def _fitted(self, terms: int) -> FiringSurface:
        degree = min(max(terms // 2 - 2, 2), self.design.degree)
        lower = TotalDegree(len(self.design.axes), degree)
        rng, shape = np.random.default_rng(0), (len(self.design.axes), FITTED // 2)
        place = np.hstack([rng.uniform(-1.0, 1.0, shape), rng.normal(0.0, 0.3, shape).clip(-1.0, 1.0)])
        place = place[:, ~self.corner(place)]
        table = np.linalg.lstsq(lower.basis(place), self._values(place), rcond=None)[0]
        shorter = table[:, 2:] @ shortening(self.design.nodes, terms)
        return replace(self, degree=degree, table=np.hstack([table[:, :2], shorter]))

    def _require_inside(self, channels: FloatArray, place: FloatArray) -> None:
        outside = ~(np.abs(place) <= 1.0 + _AT_THE_EDGE)  # NaN is outside
        if outside.any():
            width, said = self.design.half_width, []
            for axis in np.flatnonzero(outside.any(axis=1)):
                which = self.design.axes[axis]
                centre, value = self.design.channels[which], channels[which, outside[axis].argmax()]
                ends = f"{centre * (1 - width):.6g} to {centre * (1 + width):.6g}"
                said.append(f"{Channels._fields[which]} = {value:.6g} lies outside {ends}")
            raise InputError(
                f"{', '.join(said)}, the box that the firing-rate surface covers; fix the channel multipliers "
                "at values within it, or use priors within it"
            )


@dataclass(frozen=True)
class ExactRates:
    """Rate curves through exact rates, one for each parameter vector up to its alpha; each takes milliseconds.

    Parameters
    ----------
    membrane : Membrane
        Constants.
    near : FiringSurface, optional
        Surface whose rheobase is the initial value of the search, which saves most of its time.
    """

    membrane: Membrane
    near: FiringSurface | None = None
    noise = 0.0

    def curves(self, channels: Channels, alpha: ArrayLike) -> RateCurve:
        """Return rate curves of channel multipliers up to currents alpha, of their batch shape."""
        shape, (*multipliers, limit) = rows_of([*channels, alpha])
        channels = Channels(*multipliers)
        expected = None if self.near is None else self.near.curve(channels).rheobase
        curves = exact_curves(channels, self.membrane, limit, expected=expected, tolerance=_CHECKING)
        return curves.take(np.arange(limit.size).reshape(shape))

    def exact(self) -> ExactRates:
        """Return itself."""
        return self

    def shortened(self, terms: int) -> ExactRates:
        """Return itself: exact curves stay as they are."""
        return self
