"""`softness-bayes priors`: every parameter with its prior, the laws that priors may have, and the sets of priors."""

from __future__ import annotations

import click

from softness_bayes.cli.options.words import explained


@click.command()
def command() -> None:
    """List and explain the parameters and their priors, the prior distributions and the sets of priors.

    --prior NAME='DISTRIBUTION(NUMBERS)' sets the prior of one parameter, --priors SET chooses a set. A custom
    distribution is given by its importable name, such as --prior b='mypackage.laws:Gamma(2,0.02)'.
    """
    from softness_bayes.parameters.declared import EVERY_PARAMETER, HELD, PRIOR_SETS, SHAPE_PARAMETERS
    from softness_bayes.parameters.priors import LAWS, PRIORS, form_of
    from softness_bayes.supplied import installed
    from softness_bayes.touch.skin import STRAIN

    click.echo("parameters and their priors, in the units given:")
    rows = []
    for name, one in EVERY_PARAMETER.items():
        held = f"; {HELD[name]:g} unless given a prior" if name in HELD else ""
        held = "; fixed at the finger's value unless given a prior" if name in SHAPE_PARAMETERS else held
        unit = f" [{one.unit}]" if one.unit != "–" else ""
        rows.append((name, f"{one.meaning}{unit}: {one.prior}, values {one.range}{held}"))
    click.echo(explained(rows))
    click.echo("laws (--prior):")
    rows = [(form_of(law), (law.__doc__ or "").strip().partition("\n")[0]) for law in LAWS.values()]
    rows += [(name, f"{point.value}, of an installed package") for name, point in installed(PRIORS).items()]
    click.echo(explained(rows))
    click.echo("sets (--priors), with the priors that they change under the default reading of the skin:")
    of_sets = {name: found[STRAIN] for name, found in PRIOR_SETS.items()}
    changed = [(name, ", ".join(f"{p}={law}" for p, law in found.items())) for name, found in of_sets.items()]
    click.echo(explained([(name, said or "the priors above") for name, said in changed]))
    click.echo("docs: the page 'The model', section 10; for custom distributions see the page 'Extending'")
