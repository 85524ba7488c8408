"""Receptors in JAX, where it is installed (extra ``peers``): compiled for the processor, all side by side.

`step_cells` takes fixed steps of the classical fourth-order Runge-Kutta method in one compiled loop. `orbit_cells`
leaves the steps to diffrax, whose controller adapts them to a tolerance for each receptor. Both use double precision.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes.bench.peers import Peer
from softness_bayes.touch.neuron.equilibrium import rest
from softness_bayes.touch.neuron.gating import Rate
from softness_bayes.touch.neuron.limit_cycle import SPIKE_VOLTAGE
from softness_bayes.touch.neuron.membrane import CONNOR_STEVENS, PAPER_CHANNELS, Channels, Membrane

if TYPE_CHECKING:
    from jax import Array as JaxArray

Array = NDArray[np.float64]

ABSENT = "JAX or diffrax is not installed: pip install 'softness-bayes[peers]'"

_REFRACTORY = 1.0
"""Time after a spike [ms] in which no other begins; the search for the next one starts then."""


def jax_is_there() -> bool:
    """Return whether JAX and diffrax can be imported."""
    try:
        import diffrax  # noqa: F401
        import jax  # noqa: F401
    except ImportError:
        return False
    return True


def jax_peers(
    steps: tuple[float, ...] = (0.05, 0.02), tolerances: tuple[float, ...] = (1e-4, 1e-7)
) -> tuple[Peer, ...]:
    """Return steps [ms] and relative tolerances of JAX as peers; none where it cannot be imported."""
    if not jax_is_there():
        return ()
    return (
        *(Peer("JAX, side by side", f"rk4, {step} ms", _stepped(step), True) for step in steps),
        *(Peer("JAX, diffrax, side by side", f"Tsit5, rtol {rtol:.0e}", _adapted(rtol), True) for rtol in tolerances),
    )


def _stepped(step: float) -> Callable[[Array, float], Array]:
    return lambda current, duration: step_cells(current, duration, step)


def _adapted(rtol: float) -> Callable[[Array, float], Array]:
    return lambda current, duration: orbit_cells(current, 0.5 * duration, rtol)


def step_cells(
    current: Array,
    duration: float,
    step: float,
    channels: Channels = PAPER_CHANNELS,
    membrane: Membrane = CONNOR_STEVENS,
) -> Array:
    """Return rates [Hz] after a current step from rest: those of the spikes in the second half of a simulation.

    The crossing of the spike voltage is interpolated linearly within a step. A rate is 0 with fewer than two spikes.

    Parameters
    ----------
    current : ndarray, shape (n,)
        Currents [µA/cm²].
    duration : float
        Length of the simulation [ms].
    step : float
        Length of a step [ms].
    channels : Channels
        Scalar multipliers [-].
    membrane : Membrane
        Constants.

    Returns
    -------
    ndarray, shape (n,)
    """
    import jax

    with jax.enable_x64(True):
        state = np.repeat(_rest(channels, membrane), current.size, axis=1)
        weights = np.array(channels, float)
        first, last, counted = _stepping(membrane)(state, current, weights, step, round(duration / step))
        begin, end, spikes = np.asarray(first), np.asarray(last), np.asarray(counted)
    some = spikes > 1
    return np.where(some, 1000.0 * (spikes - 1) / np.where(some, end - begin, 1.0), 0.0)


def orbit_cells(
    current: Array,
    settling: float,
    rtol: float,
    channels: Channels = PAPER_CHANNELS,
    membrane: Membrane = CONNOR_STEVENS,
) -> Array:
    """Return rates [Hz] after a current step from rest: those of one interval between spikes after the settling.

    Tsitouras's fifth-order Runge-Kutta method; a search in its interpolation finds the crossing of the spike voltage.
    A rate is 0 if the next spike does not come within the time of the settling.

    Parameters
    ----------
    current : ndarray, shape (n,)
        Currents [µA/cm²].
    settling : float
        Initial part that is discarded [ms].
    rtol : float
        Relative tolerance of a step; the absolute one is a thousandth of it.
    channels : Channels
        Scalar multipliers [-].
    membrane : Membrane
        Constants.

    Returns
    -------
    ndarray, shape (n,)
    """
    import jax

    with jax.enable_x64(True):
        start, weights = _rest(channels, membrane)[:, 0], np.array(channels, float)
        found = np.asarray(_orbiting(membrane)(start, current, weights, settling, rtol))
    some = found < settling
    return np.where(some, 1000.0 / np.where(some, found, 1.0), 0.0)


@cache
def _stepping(membrane: Membrane) -> Callable[..., Any]:
    """Return the compiled loop over steps of equal length."""
    import jax
    import jax.numpy as jnp

    def run(state: JaxArray, current: JaxArray, weights: JaxArray, step: float, steps: int) -> Any:
        def slope(at: JaxArray) -> JaxArray:
            return _slope(at, current, weights, membrane)

        def advance(k: int, carried: Any) -> Any:
            at, first, last, counted = carried
            one = slope(at)
            two = slope(at + 0.5 * step * one)
            three = slope(at + 0.5 * step * two)
            four = slope(at + step * three)
            to = at + step / 6.0 * (one + 2.0 * two + 2.0 * three + four)
            fired = (at[0] < SPIKE_VOLTAGE) & (to[0] >= SPIKE_VOLTAGE) & (2 * k >= steps)
            spike = (k + (SPIKE_VOLTAGE - at[0]) / (to[0] - at[0])) * step
            return (
                to,
                jnp.where(fired & (counted == 0), spike, first),
                jnp.where(fired, spike, last),
                counted + fired,
            )

        nothing = jnp.zeros(current.shape)
        begin = (state, nothing, nothing, jnp.zeros(current.shape, int))
        return jax.lax.fori_loop(0, steps, advance, begin)[1:]

    return jax.jit(run)


@cache
def _orbiting(membrane: Membrane) -> Callable[..., Any]:
    """Return the compiled search for one interval between spikes [ms], for every current."""
    import diffrax
    import jax
    import optimistix

    def one(start: JaxArray, current: JaxArray, weights: JaxArray, settling: float, rtol: float) -> JaxArray:
        control = diffrax.PIDController(rtol=rtol, atol=1e-3 * rtol)
        term = diffrax.ODETerm(lambda _t, state, _: _slope(state, current, weights, membrane))
        spike = diffrax.Event(
            lambda t, y, args, **_: y[0] - SPIKE_VOLTAGE,
            optimistix.Newton(1e-10, 1e-10, optimistix.rms_norm),
            direction=True,
        )

        def solve(state: JaxArray, span: float, event: Any = None) -> Any:
            found = diffrax.diffeqsolve(
                term,
                diffrax.Tsit5(),
                0.0,
                span,
                1e-2,
                state,
                stepsize_controller=control,
                max_steps=2**22,
                event=event,
            )
            return found.ys[-1], found.ts[-1]

        settled, _ = solve(start, settling)
        at_spike, _ = solve(settled, settling, spike)
        after, _ = solve(at_spike, _REFRACTORY)
        _, rest_of_interval = solve(after, settling, spike)
        return _REFRACTORY + rest_of_interval

    return jax.jit(jax.vmap(one, (None, 0, None, None, None)))


def _slope(state: JaxArray, current: JaxArray, weights: JaxArray, membrane: Membrane) -> JaxArray:
    """Return the time derivative of a state [mV/ms and 1/ms], shape (1 + gates, ...)."""
    import jax.numpy as jnp

    voltage, k, a = state[0], membrane.gating.kinetics, membrane.gating.a_current
    gates = dict(zip(membrane.gating.names, state[1:], strict=True))

    def grows(rate: Rate) -> JaxArray:
        return rate.scale * jnp.exp(-(voltage + rate.offset) / rate.width)

    def bends(rate: Rate) -> JaxArray:
        y = (voltage + rate.offset) / rate.width
        return rate.scale * rate.width * jnp.where(y == 0.0, 1.0, y / -jnp.expm1(-y))

    def falls(offset: float, width: float) -> JaxArray:
        return 1.0 / (1.0 + jnp.exp((voltage + offset) / width))

    closes = k.h_close.scale * falls(k.h_close.offset, -k.h_close.width)
    changes = {
        name: opening * (1.0 - gates[name]) - closing * gates[name]
        for name, opening, closing in (
            ("m", bends(k.m_open), grows(k.m_close)),
            ("h", grows(k.h_open), closes),
            ("n", bends(k.n_open), grows(k.n_close)),
        )
    }
    c_na, c_k, c_l, c_a = weights
    net = current + c_na * membrane.g_na * gates["m"] ** 3 * gates["h"] * (membrane.e_na - voltage)
    net += c_k * membrane.g_k * gates["n"] ** 4 * (membrane.e_k - voltage)
    net += c_l * membrane.g_l * (membrane.e_l - voltage)
    if a is not None:
        offsets, widths = a.offsets, a.widths
        opened = a.a_scale * jnp.exp((voltage + offsets[0]) / widths[0]) * falls(offsets[1], widths[1])
        towards = {"A": jnp.cbrt(opened), "B": falls(offsets[2], widths[2]) ** 4}
        times = {
            "A": a.a_tau[0] + a.a_tau[1] * falls(offsets[3], widths[3]),
            "B": a.b_tau[0] + a.b_tau[1] * falls(offsets[4], widths[4]),
        }
        changes |= {name: (towards[name] - gates[name]) / times[name] for name in towards}
        net += c_a * membrane.g_a * gates["A"] ** 3 * gates["B"] * (membrane.e_a - voltage)
    return jnp.stack([net / membrane.capacitance, *(changes[name] for name in gates)])


def _rest(channels: Channels, membrane: Membrane) -> Array:
    """Return the state at rest, shape (1 + gates, 1)."""
    return rest(Channels(*(np.atleast_1d(float(c)) for c in channels)), membrane)
