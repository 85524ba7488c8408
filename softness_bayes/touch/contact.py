"""The finger, its skin, its loads and its contact with a fabric: moduli, contact radius, force (model.md 1-3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.base.errors import InputError, NumericalError
from softness_bayes.base.ranges import FORCES, INDENTATIONS, numbers, refuse, require_kind

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SkinDisplacement:
    """A reading of the skin's compression u at the contact centre (model.md 2).

    u = (a^power / R) / (1 + k E_skin), with k = (1 - nu_fab²) / ((1 - nu_skin²) E_fab).
    """

    name: str
    power: int
    exponent_unit: str
    meaning: str = field(default="", repr=False, compare=False)
    """Description of the reading, for lists."""


STRAIN = SkinDisplacement(
    "printed", power=1, exponent_unit="–", meaning="the compression a/R, a strain, as the paper prints it"
)


DISPLACEMENT = SkinDisplacement(
    "displacement", power=2, exponent_unit="1/m", meaning="the compression a²/R, a displacement; m is then in 1/m"
)


def skin_modulus(log_scale: ArrayLike, p: ArrayLike, log_k: ArrayLike, b: ArrayLike, m: ArrayLike) -> Array:
    """Solve E = b exp(m u), u = C E^-p (1 + k E)^(p-1), for the skin's modulus E [Pa].

    With E = b e^v, v = m u and w = ln v the equation becomes w + p e^w + (1-p) softplus(ln(k b) + e^w) = ln(m C) -
    p ln b. The left side rises and is convex in w, so Newton's method finds the root from any starting point, without a
    bracket; it starts at the smaller of two upper bounds, one sharp for a soft and one for a stiff fabric. Halley's
    correction lengthens steps above the root (to at most twice Newton's) and shortens those below it; three steps are
    typical.

    Parameters
    ----------
    log_scale, p
        ln C and p of a load (`contact.Loads.compression`).
    log_k
        `contact.log_compliance_ratio` [ln 1/Pa].
    b, m
        Modulus at rest [Pa] and stiffening exponent, m >= 0. All arguments broadcast.

    Raises
    ------
    InputError
        If b is not positive or m is negative: the paper's skin stiffens (model.md 2).
    """
    b, m = np.asarray(b, float), np.asarray(m, float)
    if not ((b > 0) & np.isfinite(b)).all() or not ((m >= 0) & np.isfinite(m)).all():
        raise InputError("skin: expected finite b > 0 and m >= 0")
    log_b, p = np.log(b), np.asarray(p, float)
    # m = 0 gives v = 0, replaced by a tiny positive number in logarithms
    target = np.asarray(log_scale, float) + np.log(np.maximum(m, 1e-300)) - p * log_b
    offset, q = np.asarray(log_k, float) + log_b, 1.0 - p
    stiff = np.maximum(target - q * offset, 1.0)
    w = np.minimum(
        target - q * _softplus(offset)[0],
        np.where(stiff > 1.0, np.log(stiff - np.log(stiff - np.log(stiff))), target - q * offset),
    )
    for _ in range(100):
        v = np.exp(w)
        softplus, logistic = _softplus(offset + v)
        rise = v * (p + q * logistic)
        newton = (w + p * v + q * softplus - target) / (1.0 + rise)
        bend = (rise + v * v * q * logistic * (1.0 - logistic)) / (1.0 + rise)
        step = newton / np.maximum(1.0 - 0.5 * newton * bend, 0.5)
        w = w - step
        # the next step would be of the size of its cube
        if (np.abs(step) * np.maximum(v, 1.0) <= 1e-5).all():
            return np.asarray(b * np.exp(np.minimum(np.exp(w), 600.0)))  # the exponent stays in the range of numbers
    raise NumericalError("skin: the modulus did not converge")  # pragma: no cover - never seen


def _softplus(x: Array) -> tuple[Array, Array]:
    """Return ln(1 + e^x) and its derivative, without overflow; both take less time than `numpy.logaddexp`."""
    small = np.exp(-np.abs(x))
    return np.maximum(x, 0.0) + np.log1p(small), np.where(x < 0.0, small, 1.0) / (1.0 + small)


PLATE_LENGTH = 1e-3
"""Length l [m] that turns a rigidity into a modulus, E_fab = D / l³ (the paper's number implies 1 mm)."""


HERTZ_LIMIT = 0.5
"""Ratio of contact radius to fingertip radius above which Hertz's contact theory is questionable (model.md 3)."""


@dataclass(frozen=True)
class Finger:
    """The fingertip: its shape, its Poisson ratio, the depth of its receptors and the place of contact.

    Parameters
    ----------
    radius
        Fingertip radius R [m]; the fabric is flat, so it is also the contact's relative radius.
    poisson_ratio
        Poisson ratio of the skin [-].
    receptor_depth
        Depth z of the SAI receptors [m]; the literature has 0.5-0.9 mm.
    pad_length, pad_width
        Extent of the pad along the finger (distal to proximal) and across it [m].
    contact_centre
        Point of the pad on the contact's axis, (x, y) [m].
    """

    radius: float = 8e-3
    poisson_ratio: float = 0.48
    receptor_depth: float = 0.7e-3
    pad_length: float = 30e-3
    pad_width: float = 20e-3
    contact_centre: tuple[float, float] = (12e-3, 10e-3)
    force: ClassVar[float] = 1.0
    """Force [N] of a free touch."""

    def __post_init__(self) -> None:
        for place in fields(self):
            numbers(f"finger: {place.name}", getattr(self, place.name), "numbers in m, or without a unit")
        for name in ("radius", "pad_length", "pad_width"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise InputError(f"finger: {name} is {getattr(self, name)}, expected a positive length in m")
        if not (np.isfinite(self.receptor_depth) and self.receptor_depth >= 0):
            raise InputError(f"finger: receptor_depth is {self.receptor_depth}, expected 0 or a length in m")
        if not -1 < self.poisson_ratio <= 0.5:
            raise InputError(f"finger: poisson_ratio is {self.poisson_ratio}, expected a value in (-1, 0.5]")
        x, y = self.contact_centre
        if not (0 <= x <= self.pad_length and 0 <= y <= self.pad_width):
            raise InputError(
                f"finger: contact_centre is ({x}, {y}) m, expected a point of the pad, "
                f"0-{self.pad_length} m by 0-{self.pad_width} m"
            )


class Fingertips(NamedTuple):
    """The fingertips of a batch of parameter vectors, which differ in radius, depth and force of free touches."""

    radius: Array
    """Fingertip radius R [m], of a shape that broadcasts with what it is combined with."""
    receptor_depth: Array
    """Depth z of the receptors [m], of the same shape."""
    poisson_ratio: float
    """Poisson ratio of the skin [-]."""
    force: Any = 1.0
    """Force [N] of a free touch, of that shape."""


Fingertip = Finger | Fingertips
"""The shape of a fingertip: one number each, or arrays."""


def fingertips(
    finger: Finger, radius: ArrayLike, receptor_depth: ArrayLike, force: ArrayLike = Finger.force
) -> Fingertips:
    """Return fingers with these radii and receptor depths [m], shape (n, 1); 0 selects the value of `finger`."""
    given = (np.asarray(radius, float), finger.radius), (np.asarray(receptor_depth, float), finger.receptor_depth)
    shape = (np.where(value > 0, value, usual) for value, usual in given)
    own = [value[..., None] for value in np.broadcast_arrays(*shape, np.asarray(force, float))]
    return Fingertips(own[0], own[1], finger.poisson_ratio, own[2])


@dataclass(frozen=True)
class FingerBox:
    """Ranges of fingertip radius, receptor depth [m] and free force [N] covered by the stress-field tables.

    Raises
    ------
    InputError
        If a range is not positive.
    """

    radius: tuple[float, float]
    receptor_depth: tuple[float, float]
    force: tuple[float, float] = (Finger.force, Finger.force)

    def __post_init__(self) -> None:
        for name, (low, high) in vars(self).items():
            if not 0 < low <= high < np.inf:
                raise InputError(f"finger: {name} from {low} to {high}, expected a range of positive numbers")

    @property
    def corners(self) -> tuple[Array, Array, Array]:
        """Radius and depth [m], and force [N], at the eight corners."""
        radius, depth, force = (value.ravel() for value in np.meshgrid(self.radius, self.receptor_depth, self.force))
        return radius, depth, force


@dataclass(frozen=True)
class FabricModulus:
    """A reading of the fabric's bending rigidity D [N m] (model.md 1)."""

    name: str
    power: int
    meaning: str = field(default="", repr=False, compare=False)
    """The reading in words, for lists."""

    def rigidity(self, tensile_modulus: Array, thickness: Array, poisson_ratio: Array) -> Array:
        """Return D = E_ten h³ / (12 (1 - nu^power)) [N m] from E_ten [Pa], h [m] and nu [-]."""
        return tensile_modulus * thickness**3 / (12.0 * (1.0 - poisson_ratio**self.power))


PRINTED_RIGIDITY = FabricModulus("printed", power=1, meaning="bending rigidity over 1 - nu, as the paper prints it")
PLATE_RIGIDITY = FabricModulus("plate", power=2, meaning="bending rigidity of a thin plate, over 1 - nu²")


@dataclass(frozen=True, order=True)
class Indentation:
    """A touch at a fixed indentation (approach) `depth` [m]."""

    depth: float

    def __post_init__(self) -> None:
        INDENTATIONS.require("indentation", self.depth)

    def __str__(self) -> str:
        return f"{self.depth * 1e3:.12g} mm"


@dataclass(frozen=True, order=True)
class Force:
    """A touch at a fixed contact force `newton` [N]."""

    newton: float

    def __post_init__(self) -> None:
        FORCES.require("force", self.newton)

    def __str__(self) -> str:
        return f"{self.newton:.12g} N"


@dataclass(frozen=True, order=True)
class FreeTouch(Force):
    """A touch without a given load, whose force is a parameter (`touch_force`), in units of `newton`."""

    newton: float = 1.0

    def __str__(self) -> str:
        return "free touch"


Load = Indentation | Force
LOAD = "Indentation(depth [m]) or Force(newton [N])"


def require_loads(what: str, loads: Sequence[Load]) -> tuple[Load, ...]:
    """Return some loads as a tuple.

    Raises
    ------
    InputError
        If this is not a sequence of loads; the message states the expected form.
    """
    if isinstance(loads, (str, bytes, Indentation, Force)) or not hasattr(loads, "__iter__"):
        refuse(what, loads, f"a sequence of {LOAD}, as in [Indentation(2e-3)]")
    for load in loads:
        require_kind(what, load, (Indentation, Force), LOAD)
    return tuple(loads)


def loads_at(depths: ArrayLike, forces: ArrayLike) -> tuple[Load, ...]:
    """Return the loads with some indentations [m] and forces [N], NaN where a load does not hold one or the other."""
    pairs = zip(np.asarray(depths, float).tolist(), np.asarray(forces, float).tolist(), strict=True)
    return tuple(
        Force(force) if np.isfinite(force) else Indentation(depth) if np.isfinite(depth) else FreeTouch()
        for depth, force in pairs
    )


def held(load: Load) -> float:
    """Return the quantity held constant by a load: its force [N] or its indentation [m]."""
    return load.newton if isinstance(load, Force) else load.depth


class Loads:
    """The loads of many conditions, one each, for contact solutions of all at once.

    Parameters
    ----------
    loads
        One load for each condition, or one for everything.
    """

    def __init__(self, loads: Load | Sequence[Load]) -> None:
        every = [loads] if isinstance(loads, (Indentation, Force)) else [*loads]
        shape = () if isinstance(loads, (Indentation, Force)) else (len(every),)
        self.indented = np.array([isinstance(load, Indentation) for load in every], bool).reshape(shape)
        value = np.array([held(load) for load in every], float).reshape(shape)
        # NaN for the quantity that a load does not fix
        self.depth, self.newton = np.where(self.indented, value, np.nan), np.where(self.indented, np.nan, value)

    def radius(self, reduced_modulus: Array, finger: Fingertip) -> Array:
        """Return the contact radius [m] for E_star [Pa], of shape (..., conditions)."""
        fixed = np.sqrt(finger.radius * self.depth)
        if self.indented.all():
            return np.broadcast_to(fixed, np.broadcast_shapes(fixed.shape, reduced_modulus.shape))
        newton = self.newton * finger.force
        return np.where(self.indented, fixed, np.cbrt(0.75 * finger.radius * newton / reduced_modulus))

    def contact(self, skin: Array, reduced_modulus: Array, finger: Fingertip) -> Contact:
        """Return the contacts for E_skin and E_star [Pa], of shape (..., conditions)."""
        radius = self.radius(reduced_modulus, finger)
        indentation = np.where(self.indented, self.depth, radius**2 / finger.radius)
        force = np.where(self.indented, hertz_force(reduced_modulus, radius, finger), self.newton * finger.force)
        return Contact(skin, reduced_modulus, radius, indentation, force)

    def compression(self, finger: Fingertip, displacement: SkinDisplacement) -> tuple[Array, Array]:
        """Return ln C and p of `skin_modulus`: with a given radius p = 0, with a given force p = power / 3."""
        # a = sqrt(R delta), or a³ = 3 R F / (4 E_star)
        softness = 1.0 - finger.poisson_ratio**2
        under_force = displacement.power / 3.0 * np.log(0.75 * finger.radius * self.newton * finger.force * softness)
        at_depth = displacement.power * 0.5 * np.log(finger.radius * self.depth)
        log_scale = np.where(self.indented, at_depth, under_force) - np.log(finger.radius)
        return log_scale, np.where(self.indented, 0.0, displacement.power / 3.0)


class Contact(NamedTuple):
    """The state of the contact; all fields have the same broadcast shape."""

    skin_modulus: Array
    """E_skin [Pa]."""
    reduced_modulus: Array
    """E_star [Pa]."""
    radius: Array
    """Contact radius a [m]."""
    indentation: Array
    """Approach delta [m]."""
    force: Array
    """Hertz's force F [N]."""


def hertz_force(reduced_modulus: Array, radius: Array, finger: Fingertip) -> Array:
    """Return F = 4 E_star a³ / (3 R) [N] (model.md 3)."""
    return 4.0 * reduced_modulus * radius**3 / (3.0 * finger.radius)


def log_compliance_ratio(fabric_modulus: ArrayLike, fabric_poisson: ArrayLike, finger: Fingertip) -> Array:
    """Return ln k, k = (1 - nu_fab²) / ((1 - nu_skin²) E_fab) [1/Pa] (model.md 2)."""
    modulus, poisson = np.asarray(fabric_modulus, float), np.asarray(fabric_poisson, float)
    return np.log1p(-(poisson**2)) - np.log1p(-(finger.poisson_ratio**2)) - np.log(modulus)


def reduced_modulus(skin: Array, fabric_modulus: ArrayLike, fabric_poisson: ArrayLike, finger: Fingertip) -> Array:
    """Return E_star [Pa], 1/E_star = (1-nu_skin²)/E_skin + (1-nu_fab²)/E_fab (model.md 3)."""
    fabric, poisson = np.asarray(fabric_modulus, float), np.asarray(fabric_poisson, float)
    return 1.0 / ((1.0 - finger.poisson_ratio**2) / skin + (1.0 - poisson**2) / fabric)


def solve_contact(
    fabric_modulus: ArrayLike,
    fabric_poisson: ArrayLike,
    load: Load | Loads,
    b: ArrayLike,
    m: ArrayLike,
    finger: Fingertip = Finger(),
    displacement: SkinDisplacement = STRAIN,
) -> Contact:
    """Solve the contact of a finger and a fabric (model.md 2-3).

    Parameters
    ----------
    fabric_modulus, fabric_poisson
        E_fab [Pa] and nu_fab [-].
    load
        `Indentation` or `Force`, or `Loads` of the last axis.
    b, m
        Skin modulus at rest [Pa] and its exponent ([-] or [1/m], depending on `displacement`).

    Returns
    -------
    Contact
        Fields of the broadcast shape of all arrays.

    Raises
    ------
    InputError
        If a modulus or b is not positive, m is negative, a Poisson ratio is outside (-1, 0.5], or
        any of them is not finite.
    """
    require_kind("load", load, (Indentation, Force, Loads), LOAD)
    modulus, poisson = (numbers("fabric", given) for given in (fabric_modulus, fabric_poisson))
    if not ((modulus > 0) & np.isfinite(modulus)).all() or not ((poisson > -1) & (poisson <= 0.5)).all():
        raise InputError("fabric: expected a positive finite modulus and a Poisson ratio in (-1, 0.5]")
    loads = load if isinstance(load, Loads) else Loads(load)
    log_k = log_compliance_ratio(fabric_modulus, fabric_poisson, finger)
    skin = skin_modulus(*loads.compression(finger, displacement), log_k, b, m)
    found = loads.contact(skin, reduced_modulus(skin, fabric_modulus, fabric_poisson, finger), finger)
    return Contact(*np.broadcast_arrays(*found))


class PlateLine(NamedTuple):
    """Force of a rigid plate, ln F = ln b + m slope + offset; arrays of the shape of the indentations."""

    slope: Array
    """a^power / R, the coefficient of m."""
    offset: Array
    """ln(4 a³ / (3 R (1 - nu_skin²))), the force on skin of unit modulus [ln m²]."""


def plate_line(indentation: ArrayLike, finger: Finger = Finger(), displacement: SkinDisplacement = STRAIN) -> PlateLine:
    """Return slope and offset of the force of a rigid flat plate, whose logarithm is linear in ln b and m.

    It is the limit of a contact as E_fab goes to infinity: with k = 0 the skin's modulus is b exp(m a^power / R),
    E_star = E_skin / (1 - nu_skin²), and F = 4 E_star a³ / (3 R), a = sqrt(R delta) (model.md 2-3).

    Parameters
    ----------
    indentation
        delta [m], positive.
    finger, displacement
        The fingertip, and the reading of its displacement.
    """
    radius = np.sqrt(finger.radius * np.asarray(indentation, float))
    offset = np.log(4.0 * radius**3 / (3.0 * finger.radius * (1.0 - finger.poisson_ratio**2)))
    return PlateLine(radius**displacement.power / finger.radius, offset)


def plate_force(
    indentation: ArrayLike, b: Any, m: Any, finger: Finger = Finger(), displacement: SkinDisplacement = STRAIN
) -> Array:
    """Return the force [N] of a rigid plate at indentations [m], for b [Pa] and m; all broadcast."""
    line = plate_line(indentation, finger, displacement)
    return np.asarray(np.exp(np.log(b) + m * line.slope + line.offset))
