"""Membrane model of a touch afferent: its gates, channels and their currents.

``C dV/dt = c_Na g_Na m^3 h (E_Na - V) + c_K g_K n^4 (E_K - V) + c_L g_L (E_L - V) + c_A g_A A^3 B (E_A - V) + I``

with voltages in mV, times in ms, conductances in mS/cm² and currents in µA/cm².

Every gate ``x`` obeys ``dx/dt = opening(V) - total(V) x``, so that ``x_inf = opening / total`` and
``tau = 1 / total``. Arrays of gates have one row for each gate, in the order m, (A,) h, (B,) n: activation before
inactivation, so that ``m^3 h`` and ``A^3 B`` are computed together. Arrays of channels have the rows Na, (A,) K.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.base.errors import InputError
from softness_bayes.base.ranges import numbers, require_members

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

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the gates, in the order of every array of gates."""
        return ("m", "h", "n") if self.a_current is None else ("m", "A", "h", "B", "n")

    def rates(self, voltage: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return opening and total rates [1/ms] of all gates, each (gates, n), at voltages of shape (n,) [mV]."""
        return self._formulas(np.minimum(np.maximum(voltage, -VOLTAGE_LIMIT), VOLTAGE_LIMIT))

    def rates_and_slopes(self, voltage: FloatArray) -> GateRates:
        """Return rates of all gates at voltages of shape (n,) [mV] with their derivatives.

        The derivatives are the imaginary parts of the formulas at a voltage with a tiny imaginary part, exact to
        rounding because no difference is taken.
        """
        tiny = 1e-30
        opening, total = self._formulas(np.clip(voltage, -VOLTAGE_LIMIT, VOLTAGE_LIMIT) + 1j * tiny)
        return GateRates(opening.real, total.real, opening.imag / tiny, total.imag / tiny)

    @cached_property
    def _constants(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Scales, offsets and ``-1 / width`` of all exponentials, a row for each: two of m and n, h, then A and B."""
        k, a = self.kinetics, self.a_current
        rows = [k.m_open, k.n_open, k.m_close, k.n_close, k.h_open, k.h_close]
        if a is not None:
            scales = a.a_scale, 1.0, 1.0, a.a_tau[1], a.b_tau[1]
            rows += [Rate(s, o, -w) for s, o, w in zip(scales, a.offsets, a.widths, strict=True)]
        scale, offset, width = np.array(rows).T[..., None]
        return scale, offset, -1.0 / width

    def _formulas(self, voltage: Any) -> tuple[Any, Any]:
        """Return opening and total rates at real or complex voltages."""
        scale, offset, inverse = self._constants
        z = (voltage + offset) * inverse
        growth, exponential = np.expm1(z[:2]), np.exp(z[2:])
        # with z = -y: z / expm1(z) = y / (1 - exp(-y)), near 0 from its series because the slope would lose its digits
        near = np.abs(z[:2]) < 0.02
        linear = z[:2] / np.where(near, 1.0, growth)
        if near.any():
            square = np.square(z[:2])
            series = 1.0 - 0.5 * z[:2] + square * (1.0 / 12.0 - square * (1.0 / 720.0 - square / 30240.0))
            linear = np.where(near, series, linear)
        opening, total = np.empty((2, len(self.names), *z.shape[1:]), z.dtype)
        last = len(opening) - 1
        opening[::last] = linear * (scale[:2] / -inverse[:2])  # m and n
        total[::last] = opening[::last] + scale[2:4] * exponential[:2]
        h = len(opening) // 2
        opening[h] = scale[4] * exponential[2]
        if self.a_current is None:
            total[h] = opening[h] + scale[5] / (1.0 + exponential[3])
            return opening, total
        sigmoid = 1.0 / (1.0 + exponential[[3, 5, 6, 7, 8]])
        total[h] = opening[h] + scale[5] * sigmoid[0]
        total[1], total[3] = (
            1.0 / (tau[0] + tau[1] * one)
            for tau, one in zip((self.a_current.a_tau, self.a_current.b_tau), sigmoid[3:], strict=True)
        )
        opening[1] = (scale[6] * exponential[4] * sigmoid[1]) ** (1.0 / 3.0) * total[1]
        opening[3] = np.square(np.square(sigmoid[2])) * total[3]
        return opening, total


def open_fractions(gates: FloatArray) -> FloatArray:
    """Return open fractions ``m^3 h``, (``A^3 B``,) ``n^4`` of the channels, shape (2 or 3, n)."""
    pairs = len(gates) // 2
    activation, n = gates[:pairs], gates[-1:]
    return np.concatenate([activation * activation * activation * gates[pairs:-1], np.square(np.square(n))])


def channel_of_gate(gates: int) -> list[int]:
    """Return the row of :func:`open_fractions` that contains each gate."""
    return [0, 0, 1] if gates == 3 else [0, 1, 0, 1, 2]


def fraction_slopes(gates: FloatArray) -> FloatArray:
    """Return the derivative of each open fraction with respect to each of its gates, shape (gates, n)."""
    pairs = len(gates) // 2
    activation, n = gates[:pairs], gates[-1:]
    square = activation * activation
    return np.concatenate([3.0 * square * gates[pairs:-1], square * activation, 4.0 * n * n * n])


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


class Channels(NamedTuple):
    """Multipliers of the four maximal conductances [-]: floats, or arrays that broadcast."""

    c_Na: Any
    c_K: Any
    c_L: Any
    c_A: Any


PAPER_CHANNELS = Channels(c_Na=1.05, c_K=1.16, c_L=1.0, c_A=1.5)
"""The paper's multipliers."""


@dataclass(frozen=True)
class Membrane:
    """Constants of one excitable membrane: one interpretation of the two sources cited in the paper.

    Parameters
    ----------
    name : str
        Name in options and files.
    g_na, g_k, g_l, g_a : float
        Maximal conductances [mS/cm²]; ``g_a`` is used only if the gating has an A-current.
    e_na, e_k, e_l, e_a : float
        Reversal potentials [mV].
    gating : Gating
        Rates of the gates.
    capacitance : float
        Membrane capacitance [µF/cm²].
    meaning : str
        Description of the reading, for lists.
    """

    name: str
    g_na: float
    g_k: float
    g_l: float
    g_a: float
    e_na: float
    e_k: float
    e_l: float
    e_a: float
    gating: Gating
    capacitance: float = 1.0
    meaning: str = field(default="", repr=False, compare=False)

    @property
    def voltage_range(self) -> tuple[float, float]:
        """Lowest and highest reversal potential [mV]: without a current, the voltage cannot leave this range."""
        potentials = (self.e_na, self.e_k, self.e_l, self.e_a)[: 4 if self.gating.a_current else 3]
        return min(potentials), max(potentials)

    @property
    def without_effect(self) -> tuple[str, ...]:
        """Names of the multipliers of currents absent from the membrane."""
        return ("c_A",) if self.gating.a_current is None else ()


CONNOR_STEVENS = Membrane(
    name="connor-stevens",
    g_na=120.0,
    g_k=20.0,
    g_l=0.3,
    g_a=47.7,
    e_na=55.0,
    e_k=-72.0,
    e_l=-17.0,
    e_a=-75.0,
    gating=Gating(CONNOR_STEVENS_KINETICS, AKinetics()),
    meaning="Connor, Walter & McKown (1977)",
)

HODGKIN_HUXLEY = Membrane(
    name="hodgkin-huxley",
    g_na=120.0,
    g_k=36.0,
    g_l=0.3,
    g_a=0.0,
    e_na=50.0,
    e_k=-77.0,
    e_l=-54.387,
    e_a=-75.0,
    gating=Gating(HODGKIN_HUXLEY_KINETICS),
    meaning="Hodgkin & Huxley (1952) without an A-current; c_A has no effect",
)

PRINTED = Membrane(
    name="printed",
    g_na=120.0,
    g_k=36.0,
    g_l=0.3,
    g_a=47.7,
    e_na=50.0,
    e_k=-77.0,
    e_l=-54.387,
    e_a=-75.0,
    gating=Gating(HODGKIN_HUXLEY_KINETICS, AKinetics()),
    meaning="Hodgkin & Huxley plus the A-current: the literal sum of the paper's citations",
)

MEMBRANES: Mapping[str, Membrane] = MappingProxyType(
    {membrane.name: membrane for membrane in (CONNOR_STEVENS, HODGKIN_HUXLEY, PRINTED)}
)
"""The membranes by name."""


class SteadyTerms(NamedTuple):
    """Outward steady currents of the channels Na, K, L and A at multiplier 1, shape (4, n)."""

    current: FloatArray
    """[µA/cm²]"""
    slope: FloatArray
    """Derivative with respect to voltage [mS/cm²]"""


def steady_terms(voltage: FloatArray, membrane: Membrane) -> SteadyTerms:
    """Return the channels' outward currents at clamped voltages of shape (n,) [mV]; combinations give ``I_ss``."""
    rates = membrane.gating.rates_and_slopes(voltage)
    gates = rates.opening / rates.total
    gate_slopes = (rates.opening_slope - gates * rates.total_slope) / rates.total
    fractions, slopes = np.zeros((4, voltage.size)), np.zeros((4, voltage.size))
    rows = [0, 1] if membrane.gating.a_current is None else [0, 3, 1]
    fractions[rows], fractions[2] = open_fractions(gates), 1.0
    for channel, slope in zip(channel_of_gate(len(gates)), fraction_slopes(gates) * gate_slopes, strict=True):
        slopes[rows[channel]] += slope
    conductance = np.array([membrane.g_na, membrane.g_k, membrane.g_l, membrane.g_a])[:, None]
    force = voltage - np.array([membrane.e_na, membrane.e_k, membrane.e_l, membrane.e_a])[:, None]
    return SteadyTerms(conductance * fractions * force, conductance * (slopes * force + fractions))


def lanes(channels: Channels, **others: ArrayLike) -> tuple[tuple[int, ...], list[FloatArray]]:
    """Check and broadcast the multipliers and further named arrays; return the common shape and the flattened arrays.

    Raises
    ------
    InputError
        If a value is not finite, or a multiplier negative.
    """
    require_members("channels", channels, Channels._fields, "Channels, as in PAPER_CHANNELS")
    shape, table = rows_of((*channels, *(numbers(name, given) for name, given in others.items())))
    if not np.isfinite(table).all():
        k, wrong = next((k, row[~np.isfinite(row)]) for k, row in enumerate(table) if not np.isfinite(row).all())
        raise InputError(f"{(*Channels._fields, *others)[k]} is not finite: {wrong[0]}")
    if (table[:4] < 0.0).any():
        k, wrong = next((k, row[row < 0.0]) for k, row in enumerate(table) if (row < 0.0).any())
        raise InputError(f"{Channels._fields[k]} is negative: {wrong[0]}")
    return shape, [*table]


def rows_of(values: Sequence[ArrayLike]) -> tuple[tuple[int, ...], FloatArray]:
    """Broadcast arrays; return their common shape, and each as a row of one table, shape (len(values), size)."""
    shape = np.broadcast(*values).shape
    table = np.empty((len(values), *shape))
    for k, value in enumerate(values):
        table[k] = value
    return shape, table.reshape(len(values), -1)
