"""Ranks where inputs are uncertain: ``python -m softness_bayes.tools.latent_ranks DIR [--kinds K,..] [--labs N]``.

Simulation-based calibration of every kind of uncertain input, alone and together. The parameters of each simulated
laboratory are drawn from the prior, and so are its true moduli, loads and fingers. Its ratings are simulated by the
forward model at these true inputs, without the approximations of the likelihood. The fit, with fixed channels, knows
only the distributions of the inputs. If it is right, the rank of each true value among the draws is uniform.

Each kind has a negative control: the true errors are twice as large as declared. Ranks of the control must not be
uniform. Posteriors are importance-sampled. The directory gets a file of ranks for each kind and its control. Existing
rows are kept. The program ends with a table of all files in the directory.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from softness_bayes.checking.inflection import turning_points
from softness_bayes.checking.ranks import DRAWS, Calibration
from softness_bayes.model.build import ExperimentModel
from softness_bayes.runs.replicate import ranks
from softness_bayes.tools.coverage import rows_of
from softness_bayes.tools.importance import TRUSTED, Effort, weighted
from softness_bayes.tools.latent_labs import KINDS, Kind, Laboratory, laboratory, model_of
from softness_bayes.touch.parameters import TouchParameters

Array = NDArray[np.float64]

CONTROL = "control"
"""Name of the fits that declare half of the errors."""

USUAL, RETRY = Effort(300, 200.0), Effort(4000, 800.0)
"""Effort of a fit, and the one spent where its weights cannot be trusted."""

HOW = ("lab", "k")
"""Columns beside the ranks: Pareto's k of the weights."""


def fitted(kind: Kind, number: int, control: bool) -> dict[str, Any]:
    """Return a row: the rank of each true value among the draws of one fit."""
    model = _model(kind)
    made = laboratory(kind, model, number, control)
    posterior = made.posterior(model.posterior)
    rng = np.random.default_rng((number, 2))
    found = weighted(posterior, rng, made.start, USUAL)
    if found.k > TRUSTED:
        found = weighted(posterior, rng, made.start, RETRY)
    theta = found.resampled(rng, DRAWS)
    every = _quantities(model, posterior, np.vstack([theta, made.theta]), made, rng)
    placed = ranks(np.array([v[-1] for v in every.values()]), np.column_stack([v[:-1] for v in every.values()]), rng)
    return {"lab": number, "k": round(found.k, 3), **dict(zip(every, placed.tolist(), strict=True))}


@cache
def _model(kind: Kind) -> ExperimentModel:
    return model_of(kind)


def _quantities(
    model: ExperimentModel, posterior: Any, theta: Array, made: Laboratory, rng: np.random.Generator
) -> dict[str, Array]:
    """Return the ranked quantities at draws of the posterior, and last at the true parameters."""
    found = {name: theta[:, k] for k, name in enumerate(posterior.names)}
    found["log_likelihood"] = posterior.log_likelihood(theta)
    touch = TouchParameters(*(np.broadcast_to(v, len(theta)) for v in posterior.space.touch(theta)))
    place = np.nan_to_num(turning_points(model.scene, touch, 0.0).modulus)
    found |= {f"turning point at {load}": place[:, k] for k, load in enumerate(model.scene.loads)}
    if made.effects:
        drawn = posterior.observation.draw_effects(
            rng, posterior.response(theta[:-1]), posterior.rating_parameters(theta[:-1])
        )
        for name, (of, true) in made.effects.items():
            found[name] = np.append(of(drawn), true)
    return found


def calibration_of(rows: Sequence[dict[str, str]]) -> Calibration:
    """Return the ranks of some rows."""
    names = tuple(name for name in rows[0] if name not in HOW)
    return Calibration(names, np.array([[int(row[name]) for name in names] for row in rows]))


def table(folder: Path) -> Iterator[str]:
    """Yield the lines of a Markdown table: the tests and the coverage of each kind and control in a folder."""
    yield "| uncertain input | laboratories | quantities | 90 % intervals that held the truth | verdict | control |"
    yield "|" + "---|" * 6
    for name, kind in KINDS.items():
        if rows := rows_of(folder / f"{name}.csv"):
            found = calibration_of(rows)
            inside = [row for row in found.coverage() if row["mass"] == 0.9]
            shares = [float(row["share"]) for row in inside]
            held = f"{np.mean(shares):.3f} ({min(shares):.2f}–{max(shares):.2f})"
            untrusted = sum(float(row["k"]) > TRUSTED for row in rows)
            words = _verdict(found) + (f"; {untrusted} fits with k above {TRUSTED}" if untrusted else "")
            control = rows_of(folder / f"{name}_{CONTROL}.csv")
            seen = f"{len(control)}: {_verdict(calibration_of(control))}" if control else ""
            yield f"| {kind.meaning} | {len(rows)} | {len(found.names)} | {held} | {words} | {seen} |"


def _verdict(found: Calibration) -> str:
    least = min(min(one.uniform_p, one.spread_p) for one in found.judge().values())
    faults = found.fault_of()
    if not faults:
        return f"no alarm (p ≥ {least:.2g}, alarm below {found.threshold:.1g})"
    return f"alarm at {', '.join(f'`{name}`' for name in list(faults)[:3])} (p = {least:.1g})"


def main() -> None:
    """Fit the laboratories that are missing in the files, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("directory", type=Path, help="directory of the files of ranks; what they hold is kept")
    parser.add_argument("--kinds", default=",".join(KINDS), help="kinds of uncertain inputs; by default all")
    parser.add_argument("--labs", type=int, default=200, help="number of laboratories of each kind")
    parser.add_argument("--controls", type=int, default=100, help="number of laboratories of each control")
    options = parser.parse_args()
    options.directory.mkdir(parents=True, exist_ok=True)
    for name in options.kinds.split(",") if options.kinds else ():
        for control, labs in ((False, options.labs), (True, options.controls)):
            _keep(options.directory / f"{name}{f'_{CONTROL}' if control else ''}.csv", KINDS[name], labs, control)
    print("\n".join(table(options.directory)))


def _keep(path: Path, kind: Kind, labs: int, control: bool) -> None:
    """Append the rows that are missing in a file."""
    done = {int(row["lab"]) for row in rows_of(path)}
    # the matrices are small: further threads of linear algebra would mostly wait, with a processor each
    with threadpool_limits(1), path.open("a", encoding="utf-8", newline="") as file:
        for number in range(labs):
            if number not in done:
                row = fitted(kind, number, control)
                writer = csv.DictWriter(file, [*row], lineterminator="\n")
                if not file.tell():
                    writer.writeheader()
                writer.writerow(row)
                file.flush()


if __name__ == "__main__":
    main()
