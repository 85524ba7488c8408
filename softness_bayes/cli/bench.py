"""`softness-bayes bench`: time and error of the forward model on this machine, beside other ways to compute it."""

from __future__ import annotations

import itertools
import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from softness_bayes.cli.options.run import force

if TYPE_CHECKING:
    from softness_bayes.bench.limit import Limit
    from softness_bayes.bench.peers import Ratio, Work
    from softness_bayes.bench.precision import Point
    from softness_bayes.bench.ratings import Integrated
    from softness_bayes.bench.scaling import SamplerSpeed, Size
    from softness_bayes.bench.subject import Effort, Subject

PRECISION, SCALING, FACTS, WORDS = "work_precision.csv", "scaling.csv", "bench.json", "summary.md"
WHOLE_RUNS = "whole_runs.csv"
FIGURE, FORMATS = "work_precision", ("png", "pdf")
BENCH, MADE = "bench", (PRECISION, SCALING, FACTS, WORDS, *(f"{FIGURE}.{name}" for name in FORMATS))


@click.command()
@click.option("--quick", is_flag=True, help="A trial run: few draws, small scenes and no sampler.")
@click.option("--scale", is_flag=True, help="Measure instead whole runs on growing tables: time and memory.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="DIR",
    default=Path("bench"),
    show_default=True,
    help="Directory to write to.",
)
@force
def command(quick: bool, scale: bool, out: Path, force: bool) -> None:
    """Measure time and error of the forward model on this machine, and of other ways to compute it.

    Measures each stage and the whole likelihood at all resolutions, on one core, for 12 fabrics under 3 indentations
    and draws of the prior. Then measures larger scenes and batches, the sampler, the limit of the machine, and
    programs that simulate every receptor. Each of these is given with its error, and with the ratio of its time to
    that of the likelihood at the same error or less. Writes work_precision.csv, scaling.csv, bench.json (machine,
    sampler, limit, ratios), summary.md (the main numbers) and work_precision.png and .pdf.

    With --scale, runs the whole job with few steps on simulated tables of up to 102 000 ratings of 1000 raters, 10 002
    conditions and 3000 loads, and predicts 40 000 touches, each in a process of its own. Writes whole_runs.csv.
    """
    from threadpoolctl import threadpool_limits

    from softness_bayes.files.outputs import require_outputs

    if scale:
        require_outputs(out, (WHOLE_RUNS,), BENCH, force)
        _whole_runs(quick, out)
        return
    require_outputs(out, MADE, BENCH, force)
    click.echo(f"this takes minutes; it then writes {', '.join(MADE)} to {out.resolve()}", err=True)
    with threadpool_limits(1):
        _measure(quick, out)
    click.echo(f"written to {out}")


def _whole_runs(quick: bool, out: Path) -> None:
    """Measure, print and write whole runs on growing tables; a trial run measures the smallest of each kind."""
    import pandas as pd

    from softness_bayes.bench.scale import TABLES, grown
    from softness_bayes.files.outputs import write_outputs
    from softness_bayes.files.spreadsheet import csv_of

    found, smallest = [], {table.what: table for table in reversed(TABLES)}
    click.echo(f"{'':12} {'size':>8} {'ratings':>8} {'seconds':>9} {'MB':>7}   grows as size to the power")
    for one in grown([*reversed(smallest.values())] if quick else TABLES):
        power = "" if one.exponent != one.exponent else f"{one.exponent:.2f}"
        click.echo(f"{one.what:12} {one.size:8} {one.ratings:8} {one.seconds:9.1f} {one.megabytes:7.0f}   {power}")
        found.append(one)
    write_outputs(out, {WHOLE_RUNS: csv_of(pd.DataFrame(found), index=False)}, BENCH)
    click.echo(f"written to {out}")


def _measure(quick: bool, out: Path) -> None:
    """Measure, print and write everything."""
    import pandas as pd

    from softness_bayes.bench.limit import limit
    from softness_bayes.bench.peers import work_of
    from softness_bayes.bench.precision import DIAL, LIKELIHOOD, dialled
    from softness_bayes.bench.scaling import sampler
    from softness_bayes.bench.subject import FULL, QUICK, machine, machine_name
    from softness_bayes.bench.words import summary
    from softness_bayes.files.outputs import write_outputs
    from softness_bayes.files.spreadsheet import csv_of

    effort, about = QUICK if quick else FULL, machine()
    name = machine_name(about)
    click.echo(f"{name}; load {about['load']}; one core is used\n")
    points = _stages(effort)
    chosen = next(p for p in points if p.stage == LIKELIHOOD and p.dial == DIAL and "free" in p.setting)
    held, free = (dialled(DIAL, effort, is_held) for is_held in (True, False))
    work = work_of(held)
    peers, ratios = _peers(work, effort, points)
    points += peers
    sizes = _sizes(held, effort)
    bare, speed = limit(held, effort), sampler(free, effort)
    ratings = _ratings(free, effort)
    click.echo(f"\n{_limit_sentence(bare)}")
    if speed is not None:
        click.echo(_sampler_sentence(speed))
    facts: dict[str, Any] = {
        "machine": about,
        "quick": quick,
        "receptors": work.receptors,
        "ratios": {name: ratio._asdict() for name, ratio in ratios.items()},
        "ratings": [one._asdict() for one in ratings],
        "limit": bare._asdict() | {"over_bare": bare.over_bare},
        "sampler": None if speed is None else speed._asdict(),
    }
    tables = {PRECISION: pd.DataFrame(points), SCALING: pd.DataFrame(sizes)}
    contents: dict[str, bytes | str] = {
        **{name: csv_of(table, index=False) for name, table in tables.items()},
        FACTS: json.dumps(facts, indent=1) + "\n",
        WORDS: summary(points, ratios, sizes, bare, speed, name),
        **_drawn(points, chosen, name),
    }
    write_outputs(out, contents, BENCH)


