"""Matching of raters and fingers with plate forces by name."""

from __future__ import annotations

from softness_bayes.data import Experiment
from softness_bayes.data.faults import listing
from softness_bayes.likelihood.plate import CompressionForces
from softness_bayes.likelihood.pressed import PressedRaters
from softness_bayes.likelihood.ratings import SKIN
from softness_bayes.model.options import ModelOptions


def pressed_raters(experiment: Experiment, options: ModelOptions, forces: CompressionForces) -> PressedRaters | None:
    """Return the raters with plate forces on their own fingers, matched by name; None if there are none."""
    if experiment.compression is None or not set(SKIN) & set(options.individual):
        return None
    return PressedRaters.of(forces, experiment.ratings.participants, experiment.compression.participants)


def people_note(experiment: Experiment, options: ModelOptions) -> str | None:
    """Describe which raters also have plate forces and how these are used; None without forces.

    Parameters
    ----------
    experiment, options
        The tables and the requested options.
    """
    if experiment.compression is None:
        return None
    pressed = set(experiment.compression.participants)
    both = [name for name in experiment.ratings.participants if name in pressed]
    if not both:
        return "no rater has the name of a pressed finger: they are treated as different people"
    whose = f"{listing(both)}: rated and pressed ({len(both)} of {len(experiment.ratings.participants)} raters)"
    own = [name for name in SKIN if name in options.individual]
    if not own:
        return (
            f"{whose}; without --individual b all raters have the typical finger, so the forces inform the "
            "typical finger and not those of single raters"
        )
    return f"{whose}; each is one person, whose {' and '.join(own)} is inferred from forces and ratings together"
