"""Builder of the shipped rate curves: ``python -m softness_bayes.tools.curve_build``, which takes a minute."""

from __future__ import annotations

from pathlib import Path

from softness_bayes.touch import neuron
from softness_bayes.touch.accuracy import PRESETS
from softness_bayes.touch.neuron.firing import CURVES, exact_curve, key, text_of
from softness_bayes.touch.neuron.fixed_channels import USUAL_CURRENT
from softness_bayes.touch.neuron.membrane import CONNOR_STEVENS, HODGKIN_HUXLEY, PAPER_CHANNELS
from softness_bayes.touch.neuron.rate_curve import LARGEST_CURRENT

RATE_NODES = sorted({preset.rate_nodes for preset in PRESETS})

CASES = [
    *((PAPER_CHANNELS, CONNOR_STEVENS, USUAL_CURRENT, nodes) for nodes in RATE_NODES),
    (PAPER_CHANNELS, CONNOR_STEVENS, LARGEST_CURRENT, RATE_NODES[-1]),
    *((PAPER_CHANNELS, HODGKIN_HUXLEY, USUAL_CURRENT, nodes) for nodes in RATE_NODES),
]
"""Arguments of `exact_curve`: what runs with the paper's channels ask for."""

if __name__ == "__main__":
    curves = {key(*case): exact_curve(*case) for case in CASES}
    (Path(neuron.__file__).parent / CURVES).write_text(text_of(curves), encoding="utf-8")
