"""Gating of the membrane's channels: opening and closing rates, exact and finite at every voltage.

Every gate ``x`` obeys ``dx/dt = opening(V) - total(V) x``, so that ``x_inf = opening / total`` and
``tau = 1 / total``. Voltages are in mV, times in ms. Arrays of gates have one row for each gate, in the order
m, (A,) h, (B,) n: activation before inactivation, so that ``m^3 h`` and ``A^3 B`` are computed together. Arrays of
channels have the rows Na, (A,) K.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

VOLTAGE_LIMIT = 5000.0
"""Rates are constant beyond plus or minus this voltage [mV], so that no exponential overflows."""


class Rate(NamedTuple):
    """Constants of one opening or closing rate, a function of ``y = (V + offset) / width``."""

    scale: float
    offset: float
    width: float


@dataclass(frozen=True)
class Kinetics:
    """Opening and closing rates [1/ms] of the gates m, h and n (Hodgkin & Huxley 1952).

    ``m_open`` and ``n_open`` are ``scale (V + offset) / (1 - exp(-y))``, ``h_close`` is ``scale / (1 + exp(-y))``
    and the other three are ``scale exp(-y)``.
    """

    m_open: Rate
    m_close: Rate
    h_open: Rate
    h_close: Rate
    n_open: Rate
    n_close: Rate


@dataclass(frozen=True)
class AKinetics:
    """Gates A and B of the transient potassium current (Connor, Walter & McKown 1977).

    ``A_inf = (a_scale exp(y_1) / (1 + exp(y_2)))^(1/3)``, ``B_inf = (1 + exp(y_3))^-4``,
    ``tau_A = a_tau[0] + a_tau[1] / (1 + exp(y_4))``, ``tau_B = b_tau[0] + b_tau[1] / (1 + exp(y_5))``,
    with ``y_i = (V + offsets[i]) / widths[i]``, voltages in mV and times in ms.
    """

    a_scale: float = 0.0761
    a_tau: tuple[float, float] = (0.3632, 1.158)
    b_tau: tuple[float, float] = (1.24, 2.678)
    offsets: tuple[float, float, float, float, float] = (94.22, 1.17, 53.3, 55.96, 50.0)
    widths: tuple[float, float, float, float, float] = (31.84, 28.93, 14.54, 20.12, 16.027)


class GateRates(NamedTuple):
    """Opening and total rates of the gates [1/ms] and their derivatives by voltage [1/(ms mV)], (gates, n) each."""

    opening: FloatArray
    total: FloatArray
    opening_slope: FloatArray
    total_slope: FloatArray


class _Terms(NamedTuple):
    """Terms common to all rates, with the rows stacked in ``Gating.__post_init__``."""

    arguments: FloatArray
    growth: FloatArray
    linear: FloatArray
    exponential: FloatArray
    sigmoid: FloatArray


@dataclass(frozen=True)
class Gating:
    """All gates of one membrane: m, h and n, plus A and B if there is an A-current.

    Parameters
    ----------
    kinetics : Kinetics
        Rates of m, h and n.
    a_current : AKinetics or None
        Rates of A and B; None for a membrane without them.
    """

    kinetics: Kinetics
    a_current: AKinetics | None = None
    _slopes: FloatArray = field(init=False, repr=False, compare=False)
    _intercepts: FloatArray = field(init=False, repr=False, compare=False)
    _open_scales: FloatArray = field(init=False, repr=False, compare=False)
    _plain_scales: FloatArray = field(init=False, repr=False, compare=False)
    _sigmoid_scales: FloatArray = field(init=False, repr=False, compare=False)
    _tau_least: FloatArray = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        k, a = self.kinetics, self.a_current
        linear, plain, sigmoid = [k.m_open, k.n_open], [k.m_close, k.n_close, k.h_open], [k.h_close]
        if a is not None:
            scales = [a.a_scale, 1.0, 1.0, a.a_tau[1], a.b_tau[1]]
            extra = [
                Rate(*constants) for constants in zip(scales, a.offsets, [-width for width in a.widths], strict=True)
            ]
            plain, sigmoid = [*plain, extra[0]], [*sigmoid, *extra[1:]]
        stack = [*linear, *plain, *sigmoid]
        slopes = _column(-1.0 / rate.width for rate in stack)
        for name, value in {
            "_slopes": slopes,
            "_intercepts": slopes * _column(rate.offset for rate in stack),
            "_open_scales": _column(rate.scale * rate.width for rate in linear),
            "_plain_scales": _column(rate.scale for rate in plain),
            "_sigmoid_scales": _column(rate.scale for rate in sigmoid),
            "_tau_least": _column([] if a is None else [a.a_tau[0], a.b_tau[0]]),
        }.items():
            object.__setattr__(self, name, value)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the gates, in the order of every array of gates."""
        return ("m", "h", "n") if self.a_current is None else ("m", "A", "h", "B", "n")

    def rates(self, voltage: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return opening and total rates [1/ms] of all gates, each (gates, n), at voltages of shape (n,) [mV]."""
        return self._compose(self._terms(voltage))

    def rates_and_slopes(self, voltage: FloatArray) -> GateRates:
        """Return rates of all gates at voltages of shape (n,) [mV] with their derivatives."""
        terms = self._terms(voltage)
        opening, total = self._compose(terms)
        return GateRates(opening, total, *self._differentiate(terms, opening, total))

    def _terms(self, voltage: FloatArray) -> _Terms:
        arguments = self._slopes * np.minimum(np.maximum(voltage, -VOLTAGE_LIMIT), VOLTAGE_LIMIT)
        arguments += self._intercepts
        z = arguments[:2]
        growth = np.expm1(z)
        # with z = -y: z / expm1(z) = y / (1 - exp(-y)), whose removable singularity has the value 1
        linear = z / growth if growth.all() else np.divide(z, growth, out=np.ones_like(z), where=growth != 0.0)
        exponential = np.exp(arguments[2:])
        sigmoid = exponential[3 if self.a_current is None else 4 :] + 1.0
        return _Terms(arguments, growth, linear, exponential, np.divide(1.0, sigmoid, out=sigmoid))

    def _compose(self, terms: _Terms) -> tuple[FloatArray, FloatArray]:
        plain = terms.exponential[: len(self._plain_scales)] * self._plain_scales
        sigmoid = terms.sigmoid * self._sigmoid_scales
        gates = 3 if self.a_current is None else 5
        opening, total = np.empty((2, gates, plain.shape[1]))
        h = gates // 2
        ends = opening[:: gates - 1]  # m and n
        np.multiply(self._open_scales, terms.linear, out=ends)
        np.add(ends, plain[:2], out=total[:: gates - 1])
        opening[h] = plain[2]
        np.add(plain[2], sigmoid[0], out=total[h])
        if self.a_current is not None:
            middle, middle_total = opening[1:4:2], total[1:4:2]  # A and B
            duration = sigmoid[3:]
            duration += self._tau_least
            np.divide(1.0, duration, out=middle_total)
            np.cbrt(plain[3] * sigmoid[1], out=opening[1])
            square = np.square(sigmoid[2])
            np.square(square, out=opening[3])
            middle *= middle_total
        return opening, total

    def _differentiate(self, terms: _Terms, opening: FloatArray, total: FloatArray) -> tuple[FloatArray, FloatArray]:
        e, sigmoid, slopes = terms.exponential, terms.sigmoid, self._slopes
        gates = len(opening)
        plain = len(e) - len(sigmoid)
        closed = 1.0 - sigmoid
        sigmoid_slope = -slopes[2 + plain :] * sigmoid * closed
        opening_slope, total_slope = np.empty_like(opening), np.empty_like(total)
        ends, h = slice(None, None, gates - 1), gates // 2
        opening_slope[ends] = self._open_scales * slopes[:2] * _linear_slope(terms)
        total_slope[ends] = opening_slope[ends] + self._plain_scales[:2] * slopes[2:4] * e[:2]
        opening_slope[h] = slopes[4] * opening[h]
        total_slope[h] = opening_slope[h] + self.kinetics.h_close.scale * sigmoid_slope[0]
        if self.a_current is not None:
            middle = slice(1, 4, 2)
            total_slope[middle] = -self._sigmoid_scales[3:] * sigmoid_slope[3:] * total[middle] ** 2
            relative = total_slope[middle] / total[middle]
            relative[0] += (slopes[5] - slopes[7] * closed[1]) / 3.0
            relative[1] -= 4.0 * slopes[8] * closed[2]
            opening_slope[middle] = opening[middle] * relative
        return opening_slope, total_slope


def open_fractions(gates: FloatArray) -> FloatArray:
    """Return open fractions ``m^3 h``, (``A^3 B``,) ``n^4`` of the channels, shape (2 or 3, n)."""
    pairs = len(gates) // 2
    activation, n = gates[:pairs], gates[-1]
    fractions = np.empty((pairs + 1, gates.shape[1]))
    cube = activation * activation
    cube *= activation
    np.multiply(cube, gates[pairs:-1], out=fractions[:pairs])
    square = n * n
    np.multiply(square, square, out=fractions[-1])
    return fractions


def channel_of_gate(gates: int) -> list[int]:
    """Return the row of :func:`open_fractions` that contains each gate."""
    return [0, 0, 1] if gates == 3 else [0, 1, 0, 1, 2]


def fraction_slopes(gates: FloatArray) -> FloatArray:
    """Return the derivative of each open fraction with respect to each of its gates, shape (gates, n)."""
    pairs = len(gates) // 2
    activation, n = gates[:pairs], gates[-1]
    square = activation * activation
    slopes = np.empty_like(gates)
    np.multiply(3.0 * square, gates[pairs:-1], out=slopes[:pairs])
    np.multiply(square, activation, out=slopes[pairs:-1])
    np.multiply(4.0 * n * n, n, out=slopes[-1])
    return slopes


def _column(values: Iterable[float]) -> FloatArray:
    return np.array(list(values))[:, None]


def _linear_slope(terms: _Terms) -> FloatArray:
    """Derivative of ``z / expm1(z)``, from its series where the closed form suffers from cancellation."""
    z, growth = terms.arguments[:2], terms.growth
    near = np.abs(z) < 0.02
    if not near.any():
        return (1.0 - terms.linear - z) / growth
    series = -0.5 + z * (1.0 / 6.0 - z**2 * (1.0 / 180.0 - z**2 / 5040.0))
    closed = np.divide(1.0 - terms.linear - z, growth, out=np.zeros_like(z), where=~near)
    return np.where(near, series, closed)


HODGKIN_HUXLEY_KINETICS = Kinetics(
    m_open=Rate(0.1, 40.0, 10.0),
    m_close=Rate(4.0, 65.0, 18.0),
    h_open=Rate(0.07, 65.0, 20.0),
    h_close=Rate(1.0, 35.0, 10.0),
    n_open=Rate(0.01, 55.0, 10.0),
    n_close=Rate(0.125, 65.0, 80.0),
)
"""Hodgkin & Huxley (1952) with the resting potential at -65 mV."""

CONNOR_STEVENS_KINETICS = Kinetics(
    m_open=Rate(0.38, 29.7, 10.0),
    m_close=Rate(15.2, 54.7, 18.0),
    h_open=Rate(0.266, 48.0, 20.0),
    h_close=Rate(3.8, 18.0, 10.0),
    n_open=Rate(0.019, 45.7, 10.0),
    n_close=Rate(0.2375, 55.7, 80.0),
)
"""Connor, Walter & McKown (1977), unrounded."""
