"""Exact firing rates against Brian2, a simulator of other hands: an extra of its own (``peers``)."""

import numpy as np
import pytest

from softness_bayes.errors import InputError
from softness_bayes.tools.benchmark_firing import EQUATIONS, brian2_rates
from softness_bayes.touch.neuron.membrane import MEMBRANES, PAPER_CHANNELS
from softness_bayes.touch.neuron.rate import firing_rate

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
