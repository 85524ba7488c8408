"""`softness-bayes resume`: continuation of a run that was interrupted, or that ended."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from softness_bayes.cli.options.run import max_time, no_figures, processes, trust_code, trusts_code
from softness_bayes.cli.options.values import whole
from softness_bayes.cli.running import Sampling, command_line, recorded_files
from softness_bayes.cli.sample import require_drawn, run
from softness_bayes.errors import InputError
from softness_bayes.ranges import STEPS

if TYPE_CHECKING:
    from softness_bayes.checkpoints.status import Status
    from softness_bayes.results.request import RunOptions


@click.command(cls=Sampling)
@click.argument("directory", type=click.Path(path_type=Path), metavar="DIR")
@click.option(
    "--more-steps",
    type=whole(STEPS),
    metavar="N",
    help="Run at least this many further steps, even if the run has converged.",
)
@max_time
@processes
@click.option(
    "--data", type=click.Path(path_type=Path), metavar="FILE", help="New path of the ratings, if they were moved."
)
@click.option(
    "--fabrics", type=click.Path(path_type=Path), metavar="FILE", help="New path of the fabrics, if they were moved."
)
@click.option(
    "--compression", type=click.Path(path_type=Path), metavar="FILE", help="New path of the forces, if they were moved."
)
@no_figures
@trust_code
def command(
    directory: Path,
    more_steps: int | None,
    max_time: float,
    processes: int | None,
    data: Path | None,
    fabrics: Path | None,
    compression: Path | None,
    no_figures: bool,
) -> None:
    """Continue a run that was interrupted or has ended.

    The run continues in DIR with its original options, and gives the same draws as a run with the same seed that was
    never interrupted. A run that ended at its --max-steps gets the same number of steps again. A run that has
    converged continues only with --more-steps. A first look (sample --quick) continues to the full run. If the data,
    the priors, the readings or anything else that determines the draws has changed, the run is refused and the
    change is named. If files of the checkpoint are damaged, the run continues from the last intact state; the damaged
    files and the number of lost steps are reported.
    """
    from softness_bayes.checkpoints.checkpoint import Checkpoint
    from softness_bayes.provenance import versions
    from softness_bayes.results.request import Request
    from softness_bayes.supplied import require_trusted

    checkpoint = Checkpoint.open(directory, salvage=True)
    status = checkpoint.status
    assert status is not None, "a run to continue has a state"
    if checkpoint.damage:
        click.echo(f"note: {checkpoint.damage}", err=True)
    if checkpoint.request is None:
        raise InputError(
            f"{directory}: the run was started in Python; continue it there, with sample(..., checkpoint=...) "
            f"inside 'with Checkpoint.open({str(directory)!r}) as checkpoint'"
        )
    require_trusted(f"{directory}: its checkpoint", checkpoint.request, trusts_code())
    verdict = status.verdict if status.written and status.ended else None
    if verdict is not None and verdict.converged and more_steps is None and _is_whole(directory):
        click.echo(f"{directory}: {verdict.sentence()} Its results are complete; use --more-steps to continue it.")
        return
    model, how = Request.from_record(checkpoint.request["options"])
    how = replace(_continued(how, status, more_steps), max_seconds=max_time, processes=processes or how.processes)
    now, then = versions(), checkpoint.request["versions"]
    names = [name for name in now if now[name] != then.get(name)]
    if changed := [f"{name.removeprefix('version_')} {then.get(name)} (now {now[name]})" for name in names]:
        click.echo(
            f"note: the run was started with {', '.join(changed)}: draws may differ from those of an uninterrupted run",
            err=True,
        )
    files = recorded_files(checkpoint.request["files"], directory)
    files = replace(
        files,
        data=data or files.data,
        fabrics=fabrics or files.fabrics,
        compression=compression or files.compression,
    )
    moved = []
    for option, given in (("data", data), ("fabrics", fabrics), ("compression", compression)):
        moved += [] if given is None else [f"--{option}", str(given)]
        path = getattr(files, option)
        if path is not None and not path.exists():
            raise InputError(
                f"{path}: no such file, and the run was started with it; if it was moved, give its new path "
                f"with --{option}"
            )
    wanted = checkpoint.request["figures"] and not no_figures
    own = checkpoint.request.get("own_figures", []) if wanted else None
    require_drawn(own)
    run(checkpoint, files, files.read(), Request(model, how), own, moved)


def _is_whole(directory: Path) -> bool:
    """Return whether the results of a run can be read; if not, print why they are written again."""
    from softness_bayes.results.result import Result

    try:
        Result.load(directory, trust_code=trusts_code())
    except InputError as error:
        click.echo(f"note: {error}; the results are written again", err=True)
        return False
    return True


def _continued(options: RunOptions, status: Status, more_steps: int | None) -> RunOptions:
    """Return the options of a run with limits that let it go on."""
    options = replace(options, command=f"{options.command}; {command_line()}")
    if options.quick:
        least = 0 if more_steps is None else status.steps + more_steps
        return replace(options, quick=False, min_steps=least, max_steps=max(options.max_steps, least))
    if more_steps is not None:
        least = status.steps + more_steps
        return replace(options, min_steps=least, max_steps=max(options.max_steps, least))
    if status.written and status.steps >= status.max_steps:
        return replace(options, max_steps=status.steps + options.max_steps)
    return options
