"""Scenes: fabrics and loads on one finger, compiled once; one call gives the response of a whole batch."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.errors import InputError
from softness_bayes.touch import batches
from softness_bayes.touch.conditions import checked_conditions, checked_fabrics, distinct, frozen, indices, valid_parts
from softness_bayes.touch.contact import Contact, Finger, FingerBox, Fingertip, Load, fingertips
from softness_bayes.touch.contacts import Contacts
from softness_bayes.touch.discretisation import Discretisation, sharing
from softness_bayes.touch.family import MANY, Family
from softness_bayes.touch.field import Profile
from softness_bayes.touch.finger_field import FieldsOfLoads, profiles
from softness_bayes.touch.mechanics import Mechanics
from softness_bayes.touch.neuron.fixed_channels import Firing
from softness_bayes.touch.parameters import TouchParameters, checked_rows
from softness_bayes.touch.population import Drive, Population
from softness_bayes.touch.readings import Readings
from softness_bayes.touch.receptors import kink_distances, receptor_count
from softness_bayes.touch.response import BeyondHertz, Response
from softness_bayes.touch.shared_fields import covered_moduli, cut, fields_of
from softness_bayes.touch.skin_start import SkinBox

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_KEPT = (
    *("loads", "firing", "fabric", "load", "finger"),
    *("readings", "discretisation", "modulus_range", "finger_box", "skin_box"),
)
"""Arguments of a scene that it keeps by their names."""


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
        loads = valid_parts(loads, firing, finger, readings, discretisation)
        moduli, poisson = checked_fabrics(fabric_modulus, fabric_poisson)
        self.fabric, self.load = checked_conditions(fabric, load, moduli.size, len(loads))
        self.fabric_modulus, self._poissons, self.modulus_range = moduli, poisson, modulus_range
        self.loads, self.firing, self.finger_box, self.skin_box = tuple(loads), firing, finger_box, skin_box
        self.finger, self.readings, self.discretisation = finger, readings, discretisation
        self.modulus, self.poisson = frozen(moduli[self.fabric]), frozen(poisson[self.fabric])
        self.count = receptor_count(finger, readings.receptor_density)
        used = [index for index in range(len(self.loads)) if (self.load == index).any()]
        self.columns = [np.flatnonzero(self.load == index) for index in used]
        covered = covered_moduli(self.modulus, self.poisson, finger, modulus_range)
        self.fields = fields_of(
            [self.loads[index] for index in used], finger, finger_box, readings, covered, discretisation
        )
        self.population = Population(self.fields[0].root, self.count, discretisation.nodes, discretisation.saturation)
        self._finer: Scene | None = None
        # the scene of the distinct conditions and the place of each in it; None if all are distinct
        first, place = distinct(self.load, self.modulus, self.poisson)
        self._once = None if first.size == self.n_conditions else (self.take(first), place)

    @cached_property
    def _parts(self) -> tuple[list[Scene], Index]:
        """Scenes of blocks of conditions, if all are too many to be evaluated at once, and each one's place in them."""
        blocks = batches.blocks(self.columns, self.discretisation.nodes)
        _ = self.rates  # shortened once, not by each part
        return [self.take(block) for block in blocks] if len(blocks) > 1 else [], np.argsort(np.concatenate(blocks))

    @cached_property
    def _contacts(self) -> Contacts:
        """The contacts of all conditions."""
        loads, displacement = [self.loads[k] for k in self.load], self.readings.skin_displacement
        return Contacts(self.modulus, self.poisson, loads, self.finger, displacement, self.skin_box)

    @cached_property
    def _side_by_side(self) -> FieldsOfLoads:
        """The stress fields of all loads."""
        return FieldsOfLoads(self.fields, self.columns)

    @property
    def rates(self) -> Firing:
        """The source of rate curves, at the scene's resolution."""
        return self.firing if self.discretisation.rate_terms is None else self._shortened

    @cached_property
    def _shortened(self) -> Firing:
        assert self.discretisation.rate_terms is not None
        return self.firing.shortened(self.discretisation.rate_terms)

    @cached_property
    def mechanics(self) -> Mechanics:
        """From the skin to the stress fields."""
        return Mechanics(
            self._contacts, self._side_by_side, self.finger, self.skin_box, self.discretisation.field_tolerance
        )

    @property
    def n_repeated(self) -> int:
        """Number of conditions that repeat another's load and fabric; their total rate is not computed again."""
        return 0 if self._once is None else self.n_conditions - self._once[0].n_conditions

    def fingertip(self, parameters: TouchParameters) -> Fingertip:
        """Return the finger: the scene's, or one for each vector of a batch (n,), with arrays of shape (n, 1).

        Raises
        ------
        InputError
            If a vector has an individual finger but the scene was compiled for one finger.
        """
        if self.finger_box is not None:
            return fingertips(self.finger, parameters.radius, parameters.receptor_depth)
        if np.count_nonzero(parameters.radius) or np.count_nonzero(parameters.receptor_depth):
            raise InputError("scene: a radius or a receptor_depth is given, but the scene has one finger and no box")
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

        Notes
        -----
        Where a load has more than `MANY` fabrics the rates are interpolated between fabrics (`Family`), with an error
        of the order of the stress fields' tolerance; `respond` evaluates every fabric.
        """
        if self._once is not None and modulus is None:
            once, place = self._once
            return once.total_rate(parameters)[..., place]
        if max(columns.size for columns in self.columns) > MANY and modulus is None:
            return self._interpolated_rate(parameters)
        parts, place = self._parts
        if parts:
            return np.concatenate([part.total_rate(parameters, modulus) for part in parts], axis=-1)[..., place]
        shape, chunks = self._chunks(parameters, modulus)
        rates = [self._total_rate(*chunk) for chunk in chunks]
        return (rates[0] if len(rates) == 1 else np.concatenate(rates)).reshape(*shape, self.n_conditions)

    def _total_rate(self, parameters: TouchParameters, modulus: Array | None) -> Array:
        """Return the total rates of one chunk; only the required parts of contact and fields are computed."""
        finger, own = self.fingertip(parameters), None if modulus is None else modulus[:, self.fabric]
        fields = self.mechanics.fields(parameters.b, parameters.m, own, finger)
        return self.population.sums(fields, self._drive(parameters)).rate

    def _interpolated_rate(self, parameters: TouchParameters) -> Array:
        shape, flat = checked_rows(parameters)
        found, curve = np.empty((flat.b.size, self.n_conditions)), self.rates.curves(flat)
        finger, chunk = self.fingertip(flat), batches.CHUNK // self.discretisation.nodes
        for columns, field in zip(self.columns, self.fields, strict=True):
            family = Family(field, self._contacts.log_k[columns], self.readings.skin_displacement)
            found[:, columns] = family.total_rate(flat, curve, self.population, finger, chunk)
        return found.reshape(*shape, self.n_conditions)

    def respond(self, parameters: TouchParameters, modulus: Array | None = None) -> Response:
        """Return all fields of every condition's response, for a batch of parameter vectors.

        Parameters and errors as in `total_rate`.
        """
        shape, chunks = self._chunks(parameters, modulus)
        parts = []
        for chunk, own in chunks:
            touch = self._contact(chunk, own)
            fields = self._side_by_side.at(touch.reduced_modulus, touch.radius, self.fingertip(chunk))
            sums = self.population.sums(fields, self._drive(chunk), intervals=True)
            with np.errstate(invalid="ignore"):
                mean_rate, mean_interval = sums.rate / sums.responding, sums.interval / sums.responding
            parts.append((sums.rate, sums.responding, mean_rate, mean_interval, fields.peak, *touch))
        rate, responding, mean_rate, mean_interval, peak, *contact_fields = (
            np.concatenate(part).reshape(*shape, self.n_conditions) for part in zip(*parts, strict=True)
        )
        return Response(rate, responding, mean_rate, mean_interval, peak, Contact(*contact_fields))

    def contact(self, parameters: TouchParameters, modulus: Array | None = None) -> Contact:
        """Return the state of the contact alone, fields of shape (..., conditions); parameters as in `total_rate`."""
        shape, chunks = self._chunks(parameters, modulus)
        fields = zip(*(self._contact(chunk, own) for chunk, own in chunks), strict=True)
        return Contact(*(np.concatenate(part).reshape(*shape, self.n_conditions) for part in fields))

    def stress_profile(self, contact: Contact, finger: Fingertip | None = None) -> Profile:
        """Return the stress fields for states of the contact of shape (batch, conditions).

        Parameters
        ----------
        contact
            As `contact` returns it.
        finger
            As `fingertip` returns it; by default the scene's finger.
        """
        if finger is None:
            finger = self.finger
        return profiles(self.fields, self.columns, contact.reduced_modulus, contact.radius, finger)

    def refined(self) -> Scene:
        """Return the same scene at a finer resolution, the reference for this scene's error; cached."""
        if self._finer is None:
            d = self.discretisation
            finer = Discretisation(d.nodes + 12, d.saturation + 8.0, 1e-2 * d.field_tolerance, d.rate_nodes)
            self._finer = self._with(discretisation=sharing(finer, d))
        return self._finer

    def exact(self) -> Scene:
        """Return the same scene at a finer resolution and with exact firing rates.

        It agrees with adaptive integration over the pad to 1e-8 of the peak, and takes milliseconds for each vector.
        """
        return self.refined().fired_by(self.firing.exact())

    @property
    def field_error(self) -> float:
        """Largest measured error of the stress-field tables, defined as their tolerance is."""
        return max(field.reached for field in self.fields)

    def error(self, parameters: TouchParameters, modulus: Array | None = None) -> Array:
        """Return the numerical error of each vector's response relative to its largest, shape (...).

        It is the largest difference from the same scene at a finer resolution, plus the error of that scene's stress
        fields, because both scenes may share those.
        """
        finer = self.refined()
        fine = finer.total_rate(parameters, modulus)
        peak = fine.max(axis=-1)
        difference = np.abs(self.total_rate(parameters, modulus) - fine).max(axis=-1)
        return difference / np.where(peak > 0, peak, 1.0) + finer.field_error

    def take(self, conditions: ArrayLike, contact_centre: tuple[float, float] | None = None) -> Scene:
        """Return the scene of some conditions, optionally with another contact centre, with the same stress fields.

        Parameters
        ----------
        conditions
            Indices into this scene's conditions, without repetition, shape (n,).
        contact_centre
            Point of the pad on the contact's axis, (x, y) [m]; unchanged by default.

        Raises
        ------
        InputError
            If there is no condition, an index is out of range, or the pad then extends farther from the axis than
            the fields.
        """
        finger = replace(self.finger, contact_centre=contact_centre or self.finger.contact_centre)
        if kink_distances(finger)[-1] > kink_distances(self.finger)[-1]:
            raise InputError(f"scene: from {contact_centre} m the pad extends farther than the stress fields")
        chosen = indices(conditions, self.n_conditions, "condition")
        if not chosen.size:
            raise InputError("scene: expected at least one condition")
        part = self._without("_contacts", "_side_by_side", "mechanics")
        part.finger, part.count = finger, receptor_count(finger, self.readings.receptor_density)
        for name in ("fabric", "load", "modulus", "poisson"):
            setattr(part, name, getattr(self, name)[chosen])
        places = [np.flatnonzero(part.load == self.load[columns[0]]) for columns in self.columns]
        part.columns = [columns for columns in places if columns.size]
        part.fields = [field for field, columns in zip(self.fields, places, strict=True) if columns.size]
        d = self.discretisation
        part.population = Population(part.fields[0].root, part.count, d.nodes, d.saturation)
        part._once = None
        return part

    def coarser(self, discretisation: Discretisation) -> Scene:
        """Return the scene at a coarser resolution, with stress fields truncated from the present ones at no cost."""
        part, d = self._without("_side_by_side", "mechanics", "_shortened"), discretisation
        part.discretisation, part._once = d, None
        part.fields = cut(self.fields, d.field_tolerance)
        part.population = Population(part.fields[0].root, self.count, d.nodes, d.saturation)
        return part

    def fired_by(self, firing: Firing) -> Scene:
        """Return the scene with its rate curves from another source."""
        part = self._without("_shortened")
        part.firing = firing
        part._once = None if self._once is None else (self._once[0].fired_by(firing), self._once[1])
        return part

    def _without(self, *made: str) -> Scene:
        """Return a copy in which some cached properties are made again."""
        part = copy.copy(self)
        part._finer = None
        for name in ("_parts", *made):
            part.__dict__.pop(name, None)
        return part

    def on_grid(self, modulus: Array, loads: Sequence[Load] | None = None) -> Scene:
        """Return a scene of fabrics with these moduli [Pa] and the median Poisson ratio, under some or all loads."""
        poisson = np.full(modulus.size, np.median(self.poisson))
        own = replace(self.discretisation, field_source=None)  # fields over another range share no source
        changed = {"fabric_modulus": modulus, "fabric_poisson": poisson, "loads": loads or self.loads}
        return self._with(**changed, fabric=None, load=None, discretisation=own)

    def under(self, loads: Sequence[Load], fabric: ArrayLike, load: ArrayLike) -> Scene:
        """Return the scene of the same fabrics in other conditions, given by indices of fabrics and new loads."""
        return self._with(loads=loads, fabric=fabric, load=load)

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
        return self._with(fabric_modulus=moduli, fabric_poisson=poisson, fabric=fabric, load=load)

    def _with(self, **changed: Any) -> Scene:
        """Compile a scene with the same arguments except the given ones."""
        own = {name: getattr(self, name) for name in _KEPT}
        own |= {"fabric_modulus": self.fabric_modulus, "fabric_poisson": self._poissons}
        return Scene(**own | changed)

    def beyond_hertz(self, parameters: TouchParameters, modulus: Array | None = None) -> BeyondHertz:
        """Return the shares of draws × conditions with contact outside the range of Hertz's geometry."""
        radius = self.contact(parameters, modulus).radius / self.fingertip(parameters).radius
        return BeyondHertz.of(radius)

    def _chunks(
        self, parameters: TouchParameters, modulus: Array | None
    ) -> tuple[tuple[int, ...], Iterator[tuple[TouchParameters, Array | None]]]:
        return batches.chunks(parameters, modulus, self.n_conditions * self.discretisation.nodes)

    def _contact(self, parameters: TouchParameters, modulus: Array | None) -> Contact:
        own = None if modulus is None else modulus[:, self.fabric]
        return self._contacts.close(parameters.b, parameters.m, own, self.fingertip(parameters))

    def _drive(self, parameters: TouchParameters) -> Drive:
        return Drive(parameters.alpha, parameters.beta, parameters.sigma_0, self.rates.curves(parameters))
