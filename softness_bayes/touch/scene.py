"""Scenes: fabrics and loads on one finger, compiled once; one call gives the response of a whole batch."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.base.errors import InputError
from softness_bayes.base.ranges import numbers, require_kind, require_members
from softness_bayes.touch.contact import (
    HERTZ_LIMIT,
    Contact,
    Finger,
    FingerBox,
    Fingertip,
    Force,
    FreeTouch,
    Indentation,
    Load,
    fingertips,
    require_loads,
)
from softness_bayes.touch.load_curves import LoadCurves, places
from softness_bayes.touch.neuron.rate_curve import Firing
from softness_bayes.touch.parameters import TouchParameters, checked_rows
from softness_bayes.touch.population import Drive, Population
from softness_bayes.touch.readings import Readings
from softness_bayes.touch.receptors import receptor_count
from softness_bayes.touch.stress_fields import Mechanics, SkinBox, StressFields
from softness_bayes.touch.stress_table import SHARE, covered_moduli, cut_tables, stress_tables

Array = NDArray[np.float64]
Index = NDArray[np.intp]

WITH_CURVES = 256
"""Vectors whose rate curves are kept at once."""

CHUNK = 1 << 16
"""Number of quadrature nodes evaluated at once: enough for fast array operations, few enough for the cache."""

LEAST_ROWS = 32
"""Vectors that are evaluated at once at least: each load's table is then read for all of them."""


@dataclass(frozen=True)
class Discretisation:
    """Resolution of a scene; the defaults have errors of about 1e-5 of the peak response."""

    nodes: int = 12
    """Nodes of the population integral for each condition."""
    saturation: float = 7.0
    """Extent of the integral along the sigmoid, in units of its exponent beyond the rheobase."""
    field_tolerance: float = 3e-6
    """Error allowed in the stress fields; they are tabulated to a tenth of it, and then truncated."""
    rate_nodes: int = 18
    """Number of exact rates interpolated by the curve of fixed channels."""
    rate_terms: int | None = None
    """Number of terms that are left of the polynomials in the root of the current; by default all."""
    load_nodes: float | None = 4.0
    """Density of the places between which a fabric's responses to many loads are interpolated (`load_curves.places`);
    None for no interpolation."""


class Response(NamedTuple):
    """The population's response, each field of shape (..., conditions)."""

    total_rate: Array
    """Sum of the receptors' firing rates [spikes/s]."""
    responding: Array
    """Number of receptors that fire."""
    mean_rate: Array
    """Mean rate of the receptors that fire [Hz]; NaN if none fire."""
    mean_interval: Array
    """Mean inter-spike interval of the receptors that fire [s]; NaN if none fire."""
    peak_stress: Array
    """Stress at receptor depth on the contact's axis [Pa]."""
    contact: Contact
    """State of the contact."""


class BeyondHertz(NamedTuple):
    """Shares of draws × conditions with a large contact (model.md 3)."""

    questionable: float
    """Share with a > `HERTZ_LIMIT` R."""
    meaningless: float
    """Share with a >= R."""


