"""Groups and variables of a result for compression data."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.checks import ExponentCheck
from softness_bayes.data.columns import FORCE, INDENTATION
from softness_bayes.data.compression import Compression
from softness_bayes.likelihood.contract import NO_RESPONSE
from softness_bayes.likelihood.plate import CompressionForces, FingerEffects, SkinParameters
from softness_bayes.provenance import PlateData, attributes_of
from softness_bayes.results.groups import Groups, Variable
from softness_bayes.touch.contact import plate_force

Array = NDArray[np.float64]

POINTS = 60
"""Number of indentations at which the force of the typical finger is stored."""


class PlateReplicates(NamedTuple):
    """Draws made after a run on compression data, each of shape (draws, ...)."""

    fingers: FingerEffects
    """Deviations of the fingers from the typical one, at every draw of every chain."""
    again: Array
    """Forces of the same fingers [N], for posterior draws."""
    prior: Array
    """Forces of new fingers [N], for prior draws."""


def draw_plate(
    rng: np.random.Generator,
    forces: CompressionForces,
    skin: Callable[[Array], SkinParameters],
    theta: Array,
    replicates: Array,
    prior: Array,
) -> PlateReplicates:
    """Draw the deviations of fingers, and replicated forces.

    Parameters
    ----------
    rng
        Random generator of effects and noise.
    forces
        The likelihood.
    skin
        Function that returns the skin's parameters at points theta.
    theta
        All draws, shape (chains, draws, dimension), for the deviations of fingers.
    replicates, prior
        Draws of the posterior and of the prior (draws, dimension) for which forces are simulated.
    """

    def forces_at(points: SkinParameters, effects: FingerEffects) -> Array:
        return forces.replicate(rng, forces.drive(NO_RESPONSE, points), points, effects)

    fingers = forces.draw_effects(rng, NO_RESPONSE, skin(theta))
    again = forces_at(skin(replicates), forces.draw_effects(rng, NO_RESPONSE, skin(replicates)))
    made = forces_at(skin(prior), forces.new_effects(rng, skin(prior), prior.shape[:1]))
    return PlateReplicates(fingers, again, made)


def plate_groups(
    compression: Compression, forces: CompressionForces, typical: SkinParameters, drawn: PlateReplicates
) -> Groups:
    """Return fingers, replicated forces, the typical finger's force and the data.

    Parameters
    ----------
    compression, forces
        The data and their likelihood.
    typical
        The skin's parameters at some draws of the posterior, shape (draws,), for the typical finger's force.
    drawn
        Output of `draw_plate`.
    """
    depth = _depths(compression)
    line = plate_force(
        depth,
        np.asarray(typical.b)[:, None],
        np.asarray(typical.m)[:, None],
        displacement=forces.model.displacement,
    )
    row = ("force_row",)
    return {
        "posterior": {
            "log_b_effect": Variable(drawn.fingers.log_b, ("finger",)),
            "m_effect": Variable(drawn.fingers.m, ("finger",)),
        },
        "posterior_predictive": {"plate_force_n": Variable(drawn.again[None], row, FORCE.unit)},
        "prior_predictive": {"plate_force_n": Variable(drawn.prior[None], row, FORCE.unit)},
        "predictions": {"typical_force_n": Variable(line[None], ("plate_indentation_mm",), FORCE.unit)},
        "observed_data": {"plate_force_n": Variable(compression.force, row, FORCE.unit)},
        "constant_data": {
            "finger_index": Variable(compression.participant, row),
            "force_indentation_mm": Variable(compression.indentation / INDENTATION.factor, row, INDENTATION.unit),
        },
    }


def plate_coordinates(compression: Compression) -> dict[str, NDArray[Any]]:
    """Return the coordinates of the axes of `plate_groups`."""
    return {
        "finger": np.array(compression.participants),
        "force_row": compression.rows,
        "plate_indentation_mm": _depths(compression) / INDENTATION.factor,
    }


def plate_attributes(compression: Compression, check: ExponentCheck) -> dict[str, Any]:
    """Return the provenance of compression data."""
    return attributes_of(
        PlateData(
            digest_compression=compression.digest,
            zero_forces=compression.n_zero,
            forces_per_finger=check.points,
            force_exponent=check.observed,
            force_exponent_low=check.low,
            force_exponent_high=check.high,
            force_p_value=check.p_value,
        )
    )


def _depths(compression: Compression) -> Array:
    """Return indentations [m] from half the smallest to a tenth more than the largest of the data."""
    return np.geomspace(0.5 * compression.indentation.min(), 1.1 * compression.indentation.max(), POINTS)
