"""Lines that say what a design can tell."""

from __future__ import annotations

from typing import Any

from softness_bayes.readable import percent

SPREADS = frozenset({"tau", "varsigma", "omega", "tau_b", "tau_m", "varsigma_f"})
"""Spreads of people, fabrics and ratings, which more of any of them narrows."""

MOST_OTHERS = 6
"""Number of other designs that are named."""


def design_lines(told: dict[str, Any]) -> list[str]:
    """Return what `model.understanding.foreseen` found, in lines."""
    lines = [
        "What can this design tell?",
        f"Expected posterior sd over prior sd, at {told['truths']} truths from the prior: median (10 to 90 % of them).",
        "Linearised, without sampling: of 64 widths of test runs, 61 lay within a factor of 1.5 of these.",
    ]
    given, used = told["loads"]
    if used < given:
        lines.append(f"Neighbours among the {given} loads are taken for one another: {used} loads.")
    for name, ratio in told["sd_ratio"].items():
        lines.append(f"  {name:14} {_limits(ratio)}")
    if told["not_foreseen"]:
        lines.append(f"  not foreseen: {', '.join(told['not_foreseen'])}")
    for place in told["turning_points"]:
        lines.append(f"  {_place(place, told['truths'])}")
    lines.append("What would help most? (further information, and what of skin, receptors and readout it narrows most)")
    for other in told["others"][:MOST_OTHERS]:
        lines.append(
            f"  {other['design']} ({other['further_ratings']} ratings more): {other['bits']:+.1f} bits; "
            f"{_most(told['sd_ratio'], other['sd_ratio'])}"
        )
    return lines


def _place(place: dict[str, Any], truths: int) -> str:
    share = f"the prior's response turns over in {percent(place['prior_share'])} of draws"
    if place["factor_90"] is None:
        return f"turning point at {place['load']}: not foreseen; {share}"
    low, middle, high = place["factor_90"]
    found = f"where there is one ({place['truths']} of {truths} truths)"
    return (
        f"turning point at {place['load']}: E_fab to a factor of {middle:.2f} ({low:.2f} to {high:.2f}), "
        f"sd {place['sd_ratio'][1]:.2f} of the prior's, {found}; {share}"
    )


def _most(now: dict[str, list[float]], other: dict[str, list[float]]) -> str:
    """Return the parameter whose median ratio falls most, spreads of people and ratings aside, with both ratios."""
    name = min(now.keys() - SPREADS, key=lambda one: (other[one][1] / now[one][1], one))
    if other[name][1] > 0.95 * now[name][1]:
        return "no parameter by more than 5 %"
    return f"{name} {now[name][1]:.2f} to {other[name][1]:.2f}"


def _limits(ratio: list[float]) -> str:
    low, middle, high = ratio
    return f"{middle:.2f} ({low:.2f} to {high:.2f})"
