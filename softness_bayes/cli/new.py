"""`softness-bayes new`: tables and scripts to start from, explained in place."""

from __future__ import annotations

import os
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path

import click

from softness_bayes.cli.options.values import FILE
from softness_bayes.errors import InputError

NEW = "new"
EXAMPLE = ("ratings.csv", "fabrics.csv", "analysis.sh", "analysis.py", "README.md")
"""Files in `softness_bayes/example`; Python scripts are stored there as text."""


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
def command(directory: Path) -> None:
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
