"""Options of a run: seed, limit of time, processes, figures and output."""

from __future__ import annotations

import re
from pathlib import Path

import click

from softness_bayes.cli.options.completion import figures
from softness_bayes.cli.options.values import FILE, whole
from softness_bayes.defaults import SEED
from softness_bayes.ranges import PROCESSES

_SECONDS = {"": 1, "s": 1, "m": 60, "h": 3600}


def _duration(ctx: click.Context, param: click.Parameter, text: str | None) -> float:
    if text is None:
        return float("inf")
    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([smh]?)", text.strip())
    if match is None:
        raise click.BadParameter(f"expected a time such as 90, 90s, 10m or 2h, got {text!r}")
    return float(match[1]) * _SECONDS[match[2]]


max_time = click.option(
    "--max-time",
    callback=_duration,
    metavar="TIME",
    help="Time after which the run ends, converged or not: 90 (seconds), 10m or 2h. By default there is none.",
)
"""Gives a verb `max_time` [s]."""

processes = click.option(
    "--processes",
    type=whole(PROCESSES),
    metavar="N",
    help="Processes that share the ensembles; by default one for each core. Draws do not depend on it.",
)
"""Gives a verb `processes`."""

dask = click.option(
    "--dask",
    metavar="SCHEDULER",
    help="Run on an existing Dask cluster instead of processes of this machine: the address of its scheduler, as in "
    "tcp://10.0.0.1:8786, or its scheduler file. Its workers have this version, one thread each, and share --out.",
)
"""Gives a verb `dask`, an address or a file, or None."""

no_figures = click.option("--no-figures", is_flag=True, help="Leave out the figures.")
"""Gives a verb `no_figures`."""

own_figures = click.option(
    "--figure",
    "own_figures",
    multiple=True,
    shell_complete=figures,
    metavar="MODULE:NAME",
    help="Draw this figure of your own too, a function of a result and a style. Repeatable; those of installed "
    "packages are drawn anyway.",
)
"""Gives a verb `own_figures`, importable names."""

seed = click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=SEED,
    show_default=True,
    help="Seed of the random numbers: equal seeds, equal results.",
)
"""Gives a verb `seed`."""

out = click.option(
    "--out",
    type=FILE,
    metavar="DIR",
    default=Path("results"),
    show_default=True,
    help="Directory to write to; one that is not empty is refused.",
)
"""Gives a verb `out`."""

force = click.option("--force", is_flag=True, help="Replace the files in --out that this command wrote, and no others.")
"""Gives a verb `force`."""
