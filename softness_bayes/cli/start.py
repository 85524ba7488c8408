"""`softness-bayes new`, `demo` and `list`: tables to start from, a small example, and what options name."""

from __future__ import annotations

import os
import shlex
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any

import click

from softness_bayes.base.errors import InputError, NotConvergedError
from softness_bayes.cli.options import Given, Words, command
from softness_bayes.results.run_options import RunOptions

EXAMPLE = ("ratings.csv", "fabrics.csv", "analysis.sh", "analysis.py", "README.md")
"""Files in `softness_bayes/example`; Python scripts are stored there as text."""
TITLE = "EXAMPLE: simulated ratings of fabrics that do not exist"
HELD = {"m": 2, "alpha": 20.3, "beta": 0.6, "eps": 0.1, "c_Na": 1.05, "c_K": 1.16, "c_L": 1, "c_A": 1.5}
"""Parameters fixed at the values used to simulate the example, so that sampling takes seconds."""
STEPS = 3000
"""Largest number of steps; the example needs about 350."""


def example() -> dict[str, str]:
    """Return the files by their names."""
    home = files("softness_bayes") / "example"
    kept = {name: name + ".txt" if name.endswith(".py") else name for name in EXAMPLE}
    return {name: (home / file).read_text(encoding="utf-8") for name, file in kept.items()}


def _require_none(directory: Path, *names: str) -> None:
    """Raise InputError, naming them, if a directory has files of these names, which are never replaced."""
    if present := [name for name in names if os.path.lexists(directory / name)]:
        raise InputError(f"{directory}: {', '.join(present)} exists and would be overwritten; choose another directory")


@command
def new(directory: Path) -> None:
    """Write tables and scripts to start from into DIR.

    ratings.csv and fabrics.csv contain a small example, with a column 'note' that explains the others: replace its rows
    by your data. analysis.sh (command line) and analysis.py (Python) lead from these tables to a report and to
    predictions. Existing files are never overwritten: if DIR has a file of one of these names, the command stops.

    Parameters
    ----------
    directory : DIR
    """
    from softness_bayes.base.files.outputs import write_outputs

    _require_none(directory, *EXAMPLE)
    write_outputs(directory, example(), "new")
    click.echo(f"{directory}: {', '.join(EXAMPLE)}")
    click.echo("the tables contain an EXAMPLE (simulated): replace its rows by your data, then run")
    click.echo(f"  softness-bayes check --data {directory / 'ratings.csv'}    how the tables are read")
    click.echo(f"  sh {directory / 'analysis.sh'}    the whole analysis (or: python {directory / 'analysis.py'})")


@command
def demo(directory: Path = Path("softness-demo"), *, run: Annotated[RunOptions, Given("processes")]) -> None:
    """Run a complete small example, from tables to a report, in seconds.

    Writes the files of 'new' into DIR (by default softness-demo), samples the posterior and makes its report, and shows
    the commands for these steps. The ratings are simulated, and most parameters are fixed at their true values. An
    analysis of real data samples all parameters, which takes minutes. Exit code 3 if the run has not converged, as for
    any run.

    Parameters
    ----------
    directory : [DIR]
    """
    from softness_bayes.base.files.outputs import write_outputs
    from softness_bayes.cli.check import check
    from softness_bayes.cli.report import report
    from softness_bayes.cli.sample import sample

    results, data = directory / "results", directory / "ratings.csv"
    _require_none(directory, *EXAMPLE, results.name)
    click.echo(TITLE)
    write_outputs(directory, example(), "new")
    _shown("new", directory)
    _run(check, "--data", data)
    held = [part for name, value in HELD.items() for part in ("--fix", f"{name}={value}")]
    words = ["--data", data, "--out", results, "--modulus-cv", "0", *held, "--max-steps", STEPS, "--no-figures"]
    ended: NotConvergedError | None = None
    try:
        _run(sample, *words, *run.words("processes"))
    except NotConvergedError as error:
        ended = error
    _run(report, results, "--title", TITLE)
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
    _shown(verb.name, *words)
    verb.main([str(word) for word in words], prog_name=f"softness-bayes {verb.name}", standalone_mode=False)


def _places(incomplete: str) -> Iterable[str]:
    from softness_bayes.touch.readings import ALTERNATIVES

    return ALTERNATIVES


