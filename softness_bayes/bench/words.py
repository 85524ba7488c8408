"""Summary of the measurements in a few lines of Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from softness_bayes.bench.limit import TOGETHER, Limit
from softness_bayes.bench.peers import PEER, Ratio
from softness_bayes.bench.precision import LIKELIHOOD, Point
from softness_bayes.bench.scaling import SamplerSpeed, Size
from softness_bayes.bench.subject import BATCH


def summary(
    points: Sequence[Point],
    ratios: Mapping[str, Ratio],
    sizes: Sequence[Size],
    bare: Limit,
    speed: SamplerSpeed | None,
    machine: str,
) -> str:
    """Return tables of likelihood and peers, then the other measurements.

    Parameters
    ----------
    points
        All measurements that have a time and an error.
    ratios
        Time ratios of the peers, by setting.
    sizes
        Timings of larger scenes and batches.
    bare, speed
        Time of the necessary operations alone, and the sampler's speed if it ran.
    machine
        Description of the machine.
    """
    rows = [
        "| likelihood | µs per vector | error / peak response | error of log(N/N_ref + eps) |",
        "|---|---|---|---|",
        *(
            f"| {p.setting} | {_short(1e6 * p.seconds)} | {p.max_peak:.0e} | {p.max_log:.0e} |"
            for p in points
            if p.stage == LIKELIHOOD
        ),
        "",
        "| every receptor simulated | s per vector | error / peak response | time over the likelihood's |",
        "|---|---|---|---|",
        *(
            f"| {p.setting} | {_short(p.seconds)} | {p.max_peak:.0e} | "
            f"{f'{ratios[p.setting].ratio:.1e}' if p.setting in ratios else ''} |"
            for p in points
            if p.stage == PEER
        ),
    ]
    largest = max((s for s in sizes if s.what == "conditions"), key=lambda s: s.size)
    said = [
        f"Measured on: {machine}.",
        f"The forward model takes {1e6 * bare.seconds:.0f} µs for each vector. The {bare.exponentials} exponentials, "
        f"{bare.roots} roots, {bare.divisions} divisions and {bare.multiply_adds} multiply-adds that it cannot do "
        f"without take {1e6 * bare.bare_seconds:.1f} µs alone, in place and within the cache "
        f"({bare.megabytes:.1f} MB of passes), a factor of {bare.over_bare:.1f}. They are done for {TOGETHER} "
        f"vectors in a call; for {BATCH} vectors in a call they take {1e6 * bare.together_seconds:.1f} µs.",
        f"{largest.size} conditions take {1e3 * largest.seconds:.1f} ms for each vector, "
        f"{1e9 * largest.per_condition:.0f} ns each.",
    ]
    if speed is not None:
        said.append(
            f"One process draws {_short(speed.ess_per_second)} effective draws of all parameters in a second "
            f"(autocorrelation time {speed.tau:.0f} steps)."
        )
    return "\n".join([*rows, "", *said]) + "\n"


def _short(number: float) -> str:
    return f"{number:.3g}" if number < 1e3 else f"{number:.0f}"
