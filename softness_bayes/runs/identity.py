"""Identity of a run, which must not change on continuation: all settings that affect its draws, by name."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes.base.errors import InputError
from softness_bayes.data import Experiment, Measurements
from softness_bayes.model.posterior import Density
from softness_bayes.sampler.chains import RunState
from softness_bayes.sampler.sampling import Settings

_RELATIVE, _ABSOLUTE = 1e-9, 2e-3
"""Tolerance of a log density. Library versions differ in rounding errors, and integrals over raters' effects by up to
their own error, 1e-3, with the points that are evaluated together."""


def identity(
    data: Experiment | Measurements, density: Density, settings: Settings, choices: Mapping[str, str]
) -> dict[str, str]:
    """Return all settings that affect the draws of a run, by name; runs that agree in them have the same draws.

    Parameters
    ----------
    data, density, settings
        Data, sampled density, and settings of the sampler.
    choices
        Further choices, such as the seed.
    """
    space = density.space
    return {
        **_digests(data),
        "parameters": ", ".join(space.names),
        **{f"prior of {p.name}": str(p.prior) for p in space.sampled},
        **{f"value of {name}": repr(value) for name, value in space.held.items()},
        **{f"coordinate of {name}": str(bend) for name, bend in space.bent.items()},
        **choices,
        **settings.description(space.dimension),
    }


def differences(then: Mapping[str, str], now: Mapping[str, str]) -> str:
    """Describe the settings in which a run differs from its start."""
    names = [name for name in {**then, **now} if then.get(name) != now.get(name)]
    return "; ".join(f"{n} {then.get(n, 'not given')} (now {now.get(n, 'not given')})" for n in names)


def _digests(data: Experiment | Measurements) -> dict[str, str]:
    """Return digests of the tables of some data, by their content."""
    plate, recorded = data.compression, data.afferents
    found = {} if plate is None else {"compression data": _digest(plate.participant, plate.indentation, plate.force)}
    if recorded is not None:
        place = np.array([str(load) for load in recorded.loads]), recorded.curvature, recorded.distance
        responses = recorded.rate, recorded.n, recorded.sd, recorded.window
        found |= {"recorded afferents": _digest(recorded.afferent, *place, *responses)}
    if isinstance(data, Measurements):
        return found
    ratings, fabrics, cells = data.ratings, data.fabrics, data.ratings.cells
    touched = (ratings.participant, ratings.fabric, ratings.load)
    sources = [text for source in fabrics.cells().values() for text in source]
    return {
        "ratings": _digest(ratings.rating, *touched, np.array([str(load) for load in ratings.loads])),
        **({} if ratings.load_cv is None else {"errors of loads": _digest(ratings.load_cv)}),
        **({} if cells is None else {"raters": str(cells.raters)}),
        **({} if cells is None or cells.geometric_sd is None else {"their spread": _digest(cells.geometric_sd)}),
        "fabrics": _digest(np.array(sources)),
        **found,
    }


def require_density(density: Density, state: RunState) -> None:
    """Raise an error if the density has changed since the run began, perhaps with other software.

    Raises
    ------
    InputError
        If it differs at a walker by more than numerical errors.
    """
    for ensemble in state.ensembles:
        then, now = ensemble.log_density, density.for_sampling(state.map.forward(ensemble.coordinates))
        apart = ~np.isclose(now, then, rtol=_RELATIVE, atol=_ABSOLUTE)
        if apart.any():
            k = int(apart.argmax())
            raise InputError(
                f"the run cannot be continued: the log density at one of its walkers was {then[k]!r} and is "
                f"{now[k]!r} now, although data and options are the same; has the software changed?"
            )


def _digest(*arrays: NDArray[Any]) -> str:
    """Return the first half of the SHA-256 of some arrays' values, enough to distinguish them."""
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(repr((array.dtype.str, array.shape)).encode() + np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:32]
