"""`softness-bayes design`: the touches whose ratings would tell most."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import click

from softness_bayes.base.defaults import SEED
from softness_bayes.base.errors import InputError
from softness_bayes.base.options import Kind, Names, Number
from softness_bayes.base.ranges import PANEL, Count, Range
from softness_bayes.cli.options import Directory, Force, Given, Loads, Out, Seed, Several, TrustCode, command, typed
from softness_bayes.cli.running import reading
from softness_bayes.model.options import ModelOptions
from softness_bayes.results.run_options import DataFiles

if TYPE_CHECKING:
    from softness_bayes.experiments.design import Plan


class Grid(Kind):
    """Moduli [Pa] evenly spaced in the logarithm."""

    metavar = "LOW:HIGH:N"

    def parse(self, text: str) -> list[float]:
        """Return the moduli of a text such as 20:2000:8 [kPa]."""
        import numpy as np

        try:
            low, high, number = text.split(":")
            ends, n = (float(low), float(high)), int(number)
        except ValueError:
            raise InputError(f"expected LOW:HIGH:N, such as 20:2000:8 [kPa], got {text!r}") from None
        if not (0 < ends[0] <= ends[1] < float("inf") and 1 <= n <= 200):
            raise InputError(f"expected 0 < LOW <= HIGH [kPa] and N from 1 to 200, got {text!r}")
        return list(np.geomspace(*ends, n) * 1e3)


class LargestLoad(Kind):
    """A load with its unit."""

    metavar = "LOAD"

    def parse(self, text: str) -> Any:
        """Return the load of a text such as 2mm or 1N."""
        from softness_bayes.experiments.design import load_named

        return load_named(text)


class Raters(Kind):
    """The same raters (None), or a number of new ones."""

    metavar = "same|new:N"

    def parse(self, text: str) -> int | None:
        """Return the number of new raters from same or new:N."""
        kind, _, number = text.partition(":")
        if text == "same":
            return None
        if kind != "new" or not number.isdigit() or not PANEL.holds(int(number)):
            raise InputError(f"expected same or new:N, such as new:12, got {text!r}")
        return int(number)


@command
def design(
    *,
    given: Annotated[tuple[Path, ...], Several(Directory())] = (),
    files: Annotated[DataFiles, Given(without=("compression", "afferents", "force_n", "indentation_mm"))],
    model: Annotated[ModelOptions, Given(without=("noise",))],
    about: Annotated[tuple[str, ...], Names()] = (),
    candidates: Path | None = None,
    moduli: Annotated[list[float] | None, Grid()] = None,
    touches: Loads,
    largest_load: Annotated[Any, LargestLoad()] = None,
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
        A finished run. Give two runs of the same ratings to tell them apart (--about run).
    about : NAME,...
        What is to be learnt: parameters, turning@2mm or turning@1N, run (which of two); by default everything.
    candidates
        Table of fabrics that could be rated; by default the rated ones.
    moduli
        Effective moduli [kPa] of fabrics to obtain; by default 12 over the range of the rated ones.
    indentation_mm
        Indentation [mm] of a candidate; by default as rated.
    force_n
        Contact force [N] of a candidate; by default as rated.
    largest_load
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

    if bool(given) == (files.data is not None):
        raise InputError("design: give either --given, a finished run, or --data, before any rating")
    if len(given) > 2:
        raise InputError(f"design: expected one run, or two to tell apart, got {len(given)}")
    inputs = [path for path in (candidates, files.data, files.fabrics) if path is not None]
    require_outputs(out, FILES, "design", force, inputs)
    with reading(*given, trust_code=trust_code) as results:
        source: Any = files.read() if not results else results[0] if len(results) == 1 else results
        plan = design_of(
            source,
            about,
            candidates=None if candidates is None else Fabrics.read(candidates),
            moduli=moduli,
            loads=touches.loads or None,
            largest_load=largest_load,
            conditions=conditions,
            raters=raters,
            costs=Costs(budget, cost_fabric, cost_load, cost_rating),
            modulus_cv=model.modulus_cv if typed("modulus_cv") else None,
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
    ratios = sorted(plan.sd_ratio.items(), key=lambda each: each[1])
    click.echo("expected posterior sd / present sd: " + ", ".join(f"{name} {ratio:.2f}" for name, ratio in ratios[:8]))
    for note in plan.notes:
        click.echo(f"note: {note}")
