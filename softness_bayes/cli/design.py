"""`softness-bayes design`: the touches whose ratings would tell most."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from softness_bayes.cli.options import FILE, collected, load_options, number, out, path, seed, trust_code, typed
from softness_bayes.cli.running import reading
from softness_bayes.errors import InputError
from softness_bayes.model.options import ModelOptions
from softness_bayes.ranges import PANEL, Count, Range
from softness_bayes.results.run_options import DataFiles

if TYPE_CHECKING:
    from softness_bayes.experiments.choice import Plan
    from softness_bayes.touch.contact import Load

DESIGN = "design"

KPA = 1e3


@click.command()
@click.option(
    "--given",
    type=FILE,
    multiple=True,
    metavar="DIR",
    help="A finished run. Give two runs of the same ratings to tell them apart (--about run).",
)
@collected("files", DataFiles, without=("compression", "afferents", "force_n", "indentation_mm"))
@collected("model", ModelOptions, without=("noise",))
@click.option(
    "--about",
    metavar="NAME,...",
    default="",
    help="What is to be learnt: parameters, turning@2mm or turning@1N, run (which of two); by default everything.",
)
@path("--candidates", "FILE", "Table of fabrics that could be rated; by default the rated ones.")
@click.option(
    "--moduli",
    metavar="LOW:HIGH:N",
    help="Effective moduli [kPa] of fabrics to obtain; by default 12 over the range of the rated ones.",
)
@load_options(" of a candidate. Repeatable; by default as rated.")
@click.option("--largest-load", metavar="LOAD", help="Leave out loads of its kind above this one, such as 2mm or 1N.")
@number("--conditions", Count(1, 50), "Largest number of touches.", 8)
@click.option(
    "--raters",
    metavar="same|new:N",
    default="same",
    show_default=True,
    help="Raters, each of whom rates every touch once: those of the run, or N new ones.",
)
@number("--budget", Range(0.0, above=True), "Budget, in the unit of the costs.", metavar="X")
@number("--cost-fabric", Range(0.0), "Cost of a fabric that has to be obtained.", 0.0, "X")
@number("--cost-load", Range(0.0), "Cost of each load.", 0.0, "X")
@number("--cost-rating", Range(0.0), "Cost of one rating.", 1.0, "X")
@seed
@out(DESIGN)
@click.option("--force", is_flag=True, help="Replace the files that 'design' wrote there.")
@trust_code
def command(
    given: tuple[Path, ...],
    files: DataFiles,
    model: ModelOptions,
    about: str,
    candidates: Path | None,
    moduli: str | None,
    indentation_mm: tuple[float, ...],
    force_n: tuple[float, ...],
    largest_load: str | None,
    conditions: int,
    raters: str,
    budget: float | None,
    cost_fabric: float,
    cost_load: float,
    cost_rating: float,
    seed: int,
    out: Path,
    force: bool,
) -> None:
    """Choose the touches whose ratings would tell most, from a finished run.

    Candidates are the fabrics that were rated, and moduli of fabrics to obtain, under the loads of the run. Touches
    whose contact exceeds half the fingertip's radius are left out, and none is chosen more than twice. Moduli have the
    errors of the run (15 % where it took them as exact; --modulus-cv): a design that ignores them misleads.
    With --data instead of --given the plan is made from the prior, before any rating.
    """
    from softness_bayes.data import Fabrics, loads_of
    from softness_bayes.experiments.choice import FILES, Costs
    from softness_bayes.experiments.design import design
    from softness_bayes.files.outputs import require_outputs

    if bool(given) == (files.data is not None):
        raise InputError("design: give either --given, a finished run, or --data, before any rating")
    if len(given) > 2:
        raise InputError(f"design: expected one run, or two to tell apart, got {len(given)}")
    inputs = [path for path in (candidates, files.data, files.fabrics) if path is not None]
    require_outputs(out, FILES, DESIGN, force, inputs)
    chosen = None if candidates is None else Fabrics.read(candidates)
    loads = loads_of(indentation_mm, force_n)
    with reading(*given) as results:
        source: Any = files.read() if not results else results[0] if len(results) == 1 else results
        plan = design(
            source,
            tuple(name.strip() for name in about.split(",") if name.strip()),
            candidates=chosen,
            moduli=None if moduli is None else _grid(moduli),
            loads=loads or None,
            largest_load=None if largest_load is None else _largest(largest_load),
            conditions=conditions,
            raters=_raters(raters),
            costs=Costs(budget, cost_fabric, cost_load, cost_rating),
            modulus_cv=model.modulus_cv if typed("modulus_cv") else None,
            options=model,
            seed=seed,
        )
    plan.save(out)
    _show(plan)
    click.echo(f"written to {out}: {', '.join(FILES)}", err=True)


def _grid(text: str) -> list[float]:
    """Return moduli [Pa] evenly spaced in the logarithm from LOW:HIGH:N [kPa]."""
    import numpy as np

    try:
        low, high, number = text.split(":")
        ends, n = (float(low), float(high)), int(number)
    except ValueError:
        raise InputError(f"--moduli: expected LOW:HIGH:N, such as 20:2000:8 [kPa], got {text!r}") from None
    if not (0 < ends[0] <= ends[1] < float("inf") and 1 <= n <= 200):
        raise InputError(f"--moduli: expected 0 < LOW <= HIGH [kPa] and N from 1 to 200, got {text!r}")
    return list(np.geomspace(*ends, n) * KPA)


def _largest(text: str) -> Load:
    """Return a load from a text such as 2mm or 1N."""
    from softness_bayes.experiments.design import load_named

    load = load_named(text)
    if load is None:
        raise InputError(f"--largest-load: expected a load such as 2mm or 1N, got {text!r}")
    return load


def _raters(text: str) -> int | None:
    """Return the number of new raters from same or new:N; None for the same raters."""
    if text == "same":
        return None
    kind, _, number = text.partition(":")
    if kind != "new" or not number.isdigit() or not PANEL.low <= int(number) <= PANEL.high:
        raise InputError(f"--raters: expected same or new:N, such as new:12, got {text!r}")
    return int(number)


def _show(plan: Plan) -> None:
    """Print the chosen touches, and what they are expected to tell."""
    columns = ["order", "fabric", "to_obtain", "e_fab_kpa", "indentation_mm", "force_n", "raters", "step_nats"]
    shown = plan.table[columns].dropna(axis=1, how="all")
    click.echo(f"rate next, to learn {', '.join(plan.about)} (the most informative first):")
    click.echo(shown.to_string(index=False, float_format="{:.4g}".format))
    b = plan.bracket
    click.echo(f"information: {b.low:.2f} to {b.high:.2f} nats (± {b.se:.2f})")
    ratios = sorted(plan.sd_ratio.items(), key=lambda each: each[1])
    click.echo("expected posterior sd / present sd: " + ", ".join(f"{name} {ratio:.2f}" for name, ratio in ratios[:8]))
    for note in plan.notes:
        click.echo(f"note: {note}")
