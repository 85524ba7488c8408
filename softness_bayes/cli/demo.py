"""`softness-bayes demo`: a complete small example, from tables to a report."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

import click

from softness_bayes.cli.new import EXAMPLE, NEW, example, require_none
from softness_bayes.cli.options.run import processes
from softness_bayes.cli.options.values import FILE
from softness_bayes.errors import NotConvergedError

TITLE = "EXAMPLE: simulated ratings of fabrics that do not exist"
HELD = {
    "m": 2,
    "alpha": 20.3,
    "beta": 0.6,
    "eps": 0.1,
    "c_Na": 1.05,
    "c_K": 1.16,
    "c_L": 1,
    "c_A": 1.5,
}
"""Parameters fixed at the values used to simulate the example, so that sampling takes seconds."""
STEPS = 3000
"""Largest number of steps; the example needs about 350."""


@click.command()
@click.argument("directory", type=FILE, default=Path("softness-demo"), metavar="[DIR]")
@processes
def command(directory: Path, processes: int | None) -> None:
    """Run a complete small example, from tables to a report, in seconds.

    Writes the files of 'new' into DIR (by default softness-demo), samples the posterior and makes its report, and shows
    the commands for these steps. The ratings are simulated, and most parameters are fixed at their true values. An
    analysis of real data samples all parameters, which takes minutes. Exit code 3 if the run has not converged, as for
    any run.
    """
    from softness_bayes.cli.check import command as check
    from softness_bayes.cli.report import command as report
    from softness_bayes.cli.sample import command as sample
    from softness_bayes.files.outputs import write_outputs

    results, data = directory / "results", directory / "ratings.csv"
    require_none(directory, [*EXAMPLE, results.name])
    click.echo(TITLE)
    write_outputs(directory, example(), NEW)
    _shown("new", directory)
    _run(check, "check", "--data", data)
    held = [part for name, value in HELD.items() for part in ("--fix", f"{name}={value}")]
    words = ["--data", data, "--out", results, "--modulus-cv", "0", *held, "--max-steps", STEPS, "--no-figures"]
    words += [] if processes is None else ["--processes", processes]
    ended: NotConvergedError | None = None
    try:
        _run(sample, "sample", *words)
    except NotConvergedError as error:
        ended = error
    _run(report, "report", results, "--title", TITLE)
    click.echo(
        f"\nthis was an EXAMPLE, with most parameters fixed at their true values; open {results / 'report.html'}"
    )
    click.echo("in a browser. To analyse your own tables, begin with\n  softness-bayes new my-study")
    if ended is not None:
        raise ended


def _shown(*words: Any) -> None:
    click.echo(f"\n$ {shlex.join(['softness-bayes', *map(str, words)])}")


def _run(verb: click.Command, *words: Any) -> None:
    """Print a command, then run it."""
    _shown(*words)
    verb.main([str(word) for word in words[1:]], prog_name=f"softness-bayes {words[0]}", standalone_mode=False)
