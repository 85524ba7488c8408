"""Precision of a design and cost of a run, foreseen before any sampling, as lines of text."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from softness_bayes.readable import percent

if TYPE_CHECKING:
    from softness_bayes.model.build import ExperimentModel
    from softness_bayes.touch.accuracy import Errors
    from softness_bayes.touch.scene import Discretisation

SPREADS = frozenset({"tau", "varsigma", "omega", "tau_b", "tau_m", "varsigma_f"})
"""Standard deviations of participants, fabrics and ratings, which are estimated better with more of each."""

MOST_OTHERS = 6
"""Largest number of alternative designs that are listed."""


def design_lines(expected: dict[str, Any]) -> list[str]:
    """Return the result of `model.understanding.foreseen` as lines of text."""
    lines = [
        "How precise is this design?",
        f"Expected posterior sd / prior sd at {expected['truths']} true values from the prior: median (10 % to 90 "
        "% quantile).",
        "Linear approximation, without sampling. In test runs, 61 of 64 posterior widths were within a factor "
        "of 1.5 of it.",
    ]
    count, used = expected["loads"]
    if used < count:
        lines.append(f"Neighbouring loads among the {count} are merged into {used} for this prediction.")
    for name, ratio in expected["sd_ratio"].items():
        lines.append(f"  {name:14} {_limits(ratio)}")
    if expected["not_foreseen"]:
        lines.append(f"  not covered: {', '.join(expected['not_foreseen'])}")
    for place in expected["turning_points"]:
        lines.append(f"  {_place(place, expected['truths'])}")
    lines.append("Which changes would help most? (information gained, and the sd ratio that falls most, now and then)")
    for other in expected["others"][:MOST_OTHERS]:
        lines.append(
            f"  {other['design']} ({other['further_ratings']} ratings more): {other['bits']:+.1f} bits; "
            f"{_most(expected['sd_ratio'], other['sd_ratio'])}"
        )
    return lines


def _place(place: dict[str, Any], truths: int) -> str:
    share = f"the response turns over in {percent(place['prior_share'])} of prior draws"
    if place["factor_90"] is None:
        return f"turning point at {place['load']}: precision not predicted; {share}"
    low, middle, high = place["factor_90"]
    found = f"if there is one ({place['truths']} of {truths} true values)"
    return (
        f"turning point at {place['load']}: E_fab known to a factor of {middle:.2f} ({low:.2f} to {high:.2f}), "
        f"posterior sd {place['sd_ratio'][1]:.2f} of the prior sd, {found}; {share}"
    )


def _most(now: dict[str, list[float]], other: dict[str, list[float]]) -> str:
    """Return the parameter whose median ratio falls most, spreads of people and ratings aside, with both ratios."""
    name = min(now.keys() - SPREADS, key=lambda one: (other[one][1] / now[one][1], one))
    if other[name][1] > 0.95 * now[name][1]:
        return "no ratio falls by more than 5 %"
    return f"{name} {now[name][1]:.2f} to {other[name][1]:.2f}"


def _limits(ratio: list[float]) -> str:
    low, middle, high = ratio
    return f"{middle:.2f} ({low:.2f} to {high:.2f})"


def cost_lines(model: ExperimentModel) -> list[str]:
    """Return how a run evaluates its model: stages, nodes, errors and cost, and the alternatives.

    Errors are the largest over draws of the prior and conditions: of the response, relative to the peak of each draw,
    and of log(N/N_ref + eps). Costs are the time per parameter vector in batches of 64, measured on this machine.
    """
    import pandas as pd

    from softness_bayes.model.scenes import prior_draws
    from softness_bayes.model.understanding import BATCH, ladder, seconds
    from softness_bayes.touch.accuracy import DRAWS

    scene, chosen, draws = model.scene, model.resolution, prior_draws(model.posterior.space)
    assert chosen is not None, "the command line sets an accuracy"
    d = chosen.discretisation
    cost, others = seconds(scene, draws.parameters), model.posterior.other_loads
    cost += 0.0 if others is None else seconds(others, draws.parameters)
    mechanics = f"{d.nodes} nodes to exp(-{d.saturation:g}), tolerance {d.field_tolerance:.0e}"
    stages = [
        {"stage": "mechanics", "resolution": mechanics, **_shown(chosen.mechanics)},
        {"stage": "firing rates", "resolution": _rates(scene.firing, d), **_shown(chosen.firing)},
        {"stage": "sum", "resolution": "", **_shown(chosen.errors)},
    ]
    presets = [
        {
            "nodes": one.discretisation.nodes,
            "to exp(-x)": one.discretisation.saturation,
            "tolerance": f"{one.discretisation.field_tolerance:.0e}",
            "rates": _terms(one.discretisation),
            **_shown(one.errors),
            "cost [µs]": f"{1e6 * taken:.1f}",
            "": "<- chosen" if one.discretisation == d else "",
        }
        for one, taken in ladder(scene, draws)
    ]
    return [
        f"accuracy {model.options.accuracy:g}, {scene.n_conditions} conditions, errors over {DRAWS} draws of the prior",
        f"\n{pd.DataFrame(stages).to_string(index=False)}",
        f"\ncost: {1e6 * cost:.1f} µs for each parameter vector, {BATCH} at a time, on one core",
        f"\npresets:\n{pd.DataFrame(presets).to_string(index=False)}",
    ]


def _rates(firing: object, d: Discretisation) -> str:
    from softness_bayes.touch.neuron.fixed_channels import FixedChannels

    if not isinstance(firing, FixedChannels):
        return f"surface, {_terms(d)}"
    return f"curve through {d.rate_nodes} rates, {_terms(d)}"


def _terms(d: Discretisation) -> str:
    return "all terms" if d.rate_terms is None else f"{d.rate_terms} terms"


def _shown(errors: Errors) -> dict[str, str]:
    return {"error / peak": f"{float(errors.peak):.1e}", "error of log": f"{float(errors.log):.1e}"}
