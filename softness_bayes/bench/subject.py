"""Benchmark scene, its parameter vectors, and a description of the machine."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Mapping
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.data import Experiment, Fabrics
from softness_bayes.model.build import ExperimentModel, build
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.scenes import prior_draws, usual_values
from softness_bayes.model.simulation import simulate_ratings
from softness_bayes.touch.contact import Indentation
from softness_bayes.touch.neuron.membrane import PAPER_CHANNELS
from softness_bayes.touch.readings import MENDED
from softness_bayes.touch.resolution import Draws
from softness_bayes.touch.scene import Discretisation

Array = NDArray[np.float64]

FABRICS = Fabrics(tuple(f"F{k}" for k in range(1, 13)), effective_modulus=np.geomspace(1e3, 5e6, 12))
LOADS = (Indentation(1e-3), Indentation(2e-3), Indentation(3e-3))
PARTICIPANTS = 30
BATCH = 64


class Effort(NamedTuple):
    """Amount of work of a benchmark."""

    draws: int
    """Prior draws at which errors are measured."""
    repeats: int
    """Number of calls, of which the fastest counts."""
    finest: float
    """Tolerance of the stress fields that errors are measured against."""
    most_fabrics: int
    """Fabrics of the largest scene, under each of the loads."""
    most_vectors: int
    """Vectors of the largest batch."""
    lanes: int
    """Receptors that vectorised peers integrate."""
    loop: int
    """Receptors that a loop integrates."""
    duration: float
    """Time that peers integrate [ms]."""
    sampler_steps: int
    """Steps of the sampler that is timed."""


LEAST = 0.05
"""Processor time that repeated calls take together, in seconds for each repeat that is asked for."""

FULL = Effort(1000, 30, 1e-8, 3334, 1024, 400, 6, 600.0, 1500)
QUICK = Effort(64, 3, 1e-5, 40, 64, 20, 1, 400.0, 0)


class Subject(NamedTuple):
    """The model, with simulated ratings, at one resolution, and prior draws of its parameters."""

    model: ExperimentModel
    draws: Draws
    theta: Array
    """Points at which the likelihood is evaluated, shape (BATCH, parameters)."""


def subject(discretisation: Discretisation, held: bool, size: int) -> Subject:
    """Return the model of simulated ratings, with channel multipliers fixed or free."""
    options = ModelOptions(fix=PAPER_CHANNELS._asdict() if held else {}, discretisation=discretisation)
    values = usual_values(MENDED, given={"sigma_0": 7.0})
    made = simulate_ratings(np.random.default_rng(1), FABRICS, LOADS, values, participants=PARTICIPANTS)
    model = build(Experiment(made.ratings, FABRICS, ()), options)
    space = model.posterior.space
    return Subject(model, prior_draws(space, size), space.draw_prior(np.random.default_rng(0), BATCH))


def quickest(call: Callable[[], Any], repeats: int) -> float:
    """Return the shortest processor time of repeated calls [s], which other programs on the machine hardly change.

    Short calls are repeated more often, so that a moment in which another program slows them does not decide.
    """
    taken: list[float] = []
    while len(taken) < repeats or (repeats > 1 and sum(taken) < LEAST * repeats):
        begun = time.process_time()
        call()
        taken.append(time.process_time() - begun)
    return min(taken)


VECTORS: Mapping[str, str] = MappingProxyType({"avx512f": "AVX-512", "avx2": "AVX2", "avx": "AVX", "asimd": "NEON"})
"""Names of vector instructions, the widest first, by the system's flag for them."""

PEER_PACKAGES = ("brian2", "jax", "diffrax")


def machine(info: Path = Path("/proc/cpuinfo")) -> dict[str, str]:
    """Return a description of the machine: processor, vector instructions, cores, load, versions.

    Parameters
    ----------
    info
        The system's description of its processors.
    """
    pairs = [line.split(":", 1) for line in reversed(_lines(info)) if ":" in line]
    told = {key.strip().lower(): value.strip() for key, value in pairs}  # of the first processor
    flags = told.get("flags", told.get("features", "")).split()
    load = f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown"
    return {
        "processor": told.get("model name") or platform.processor() or platform.machine(),
        "vectors": next((name for flag, name in VECTORS.items() if flag in flags), "unknown vector instructions"),
        "cores": str(os.cpu_count()),
        "load": load,
        "system": platform.system(),
        "python": platform.python_version(),
        **{name: version(name) for name in ("numpy", "scipy", "emcee", "softness-bayes")},
        **{name: version(name) for name in PEER_PACKAGES if find_spec(name) is not None},
    }


def machine_name(about: Mapping[str, str]) -> str:
    """Return a machine's description in a line."""
    processor = f"{about['processor']} with {about['vectors']}"
    return f"{processor}, {about['cores']} cores, Python {about['python']}, NumPy {about['numpy']}"


def _lines(path: Path) -> list[str]:
    return path.read_text(encoding="utf-8", errors="replace").splitlines() if path.is_file() else []
