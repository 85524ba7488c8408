"""Individual fingers or answers of raters: the quantities that differ, and the grids of fingers (model.md 9)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from softness_bayes.errors import InputError
from softness_bayes.likelihood.effects import RATER_SPREADS
from softness_bayes.touch.finger_grid import SPREAD_OF, FingerGrid
from softness_bayes.touch.fingers import FingerFamily
from softness_bayes.touch.scene import Scene

NODES: Mapping[int, Mapping[str, int]] = MappingProxyType(
    {
        1: {"b": 33, "m": 17, "sigma_0": 33},
        2: {"b": 25, "m": 9, "sigma_0": 25},
        3: {"b": 21, "m": 7, "sigma_0": 21},
    }
)
"""Nodes per quantity, by the number of quantities that differ; `FingerGrid` states the error of their spacing."""

RESPONSE_NODES, SKIN_NODES = 20, 14
"""Resolution of the fingers' responses, with errors of about 1e-3 in log(N/N_ref + 0.1 Hz) over the prior."""

FINER_RESPONSE_NODES, FINER_SKIN_NODES = 40, 24
"""The same for the reference of the exactness check."""


def require_individual(names: Sequence[str]) -> None:
    """Raise an error for unknown or repeated quantities, and for fingers combined with answers.

    Raises
    ------
    InputError
        Naming what is expected.
    """
    known = {**SPREAD_OF, **RATER_SPREADS}
    if len(set(names)) < len(names) or not known.keys() >= set(names):
        raise InputError(f"individual is {','.join(names)}, expected some of {', '.join(known)}, each once")
    if fingers_of(names) and answers_of(names):
        raise InputError(
            f"individual is {','.join(names)}: raters' own fingers ({', '.join(SPREAD_OF)}) and their own "
            f"answers ({', '.join(RATER_SPREADS)}) cannot be combined; use one kind at a time, and compare the "
            "two runs"
        )


def fingers_of(names: Sequence[str]) -> tuple[str, ...]:
    """Return the quantities among `names` that belong to raters' fingers."""
    return tuple(name for name in names if name in SPREAD_OF)


def answers_of(names: Sequence[str]) -> tuple[str, ...]:
    """Return the quantities among `names` that belong to raters' answers: exponents and noise."""
    return tuple(name for name in RATER_SPREADS if name in names)


def differing(names: Sequence[str]) -> str:
    """Describe the quantities that differ between raters."""
    words = {"gamma": "exponents", "varsigma": "noise"}
    return f"own {' and '.join(words[name] for name in answers_of(names)) or 'fingers'}"


def spreads_of(names: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the parameters for the spreads of quantities that differ."""
    return tuple({**SPREAD_OF, **RATER_SPREADS}[name] for name in names)


def grid_of(names: Sequence[str]) -> FingerGrid:
    """Return the grid of fingers over which individual fingers are summed."""
    return FingerGrid({name: NODES[len(names)][name] for name in names})


def family_of(scene: Scene, grid: FingerGrid) -> FingerFamily:
    """Return the family of fingers of a grid that touch a scene, at the default resolution."""
    return FingerFamily(scene, grid, RESPONSE_NODES, SKIN_NODES)


def finer_family_of(scene: Scene, grid: FingerGrid) -> FingerFamily:
    """Return the same family at the resolution of the reference."""
    return FingerFamily(scene, grid, FINER_RESPONSE_NODES, FINER_SKIN_NODES)
