"""Precomputed rate curves of the paper's channels; other channels take a second or two per curve."""

from __future__ import annotations

import json
from functools import cache
from importlib import resources

import numpy as np

from softness_bayes.files.json_text import parse_json
from softness_bayes.touch.neuron.firing import CurveError, RateCurve, exact_curve
from softness_bayes.touch.neuron.membrane import Channels, Membrane

CURVES = "known_curves.json"
"""File of the curves, written by `tools.curve_build`."""


def known_curve(channels: Channels, membrane: Membrane, max_current: float, nodes: int) -> RateCurve:
    """Return the shipped curve if there is one; otherwise compute it by `exact_curve` with the same arguments."""
    kept = (
        None if any(np.ndim(value) for value in channels) else _kept().get(key(channels, membrane, max_current, nodes))
    )
    return exact_curve(channels, membrane, max_current, nodes) if kept is None else kept


def key(channels: Channels, membrane: Membrane, max_current: float, nodes: int) -> str:
    """Return a text key with everything that determines a curve, including all constants of the membrane."""
    multipliers = ", ".join(f"{name} {float(value)!r}" for name, value in channels._asdict().items())
    return f"{multipliers}, to {float(max_current)!r} µA/cm², {nodes} nodes, {membrane!r}"


def text_of(curves: dict[str, RateCurve]) -> str:
    """Return the content of the file, with full precision."""
    fields = {
        name: {
            "rheobase": float(curve.rheobase),
            "onset_rate": float(curve.onset_rate),
            "coefficients": curve.coefficients.tolist(),
            "max_current": float(curve.max_current),
            "error": list(curve.error),
        }
        for name, curve in curves.items()
    }
    return json.dumps(fields, indent=1) + "\n"


@cache
def _kept() -> dict[str, RateCurve]:
    text = resources.files("softness_bayes.touch.neuron").joinpath(CURVES).read_text(encoding="utf-8")
    return {
        name: RateCurve(
            np.array(found["rheobase"]),
            np.array(found["onset_rate"]),
            np.array(found["coefficients"]),
            found["max_current"],
            CurveError(*found["error"]),
        )
        for name, found in parse_json(text).items()
    }
