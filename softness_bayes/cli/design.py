"""`softness-bayes design`: the touches whose ratings would tell most."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import click

from softness_bayes.base.defaults import SEED
from softness_bayes.base.errors import InputError
from softness_bayes.base.options import Kind, Names, Number
from softness_bayes.base.ranges import Count, Range
from softness_bayes.cli.options import Directory, Force, Given, Loads, Out, Seed, Several, TrustCode, command, typed
from softness_bayes.cli.running import reading
from softness_bayes.model.options import ModelOptions
from softness_bayes.results.run_options import DataFiles

if TYPE_CHECKING:
    from softness_bayes.experiments.design import Plan


class Grid(Kind):
    """Moduli [Pa] evenly spaced in the logarithm."""

    metavar = "LOW:HIGH:N"

    def parse(self, text: str) -> tuple[float, ...]:
        """Return the moduli of a text such as 20:2000:8 [kPa]."""
        import numpy as np

        try:
            low, high, number = (float(part) for part in text.split(":"))
        except ValueError:
            low = high = number = 0.0
        if not (0 < low <= high < float("inf") and number in range(1, 201)):
            raise InputError(f"expected LOW:HIGH:N, such as 20:2000:8 [kPa], N from 1 to 200, got {text!r}")
        return tuple((np.geomspace(low, high, int(number)) * 1e3).tolist())


class Raters(Kind):
    """The same raters (None), or a number of new ones."""

    metavar = "same|new:N"

    def parse(self, text: str) -> int | None:
        """Return the number of new raters from same or new:N."""
        kind, _, number = text.partition(":")
        if text != "same" and (kind != "new" or not number.isdigit()):
            raise InputError(f"expected same or new:N, such as new:12, got {text!r}")
        return int(number) if number else None


@command
def design(
    *,
    given: Annotated[tuple[Path, ...], Several(Directory())] = (),
    files: Annotated[DataFiles, Given(without=("compression", "afferents", "force_n", "indentation_mm"))],
    model: Annotated[ModelOptions, Given(without=("noise",))],
    about: Annotated[tuple[str, ...], Names()] = (),
    candidates: Path | None = None,
    moduli: Annotated[tuple[float, ...] | None, Grid()] = None,
    touches: Loads,
    largest_load: str | None = None,
    conditions: Annotated[int, Number(Count(1, 50), "N")] = 8,
    raters: Annotated[int | None, Raters()] = None,
    budget: Annotated[float | None, Number(Range(0.0, above=True))] = None,
    cost_fabric: Annotated[float, Number(Range(0.0))] = 0.0,
    cost_load: Annotated[float, Number(Range(0.0))] = 0.0,
    cost_rating: Annotated[float, Number(Range(0.0))] = 1.0,
    seed: Seed = SEED,
    out: Out = Path("design"),
    force: Force = False,
    trust_code: TrustCode = False,
) -> None:
    """Choose the touches whose ratings would tell most, from a finished run.

    Candidates are the fabrics that were rated, and moduli of fabrics to obtain, under the loads of the run. Touches
    whose contact exceeds half the fingertip's radius are left out, and none is chosen more than twice. Moduli have the
    errors of the run (15 % where it took them as exact; --modulus-cv): a design that ignores them misleads.
    With --data instead of --given the plan is made from the prior, before any rating.

    Parameters
    ----------
    given
        A finished run. Give several runs of the same ratings to tell them apart (--about run).
    about : NAME,...
        What is to be learnt: parameters, turning@2mm or turning@1N, run (which of several); by default everything.
    candidates
        Table of fabrics that could be rated; by default the rated ones.
    moduli
        Effective moduli [kPa] of fabrics to obtain; by default 12 over the range of the rated ones.
    indentation_mm
        Indentation [mm] of a candidate; by default as rated.
    force_n
        Contact force [N] of a candidate; by default as rated.
    largest_load : LOAD
        Leave out loads of its kind above this one, such as 2mm or 1N.
    conditions
        Largest number of touches.
    raters
        Raters, each of whom rates every touch once: those of the run, or N new ones.
    budget
        Budget, in the unit of the costs.
    cost_fabric
        Cost of a fabric that has to be obtained.
    cost_load
        Cost of each load.
    cost_rating
        Cost of one rating.
    """
    from softness_bayes.base.files.outputs import require_outputs
    from softness_bayes.data import Fabrics
    from softness_bayes.experiments.design import FILES, Costs
    from softness_bayes.experiments.design import design as design_of
    from softness_bayes.experiments.outlook import Candidates

    if bool(given) == (files.data is not None):
        raise InputError("design: give either --given, a finished run, or --data, before any rating")
    inputs = [path for path in (candidates, files.data, files.fabrics) if path is not None]
    require_outputs(out, FILES, "design", force, inputs)
    with reading(*given, trust_code=trust_code) as results:
        cloth = None if candidates is None else Fabrics.read(candidates)
        loads, cv = tuple(map(str, touches.loads)) or None, model.modulus_cv if typed("modulus_cv") else None
        plan = design_of(
            results or files.read(),
            about,
            Candidates(cloth, moduli, loads, largest_load, cv),
            conditions=conditions,
            raters=raters,
            costs=Costs(budget, cost_fabric, cost_load, cost_rating),
            options=model,
            seed=seed,
        )
    plan.save(out)
    _show(plan)
    click.echo(f"written to {out}: {', '.join(FILES)}", err=True)


def _show(plan: Plan) -> None:
    """Print the chosen touches, and what they are expected to tell."""
    columns = ["order", "fabric", "to_obtain", "e_fab_kpa", "indentation_mm", "force_n", "raters", "step_nats"]
    shown = plan.table[columns].dropna(axis=1, how="all")
    click.echo(f"rate next, to learn {', '.join(plan.about)} (the most informative first):")
    click.echo(shown.to_string(index=False, float_format="{:.4g}".format))
    b = plan.bracket
    click.echo(f"information: {b.low:.2f} to {b.high:.2f} nats (± {b.se:.2f})")
    ratios = sorted(plan.bracket.sd_ratio.items(), key=lambda each: each[1])
    click.echo("expected posterior sd / present sd: " + ", ".join(f"{name} {ratio:.2f}" for name, ratio in ratios[:8]))
    for note in plan.notes:
        click.echo(f"note: {note}")
