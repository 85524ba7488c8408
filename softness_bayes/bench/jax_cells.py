"""Every receptor in JAX, where it is installed (extra ``peers``): compiled, side by side, steps adapted by diffrax."""

from __future__ import annotations

from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes.bench.peers import Peer
from softness_bayes.touch.neuron.cells import rest
from softness_bayes.touch.neuron.limit_cycle import SPIKE_VOLTAGE
from softness_bayes.touch.neuron.membrane import CONNOR_STEVENS, PAPER_CHANNELS, Channels

Array = NDArray[np.float64]
REFRACTORY = 1.0
"""Time after a spike [ms] from which the next one is sought."""


def slope(_t: Any, state: Any, current: Any) -> Any:
    """Return the time derivative of a state (voltage, m, A, h, B, n); Connor, Walter & McKown (1977), mV and ms."""
    import jax.numpy as np
    from jax.numpy import exp

    v, m, a, h, b, n = state
    c = PAPER_CHANNELS
    a_inf = np.cbrt(0.0761 * exp((v + 94.22) / 31.84) / (1 + exp((v + 1.17) / 28.93)))
    net = current + 120 * c.c_Na * m**3 * h * (55 - v) + 20 * c.c_K * n**4 * (-72 - v)
    return np.stack(
        [
            net + 0.3 * c.c_L * (-17 - v) + 47.7 * c.c_A * a**3 * b * (-75 - v),
            0.38 * (v + 29.7) / -np.expm1(-(v + 29.7) / 10) * (1 - m) - 15.2 * exp(-(v + 54.7) / 18) * m,
            (a_inf - a) / (0.3632 + 1.158 / (1 + exp((v + 55.96) / 20.12))),
            0.266 * exp(-(v + 48) / 20) * (1 - h) - 3.8 / (1 + exp(-(v + 18) / 10)) * h,
            (1 / (1 + exp((v + 53.3) / 14.54)) ** 4 - b) / (1.24 + 2.678 / (1 + exp((v + 50) / 16.027))),
            0.019 * (v + 45.7) / -np.expm1(-(v + 45.7) / 10) * (1 - n) - 0.2375 * exp(-(v + 55.7) / 80) * n,
        ]
    )


@cache
def compiled(rtol: float) -> Any:
    """Return the compiled search for one interval between spikes [ms] after a settling time, for every current."""
    import diffrax
    import jax
    import optimistix

    newton = optimistix.Newton(1e-10, 1e-10, optimistix.rms_norm)
    spike = diffrax.Event(lambda t, y, args, **_: y[0] - SPIKE_VOLTAGE, newton, direction=True)
    control = diffrax.PIDController(rtol=rtol, atol=1e-3 * rtol)
    how = {"stepsize_controller": control, "max_steps": 2**22}

    def one(start: Any, current: Any, settling: float) -> Any:
        def solve(state: Any, span: float, event: Any = None) -> Any:
            method, term = diffrax.Tsit5(), diffrax.ODETerm(slope)
            return diffrax.diffeqsolve(term, method, 0.0, span, 1e-2, state, current, event=event, **how)

        spiked = solve(solve(start, settling).ys[-1], settling, spike).ys[-1]
        return REFRACTORY + solve(solve(spiked, REFRACTORY).ys[-1], settling, spike).ts[-1]

    return jax.jit(jax.vmap(one, (None, 0, None)))


def rates(rtol: float, current: Array, duration: float) -> Array:
    """Return rates [Hz] after a current step from rest; 0 without a second spike in half of the duration [ms]."""
    import jax

    with jax.enable_x64(True):
        start = rest(Channels(*(np.atleast_1d(c) for c in PAPER_CHANNELS)), CONNOR_STEVENS)[:, 0]
        interval = np.asarray(compiled(rtol)(start, current, 0.5 * duration))
    return np.where(interval < 0.5 * duration, 1000.0 / interval, 0.0)


PEERS = tuple(Peer("JAX, diffrax", f"Tsit5, rtol {rtol:.0e}", partial(rates, rtol), True) for rtol in (1e-4, 1e-7))
