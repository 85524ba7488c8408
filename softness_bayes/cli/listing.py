"""`softness-bayes list`: the readings, priors and figures that options name, each explained."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import click

from softness_bayes.errors import InputError

WIDTH = 110
"""Width of a line."""


def _complete(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    from softness_bayes.touch.readings import ALTERNATIVES

    words = ALTERNATIVES if ctx.params.get("what") == "readings" else ()
    return [word for word in words if word.startswith(incomplete)]


@click.command()
@click.argument("what", type=click.Choice(["readings", "priors", "figures"]), metavar="WHAT")
@click.argument("place", required=False, metavar="[PLACE]", shell_complete=_complete)
def command(what: str, place: str | None) -> None:
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
    """
    if what == "readings":
        _readings(place)
    elif place is not None:
        raise InputError(f"list {what}: unexpected {place!r}; only readings have places")
    else:
        (_priors if what == "priors" else _figures)()


def _readings(place: str | None) -> None:
    from softness_bayes.touch.readings import ALTERNATIVES, MENDED, NAMED_READINGS

    if place is not None and place not in ALTERNATIVES:
        raise InputError(f"readings: no place '{place}'; expected one of {', '.join(ALTERNATIVES)}")
    for at in ALTERNATIVES if place is None else [place]:
        click.echo(f"{at}:")
        first, *others = ALTERNATIVES[at].items()
        rows = [(first[0], f"{first[1].meaning} (the default)"), *((name, one.meaning) for name, one in others)]
        _explain([*rows, *_installed(at)])
    if place is None:
        click.echo("sets (--readings):")
        sets = {name: readings.names for name, readings in NAMED_READINGS.items()}
        rows = [
            (name, ", ".join(f"{at}={one}" for at, one in names.items() if one != MENDED.names[at]) or "defaults")
            for name, names in sets.items()
        ]
        _explain(rows)
    click.echo("docs: the page 'The model', sections 1 to 8; for custom readings see the page 'Extending'")


def _priors() -> None:
    from softness_bayes.parameters.declared import EVERY_PARAMETER, HELD, PRIOR_SETS, SHAPE_PARAMETERS
    from softness_bayes.parameters.priors import LAWS, PRIORS, form_of
    from softness_bayes.touch.contact import STRAIN

    click.echo("parameters and their priors, in the units given:")
    rows = []
    for name, one in EVERY_PARAMETER.items():
        held = f"; {HELD[name]:g} unless given a prior" if name in HELD else ""
        held = "; fixed at the finger's value unless given a prior" if name in SHAPE_PARAMETERS else held
        unit = f" [{one.unit}]" if one.unit != "–" else ""
        rows.append((name, f"{one.meaning}{unit}: {one.prior}, values {one.range}{held}"))
    _explain(rows)
    click.echo("laws (--prior):")
    rows = [(form_of(law), (law.__doc__ or "").strip().partition("\n")[0]) for law in LAWS.values()]
    _explain([*rows, *_installed(PRIORS)])
    click.echo("sets (--priors), with the priors that they change under the default reading of the skin:")
    changed = {name: ", ".join(f"{p}={law}" for p, law in laws[STRAIN].items()) for name, laws in PRIOR_SETS.items()}
    _explain([(name, laws or "the priors above") for name, laws in changed.items()])
    click.echo("docs: the page 'The model', section 10; for custom distributions see the page 'Extending'")


def _figures() -> None:
    from softness_bayes.plotting.figures import FIGURES, OWN_FIGURES

    _explain([*((name, drawing.shows) for name, drawing in FIGURES.items()), *_installed(OWN_FIGURES)])
    click.echo("docs: for custom figures see the page 'Extending'")


def _installed(group: str) -> list[tuple[str, str]]:
    from softness_bayes.supplied import installed

    return [(name, f"{point.value}, of an installed package") for name, point in installed(group).items()]


def _explain(rows: Sequence[tuple[str, str]]) -> None:
    """Print names beside their explanations, which are wrapped."""
    column = max((len(name) for name, _ in rows), default=0) + 4
    for name, meaning in rows:
        begin = f"  {name}".ljust(column)
        click.echo(textwrap.fill(meaning or "–", WIDTH, initial_indent=begin, subsequent_indent=" " * column))
