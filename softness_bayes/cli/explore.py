"""`softness-bayes explore`: the fast model on a page of sliders."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING

import click

from softness_bayes.cli.options import FILE, TOUCHES, Touches, collected, number, touches, trust_code, typed
from softness_bayes.cli.running import reading, warn_of_unconverged
from softness_bayes.errors import InputError
from softness_bayes.model.options import ModelOptions
from softness_bayes.ranges import PORTS

if TYPE_CHECKING:
    from softness_bayes.explore.subject import Subject


@click.command()
@click.argument("directory", type=FILE, required=False, metavar="[DIR]")
@touches("six example fabrics", "indentations of 1, 2 and 3 mm")
@collected("model", ModelOptions, "fix", "priors", "prior_set", "readings", "finger")
@number("--port", PORTS, "Port on the loopback address of this machine; 0 for any free port.", 0)
@click.option("--show", is_flag=True, help="Open the page in the browser.")
@trust_code
def command(
    directory: Path | None,
    touches: Touches,
    model: ModelOptions,
    port: int,
    show: bool,
) -> None:
    """Open an interactive page that shows how the response depends on each parameter.

    Without DIR the parameters start at the medians of their priors. With the DIR of a finished run they start at the
    posterior medians; the page then uses the finger, fabrics and loads of the run, and draws its data and credible
    bands behind the curves. Sliders cover the central 98 % of each prior. The page shows the command that repeats its
    numbers. It is served only on 127.0.0.1, until Ctrl-C, and writes nothing.
    """
    from softness_bayes.explore.picture import picture
    from softness_bayes.explore.server import listening, serve

    def show_address(address: str) -> None:
        click.echo(address)
        click.echo("Ctrl-C ends it", err=True)
        if show:
            webbrowser.open(address)

    with listening(port) as opened:
        if directory is None:
            subject = _of_priors(touches, model)
        else:
            if typed(*TOUCHES, *ModelOptions.declared):
                raise InputError(
                    "DIR has its own fabrics, loads, priors, readings and finger: omit the options for these, or DIR"
                )
            subject = _of_run(directory)
        picture(subject, subject.start)  # compiles the scene, and refuses now what the page could not draw
        serve(subject, opened, show_address)


def _of_run(directory: Path) -> Subject:
    from softness_bayes.explore.subject import of_run

    with reading(directory) as (result,):
        warn_of_unconverged(result)
        return of_run(result)


def _of_priors(touches: Touches, model: ModelOptions) -> Subject:
    from softness_bayes.explore.subject import EXAMPLE_LOADS, example_fabrics, of_priors

    fabrics, loads = touches.among(example_fabrics(), EXAMPLE_LOADS)
    return of_priors(fabrics, loads, model)
