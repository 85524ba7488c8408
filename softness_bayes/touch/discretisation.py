"""The resolution of a scene."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Discretisation:
    """Resolution of a scene; the defaults have errors of about 1e-5 of the peak response."""

    nodes: int = 10
    """Nodes of the population integral for each condition."""
    saturation: float = 11.0
    """Extent of the integral along the sigmoid, in units of its exponent beyond the rheobase."""
    field_tolerance: float = 3e-6
    """Error allowed in the tabulated stress field."""
    rate_nodes: int = 18
    """Number of exact rates interpolated by the curve of fixed channels."""
    field_source: float | None = None
    """Tolerance to which the stress field is computed before truncation to `field_tolerance`; by default the same."""
    rate_terms: int | None = None
    """Number of terms that are left of the polynomials in the root of the current; by default all."""


def sharing(wanted: Discretisation, other: Discretisation) -> Discretisation:
    """Return a resolution whose stress fields are truncated from those of another, if these are fine enough.

    Fields of the same loads, finger and range of moduli are then computed once for both.
    """
    source = other.field_source or other.field_tolerance
    return replace(wanted, field_source=source) if source <= wanted.field_tolerance * (1.0 + 1e-9) else wanted
