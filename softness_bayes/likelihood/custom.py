"""Custom observation models of ratings: found by name, and tested before a run so that none fails after it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.errors import InputError
from softness_bayes.likelihood.contract import Parameters
from softness_bayes.likelihood.error_laws import ERROR_LAWS
from softness_bayes.likelihood.ratings import RatingsLikelihood
from softness_bayes.likelihood.scales import Scale

FloatArray = NDArray[np.float64]

MEMBERS = (
    "scale", "error", "needs", "levels", "direction", "error_sd", "typical", "named_effects", "drive",
    "drive_at", "draw_effects", "with_new_participants", "for_others", "draw_ratings", "observe",
)  # fmt: skip
"""Required members of a model of ratings."""


def require_model(scale: Scale, model: Any) -> None:
    """Raise an error for a value that is not a model of ratings on a scale.

    Raises
    ------
    InputError
        Naming what is missing or wrong.
    """
    own = f"ratings: the model of {scale.name}"
    if missing := [name for name in MEMBERS if not hasattr(model, name)]:
        raise InputError(f"{own} has no {missing[0]!r}, expected all that likelihood.ratings.RatingsModel has")
    if model.scale != scale:
        raise InputError(f"{own} has the scale {model.scale.name}, expected {scale.name} itself")
    if model.error not in ERROR_LAWS.values():
        raise InputError(f"{own} has an unknown error law, expected one of {', '.join(ERROR_LAWS)}")


def try_likelihood(observed: RatingsLikelihood, mean_rate: FloatArray, values: Mapping[str, ArrayLike]) -> None:
    """Call every member of a custom likelihood that a run needs, and check the shapes of the results.

    Parameters
    ----------
    observed
        Ratings under the model.
    mean_rate
        N/N_ref [Hz] of each condition at some parameters, shape (draws, conditions).
    values
        Parameters of the model by name, each (draws,).

    Raises
    ------
    InputError
        Names the member that fails or returns an invalid value.
    """
    model, rng = observed.model, np.random.default_rng(0)
    draws, rows = len(mean_rate), observed.design.n_rows
    conditions, people = observed.design.n_conditions, observed.design.n_participants
    own = f"ratings: the model of {model.scale.name}: "

    def tried(name: str, call: Callable[[], Any], shape: tuple[int, ...] | None = None) -> Any:
        try:
            found = call()
        except Exception as error:
            raise InputError(f"{own}{name} fails: {type(error).__name__}: {error}") from error
        if shape is not None and np.shape(found) != shape:
            raise InputError(f"{own}{name} has shape {np.shape(found)}, expected {shape}")
        return found

    p = Parameters(**values)
    tried("error_sd", lambda: model.error_sd(p), (draws,))
    tried("log_likelihood", lambda: observed.log_likelihood(mean_rate, p), (draws,))
    tried("log_likelihood_loo", lambda: observed.log_likelihood_loo(mean_rate, p), (draws, rows))
    tried("below_loo", lambda: observed.below_loo(mean_rate, p), (draws, rows))
    tried("log_likelihood_participants", lambda: observed.log_likelihood_participants(mean_rate, p), (draws, people))
    drive = tried("drive", lambda: observed.drive(mean_rate, p), (draws, conditions))
    tried("predictor", lambda: observed.predictor(mean_rate, p), (draws, conditions))
    effects = tried("draw_effects", lambda: observed.draw_effects(rng, mean_rate, p))
    tried("new_effects", lambda: observed.new_effects(rng, p, (draws,)))
    others = tried("with_new_participants", lambda: observed.with_new_participants(rng, p, effects))
    tried("typical", lambda: model.typical(effects, drive), (draws, conditions))
    tried("draw_ratings", lambda: observed.replicate(rng, drive, p, others, mean_rate), (draws, rows))
    for name, (effect, axes) in tried("named_effects", lambda: dict(model.named_effects(effects))).items():
        if np.ndim(effect) != 1 + len(axes):
            raise InputError(f"{own}named_effects: {name} has {np.ndim(effect)} axes, expected {1 + len(axes)}")
    tried("residual", lambda: observed.residual(mean_rate, p, effects), (draws, rows))
    tried("with_values", lambda: observed.with_values(observed.values))
    if rows > 1:
        tried("without", lambda: observed.without(np.arange(rows) == 0))
    fabric = np.array([0, -1])
    tried("for_others", lambda: model.for_others(rng, p, effects, 2, fabric))