class Scene:
    """Fabrics × loads × pad, compiled once.

    Parameters
    ----------
    fabric_modulus, fabric_poisson
        E_fab [Pa] and nu_fab [-] of each fabric, shape (fabrics,).
    loads
        The loads.
    firing
        Source of the rate curves.
    fabric, load
        Indices of each condition's fabric and load, shape (conditions,). By default, the conditions
        are all pairs, ordered by load.
    finger, readings, discretisation
        Geometry, readings and resolution.
    modulus_range
        Range [Pa] that the stress fields cover in addition to the fabrics' moduli, for calls with other moduli.
    finger_box
        Radii and receptor depths that the stress fields cover, for parameter vectors with individual fingers;
        None if all use the scene's finger.
    skin_box
        Expected range of the skin's parameters. Within it, polynomials replace the contact's solution as far as
        the tolerance of the stress fields allows, which is faster.

    Raises
    ------
    InputError
        If a modulus is not positive and finite, a Poisson ratio is outside (-1, 0.5], there is no
        condition, or an index is out of range.
    """

    def __init__(
        self,
        fabric_modulus: ArrayLike,
        fabric_poisson: ArrayLike,
        loads: Sequence[Load],
        firing: Firing,
        fabric: ArrayLike | None = None,
        load: ArrayLike | None = None,
        finger: Finger = Finger(),
        readings: Readings = Readings(),
        discretisation: Discretisation = Discretisation(),
        modulus_range: tuple[float, float] | None = None,
        finger_box: FingerBox | None = None,
        skin_box: SkinBox | None = None,
    ) -> None:
        self.loads = require_loads("loads", loads)
        if FreeTouch() in self.loads and len({*self.loads}) > 1:
            raise InputError("loads: a free touch has an unknown force and cannot be combined with given loads")
        require_members("firing", firing, ("curves",), "a source of rate curves, such as FixedChannels()")
        require_kind("finger", finger, Finger, "a Finger, such as Finger(receptor_depth=0.6e-3)")
        require_kind("readings", readings, Readings, "Readings, such as NAMED_READINGS['printed']")
        require_kind("discretisation", discretisation, Discretisation, "a Discretisation")
        given = numbers("fabric_modulus", fabric_modulus, "numbers in Pa"), numbers("fabric_poisson", fabric_poisson)
        moduli, poisson = np.broadcast_arrays(np.atleast_1d(given[0]), given[1])
        if not ((moduli > 0) & np.isfinite(moduli)).all():
            raise InputError("scene: every fabric modulus must be positive and finite [Pa]")
        if not ((poisson > -1) & (poisson <= 0.5)).all():
            raise InputError("scene: every fabric's Poisson ratio must lie in (-1, 0.5]")
        if fabric is None or load is None:
            fabric, load = np.tile(np.arange(moduli.size), len(loads)), np.repeat(np.arange(len(loads)), moduli.size)
        self.fabric, self.load = _indices(fabric, moduli.size, "fabric"), _indices(load, len(loads), "load")
        if self.fabric.size == 0 or self.fabric.shape != self.load.shape:
            raise InputError("scene: expected one fabric and one load index for each of at least one condition")
        self.fabric_modulus, self._poissons, self.modulus_range = moduli, poisson, modulus_range
        self.firing, self.finger_box, self.skin_box = firing, finger_box, skin_box
        self.finger, self.readings, self.discretisation = finger, readings, discretisation
        self.modulus, self.poisson = moduli[self.fabric], poisson[self.fabric]
        for array in (self.modulus, self.poisson):
            array.flags.writeable = False
        covered = covered_moduli(self.modulus, self.poisson, finger, modulus_range)
        used = [self.loads[k] for k in np.unique(self.load)]
        self._whole = stress_tables(used, finger, finger_box, readings, covered, discretisation.field_tolerance)
        # decided once, so that a part of the scene has the errors of the whole
        self.along = [kind for kind in (Indentation, Force) if self._saves_touches(kind)]
        """Kinds of loads along which the responses of each fabric are interpolated, if the density of places allows."""
        self._compile()

    def _compile(self) -> None:
        """Compile what depends on the conditions, the resolution and the place of contact, from the whole tables."""
        self.count = receptor_count(self.finger, self.readings.receptor_density)
        self.tables, d = cut_tables(self._whole, self.discretisation.field_tolerance), self.discretisation
        used = np.unique(self.load)
        self.columns = [np.flatnonzero(self.load == k) for k in used]
        self.stress_fields = StressFields(self.tables, [self.loads[k] for k in self.load], self.finger)
        self.population = Population(self.tables[self.loads[used[0]]].root, self.count, d.nodes, d.saturation)
        for name in ("mechanics", "rates", "_curves", "_others", "_exactly"):
            self.__dict__.pop(name, None)

    @cached_property
    def _curves(self) -> list[LoadCurves]:
        """Interpolated responses to each kind of load of which many share a table."""
        found = []
        for kind in self.along:
            conditions, many = self._under(kind), [load for load in self._whole if isinstance(load, kind)]
            nodes = places(many, self.discretisation.load_nodes)
            if conditions.size and nodes:
                curves = LoadCurves(
                    self.tables[many[0]],
                    many,
                    self.fabric_modulus,
                    self._poissons,
                    conditions,
                    self.fabric[conditions],
                    [self.loads[k] for k in self.load[conditions]],
                    self.finger,
                    self.readings,
                    self.skin_box if self.finger_box is None else None,
                    self.population,
                    nodes,
                )
                found.append(curves)
        return found

    def _under(self, kind: type[Load]) -> Index:
        """Return the conditions under loads of a kind."""
        return np.flatnonzero([isinstance(self.loads[k], kind) for k in self.load])

    def _saves_touches(self, kind: type[Load]) -> bool:
        """Return whether loads of a kind share a table, and interpolation along them takes half the touches."""
        tables = {load: id(table) for load, table in self._whole.items() if isinstance(load, kind)}
        if len({*tables.values()}) == len(tables):
            return False
        conditions, nodes = self._under(kind), places([*tables], self.discretisation.load_nodes)
        return bool(2 * nodes * np.unique(self.fabric[conditions]).size <= conditions.size)

    @cached_property
    def _others(self) -> tuple[Index, Scene]:
        """The conditions whose responses are not interpolated, and their scene."""
        interpolated = np.concatenate([curves.conditions for curves in self._curves])
        others = np.setdiff1d(np.arange(self.n_conditions), interpolated)
        return others, self.take(others) if others.size else self

    @cached_property
    def rates(self) -> Firing:
        """The source of rate curves, at the scene's resolution."""
        terms = self.discretisation.rate_terms
        return self.firing if terms is None else self.firing.shortened(terms)

    @cached_property
    def mechanics(self) -> Mechanics:
        """From the skin to the contacts and stress fields."""
        return Mechanics(
            self.modulus,
            self.poisson,
            [self.loads[k] for k in self.load],
            self.finger,
            self.readings.skin_displacement,
            self.stress_fields,
            self.skin_box if self.finger_box is None else None,
            self.discretisation.field_tolerance,
        )

    @cached_property
    def _has_free_touch(self) -> bool:
        """True if a load is the unknown one."""
        return FreeTouch() in self.loads

    def fingertip(self, parameters: TouchParameters) -> Fingertip:
        """Return the finger: the scene's, or one for each vector of a batch (n,), with arrays of shape (n, 1).

        Raises
        ------
        InputError
            If a vector has an individual finger but the scene was compiled for one finger.
        """
        free = self._has_free_touch
        if self.finger_box is not None:
            force = parameters.touch_force if free else Finger.force
            return fingertips(self.finger, parameters.radius, parameters.receptor_depth, force)
        if np.count_nonzero(parameters.radius) or np.count_nonzero(parameters.receptor_depth):
            raise InputError("scene: a radius or a receptor_depth is given, but the scene has one finger and no box")
        if free:
            raise InputError("scene: a free touch needs the range of its forces, as a FingerBox")
        return self.finger

    @property
    def n_conditions(self) -> int:
        """Number of conditions."""
        return self.fabric.size

    @property
    def n_receptors(self) -> float:
        """Expected number of receptors on the pad (N_ref of the rating model is one spike per second for each)."""
        return self.count.total

    def total_rate(self, parameters: TouchParameters, modulus: Array | None = None) -> Array:
        """Return the total rate [spikes/s] of every condition for a batch of parameter vectors.

        Parameters
        ----------
        parameters
            Arrays of one batch shape (...), or scalars.
        modulus
            Positive E_fab [Pa] of each fabric, shape (..., fabrics), in place of the scene's values.

        Returns
        -------
        ndarray
            Shape (..., conditions).

        Raises
        ------
        InputError
            If a parameter is not finite, b, alpha or beta is not positive, m is negative, or a radius or a depth is
            given to a scene of one finger.
        """
        shape, chunks = self._chunks(parameters, modulus)
        rates = []
        for chunk, own, drive in chunks:
            rates.append(self._rates(chunk, own, drive))
        return (rates[0] if len(rates) == 1 else np.concatenate(rates)).reshape(*shape, self.n_conditions)

    def _rates(self, p: TouchParameters, modulus: Array | None, drive: Drive) -> Array:
        """Return the total rates of some vectors (batch,), shape (batch, conditions), with moduli of the fabrics."""
        finger = self.fingertip(p)
        if not self._curves:
            own = None if modulus is None else modulus[:, self.fabric]
            return self.population.sums(self.mechanics.fields(p.b, p.m, own, finger), drive).rate
        found, holds = np.empty((p.b.size, self.n_conditions)), np.ones(p.b.size, dtype=bool)
        for curves in self._curves:
            holds &= curves.rates(p, modulus, finger, drive, found)
        others, scene = self._others
        if others.size:
            found[:, others] = scene._rates(p, modulus, drive)
        if not holds.all():
            left = np.flatnonzero(~holds)
            some = TouchParameters(*(value[left] for value in p)), None if modulus is None else modulus[left]
            found[left] = self._exactly._rates(*some, drive.part(left))
        return found

    @cached_property
    def _exactly(self) -> Scene:
        """The scene without interpolation along loads."""
        return self.coarser(replace(self.discretisation, load_nodes=None))

    def respond(self, parameters: TouchParameters, modulus: Array | None = None) -> Response:
        """Return all fields of every condition's response, for a batch of parameter vectors.

        Parameters and errors as in `total_rate`.
        """
        shape, chunks = self._chunks(parameters, modulus)
        parts = []
        for chunk, own, drive in chunks:
            finger = self.fingertip(chunk)
            touch = self._contact(chunk, own)
            fields = self.stress_fields.at(touch.reduced_modulus, touch.radius, finger)
            sums = self.population.sums(fields, drive, intervals=True)
            with np.errstate(invalid="ignore"):
                mean_rate, mean_interval = sums.rate / sums.responding, sums.interval / sums.responding
            parts.append((sums.rate, sums.responding, mean_rate, mean_interval, fields.peak, *touch))
        rate, responding, mean_rate, mean_interval, peak, *contact_fields = (
            np.concatenate(part).reshape(*shape, self.n_conditions) for part in zip(*parts, strict=True)
        )
        return Response(rate, responding, mean_rate, mean_interval, peak, Contact(*contact_fields))

    def contact(self, parameters: TouchParameters, modulus: Array | None = None) -> Contact:
        """Return the state of the contact alone, fields of shape (..., conditions); parameters as in `total_rate`."""
        shape, chunks = self._chunks(parameters, modulus, fires=False)
        parts = [self._contact(chunk, own) for chunk, own, _ in chunks]
        fields = zip(*parts, strict=True)
        return Contact(*(np.concatenate(part).reshape(*shape, self.n_conditions) for part in fields))

    def _contact(self, p: TouchParameters, modulus: Array | None) -> Contact:
        own = None if modulus is None else modulus[:, self.fabric]
        return self.mechanics.contact(p.b, p.m, own, self.fingertip(p))

    def beyond_hertz(self, parameters: TouchParameters, modulus: Array | None = None) -> BeyondHertz:
        """Return the shares of draws × conditions with contact outside the range of Hertz's geometry."""
        radius = self.contact(parameters, modulus).radius / self.fingertip(parameters).radius
        return BeyondHertz(float((radius > HERTZ_LIMIT).mean()), float((radius >= 1.0).mean()))

    def refined(self) -> Scene:
        """Return a reference: the same scene with whole stress tables, solved contacts and a finer quadrature."""
        d = self.discretisation
        finer = Discretisation(
            d.nodes + 12, d.saturation + 8.0, SHARE * d.field_tolerance, d.rate_nodes, load_nodes=None
        )
        return self._copied(discretisation=finer, skin_box=None)

    def exact(self) -> Scene:
        """Return the refined scene with exact firing rates, which takes milliseconds for each vector.

        What is left are the errors of its stress tables, `field_error`.
        """
        return self.refined().fired_by(self.firing.exact())

    @property
    def field_error(self) -> float:
        """Largest measured error of the whole stress tables, relative to the largest value under a load."""
        return max(table.reached for table in self._whole.values())

    def error(self, parameters: TouchParameters, modulus: Array | None = None) -> Array:
        """Return the numerical error of each vector's response relative to its largest, shape (...).

        It is the largest difference from the refined scene, plus the error of the stress tables that both share.
        """
        fine = self.refined().total_rate(parameters, modulus)
        peak = fine.max(axis=-1)
        difference = np.abs(self.total_rate(parameters, modulus) - fine).max(axis=-1)
        return difference / np.where(peak > 0, peak, 1.0) + self.field_error

    def take(self, conditions: ArrayLike, contact_centre: tuple[float, float] | None = None) -> Scene:
        """Return the scene of some conditions, optionally with another contact centre, with the same stress tables.

        Parameters
        ----------
        conditions
            Indices into this scene's conditions, without repetition, shape (n,).
        contact_centre
            Point of the pad on the contact's axis, (x, y) [m]; unchanged by default.

        Raises
        ------
        InputError
            If there is no condition, or an index is out of range.
        """
        chosen = _indices(conditions, self.n_conditions, "condition")
        if not chosen.size:
            raise InputError("scene: expected at least one condition")
        finger = replace(self.finger, contact_centre=contact_centre or self.finger.contact_centre)
        arrays = {name: getattr(self, name)[chosen] for name in ("fabric", "load", "modulus", "poisson")}
        return self._copied(finger=finger, **arrays)

    def coarser(self, discretisation: Discretisation) -> Scene:
        """Return the scene at another resolution, with stress fields truncated from the present tables at no cost."""
        return self._copied(discretisation=discretisation)

    def _copied(self, **changed: Any) -> Scene:
        """Return a copy with other attributes, compiled from the same whole tables."""
        part = copy.copy(self)
        part.__dict__.update(changed)
        part._compile()
        return part

    def fired_by(self, firing: Firing) -> Scene:
        """Return the scene with its rate curves from another source."""
        part = copy.copy(self)
        part.firing = firing
        part.__dict__.pop("rates", None)
        return part

    def on_grid(self, modulus: Array, loads: Sequence[Load] | None = None) -> Scene:
        """Return a scene of fabrics with these moduli [Pa] and the median Poisson ratio, under some or all loads."""
        poisson = np.full(modulus.size, np.median(self.poisson))
        changed = {"fabric_modulus": modulus, "fabric_poisson": poisson, "loads": loads or self.loads}
        return self.recompiled(**changed, fabric=None, load=None)

    def under(self, loads: Sequence[Load], fabric: ArrayLike, load: ArrayLike) -> Scene:
        """Return the scene of the same fabrics in other conditions, given by indices of fabrics and new loads."""
        return self.recompiled(loads=loads, fabric=fabric, load=load)

    def beside(self, modulus: Array, fabric: ArrayLike, load: ArrayLike) -> Scene:
        """Return the scene with fabrics of these moduli [Pa] and the median Poisson ratio appended to its fabrics.

        Parameters
        ----------
        modulus
            E_fab [Pa] of the further fabrics, shape (n,).
        fabric, load
            Indices of the conditions, into all fabrics and the scene's loads.
        """
        poisson = np.append(self._poissons, np.full(modulus.size, np.median(self.poisson)))
        moduli = np.append(self.fabric_modulus, modulus)
        return self.recompiled(fabric_modulus=moduli, fabric_poisson=poisson, fabric=fabric, load=load)

    def recompiled(self, **changed: Any) -> Scene:
        """Compile a scene with the same arguments except the given ones; conditions are indices into its fabrics."""
        names = (
            *("loads", "firing", "fabric", "load", "finger"),
            *("readings", "discretisation", "modulus_range", "finger_box", "skin_box"),
        )
        own = {name: getattr(self, name) for name in names}
        own |= {"fabric_modulus": self.fabric_modulus, "fabric_poisson": self._poissons}
        return Scene(**own | changed)

    def _chunks(
        self, parameters: TouchParameters, modulus: Array | None, fires: bool = True
    ) -> tuple[tuple[int, ...], Iterator[tuple[TouchParameters, Array | None, Any]]]:
        """Cut a batch of parameter vectors into chunks whose quadrature fits into the processor's cache.

        Returns
        -------
        shape, chunks
            The batch shape, and the vectors of each chunk along one axis, with the moduli of the fabrics and the
            drives, if `fires`. Chunks are created lazily, so that the memory of one is released before the next. Rate
            curves are computed for several chunks at once: exact ones take seconds for any number of vectors.
        """
        require_members("parameters", parameters, ("b", "m"), "TouchParameters, as touch_parameters(values) returns")
        if modulus is not None:
            shape = np.broadcast_shapes(*(np.shape(value) for value in parameters), modulus.shape[:-1])
            parameters = parameters.broadcast(shape)
            modulus = np.broadcast_to(modulus, (*shape, modulus.shape[-1])).reshape(-1, modulus.shape[-1])
        shape, flat = checked_rows(parameters)
        touches = sum(curves.touches for curves in self._curves)
        rows = max(LEAST_ROWS, CHUNK // ((touches or self.n_conditions) * self.discretisation.nodes))

        def chunks() -> Iterator[tuple[TouchParameters, Array | None, Any]]:
            several = max(rows, WITH_CURVES)
            for first in range(0, max(flat.b.size, 1), several):
                group = TouchParameters(*(value[first : first + several] for value in flat))
                curve = self.rates.curves(group.channels, group.alpha) if fires else None
                drive = None if curve is None else Drive(group.alpha, group.beta, group.sigma_0, curve)
                # of about equal sizes: a short one would take as long as one of many vectors
                size = -(-group.b.size // max(1, round(group.b.size / rows))) or 1
                for start in range(0, max(group.b.size, 1), size):
                    k = slice(start, start + size)
                    own = None if modulus is None else modulus[first : first + several][k]
                    yield TouchParameters(*(value[k] for value in group)), own, drive and drive.part(k)

        return shape, chunks()


def _indices(values: ArrayLike, size: int, what: str) -> Index:
    """Return indices as a read-only array; raise an error if one is outside 0 to size - 1."""
    array = np.array(values, dtype=np.intp)
    if array.size and not ((array >= 0) & (array < size)).all():
        raise InputError(f"scene: a {what} index lies outside 0 to {size - 1}")
    array.flags.writeable = False
    return array
