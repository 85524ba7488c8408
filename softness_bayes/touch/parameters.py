"""The parameters of the chain, as the forward model takes them: by name, in SI, any batch shape."""

from __future__ import annotations

from typing import NamedTuple

from numpy.typing import ArrayLike


class TouchParameters(NamedTuple):
    """One value, or one array of a common batch shape, for each parameter of the chain (model.md 10)."""

    b: ArrayLike
    """Skin modulus at rest [Pa]."""
    m: ArrayLike
    """Stiffening exponent of the skin [-] (under the ``displacement`` reading [1/m])."""
    alpha: ArrayLike
    """Largest receptor current [µA/cm²]."""
    beta: ArrayLike
    """Steepness of the transduction [1/Pa]."""
    sigma_0: ArrayLike
    """Stress at half the largest current [Pa]."""
    c_Na: ArrayLike
    """Multiplier of the sodium conductance [-]."""
    c_K: ArrayLike
    """Multiplier of the potassium conductance [-]."""
    c_L: ArrayLike
    """Multiplier of the leak conductance [-]."""
    c_A: ArrayLike
    """Multiplier of the A-current's conductance [-]."""
