"""Membrane model of a touch afferent: channels and their currents.

``C dV/dt = c_Na g_Na m^3 h (E_Na - V) + c_K g_K n^4 (E_K - V) + c_L g_L (E_L - V) + c_A g_A A^3 B (E_A - V) + I``

with voltages in mV, times in ms, conductances in mS/cm² and currents in µA/cm².
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.errors import InputError
from softness_bayes.kinds import numbers, require_members
from softness_bayes.touch.neuron.gating import (
    CONNOR_STEVENS_KINETICS,
    HODGKIN_HUXLEY_KINETICS,
    AKinetics,
    Gating,
    channel_of_gate,
    fraction_slopes,
    open_fractions,
)

FloatArray = NDArray[np.float64]


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
