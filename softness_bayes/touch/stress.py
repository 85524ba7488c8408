"""Pressure under the fingerpad and the resulting stress at receptor depth (model.md 4-5)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ellipe, ellipkm1

from softness_bayes.base.ranges import numbers
from softness_bayes.touch.contact import Finger, Fingertip, hertz_force

Array = NDArray[np.float64]

ATTENUATION = 2.67e-3
"""kappa of the attenuated pressure [N m]: 2.67 in the paper, which must be in N mm."""

GAUSS_DENSITY = 9.0
"""Gauss nodes per unit of the graded variable of the stress integral; 9 reach 1e-12 at every depth."""


@dataclass(frozen=True)
class Pressure:
    """A reading of the contact pressure, p(r) = amplitude sqrt(1 - r²/a²) exp(-decay r²/a²) for r <= a.

    Amplitude and decay depend on the touch only through E_star and a. A scene can therefore tabulate the stress field
    of a load as a one-parameter family.
    """

    name: str
    amplitude: Callable[[Array, Array, Fingertip], Array]
    """Pressure at the centre [Pa] as a function of E_star [Pa], a [m] and the finger."""
    decay: Callable[[Array, Array, Fingertip], Array]
    """Dimensionless decay as a function of the same quantities."""
    meaning: str = field(default="", repr=False, compare=False)
    """Description of the reading, for lists."""

    def __call__(self, r: ArrayLike, reduced_modulus: ArrayLike, radius: ArrayLike, finger: Fingertip) -> Array:
        """Return the pressure [Pa] at distance `r` [m] from the axis; 0 outside the contact."""
        modulus, a = np.asarray(reduced_modulus, float), np.asarray(radius, float)
        x2 = (np.asarray(r, float) / a) ** 2
        inside = np.sqrt(np.maximum(1.0 - x2, 0.0)) * np.exp(-self.decay(modulus, a, finger) * np.minimum(x2, 1.0))
        return self.amplitude(modulus, a, finger) * inside


def _hertz_amplitude(modulus: Array, a: Array, finger: Fingertip) -> Array:
    return 2.0 * modulus * a / (np.pi * finger.radius)


def _hertz_decay(modulus: Array, a: Array, finger: Fingertip) -> Array:
    return 0.0 * modulus * a


def _attenuated_decay(modulus: Array, a: Array, finger: Fingertip) -> Array:
    return hertz_force(modulus, a, finger) * a / ATTENUATION


def _printed_amplitude(modulus: Array, a: Array, finger: Fingertip) -> Array:
    return 2.0 * modulus * a / finger.radius


def _printed_decay(modulus: Array, a: Array, finger: Fingertip) -> Array:
    # numbers in mm-N-MPa, as in the paper: F = 4 a⁴ E_star / 3 and r² F / (2.67 a)
    a_mm, modulus_mpa = a * 1e3, modulus * 1e-6
    return a_mm * (4.0 * a_mm**4 * modulus_mpa / 3.0) / 2.67


ATTENUATED = Pressure(
    "attenuated",
    _hertz_amplitude,
    _attenuated_decay,
    "Hertz's pressure attenuated by exp(-r² F / (kappa a)); integrates to less than F",
)
HERTZ = Pressure("hertz", _hertz_amplitude, _hertz_decay, "Hertz's pressure; integrates to F")
PRINTED_PRESSURE = Pressure(
    "printed", _printed_amplitude, _printed_decay, "the attenuated pressure as the paper prints it, in mm-N-MPa"
)


@dataclass(frozen=True)
class Kernel:
    """A reading of the stress at depth z and distance rho due to pressure at distance s (model.md 5).

    `vertical(rho, s, z)` returns the stress sigma_z per unit pressure and length [1/m], and `plane` the stresses
    (sigma_x, sigma_z, tau_xz), None where the kernel does not give them; `centre(rho, z)` is the s at which the
    influence peaks; `two_sided` is true if s runs over [-a, a] (a line), false if over [0, a] (rings).
    """

    name: str
    vertical: Callable[[Array, Array, float], Array]
    plane: Callable[[Array, Array, float], tuple[Array, Array, Array]] | None
    centre: Callable[[Array, float], Array]
    two_sided: bool
    far_power: float
    """Exponent n of the decay rho^-n of the vertical stress far from the contact."""
    meaning: str = field(default="", repr=False, compare=False)
    """Description of the reading, for lists."""


def _plane(gap: Array, away: Array, z: float) -> tuple[Array, Array, Array]:
    """Return the plane stresses of a line load, with the gap of the numerators and that of the denominators."""
    common = 2.0 * z / np.pi / (away**2 + z**2) ** 2
    return common * gap**2, common * z**2, common * z * gap


def _line_vertical(rho: Array, s: Array, z: float) -> Array:
    return (2.0 * z**3 / np.pi) / ((rho - s) ** 2 + z**2) ** 2


def _line_plane(rho: Array, s: Array, z: float) -> tuple[Array, Array, Array]:
    return _plane(rho - s, rho - s, z)


def _line_centre(rho: Array, z: float) -> Array:
    return rho


def _printed_vertical(rho: Array, s: Array, z: float) -> Array:
    return (2.0 * z**3 / np.pi) / ((np.hypot(rho, z) - s) ** 2 + z**2) ** 2


def _printed_plane(rho: Array, s: Array, z: float) -> tuple[Array, Array, Array]:
    return _plane(rho - s, np.hypot(rho, z) - s, z)


def _printed_centre(rho: Array, z: float) -> Array:
    return np.hypot(rho, z)


def _ring_vertical(rho: Array, s: Array, z: float) -> Array:
    # the ring of radius s: 3 z³/(2 pi) s times the integral of d^-5 over its angle, by elliptic integrals
    near, far = (rho - s) ** 2 + z**2, (rho + s) ** 2 + z**2
    complement = near / far
    k, e = ellipkm1(complement), ellipe(1.0 - complement)
    angle = 4.0 / (3.0 * near**2 * far**1.5) * (2.0 * (near + far) * e - near * k)
    return 1.5 * z**3 / np.pi * s * angle


LINE = Kernel(
    "line",
    _line_vertical,
    _line_plane,
    _line_centre,
    two_sided=True,
    far_power=4.0,
    meaning="Johnson's line load in the plane of the axis and the receptor",
)
PRINTED_KERNEL = Kernel(
    "printed",
    _printed_vertical,
    _printed_plane,
    _printed_centre,
    two_sided=True,
    far_power=4.0,
    meaning="the line load with rho replaced by sqrt(rho² + z²) in the denominators, as the paper prints it",
)
AXISYMMETRIC = Kernel(
    "axisymmetric",
    _ring_vertical,
    None,
    _line_centre,
    two_sided=False,
    far_power=5.0,
    meaning="Boussinesq's point loads summed over the contact disc",
)


@dataclass(frozen=True)
class Component:
    """A reading of the stress that drives the receptor: of sigma_z alone, or of (sigma_x, sigma_z, tau_xz)."""

    name: str
    select: Callable[..., Array]
    needs_plane: bool
    """True if all three plane stresses are needed, which the axisymmetric kernel does not provide."""
    far_power: float | None
    """Exponent n of the decay rho^-n of the stress far from the contact; None if the kernel defines it."""
    meaning: str = field(default="", repr=False, compare=False)
    """Description of the reading, for lists."""


def _vertical(sigma_z: Array) -> Array:
    return sigma_z


def _principal(sigma_x: Array, sigma_z: Array, tau_xz: Array) -> Array:
    return 0.5 * (sigma_x + sigma_z) + np.hypot(0.5 * (sigma_x - sigma_z), tau_xz)


VERTICAL = Component("vertical", _vertical, needs_plane=False, far_power=None, meaning="the vertical stress alone")
PRINCIPAL = Component(
    "principal",
    _principal,
    needs_plane=True,
    far_power=2.0,
    meaning="the largest compressive principal stress of the plane state",
)


@lru_cache(maxsize=64)
def _gauss(nodes: int) -> tuple[Array, Array]:
    x, weight = np.polynomial.legendre.leggauss(nodes)
    x.flags.writeable = weight.flags.writeable = False
    return x, weight


def _graded(lower: Array, upper: Array, centre: Array, scale: Array, density: float) -> tuple[Array, Array]:
    """Gauss nodes and weights on [lower, upper], concentrated within `scale` of `centre` by a sinh map."""
    u0, u1 = np.arcsinh((lower - centre) / scale), np.arcsinh((upper - centre) / scale)
    x, weight = _gauss(int(28 + density * np.max(u1 - u0, initial=0.0)))
    half = 0.5 * (u1 - u0)[..., None]
    u = half * x
    u += 0.5 * (u0 + u1)[..., None]
    # twice sinh and cosh from one exponential, which takes a quarter of the time
    rising = np.exp(u, out=u)
    falling = 1.0 / rising
    place, share = rising - falling, np.add(rising, falling, out=rising)
    place *= 0.5 * scale[..., None]
    place += centre[..., None]
    share *= weight
    share *= 0.5 * half * scale[..., None]
    return place, share


def unit_stress(
    rho: ArrayLike,
    depth: float,
    radius: ArrayLike,
    decay: ArrayLike,
    kernel: Kernel = LINE,
    component: Component = VERTICAL,
    density: float = GAUSS_DENSITY,
) -> Array:
    """Return the stress at a receptor under a pressure of amplitude 1, sqrt(1 - s²/a²) exp(-decay s²/a²).

    The substitution s = a sin(phi) removes the square-root edges. Two length scales remain: the
    receptor's depth around the influence's centre, and the width of the attenuation around the
    axis. If they are far apart, the range is divided between them and each piece is graded towards its own centre. The
    number of nodes then grows only with the logarithm of the ratio of scales as the depth tends to 0 or the decay to
    infinity.

    Parameters
    ----------
    rho
        Distance of the receptor from the contact's axis [m].
    depth
        Receptor depth z [m]; at 0 the stress is the pressure itself.
    radius, decay
        Contact radius a [m] and the pressure's decay; both broadcast with `rho`.
    kernel, component, density
        The readings, and the Gauss nodes per unit of the graded variable.

    Returns
    -------
    ndarray
        Stress divided by the pressure amplitude, of the broadcast shape.
    """
    given = np.broadcast_arrays(np.asarray(rho, float), np.asarray(radius, float), np.asarray(decay, float))
    rho, a, q = (values.reshape(-1) for values in given)
    if depth == 0:
        x2 = (rho / a) ** 2
        pressure = np.where(x2 < 1, np.sqrt(np.maximum(1 - x2, 0)) * np.exp(-q * np.minimum(x2, 1)), 0.0)
        return pressure.reshape(given[0].shape)
    pole = np.arcsin((kernel.centre(rho, depth) + 1j * depth) / a)
    centre = pole.real
    # beyond exp(-42) the pressure is negligible
    edge = np.arcsin(np.minimum(6.5 / np.sqrt(np.maximum(q, 1e-300)), 1.0))
    lower = -edge if kernel.two_sided else np.zeros_like(edge)
    width = 1.0 / np.sqrt(1.0 + 2.0 * q)
    apart = width < 0.5 * centre
    cut = np.where(apart, np.minimum(0.5 * centre, edge), lower)
    scale = np.where(apart, pole.imag, np.minimum(pole.imag, width))

    def piece(of: NDArray[np.bool_] | slice, low: Array, high: Array, centre: Array, scale: Array) -> Array:
        phi, weight = _graded(low[of], high[of], centre[of], scale[of], density)
        sine = np.sin(phi)
        squared = sine**2
        # in place, because the arrays are large and most of the time for tables is spent here
        share = np.exp(-q[of][:, None] * squared)
        share *= np.subtract(1.0, squared, out=squared)
        share *= weight
        sine *= a[of][:, None]
        law = kernel.plane if component.needs_plane else kernel.vertical
        assert law is not None, "refused by Readings"
        found = law(rho[of][:, None], sine, depth)
        parts = found if isinstance(found, tuple) else (found,)
        return a[of] * np.array([np.einsum("ni,ni->n", share, part) for part in parts])

    stresses = piece(slice(None), cut, edge, centre, scale)
    stresses[:, apart] += piece(apart, lower, cut, np.zeros_like(edge), width)
    return component.select(*stresses).reshape(given[0].shape)


def stress(
    rho: ArrayLike,
    reduced_modulus: ArrayLike,
    radius: ArrayLike,
    finger: Fingertip = Finger(),
    pressure: Pressure = ATTENUATED,
    kernel: Kernel = LINE,
    component: Component = VERTICAL,
) -> Array:
    """Return the compressive stress [Pa] at receptor depth, at distance `rho` [m] from the contact's axis.

    Parameters
    ----------
    rho
        Distance from the axis [m].
    reduced_modulus, radius
        E_star [Pa] and contact radius a [m] of a `Contact`; all three broadcast.
    finger, pressure, kernel, component
        Geometry (the depth is `finger.receptor_depth`, a number or an array that broadcasts) and readings
        (model.md 4-5).
    """
    rho, modulus, a = numbers("rho", rho), numbers("reduced_modulus", reduced_modulus), numbers("radius", radius)
    amplitude, decay = pressure.amplitude(modulus, a, finger), pressure.decay(modulus, a, finger)
    # with the depth as the unit of length, one call serves all depths; at depth 0 there is none
    depth = finger.receptor_depth
    unit, one = (depth, 1.0) if np.all(depth) else (1.0, 0.0)
    return amplitude * unit_stress(np.asarray(rho, float) / unit, one, a / unit, decay, kernel, component)
