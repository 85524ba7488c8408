"""The prior set `recorded`: ``python recorded_law.py AFFERENTS.csv``.

AFFERENTS.csv has the table of recorded afferents (columns of `Afferents.read`), for the stored law the 21 mean rates of
monkey SA1 afferents under spheres (Goodwin, Browning and Wheat 1995, J. Neurosci. 15, 798; digitised, not part of this
package) at the contact's centre. A run of the recordings alone, in the default readings, gives draws of the skin and
the transduction; mean and covariance in the coordinates of `JointLaw` are printed as its numbers.
"""

from __future__ import annotations

import sys

import numpy as np

from softness_bayes import sample
from softness_bayes.data import Afferents
from softness_bayes.parameters.joint import JointLaw, coordinates
from softness_bayes.touch.neuron.fixed_channels import FixedChannels
from softness_bayes.touch.neuron.membrane import PAPER_CHANNELS


def main(path: str) -> None:
    """Print the law of the posterior of a table."""
    run = sample(Afferents.read(path), max_steps=20_000, seed=1)
    drawn = {name: run.group("posterior")[f"{name}_rec"].values.ravel() for name in ("b", "m", "alpha", "beta", "rest")}
    rheobase = float(FixedChannels(PAPER_CHANNELS).curves(PAPER_CHANNELS, 40.0).rheobase)
    with np.errstate(invalid="ignore"):
        sigma_0 = np.log(drawn["alpha"] / (drawn.pop("rest") * rheobase) - 1.0) / drawn["beta"]
    points = coordinates(**drawn, sigma_0=sigma_0, limit=rheobase)
    kept = points[np.isfinite(points).all(axis=1)]
    centre, root = kept.mean(axis=0).round(3), np.linalg.cholesky(np.cov(kept.T)).round(3)
    sd = run.provenance.recorded.rate_residual_sd
    print(f"residual sd {sd:.2f} Hz; sigma_0 > 0 in {len(kept)} of {len(points)} draws")
    print(JointLaw(tuple(centre.tolist()), tuple(map(tuple, root.tolist())), round(rheobase, 4)))


if __name__ == "__main__":
    main(sys.argv[1])
