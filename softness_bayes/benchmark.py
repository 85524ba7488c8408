"""Time and error of the forward model on this machine: ``python -m softness_bayes.benchmark``.

Prints, for 12 fabrics × 3 indentations and batches of 64 parameter vectors drawn from the prior, the
time per vector at several resolutions, the largest error of each against a scene resolved much more
finely, and the error of that one against adaptive integration at a few vectors. Errors are relative
to each vector's peak response, and of log(N/N_ref + 0.1 Hz), which is what the likelihood sees.
"""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.inference.parameters import HELD, parameter_space
from softness_bayes.touch.contact import Indentation
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.reference import reference_response
from softness_bayes.touch.scene import Discretisation, FixedChannels, Scene

Array = NDArray[np.float64]

BATCH, DRAWS, REPEATS, REFERENCES = 64, 1000, 40, 3
FABRICS = np.geomspace(1e3, 5e6, 12)
LOADS = (Indentation(1e-3), Indentation(2e-3), Indentation(3e-3))
COARSE, USUAL, FINE = Discretisation(8, 9.0, 1e-5), Discretisation(), Discretisation(24, 20.0, 1e-8)


class Errors(NamedTuple):
    """Largest errors over draws and conditions."""

    peak: float
    """Of the total rate, relative to each draw's peak."""
    log: float
    """Of log(N/N_ref + 0.1 Hz)."""


def errors(rate: Array, exact: Array, n_receptors: float) -> Errors:
    """Compare total rates, shape (draws, conditions), with better ones."""
    peak = exact.max(axis=-1, keepdims=True)
    relative = np.abs(rate - exact) / np.where(peak > 0, peak, 1.0)
    logs = np.log((rate / n_receptors + HELD["eps"]) / (exact / n_receptors + HELD["eps"]))
    return Errors(float(relative.max()), float(np.abs(logs).max()))


def _scene(firing: FixedChannels, discretisation: Discretisation) -> Scene:
    return Scene(FABRICS, 0.3, LOADS, firing, discretisation=discretisation)


def _take(parameters: TouchParameters, rows: slice | int) -> TouchParameters:
    return TouchParameters(*(np.broadcast_to(value, (DRAWS,))[rows] for value in parameters))


def _seconds(scene: Scene, parameters: TouchParameters) -> float:
    """Return the median time of one call."""
    taken = []
    for _ in range(REPEATS):
        begun = time.perf_counter()
        scene.total_rate(parameters)
        taken.append(time.perf_counter() - begun)
    return float(np.median(taken))


def main() -> None:
    """Print the table."""
    from threadpoolctl import threadpool_limits

    space = parameter_space()
    parameters = space.touch(space.draw_prior(np.random.default_rng(1), DRAWS))
    firing = FixedChannels()
    with threadpool_limits(1):
        best = _scene(firing, Discretisation(60, 30.0, 1e-9))
        exact = best.total_rate(parameters)
        print(f"{(exact == 0).all(axis=-1).mean():.1%} of {DRAWS} prior draws are silent in every condition")
        print("nodes  saturation  field tolerance   µs/vector   error / peak   error of the log")
        for d in (COARSE, USUAL, FINE):
            scene = _scene(firing, d)
            found = errors(scene.total_rate(parameters), exact, scene.n_receptors)
            spent = 1e6 * _seconds(scene, _take(parameters, slice(BATCH))) / BATCH
            print(
                f"{d.nodes:5}  {d.saturation:10.0f}  {d.field_tolerance:15.0e}  {spent:10.1f}  "
                f"{found.peak:13.1e}  {found.log:17.1e}"
            )
        firing_vectors = np.flatnonzero(exact.max(axis=-1) > 0)[:REFERENCES]
        slow = [
            reference_response(best, _take(parameters, int(i)), law=firing.curve).total_rate for i in firing_vectors
        ]
    found = errors(exact[firing_vectors], np.array(slow), best.n_receptors)
    print(f"finest scene against adaptive integration, {REFERENCES} vectors: {found.peak:.1e} of the peak")


if __name__ == "__main__":
    main()
