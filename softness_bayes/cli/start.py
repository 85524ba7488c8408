"""`softness-bayes new` and `softness-bayes demo`: tables to start from, and a complete small example."""

from __future__ import annotations

import os
import shlex
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import click

from softness_bayes.cli.options import FILE, flag
from softness_bayes.errors import InputError, NotConvergedError
from softness_bayes.results.run_options import RunOptions

NEW = "new"
EXAMPLE = ("ratings.csv", "fabrics.csv", "analysis.sh", "analysis.py", "README.md")
"""Files in `softness_bayes/example`; Python scripts are stored there as text."""
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


def example() -> dict[str, str]:
    """Return the files by their names."""
    home = files("softness_bayes") / "example"
    kept = {name: name + ".txt" if name.endswith(".py") else name for name in EXAMPLE}
    return {name: (home / file).read_text(encoding="utf-8") for name, file in kept.items()}


def require_none(directory: Path, names: Sequence[str] = EXAMPLE) -> None:
    """Raise an error if a directory has files of these names, which are never replaced.

    Raises
    ------
    InputError
        Naming them.
    """
    if present := [name for name in names if os.path.lexists(directory / name)]:
        raise InputError(f"{directory}: {', '.join(present)} exists and would be overwritten; choose another directory")


@click.command()
@click.argument("directory", type=FILE, metavar="DIR")
def new(directory: Path) -> None:
    """Write tables and scripts to start from into DIR.

    ratings.csv and fabrics.csv contain a small example, with a column 'note' that explains the others: replace its rows
    by your data. analysis.sh (command line) and analysis.py (Python) lead from these tables to a report and to
    predictions. Existing files are never overwritten: if DIR has a file of one of these names, the command stops.
    """
    from softness_bayes.files.outputs import write_outputs

    require_none(directory)
    write_outputs(directory, example(), NEW)
    click.echo(f"{directory}: {', '.join(EXAMPLE)}")
    click.echo("the tables contain an EXAMPLE (simulated): replace its rows by your data, then run")
    click.echo(f"  softness-bayes check --data {directory / 'ratings.csv'}    how the tables are read")
    click.echo(f"  sh {directory / 'analysis.sh'}    the whole analysis (or: python {directory / 'analysis.py'})")


@click.command()
@click.argument("directory", type=FILE, default=Path("softness-demo"), metavar="[DIR]")
@flag(RunOptions, "processes")
def demo(directory: Path, processes: int | None) -> None:
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
