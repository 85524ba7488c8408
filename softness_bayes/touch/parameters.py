"""The parameters of the chain, as the forward model takes them: by name, in SI, any batch shape."""

from __future__ import annotations

from typing import Any, NamedTuple


class TouchParameters(NamedTuple):
    """One number, or one array of a common batch shape, for each parameter of the chain (model.md 10)."""

    b: Any
    """Skin modulus at rest [Pa]."""
    m: Any
    """Stiffening exponent of the skin [-] (under the ``displacement`` reading [1/m])."""
    alpha: Any
    """Largest receptor current [µA/cm²]."""
    beta: Any
    """Steepness of the transduction [1/Pa]."""
    sigma_0: Any
    """Stress at half the largest current [Pa]."""
    c_Na: Any
    """Multiplier of the sodium conductance [-]."""
    c_K: Any
    """Multiplier of the potassium conductance [-]."""
    c_L: Any
    """Multiplier of the leak conductance [-]."""
    c_A: Any
    """Multiplier of the A-current's conductance [-]."""
