"""`softness-bayes figures`: the figures that a finished run may have."""

from __future__ import annotations

import click

from softness_bayes.cli.options.words import explained


@click.command()
def command() -> None:
    """List and explain the figures of a finished run.

    'plot DIR --figures NAME' draws one. A custom figure is given by its importable name, such as
    --figures mypackage.figures:mine.
    """
    from softness_bayes.plotting.figures import FIGURES, OWN_FIGURES
    from softness_bayes.supplied import installed

    rows = [(name, drawing.shows) for name, drawing in FIGURES.items()]
    rows += [(name, f"{point.value}, of an installed package") for name, point in installed(OWN_FIGURES).items()]
    click.echo(explained(rows))
    click.echo("docs: for custom figures see the page 'Extending'")
