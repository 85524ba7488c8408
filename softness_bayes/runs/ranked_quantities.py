"""Ranked quantities of a calibration: functions of parameters, participants and ratings.

Any such quantity has uniform ranks if the inference is correct. Without a turning point, its position is set to zero,
below all others, and ties are broken at random, so that no replicate is left out and ranks remain uniform. The presence
of a turning point is ranked as 0 or 1 with random ties, which compares its probability with its frequency. Participants
are exchangeable, so that one represents all.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.inflection import CurveShape, curve_scene, find_inflection, response_curves
from softness_bayes.likelihood.contract import Effects
from softness_bayes.model.posterior import Posterior
from softness_bayes.touch.load_groups import groups_of
from softness_bayes.touch.scene import Scene

FloatArray = NDArray[np.float64]

LOG_LIKELIHOOD = "log_likelihood"
"""Name of the joint log-likelihood among the ranked quantities."""

PARTICIPANT, PARTICIPANTS = "participant_effect", "participant_spread"
"""Names of the first participant's effect, and of the standard deviation of all participants' effects."""

FABRIC, FABRICS = "fabric_effect", "fabric_spread"
"""Names of the first fabric's deviation, and of the standard deviation of all fabrics' deviations."""


def turns(load: object) -> str:
    """Return the name of the presence, 0 or 1, of a turning point under a load."""
    return f"turns[{load}]"


def turning_point(load: object) -> str:
    """Return the name of the position of the turning point, E_fab [kPa], 0 without one."""
    return f"turning_point_kpa[{load}]"


def quantities(posterior: Posterior, theta: FloatArray, effects: Effects) -> dict[str, FloatArray]:
    """Return the ranked quantities at some points, by name.

    Parameters
    ----------
    posterior
        The model, with the ratings of the points.
    theta
        Points in natural units, shape (points, dimension).
    effects
        Effects of each point, in the form drawn by the likelihood of the ratings.

    Returns
    -------
    dict of ndarray, each of shape (points,)
    """
    found = {name: theta[:, k] for k, name in enumerate(posterior.names)}
    drawn = posterior.observation.model.named_effects(effects)
    found |= {name: values for name, (values, axes) in drawn.items() if not axes}
    found |= {LOG_LIKELIHOOD: posterior.log_likelihood(theta)}
    if PARTICIPANT in drawn and posterior.space.held.get("tau") != 0.0:
        participants, _ = drawn[PARTICIPANT]
        found |= {PARTICIPANT: participants[:, 0], PARTICIPANTS: participants.std(axis=-1)}
    if FABRIC in drawn and "omega" in posterior.names:
        fabrics, _ = drawn[FABRIC]
        found |= {FABRIC: fabrics[:, 0], FABRICS: fabrics.std(axis=-1)}
    if isinstance(posterior.scene, Scene):
        found |= _turning_points(posterior, posterior.scene, theta)
    return found


def _turning_points(posterior: Posterior, scene: Scene, theta: FloatArray) -> dict[str, FloatArray]:
    groups = groups_of(scene.loads)
    grid = curve_scene(scene, loads=[scene.loads[k] for k in groups.at])
    curves = response_curves(grid, posterior.space.touch(theta))
    turn = find_inflection(curves, 0.0, (float(scene.modulus.min()), float(scene.modulus.max())))
    interior = np.broadcast_to(turn.outcome == CurveShape.INTERIOR, (len(theta), len(groups.names)))
    place = np.where(interior, turn.modulus * 1e-3, 0.0)
    found = {turns(load): interior[:, k].astype(float) for k, load in enumerate(groups.names)}
    return found | {turning_point(load): place[:, k] for k, load in enumerate(groups.names)}
