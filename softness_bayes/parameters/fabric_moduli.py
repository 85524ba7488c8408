"""Uncertain effective moduli of fabrics, as sampled parameters with prior laws (model.md 1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from softness_bayes.errors import InputError
from softness_bayes.parameters.priors import LogNormal, Prior

FloatArray = NDArray[np.float64]

UNKNOWN_MODULUS = LogNormal(100, 2)
"""Prior law of a modulus about which nothing is known [kPa]: 90 % within 4 to 2700 kPa, which includes most cloth."""

KPA = 1e3
"""Number of pascals in the unit of the laws."""

FABRIC_MODULUS = "fabric_modulus"
"""Name of the sampled moduli in files; one of them is `FABRIC_MODULUS`[fabric]."""


@dataclass(frozen=True)
class FabricModuli:
    """Effective modulus of every fabric: central value, and prior law if uncertain.

    Parameters
    ----------
    names
        The fabrics.
    middle
        Measured modulus, or the median of the law [Pa], of each fabric.
    laws
        Law of each modulus [kPa]; None if it is known exactly.
    """

    names: tuple[str, ...]
    middle: tuple[float, ...]
    laws: tuple[Prior | None, ...]

    @property
    def uncertain(self) -> tuple[int, ...]:
        """Indices of the fabrics with uncertain moduli."""
        return tuple(k for k, law in enumerate(self.laws) if law is not None)

    @property
    def known(self) -> bool:
        """True if every modulus is known exactly."""
        return not self.uncertain

    @property
    def extent(self) -> tuple[float, float]:
        """Range of moduli [Pa] to cover in a run: four standard deviations of each law."""
        ends = [(middle, middle) for middle in self.middle]
        for k in self.uncertain:
            law = self.laws[k]
            assert law is not None
            low, high = (np.asarray(law.quantile([3e-5, 1.0 - 3e-5])) * KPA).tolist()
            ends[k] = low, high
        return min(low for low, _ in ends), max(high for _, high in ends)

    def at(self, sampled: FloatArray) -> FloatArray:
        """Return E_fab [Pa] of every fabric, shape (..., fabrics), at sampled moduli [kPa], (..., uncertain)."""
        found = np.empty((*sampled.shape[:-1], len(self.middle)))
        found[...] = self.middle
        found[..., list(self.uncertain)] = sampled * KPA
        return found


def require_law(name: str, law: Prior) -> None:
    """Raise an error for a law of a modulus that allows negative values.

    Raises
    ------
    InputError
        With the law.
    """
    if law.support[0] < 0 or not law.median > 0:
        raise InputError(
            f"{name}: {law} allows moduli below 0, expected a distribution above 0 [kPa], such as {UNKNOWN_MODULUS}"
        )