def _stages(effort: Effort) -> list[Point]:
    """Measure and print the stages and the likelihood at all resolutions."""
    from softness_bayes.bench.precision import work_precision

    click.echo(f"{'':62} µs/vector   error/peak: largest, median   of log: largest, median")
    points = []
    for point in work_precision(effort):
        points.append(point)
        click.echo(_line(point))
    return points


def _peers(work: Work, effort: Effort, points: list[Point]) -> tuple[list[Point], dict[str, Ratio]]:
    """Measure and print other ways to compute the response, and the ratio of their times to those in `points`."""
    from softness_bayes.bench import brian, jax_cells
    from softness_bayes.bench.peers import PEERS, faster, measure_peer

    peers: list[Point] = []
    ratios: dict[str, Ratio] = {}
    others = {brian.ABSENT: brian.brian_peers(), jax_cells.ABSENT: jax_cells.jax_peers()}
    for peer in (*PEERS, *itertools.chain(*others.values())):
        point = measure_peer(peer, work, effort)
        click.echo(_line(point))
        if found := faster(point, points):
            ratios[point.setting] = found
            click.echo(f"{'':6}takes {found.ratio:.3g} times as long as the likelihood at the same error or less")
        peers.append(point)
    for absent, found_peers in others.items():
        if not found_peers:
            click.echo(f"left out: {absent}")
    return peers, ratios


def _sizes(subject: Subject, effort: Effort) -> list[Size]:
    """Measure and print larger scenes and batches."""
    from softness_bayes.bench.scaling import scaling

    sizes = scaling(subject, effort)
    click.echo("\nconditions or batch   µs/vector   ns/vector and condition")
    for size in sizes:
        click.echo(f"{size.what:10} {size.size:8} {1e6 * size.seconds:12.1f} {1e9 * size.per_condition:14.0f}")
    return sizes


def _ratings(subject: Subject, effort: Effort) -> list[Integrated]:
    """Measure and print the observation models of ratings."""
    from softness_bayes.bench.ratings import rating_models

    found = rating_models(subject, effort)
    click.echo("\nlikelihood of 1080 ratings       µs/vector   over closed form   largest error: near truth, prior")
    for one in found:
        numbers = f"{1e6 * one.seconds:9.1f} {one.ratio:18.2f} {one.largest_error:24.1e} {one.prior_error:9.1e}"
        click.echo(f"{one.model:31} {numbers}")
    return found


def _limit_sentence(bare: Limit) -> str:
    """Return the machine's limit in words."""
    from softness_bayes.bench.limit import TOGETHER
    from softness_bayes.bench.subject import BATCH

    return (
        f"machine's limit: {bare.exponentials} exponentials, {bare.roots} roots, {bare.divisions} divisions, "
        f"{bare.multiply_adds} multiply-adds, {bare.megabytes:.1f} MB of passes for each vector: "
        f"{1e6 * bare.bare_seconds:.1f} µs bare in NumPy, {TOGETHER} vectors in a call "
        f"({1e6 * bare.together_seconds:.1f} µs with {BATCH}); the scene takes {1e6 * bare.seconds:.1f} µs, "
        f"{bare.over_bare:.2f} times that (a matrix product does the multiply-adds in {1e6 * bare.flop_seconds:.2f} µs)"
    )


def _sampler_sentence(speed: SamplerSpeed) -> str:
    """Return the sampler's speed in words, with a warning if its walk was too short to measure it."""
    from softness_bayes.sampler.diagnostics import Goal

    return (
        f"sampler, all parameters free, one process: {speed.ess_per_second:.3g} effective draws/s "
        f"(autocorrelation time {speed.tau:.0f} steps, kept {speed.lengths:.0f} times"
        + (", too few to trust)" if speed.lengths < Goal().lengths else ")")
    )


def _line(point: Point) -> str:
    errors = (point.max_peak, point.median_peak, point.max_log, point.median_log)
    shown = "  ".join(f"{error:9.1e}" for error in errors)
    mark = f"  dial {point.dial:g}" if point.dial == point.dial else ""
    return f"{f'{point.stage}: {point.setting}':62} {1e6 * point.seconds:9.1f}   {shown}{mark}"


def _drawn(points: Sequence[Point], chosen: Point, machine: str) -> dict[str, bytes]:
    from softness_bayes.bench.peers import PEER
    from softness_bayes.bench.precision import LIKELIHOOD
    from softness_bayes.plotting.benchmark import work_precision_figure
    from softness_bayes.plotting.style import files_of

    series: dict[str, list[tuple[float, float]]] = {}
    for point in points:
        if point.stage != PEER:
            part = f", {point.setting.split(',')[0]}" if point.stage == LIKELIHOOD else ""
            series.setdefault(point.stage + part, []).append((point.seconds, point.max_peak))
    columns = {name: tuple(zip(*rows, strict=True)) for name, rows in series.items()}
    peers = {p.setting: (p.seconds, p.max_peak) for p in points if p.stage == PEER}
    figure = work_precision_figure(
        {name: (time, error) for name, (time, error) in columns.items()},
        peers,
        [(chosen.seconds, chosen.max_peak)],
        machine,
    )
    return files_of(figure, FIGURE, FORMATS)
