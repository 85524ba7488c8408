"""Values that a shell completes: names of parameters, priors, readings and figures, from the tables in the code.

The tables are imported when the tab key is pressed, so that `--help` stays fast.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import click

Complete = Callable[[click.Context, click.Parameter, str], list[str]]


def _beginning(incomplete: str, words: Iterable[str]) -> list[str]:
    return [word for word in words if word.startswith(incomplete)]


def parameters(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    """Complete the name of a parameter."""
    from softness_bayes.parameters.declared import EVERY_PARAMETER

    return _beginning(incomplete, [f"{name}=" for name in EVERY_PARAMETER])


def priors(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    """Complete the name of a parameter, then the law of its prior."""
    from softness_bayes.parameters.priors import LAWS
    from softness_bayes.parameters.priors import PRIORS as GROUP
    from softness_bayes.supplied import installed

    name, given, _ = incomplete.partition("=")
    if not given:
        return parameters(ctx, param, incomplete)
    return _beginning(incomplete, [f"{name}={law}(" for law in (*LAWS, *installed(GROUP))])


def prior_sets(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    """Complete the name of a set of priors."""
    from softness_bayes.parameters.declared import PRIOR_SETS

    return _beginning(incomplete, PRIOR_SETS)


def places(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    """Complete the name of a place of the model."""
    from softness_bayes.touch.readings import ALTERNATIVES

    return _beginning(incomplete, ALTERNATIVES)


def readings(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    """Complete the name of a place of the model, then one of its readings."""
    from softness_bayes.supplied import installed
    from softness_bayes.touch.readings import ALTERNATIVES

    place, given, _ = incomplete.partition("=")
    if not given or place not in ALTERNATIVES:
        return _beginning(incomplete, [f"{place}=" for place in ALTERNATIVES])
    return _beginning(incomplete, [f"{place}={name}" for name in (*ALTERNATIVES[place], *installed(place))])


def reading_sets(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    """Complete the name of a set of readings."""
    from softness_bayes.touch.readings import NAMED_READINGS

    return _beginning(incomplete, NAMED_READINGS)


def fingers(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    """Complete the name of a value of the finger."""
    from softness_bayes.model.fingers import every_value
    from softness_bayes.touch.contact import Finger

    return _beginning(incomplete, [f"{name}=" for name in every_value(Finger())])


def figures(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    """Complete the name of a figure."""
    from softness_bayes.plotting.figures import every_figure

    return _beginning(incomplete, every_figure())
