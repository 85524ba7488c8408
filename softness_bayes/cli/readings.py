"""`softness-bayes readings`: the places of the model that allow several readings, and what each reading is."""

from __future__ import annotations

import click

from softness_bayes.cli.options.completion import places
from softness_bayes.cli.options.words import explained


@click.command()
@click.argument("place", required=False, metavar="[PLACE]", shell_complete=places)
def command(place: str | None) -> None:
    """List and explain the readings of the model's equations.

    In every command that has these options, --reading PLACE=NAME chooses one reading and --readings SET a whole set. A
    custom reading is given by its importable name, such as --reading pressure=mypackage.pressures:mine.
    """
    from softness_bayes.errors import InputError
    from softness_bayes.supplied import installed
    from softness_bayes.touch.readings import ALTERNATIVES, NAMED_READINGS

    if place is not None and place not in ALTERNATIVES:
        raise InputError(f"readings: no place '{place}'; expected one of {', '.join(ALTERNATIVES)}")
    for at in ALTERNATIVES if place is None else [place]:
        click.echo(f"{at}:")
        first, *others = ALTERNATIVES[at].items()
        rows = [(first[0], f"{first[1].meaning} (the default)"), *((name, one.meaning) for name, one in others)]
        rows += [(name, f"{point.value}, of an installed package") for name, point in installed(at).items()]
        click.echo(explained(rows))
    if place is None:
        click.echo("sets (--readings):")
        click.echo(explained([(name, _differences(name)) for name in NAMED_READINGS]))
    click.echo("docs: the page 'The model', sections 1 to 8; for custom readings see the page 'Extending'")


def _differences(name: str) -> str:
    from softness_bayes.touch.readings import MENDED, NAMED_READINGS

    names = NAMED_READINGS[name].names
    return ", ".join(f"{place}={names[place]}" for place in names if names[place] != MENDED.names[place]) or "defaults"
