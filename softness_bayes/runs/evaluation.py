"""Evaluation of a model at one point, for models whose parameters are all fixed."""

from __future__ import annotations

import numpy as np

from softness_bayes.checking.inflection import CURVE_POINTS, CurveShape, Inflection, turning_points
from softness_bayes.model.posterior import Density, Posterior
from softness_bayes.touch.contact import Load
from softness_bayes.touch.load_groups import LoadGroup, groups_of
from softness_bayes.touch.scene import Scene


class Evaluation:
    """A model at the values of its fixed parameters.

    Parameters
    ----------
    density
        A model without a sampled parameter.
    error
        Numerical error of the response relative to its peak.

    Attributes
    ----------
    values
        Every parameter in natural units.
    log_likelihood
        Log density of the data.
    loads
        The loads, or groups of many, each evaluated at its middle load.
    inflection
        Turning points of the response, with fields of shape (1, loads); None without ratings.

    Raises
    ------
    NumericalError
        If the log-likelihood is not a number there.
    """

    def __init__(self, density: Density, error: float = 0.0) -> None:
        space, theta = density.space, np.empty((1, 0))
        self.values = {name: float(value) for name, value in space.held.items()}
        self.log_likelihood = float(density.log_likelihood(theta)[0])
        self.loads: tuple[Load | LoadGroup, ...] = ()
        self.inflection: Inflection | None = None
        if isinstance(density, Posterior) and isinstance(scene := density.scene, Scene):
            groups = groups_of(scene.loads)
            touch, loads = space.touch(theta).broadcast(1), [scene.loads[k] for k in groups.at]
            self.loads = groups.called
            self.inflection = turning_points(scene, touch, error, CURVE_POINTS, loads)

    def sentences(self) -> tuple[str, ...]:
        """Return the evaluation as lines of text."""
        held = ", ".join(f"{name} {value:g}" for name, value in self.values.items())
        said = [f"all parameters are fixed, so there is nothing to sample: {held}"]
        said.append(f"log-likelihood of the data at this point: {self.log_likelihood:.10g}")
        if self.inflection is not None:
            at = [f"{one}, at {one.load}" if isinstance(one, LoadGroup) else str(one) for one in self.loads]
            said += [f"under {load}: {self._turn(self.inflection, k)}" for k, load in enumerate(at)]
        return tuple(said)

    def _turn(self, found: Inflection, k: int) -> str:
        match CurveShape(found.outcome[0, k]):
            case CurveShape.SILENT:
                return "no receptor fires"
            case CurveShape.NONE:
                return "the response does not turn over"
        where = "among" if found.inside[0, k] else "beyond"
        return (
            f"the response turns over at E_fab {found.modulus[0, k] / 1e3:.4g} kPa, {where} the fabrics that were rated"
        )
