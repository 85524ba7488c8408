"""Exact firing rates against Brian2 and JAX, simulators of other hands: an extra of its own (``peers``)."""

import csv

import numpy as np
import pytest

from softness_bayes.bench.jax_cells import ABSENT, jax_is_there, jax_peers, orbit_cells, step_cells
from softness_bayes.errors import InputError
from softness_bayes.tools.benchmark_firing import (
    ADAPTIVE,
    COLUMNS,
    EQUATIONS,
    OURS,
    STEPS,
    TARGETS,
    brian2_rates,
    jax_orbits,
    jax_rates,
)
from softness_bayes.touch.neuron.membrane import MEMBRANES, PAPER_CHANNELS
from softness_bayes.touch.neuron.rate import firing_rate
from support.paths import ROOT

# well above each membrane's onset, and below its depolarisation block
CURRENTS = {"connor-stevens": (20.3, 30.0, 60.0), "hodgkin-huxley": (12.0, 25.0, 60.0), "printed": (60.0, 75.0, 100.0)}


def test_every_membrane_has_equations() -> None:
    assert EQUATIONS.keys() == MEMBRANES.keys() == CURRENTS.keys()


def test_without_brian2_it_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "brian2", None)
    with pytest.raises(InputError, match=r"Brian2 is not installed here: install softness-bayes\[peers\]"):
        brian2_rates(np.array([20.3]))


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # of another project
@pytest.mark.parametrize("name", EQUATIONS)
def test_brian2_converges_to_the_exact_rate(name: str) -> None:
    pytest.importorskip("brian2", reason="Brian2 is not installed: it comes with the extra 'peers'")
    membrane, current = MEMBRANES[name], np.array(CURRENTS[name])
    exact = firing_rate(current, PAPER_CHANNELS, membrane)
    assert (exact > 30.0).all()
    coarse, fine = (
        float(np.abs(brian2_rates(current, PAPER_CHANNELS, membrane, step).rate / exact - 1.0).max())
        for step in (0.04, 0.02)
    )
    assert fine < 1e-5
    assert fine < coarse / 2.0
    # negative control: rates of other multipliers are far away
    other = firing_rate(current, PAPER_CHANNELS._replace(c_K=1.17), membrane)
    assert np.abs(other / exact - 1.0).max() > 100.0 * fine


@pytest.mark.parametrize("missing", ["jax", "diffrax"])
def test_without_jax_it_is_named(monkeypatch: pytest.MonkeyPatch, missing: str) -> None:
    monkeypatch.setitem(__import__("sys").modules, missing, None)
    assert jax_peers() == ()
    for rates in (jax_rates, jax_orbits):
        with pytest.raises(InputError, match=r"not installed: pip install 'softness-bayes\[peers\]'"):
            rates(np.array([20.3]))


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # of other projects
@pytest.mark.parametrize("name", EQUATIONS)
def test_jax_converges_to_the_exact_rate(name: str) -> None:
    if not jax_is_there():
        pytest.skip(ABSENT)
    membrane, current = MEMBRANES[name], np.array(CURRENTS[name])
    exact = firing_rate(current, PAPER_CHANNELS, membrane)

    def error(rate: np.ndarray) -> float:
        return float(np.abs(rate / exact - 1.0).max())

    coarse, fine = (error(step_cells(current, 400.0, step, PAPER_CHANNELS, membrane)) for step in (0.04, 0.02))
    loose, tight = (error(orbit_cells(current, 200.0, rtol, PAPER_CHANNELS, membrane)) for rtol in (1e-4, 1e-7))
    assert fine < 1e-5
    assert fine < coarse / 2.0
    assert tight < 1e-7
    assert tight < loose / 10.0
    # negative controls: rates of other multipliers are far away, and a silent cell has none
    other = firing_rate(current, PAPER_CHANNELS._replace(c_K=1.17), membrane)
    assert error(other) > 100.0 * fine
    assert step_cells(np.array([0.0]), 50.0, 0.05, PAPER_CHANNELS, membrane) == [0.0]
    assert orbit_cells(np.array([0.0]), 50.0, 1e-4, PAPER_CHANNELS, membrane) == [0.0]


def test_the_kept_comparison_has_every_simulator() -> None:
    with (ROOT / "notebooks" / "results" / "firing.csv").open(encoding="utf-8", newline="") as file:
        rows = [*csv.DictReader(file)]
    assert tuple(rows[0]) == COLUMNS
    simulators = [row["simulator"] for row in rows]
    expected = {"softness-bayes": len(OURS), "Brian2": len(STEPS) * len(TARGETS), "JAX": len(STEPS)}
    assert {name: simulators.count(name) for name in simulators} == expected | {"JAX, diffrax": len(ADAPTIVE)}
    assert len({row["machine"] for row in rows}) == 1
    for row in rows:
        # every simulator converges; the coarsest setting of each is the least accurate
        assert float(row["error"]) < 1e-2, row
