"""Speed of two versions of the package: ``python -m softness_bayes.tools.benchmark_versions FILE.csv OTHER``.

OTHER is a directory with another version of the source, such as ``git archive COMMIT | tar -x -C OTHER`` makes. Both
versions are timed in alternation, each in a process of its own: batches of 64 draws of the prior, 36 conditions, 1080
ratings. Of the calls of a round the fastest counts; a ratio is the median over the rounds. Processor time is taken,
but a busy machine slows that down as well, so that only ratios of one run mean something. The forward model is also
compared with the bare operations (`softness_bayes.bench.limit`), which this version times between its rounds.
"""

from __future__ import annotations

import argparse
import csv
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import IO, cast

import softness_bayes

HERE = Path(softness_bayes.__file__).parent.parent

CASES = ((1e-3, "free"), (1e-3, "held"), (1e-6, "held"))
"""Accuracies, and whether channel multipliers are sampled."""

ROUNDS, CALLS = 8, 150

FORWARD, LIKELIHOOD, BARE = "forward", "likelihood", "bare"

_CHILD = """
import sys, time
from functools import partial
where, accuracy, channels, calls = sys.argv[1], float(sys.argv[2]), sys.argv[3], int(sys.argv[4])
sys.path.insert(0, where)
import softness_bayes
assert softness_bayes.__file__.startswith(where), softness_bayes.__file__
from softness_bayes.bench import precision, subject
of = precision.dialled(accuracy, subject.FULL, channels == "held")
# earlier versions keep model and scene in other places
posterior = of.model.posterior if hasattr(of, "model") else of.posterior
scene = posterior.scene if hasattr(posterior, "scene") else precision.scene_in(posterior)
some = precision.first(of.draws.parameters, subject.BATCH)
timed = {"forward": partial(scene.total_rate, some), "likelihood": partial(posterior.log_likelihood, of.theta)}
print("ready", flush=True)
for line in sys.stdin:
    if line.strip() == "bare":
        from softness_bayes.bench.limit import limit
        print(limit(of, subject.FULL).bare_seconds, flush=True)
        continue
    taken = []
    for _ in range(calls):
        begun = time.process_time_ns()
        timed[line.strip()]()
        taken.append(time.process_time_ns() - begun)
    print(1e-9 * min(taken) / subject.BATCH, flush=True)
"""

COLUMNS = (
    "channels",
    "accuracy",
    "other_likelihood_us",
    "likelihood_us",
    "likelihood_ratio",
    "forward_ratio",
    "forward_over_bare",
    "likelihood_over_forward",
)


class Version:
    """One version of the package in a process of its own."""

    def __init__(self, where: Path, accuracy: float, channels: str, calls: int) -> None:
        arguments = [str(where), str(accuracy), channels, str(calls)]
        self._process = subprocess.Popen(
            [sys.executable, "-c", _CHILD, *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=where,
            env=os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
        )
        self._in, self._out = cast(IO[str], self._process.stdin), cast(IO[str], self._process.stdout)
        self._out.readline()

    def seconds(self, what: str) -> float:
        """Return the time for each vector of the fastest of some calls [s]."""
        self._in.write(f"{what}\n")
        self._in.flush()
        return float(self._out.readline())

    def end(self) -> None:
        """End the process."""
        self._in.close()
        self._process.wait()
        self._out.close()


def measure(other: Path, accuracy: float, channels: str, rounds: int = ROUNDS, calls: int = CALLS) -> tuple[str, ...]:
    """Return a row of the table."""
    old, new = (Version(where.resolve(), accuracy, channels, calls) for where in (other, HERE))
    found = []
    for _ in range(rounds):
        times = [version.seconds(what) for what in (FORWARD, LIKELIHOOD) for version in (old, new)]
        found.append((*times, new.seconds(BARE)))
    old.end()
    new.end()
    forward, whole = (median(one[k + 1] / one[k] for one in found) for k in (0, 2))
    over_bare, over_forward = (median(one[k] / one[n] for one in found) for k, n in ((1, 4), (3, 1)))
    fastest = (f"{1e6 * min(one[k] for one in found):.1f}" for k in (2, 3))
    ratios = (f"{ratio:.2f}" for ratio in (whole, forward, over_bare, over_forward))
    return channels, f"{accuracy:g}", *fastest, *ratios


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a row for each case, and write all rows."""
    parser = argparse.ArgumentParser(description="Time the likelihood of two versions of the package in alternation.")
    parser.add_argument("file", type=Path, metavar="FILE.csv", help="file to write")
    parser.add_argument("other", type=Path, metavar="OTHER", help="directory with another version of the source")
    given, rows = parser.parse_args(arguments), []
    print(" | ".join(COLUMNS))
    for accuracy, channels in CASES:
        rows.append(measure(given.other, accuracy, channels))
        print(" | ".join(rows[-1]), flush=True)
    with given.file.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([COLUMNS, *rows])


if __name__ == "__main__":
    main()
