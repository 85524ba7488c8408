"""Ranks of every observation model and uncertain input: ``python ranks.py DIR``.

Simulation-based calibration of one small design after another: parameters, true inputs and ratings are drawn, fitted
by the sampler, and the true values are ranked among the draws. Each observation model is also fitted with known
mistakes in its likelihood (negative controls), which the ranks must show. Finished replicates in DIR are kept, so that
a second call continues where the first one ended. `ranks.csv` gets the table of the page on results.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from softness_bayes import (
    AGGREGATED,
    CATEGORIES,
    LAPSES,
    NORMAL,
    PAIRS,
    PAPER_CHANNELS,
    RANKS,
    SLIDER,
    STUDENT,
    CalibrationScene,
    Fabrics,
    HalfNormal,
    LogNormal,
    ModelOptions,
    RunOptions,
    calibrate,
    usual_values,
)
from softness_bayes.base.laws import Normal, Uniform
from softness_bayes.checking.calibration import Calibration
from softness_bayes.runs.calibrate import replicate_settings
from softness_bayes.runs.replicate import replicate
from softness_bayes.touch.readings import MENDED

RUN = RunOptions(max_steps=4000, seed=1, processes=1)
MODULI = np.geomspace(3e3, 6e5, 12)
RATED = CalibrationScene(Fabrics(tuple("abcdefghijkl"), effective_modulus=MODULI), participants=5)
USUAL = usual_values(MENDED)
HELD = {name: USUAL[name] for name in ("m", "alpha", "beta", "sigma_0", *PAPER_CHANNELS._fields)}
"""Parameters that are fixed in the calibration of observation models; `calibrate` tests them."""

SCATTER = {"varsigma": LogNormal(0.3, 0.3)}
"""Prior for uncertain inputs: posteriors of ratings almost without noise are thin bent sheets."""


class Mistaken:
    """A likelihood with a known mistake: it is computed for changed parameters, or for the next fabric's response.

    Parameters
    ----------
    right
        The correct likelihood.
    factors
        Numbers that multiply parameters, by name.
    shift
        Number of conditions by which the response is displaced.
    """

    def __init__(self, right: Any, factors: Mapping[str, float], shift: int = 0) -> None:
        self._right, self._factors, self._shift = right, factors, shift

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self._right, name)

    def log_likelihood(self, mean_rate: Any, parameters: Any) -> Any:
        """Return the log density of all ratings, shape (...)."""
        changed = {name: getattr(parameters, name) * by for name, by in self._factors.items()}
        return self._right.log_likelihood(np.roll(mean_rate, self._shift, axis=-1), parameters.replace(**changed))


Mistakes = Mapping[str, Callable[[Any], Mistaken]]


def scaled(**factors: float) -> Callable[[Any], Mistaken]:
    """Return the mistake that multiplies parameters."""
    return lambda right: Mistaken(right, factors)


SIGN = {"ratings fall where they rise": scaled(gamma=-1.0)}
PRECISE = {**SIGN, "noise 1.5 times too small": scaled(varsigma=1 / 1.5)}
ORDERED = {
    **SIGN,
    "noise 3 times too small": scaled(varsigma=1 / 3),
    "each touch taken for the next fabric's": lambda right: Mistaken(right, {}, 1),
}
GAPS = {"inner categories twice as wide": scaled(gap_2=2.0, gap_3=2.0, gap_4=2.0)}
DEVIATING = {"errors": NORMAL, "resolution": 1.0, "priors": {"omega": HalfNormal(0.3)}}
SAME = {"deviations ignored": scaled(omega=0.0)}


class Case(NamedTuple):
    """One model, its design, and the mistakes that the ranks must show."""

    scene: CalibrationScene
    options: ModelOptions
    mistakes: Mistakes = MappingProxyType({})


def rated(mistakes: Mistakes, **options: Any) -> Case:
    """Return the case of an observation model: `b` and the parameters of the ratings are sampled."""
    return Case(RATED, ModelOptions(fix=HELD, **options), mistakes)


def uncertain(bracketed: tuple[int, ...] = (), unknown: tuple[int, ...] = (), **options: Any) -> Case:
    """Return the case of uncertain inputs: 20 raters, 8 fabrics, 2 loads, and all parameters but the channels."""
    known, low, high = np.geomspace(3e3, 6e5, 8), np.full(8, np.nan), np.full(8, np.nan)
    low[list(bracketed)], high[list(bracketed)] = known[list(bracketed)] / 1.5, known[list(bracketed)] * 1.5
    known[[*bracketed, *unknown]] = np.nan
    fabrics = Fabrics(
        tuple("abcdefgh"), effective_modulus=known, effective_modulus_low=low, effective_modulus_high=high
    )
    priors = {**SCATTER, **options.pop("priors", {})}
    model = ModelOptions(fix=PAPER_CHANNELS._asdict(), errors=NORMAL, resolution=0.0, priors=priors, **options)
    return Case(CalibrationScene(fabrics), model)


FINGER = {"radius": Normal(8, 1), "receptor_depth": Uniform(0.5, 0.9)}
CASES: Mapping[str, Case] = {
    "whole numbers, normal": rated(PRECISE, errors=NORMAL, resolution=1.0),
    "whole numbers, Student": rated({**PRECISE, "tails ignored": scaled(nu=1e4)}, errors=STUDENT, resolution=1.0),
    "whole numbers, lapses": rated({**PRECISE, "lapses ignored": scaled(lapse=1e-6)}, errors=LAPSES, resolution=1.0),
    "fabrics' deviations": rated({**PRECISE, **SAME}, **DEVIATING),
    "slider": rated(PRECISE, scale=SLIDER),
    "categories": rated({**SIGN, **GAPS}, scale=CATEGORIES, n_categories=5),
    "pairs": rated(ORDERED, scale=PAIRS),
    "ranks": rated(ORDERED, scale=RANKS),
    "aggregated": rated(PRECISE, scale=AGGREGATED),
    "raters' own gamma": rated(
        {**PRECISE, "differences ignored": scaled(tau_gamma=0.0)}, errors=NORMAL, resolution=0.0, individual=("gamma",)
    ),
    "raters' own varsigma": rated(
        {**PRECISE, "differences ignored": scaled(tau_varsigma=0.0)},
        errors=NORMAL,
        resolution=0.0,
        individual=("varsigma",),
    ),
    "own gamma and fabrics' deviations": rated({**PRECISE, **SAME}, individual=("gamma",), **DEVIATING),
    "moduli with errors of 15 %": uncertain(modulus_cv=0.15),
    "moduli in brackets": uncertain(bracketed=tuple(range(8))),
    "two unknown moduli": uncertain(unknown=(2, 5)),
    "errors of single loads, 10 %": uncertain(load_cv=0.1),
    "error shared by all ratings at a load, 5 %": uncertain(shared_load_cv=0.05),
    "radius and depth of the receptors": uncertain(priors=FINGER),
    "raters' own b": uncertain(individual=("b",)),
    "raters' own m": uncertain(individual=("m",)),
    "raters' own sigma_0": uncertain(individual=("sigma_0",)),
    "moduli, a bracket, an unknown one, shared load error, radius and depth": uncertain(
        (1,), (5,), modulus_cv=0.15, shared_load_cv=0.05, priors=FINGER
    ),
}


def row(name: str, folder: Path, labs: int, controls: int) -> tuple[str, ...]:
    """Return the cells of one model: replicates, smallest p-value, threshold, alarm, and mistakes that raise one."""
    scene, options, mistakes = CASES[name]
    right = calibrate(scene, options, RUN, labs, folder / "".join(c if c.isalnum() else "_" for c in name)).calibration
    least = max(0.0, min(min(one.uniform_p, one.spread_p) for one in right.judge().values()))
    posterior = scene.model(options).posterior
    settings, shown = replicate_settings(RUN, posterior), 0
    for assume in mistakes.values() if controls else ():
        found = [replicate(posterior, settings, RUN.seed, k, assume) for k in range(controls)]
        shown += bool(Calibration.of(found).faults())
    alarm = next(iter(right.faults()), "none")
    of_mistakes = f"{shown} of {len(mistakes)}" if controls and mistakes else ""
    return name, str(len(right.rank)), f"{least:.2g}", f"{right.threshold:.1g}", alarm, of_mistakes


def main() -> None:
    """Run what is missing in the directory, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("directory", type=Path, help="directory of the replicates and of ranks.csv")
    parser.add_argument("--labs", type=int, default=60, help="replicates of each model")
    parser.add_argument("--controls", type=int, default=40, help="replicates fitted with each mistake")
    parser.add_argument("--cases", default="", help="names of models, separated by semicolons; by default all")
    asked = parser.parse_args()
    table = [("model", "replicates", "smallest p", "alarm below", "alarm", "mistakes detected")]
    for name in asked.cases.split(";") if asked.cases else CASES:
        table.append(row(name, asked.directory, asked.labs, asked.controls))
        print(" | ".join(table[-1]), flush=True)
        with (asked.directory / "ranks.csv").open("w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows(table)


if __name__ == "__main__":
    main()
