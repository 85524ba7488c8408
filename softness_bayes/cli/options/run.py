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
    help="Longest time of the run, such as 90 (seconds), 10m or 2h; it then ends even if it has not "
    "converged. By default no limit.",
)
"""Passes `max_time` to a command [s]."""

processes = click.option(
    "--processes",
    type=whole(PROCESSES),
    metavar="N",
    help="Processes that share the ensembles; by default one for each core. Draws do not depend on it.",
)
"""Passes `processes` to a command."""

dask = click.option(
    "--dask",
    metavar="SCHEDULER",
    help="Run on an existing Dask cluster instead of this machine: the address of its scheduler, such as "
    "tcp://10.0.0.1:8786, or its scheduler file. Workers must have this version, one thread each, and "
    "share --out.",
)
"""Passes `dask` to a command: an address or a file, or None."""

no_figures = click.option("--no-figures", is_flag=True, help="Draw no figures.")
"""Passes `no_figures` to a command."""

own_figures = click.option(
    "--figure",
    "own_figures",
    multiple=True,
    shell_complete=figures,
    metavar="NAME",
    help="Also draw this figure: one that 'figures' lists, or a custom one such as mymodule:mine, a function of a "
    "result and a style. Repeatable. Figures of installed packages are always drawn.",
)
"""Passes `own_figures` to a command: names of figures."""

_TRUST = "softness_bayes.trust_code"


def _keep_trust(ctx: click.Context, param: click.Parameter, value: bool) -> None:
    ctx.meta[_TRUST] = value


trust_code = click.option(
    "--trust-code",
    is_flag=True,
    expose_value=False,
    callback=_keep_trust,
    help="Run code that the files of the run name, such as a custom reading or prior MODULE:NAME, because you trust "
    "whoever made them. It is searched for on Python's path (add folders by PYTHONPATH), not in the working directory.",
)
"""Lets a command read files that name code (`trusts_code`)."""


def trusts_code() -> bool:
    """Return whether the user of the present command trusts the code that its files name."""
    return bool(click.get_current_context().meta.get(_TRUST, False))


seed = click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=SEED,
    show_default=True,
    help="Seed of the random numbers: the same seed gives the same results.",
)
"""Passes `seed` to a command."""

out = click.option(
    "--out",
    type=FILE,
    metavar="DIR",
    default=Path("results"),
    show_default=True,
    help="Directory to write to; it must be empty or not exist.",
)
"""Passes `out` to a command."""

force = click.option("--force", is_flag=True, help="Replace the files in --out that this command wrote, and no others.")
"""Passes `force` to a command."""
