"""Text lines on the expected information from a design."""

from __future__ import annotations

from typing import Any

from softness_bayes.readable import percent

SPREADS = frozenset({"tau", "varsigma", "omega", "tau_b", "tau_m", "varsigma_f"})
"""Standard deviations of participants, fabrics and ratings, which are estimated better with more of each."""

MOST_OTHERS = 6
"""Largest number of alternative designs that are listed."""


def design_lines(told: dict[str, Any]) -> list[str]:
    """Return the result of `model.understanding.foreseen` as lines of text."""
    lines = [
        "How precise is this design?",
        f"Expected posterior sd / prior sd at {told['truths']} true values from the prior: median (10 % to 90 "
        "% quantile).",
        "Linear approximation, without sampling. In test runs, 61 of 64 posterior widths were within a factor "
        "of 1.5 of it.",
    ]
    given, used = told["loads"]
    if used < given:
        lines.append(f"Neighbouring loads among the {given} are merged into {used} for this prediction.")
    for name, ratio in told["sd_ratio"].items():
        lines.append(f"  {name:14} {_limits(ratio)}")
    if told["not_foreseen"]:
        lines.append(f"  not covered: {', '.join(told['not_foreseen'])}")
    for place in told["turning_points"]:
        lines.append(f"  {_place(place, told['truths'])}")
    lines.append("Which changes would help most? (information gained, and the sd ratio that falls most, now and then)")
    for other in told["others"][:MOST_OTHERS]:
        lines.append(
            f"  {other['design']} ({other['further_ratings']} ratings more): {other['bits']:+.1f} bits; "
            f"{_most(told['sd_ratio'], other['sd_ratio'])}"
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