@command
def list_(
    what: Annotated[str, Words("readings", "priors", "figures")],
    place: Annotated[str | None, Words(complete=_places)] = None,
) -> None:
    """List and explain readings, priors or figures.

    WHAT is one of these three.

    Readings: the alternatives of the model's equations, at PLACE alone if it is given. In every command that has these
    options, --reading PLACE=NAME chooses one reading and --readings SET a whole set. A custom reading is given by its
    importable name, such as --reading pressure=mypackage.pressures:mine.

    Priors: the parameters and their priors, the prior distributions and the sets of priors. --prior
    NAME='DISTRIBUTION(NUMBERS)' sets the prior of one parameter, --priors SET chooses a set. A custom distribution is
    given by its importable name, such as --prior b='mypackage.laws:Gamma(2,0.02)'.

    Figures: those of a finished run. 'plot DIR --figures NAME' draws one. A custom figure is given by its importable
    name, such as --figures mypackage.figures:mine.

    Parameters
    ----------
    what : WHAT
    place : [PLACE]
    """
    if what != "readings" and place is not None:
        raise InputError(f"list {what}: unexpected {place!r}; only readings have places")
    tables = _readings(place) if what == "readings" else _priors() if what == "priors" else _figures()
    for title, rows in tables:
        if title:
            click.echo(title)
        column = max((len(name) for name, _ in rows), default=0) + 4
        for name, meaning in rows:
            begin, rest = f"  {name}".ljust(column), " " * column
            click.echo(textwrap.fill(meaning or "–", 110, initial_indent=begin, subsequent_indent=rest))


Table = tuple[str, Sequence[tuple[str, str]]]
"""A title, and names with their explanations."""


def _readings(place: str | None) -> Iterator[Table]:
    from softness_bayes.touch.readings import ALTERNATIVES, MENDED, NAMED_READINGS

    if place is not None and place not in ALTERNATIVES:
        raise InputError(f"readings: no place '{place}'; expected one of {', '.join(ALTERNATIVES)}")
    for at in ALTERNATIVES if place is None else [place]:
        first, *others = ALTERNATIVES[at].items()
        rows = [(first[0], f"{first[1].meaning} (the default)"), *((name, one.meaning) for name, one in others)]
        yield f"{at}:", [*rows, *_installed(at)]
    if place is None:
        sets = {
            name: ", ".join(f"{at}={one}" for at, one in readings.names.items() if one != MENDED.names[at])
            for name, readings in NAMED_READINGS.items()
        }
        yield "sets (--readings):", [(name, said or "defaults") for name, said in sets.items()]
    yield "docs: the page 'The model', sections 1 to 8; for custom readings see the page 'Extending'", []


def _priors() -> Iterator[Table]:
    from softness_bayes.parameters.declared import EVERY_PARAMETER, HELD, PRIOR_SETS, SHAPE_PARAMETERS
    from softness_bayes.parameters.priors import LAWS, PRIORS, form_of
    from softness_bayes.touch.contact import STRAIN

    rows = []
    for name, one in EVERY_PARAMETER.items():
        held = f"; {HELD[name]:g} unless given a prior" if name in HELD else ""
        held = "; fixed at the finger's value unless given a prior" if name in SHAPE_PARAMETERS else held
        unit = f" [{one.unit}]" if one.unit != "–" else ""
        rows.append((name, f"{one.meaning}{unit}: {one.prior}, values {one.range}{held}"))
    yield "parameters and their priors, in the units given:", rows
    rows = [(form_of(law), (law.__doc__ or "").strip().partition("\n")[0]) for law in LAWS.values()]
    yield "laws (--prior):", [*rows, *_installed(PRIORS)]
    changed = {name: ", ".join(f"{p}={law}" for p, law in laws[STRAIN].items()) for name, laws in PRIOR_SETS.items()}
    rows = [(name, laws or "the priors above") for name, laws in changed.items()]
    yield "sets (--priors), with the priors that they change under the default reading of the skin:", rows
    yield "docs: the page 'The model', section 10; for custom distributions see the page 'Extending'", []


def _figures() -> Iterator[Table]:
    from softness_bayes.plotting.figures import FIGURES, OWN_FIGURES

    yield "", [*((name, drawing.shows) for name, drawing in FIGURES.items()), *_installed(OWN_FIGURES)]
    yield "docs: for custom figures see the page 'Extending'", []


def _installed(group: str) -> list[tuple[str, str]]:
    from softness_bayes.base.supplied import installed

    return [(name, f"{point.value}, of an installed package") for name, point in installed(group).items()]
