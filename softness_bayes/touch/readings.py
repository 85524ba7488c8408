"""Readings of the paper: tables of named alternatives, composed into one frozen `Readings`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from types import MappingProxyType
from typing import Any

from softness_bayes.base.errors import InputError, quoted
from softness_bayes.base.ranges import require_mapping
from softness_bayes.base.supplied import FORM, installed, is_supplied, reference, require_reference, supplied
from softness_bayes.touch.contact import (
    DISPLACEMENT,
    PLATE_RIGIDITY,
    PRINTED_RIGIDITY,
    STRAIN,
    FabricModulus,
    SkinDisplacement,
)
from softness_bayes.touch.neuron.membrane import CONNOR_STEVENS, HODGKIN_HUXLEY, Membrane
from softness_bayes.touch.neuron.membrane import PRINTED as PRINTED_MEMBRANE
from softness_bayes.touch.receptors import CONSISTENT, PRINTED_DENSITY, Density
from softness_bayes.touch.stress import (
    ATTENUATED,
    AXISYMMETRIC,
    HERTZ,
    LINE,
    PRINCIPAL,
    PRINTED_KERNEL,
    PRINTED_PRESSURE,
    VERTICAL,
    Component,
    Kernel,
    Pressure,
)


def _require_kind(place: str, value: Any) -> None:
    kind = type(next(iter(ALTERNATIVES[place].values())))
    if not isinstance(value, kind):
        raise InputError(
            f"reading: {place} is {value!r:.60}, expected a {kind.__name__} of {kind.__module__}, such as "
            f"{', '.join(ALTERNATIVES[place])} of ALTERNATIVES[{place!r}]"
        )


@dataclass(frozen=True)
class Readings:
    """One reading for each part of the model that the paper leaves ambiguous (model.md 1-8)."""

    fabric_modulus: FabricModulus = PRINTED_RIGIDITY
    skin_displacement: SkinDisplacement = STRAIN
    pressure: Pressure = ATTENUATED
    stress_kernel: Kernel = LINE
    stress_component: Component = VERTICAL
    membrane: Membrane = CONNOR_STEVENS
    receptor_density: Density = CONSISTENT

    def __post_init__(self) -> None:
        for place in fields(self):
            _require_kind(place.name, getattr(self, place.name))
        if self.stress_component.needs_plane and not self.stress_kernel.two_sided:
            raise InputError(
                f"readings: stress_component={self.stress_component.name} needs a plane stress state, "
                f"which stress_kernel={self.stress_kernel.name} does not give; use vertical"
            )

    @property
    def names(self) -> dict[str, str]:
        """Name of the reading of each part: one of `ALTERNATIVES`, or the importable name of a custom reading.

        A custom reading without an importable name is returned as it is; `require_names` rejects it.
        """
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {
            place: str(value.name if ALTERNATIVES[place].get(value.name) == value else reference(value) or value.name)
            for place, value in values.items()
        }

    def require_names(self) -> None:
        """Raise an error for a reading that could not be restored by name from a stored run.

        Raises
        ------
        InputError
            With the reason.
        """
        for place, name in self.names.items():
            value = getattr(self, place)
            if not (":" in name or ALTERNATIVES[place].get(name) == value):
                require_reference(f"reading: {place} {quoted(name)}", value)

    @property
    def label(self) -> str:
        """Name of the closest named set, and the parts in which these readings differ from it."""
        departures = {
            name: [f"{place}={chosen}" for place, chosen in self.names.items() if chosen != named.names[place]]
            for name, named in NAMED_READINGS.items()
        }
        nearest = min(departures, key=lambda name: len(departures[name]))
        return ", ".join([nearest, *departures[nearest]])

    def override(self, choices: Mapping[str, str]) -> Readings:
        """Return these readings with some parts replaced by other alternatives, given by name or importable name.

        Raises
        ------
        InputError
            If a part or a name does not exist, or the readings are incompatible.
        """
        require_mapping("readings", choices, "{'pressure': 'hertz'}")
        return replace(self, **{place: alternative(place, name) for place, name in choices.items()})


_PLACES: dict[str, tuple[Any, ...]] = {
    "fabric_modulus": (PRINTED_RIGIDITY, PLATE_RIGIDITY),
    "skin_displacement": (STRAIN, DISPLACEMENT),
    "pressure": (ATTENUATED, HERTZ, PRINTED_PRESSURE),
    "stress_kernel": (LINE, PRINTED_KERNEL, AXISYMMETRIC),
    "stress_component": (VERTICAL, PRINCIPAL),
    "membrane": (CONNOR_STEVENS, HODGKIN_HUXLEY, PRINTED_MEMBRANE),
    "receptor_density": (CONSISTENT, PRINTED_DENSITY),
}

ALTERNATIVES: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {place: MappingProxyType({value.name: value for value in values}) for place, values in _PLACES.items()}
)
"""All alternatives of each part, by name; the first is the default."""


MENDED = Readings()
"""The model of the paper with misprints corrected: the default."""
AS_PRINTED = Readings(
    pressure=PRINTED_PRESSURE,
    stress_kernel=PRINTED_KERNEL,
    stress_component=PRINCIPAL,
    membrane=PRINTED_MEMBRANE,
    receptor_density=PRINTED_DENSITY,
)
"""The model exactly as printed in the paper, in mm-N-MPa."""
CLASSICAL = Readings(fabric_modulus=PLATE_RIGIDITY, pressure=HERTZ, stress_kernel=AXISYMMETRIC)
"""Classical mechanics throughout: thin-plate rigidity, Hertz's pressure, Boussinesq's stress."""

NAMED_READINGS: Mapping[str, Readings] = MappingProxyType({"mended": MENDED, "printed": AS_PRINTED, "hertz": CLASSICAL})
"""The named sets of readings; the first is the default."""


def readings_named(name: str, overrides: Mapping[str, str] | None = None) -> Readings:
    """Return a named set of readings, with single parts overridden by name.

    Raises
    ------
    InputError
        If there is no such set, part or alternative, or the readings are incompatible.
    """
    if name not in NAMED_READINGS:
        raise InputError(f"readings: no set '{name}'; expected one of {', '.join(NAMED_READINGS)}")
    return NAMED_READINGS[name].override(overrides or {})


def alternative(place: str, name: str) -> Any:
    """Return an alternative of a part, by its name, entry point of an installed package, or importable name.

    Raises
    ------
    InputError
        If the part or the name does not exist; the message lists the existing ones.
    """
    if place not in ALTERNATIVES:
        raise InputError(f"reading: no place '{place}'; expected one of {', '.join(ALTERNATIVES)}")
    if name in ALTERNATIVES[place]:
        return ALTERNATIVES[place][name]
    if not is_supplied(place, name):
        known = ", ".join([*ALTERNATIVES[place], *installed(place)])
        raise InputError(f"reading: {place} has no '{name}'; expected one of {known}, or {FORM} for a custom reading")
    found = supplied(place, name)
    _require_kind(place, found)
    return found
