"""Cost and error of integrated likelihoods of ratings: ``python -m softness_bayes.tools.benchmark_ratings [FILE.csv]``.

For 1080 ratings of 30 raters under each error law, exact and on whole numbers. Times are processor times of complete
likelihood calls, alternating with calls of the closed form, so that other work on the machine affects both alike.
Errors are those of the log-likelihood, against integrals over evenly spaced points that cover all maxima.
"""

from __future__ import annotations

import argparse
import csv
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from softness_bayes.bench.ratings import name_of, rated
from softness_bayes.bench.subject import BATCH
from softness_bayes.likelihood.error_laws import LAPSES, NORMAL, STUDENT, ErrorLaw
from softness_bayes.likelihood.intervals import IntervalRatings
from softness_bayes.likelihood.quadrature import DENSE
from softness_bayes.model.options import ModelOptions

Array = NDArray[np.float64]

TABLE = Path("notebooks/results/rating_integrals.csv")

KINDS: tuple[tuple[ErrorLaw, float], ...] = (
    (NORMAL, 1.0),
    (STUDENT, 0.0),
    (STUDENT, 1.0),
    (LAPSES, 0.0),
    (LAPSES, 1.0),
)
"""Error law, and step of the grid of numbers."""

REPEATS, TURN = 300, 10
"""Calls of each likelihood, and successive ones, of which the fastest counts."""

NEAR, FAR = 20, 300
"""Vectors near the truth, and draws of the prior, for which errors are computed."""


class Row(NamedTuple):
    """Time and error of one observation model."""

    ratings: str
    us_per_vector: float
    """Processor time of a complete likelihood call for each vector, response included [µs]."""
    over_closed_form: float
    """Median over turns of the ratio of the times."""
    near: float
    """Largest error near the truth."""
    prior: float
    """Largest error over draws of the prior."""


def measured(law: ErrorLaw, step: float, closed: Callable[[], Any], repeats: int = REPEATS, far: int = FAR) -> Row:
    """Return time and error of one observation model.

    Parameters
    ----------
    law, step
        Error law, and step of the grid of numbers.
    closed
        A call of the closed form with as many vectors.
    repeats, far
        Number of calls, and of draws of the prior.
    """
    posterior, _, near = rated(ModelOptions(), law, step)
    own, base = in_turns((lambda: posterior.log_likelihood(near), closed), repeats)
    dense = posterior.with_term(cast(IntervalRatings, posterior.observation).with_quadrature(DENSE))
    at = near[:NEAR], posterior.space.draw_prior(np.random.default_rng(5), far)
    errors = [float(np.abs(posterior.log_likelihood(one) - dense.log_likelihood(one)).max()) for one in at]
    # other work slows turns of both alike, whereas the fastest of all calls belong to different moments
    cost = round(float(np.median(own / base)), 2)
    return Row(name_of(law, step), round(1e6 * own.min() / BATCH, 1), cost, *(float(f"{e:.0e}") for e in errors))


def in_turns(calls: tuple[Callable[[], Any], ...], repeats: int) -> Array:
    """Return the shortest processor time of each call in each turn [s], shape (calls, turns).

    The calls take turns of `TURN` calls, which fill the cache.
    """
    taken = np.empty((len(calls), -(-repeats // TURN), TURN))
    for turn in range(taken.shape[1]):
        for each, call in zip(taken, calls, strict=True):
            for k in range(TURN):
                begun = time.process_time()
                call()
                each[turn, k] = time.process_time() - begun
    return np.asarray(taken.min(axis=-1))


def alternating(calls: tuple[Callable[[], Any], ...], repeats: int) -> list[float]:
    """Return the shortest processor time of each call [s]; they take turns as in `in_turns`."""
    return [float(each.min()) for each in in_turns(calls, repeats)]


def rows() -> Iterator[Row]:
    """Yield the closed form, then every observation model."""
    posterior, _, near = rated(ModelOptions(), NORMAL, 0.0)

    def closed() -> Array:
        return posterior.log_likelihood(near)

    (base,) = alternating((closed,), REPEATS)
    yield Row("exact, normal (closed form)", round(1e6 * base / BATCH, 1), 1.0, 0.0, 0.0)
    for law, step in KINDS:
        yield measured(law, step, closed)


def write_table(description: str, table: Path, columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Write rows to a CSV file as soon as each is known, with one thread.

    Parameters
    ----------
    description
        First line of the help.
    table
        The file unless the command line names another.
    columns, rows
        Names and values of the columns.
    """
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("file", type=Path, nargs="?", default=table, help=f"CSV file to write (default {table})")
    path = parser.parse_args().file
    with threadpool_limits(1), path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        for row in rows:
            writer.writerow(row)
            file.flush()


def main() -> None:
    """Measure and write the table."""
    write_table(__doc__.partition("\n")[0], TABLE, Row._fields, rows())


if __name__ == "__main__":
    main()
