"""Every receptor in Brian2, where it is installed (extra ``peers``): all in one group."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from softness_bayes.bench.peers import Peer
from softness_bayes.touch.neuron.cells import rest
from softness_bayes.touch.neuron.limit_cycle import SPIKE_VOLTAGE
from softness_bayes.touch.neuron.membrane import CONNOR_STEVENS, PAPER_CHANNELS, Channels

Array = NDArray[np.float64]

EQUATIONS = """
dv/dt = (g_na*m**3*h*(55 - v) + g_k*n**4*(-72 - v) + g_l*(-17 - v) + g_a*a**3*b*(-75 - v) + I)/ms : 1
dm/dt = (am*(1 - m) - bm*m)/ms : 1
dh/dt = (ah*(1 - h) - bh*h)/ms : 1
dn/dt = (an*(1 - n) - bn*n)/ms : 1
da/dt = (a_inf - a)/(tau_a*ms) : 1
db/dt = (b_inf - b)/(tau_b*ms) : 1
am = 3.8/exprel(-(v + 29.7)/10) : 1
bm = 15.2*exp(-(v + 54.7)/18) : 1
ah = 0.266*exp(-(v + 48)/20) : 1
bh = 3.8/(1 + exp(-(v + 18)/10)) : 1
an = 0.19/exprel(-(v + 45.7)/10) : 1
bn = 0.2375*exp(-(v + 55.7)/80) : 1
a_inf = (0.0761*exp((v + 94.22)/31.84)/(1 + exp((v + 1.17)/28.93)))**(1.0/3) : 1
tau_a = 0.3632 + 1.158/(1 + exp((v + 55.96)/20.12)) : 1
b_inf = (1 + exp((v + 53.3)/14.54))**(-4) : 1
tau_b = 1.24 + 2.678/(1 + exp((v + 50)/16.027)) : 1
I : 1
"""
"""Connor, Walter & McKown (1977); voltages in mV, currents in µA/cm², without units for speed."""


def rates(step: float, current: Array, duration: float) -> Array:
    """Return rates [Hz] over the second half of the spikes, with fourth-order Runge-Kutta steps [ms]."""
    import brian2 as b2

    b2.start_scope()
    c, membrane, spikes = PAPER_CHANNELS, CONNOR_STEVENS, f"v > {SPIKE_VOLTAGE}"
    named = {"g_na": membrane.g_na * c.c_Na, "g_k": membrane.g_k * c.c_K}
    named |= {"g_l": membrane.g_l * c.c_L, "g_a": membrane.g_a * c.c_A}
    how = {"threshold": spikes, "refractory": spikes, "method": "rk4", "dt": step * b2.ms, "namespace": named}
    group = b2.NeuronGroup(current.size, EQUATIONS, **how)
    group.I = current
    state = rest(Channels(*(np.atleast_1d(x) for x in c)), membrane)[:, 0]
    for name, value in zip(("v", "m", "a", "h", "b", "n"), state, strict=True):
        setattr(group, name, value)
    monitor = b2.SpikeMonitor(group)
    b2.Network(group, monitor).run(duration * b2.ms)
    found = []
    for train in monitor.spike_trains().values():  # in seconds, whose times are multiples of the step
        times, half = np.asarray(train), len(train) // 2
        found.append((times.size - 1 - half) / float(times[-1] - times[half]) if times.size > 2 else 0.0)
    return np.array(found)


PEERS = tuple(Peer("Brian2", f"rk4, {step} ms", partial(rates, step), True) for step in (0.05, 0.02))
