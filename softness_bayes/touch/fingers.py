"""Responses of one scene to fingers of different skin and sensitivity, over which raters are integrated (model.md 8-9).

Under one load, skin and fabric act on the receptors through E_star alone. For one parameter vector the response to
every fabric of every finger is therefore one function of E_star for each load. The skin's modulus at rest and its
stiffening change E_star; the sensitivity of the receptors changes the function.

Firing begins at the E_star at which the stress on the axis reaches the receptors' threshold. With
ln E_star = (its value there) + t² the response is t² times a smooth function of t, which a short Chebyshev series
through exact values represents. E_star itself is smooth in ln b and is interpolated too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from softness_bayes.base.errors import InputError
from softness_bayes.touch.contact import Indentation, Load, Loads
from softness_bayes.touch.finger_grid import FingerGrid, FingerSpreads, SkinLaws
from softness_bayes.touch.neuron.polynomials import clenshaw
from softness_bayes.touch.parameters import TouchParameters, checked_rows
from softness_bayes.touch.population import Drive
from softness_bayes.touch.stress_fields import StressFields

if TYPE_CHECKING:
    from softness_bayes.touch.scene import Scene

Array = NDArray[np.float64]

RESPONSE_NODES = 16
"""Exact responses that the series under each load goes through."""

SKIN_NODES = 12
"""Values of ln b at which the contact is solved for each fabric."""

POINTS = 1 << 19
"""Number of responses interpolated at once."""


class _Threshold:
    """The E_star at which the stress on the axis reaches a value, under one load."""

    def __init__(self, scene: Scene, load: Load) -> None:
        from scipy.interpolate import CubicSpline  # imported here because it takes a third of a second

        low, high = scene.tables[load].modulus_range
        # the tables of indentations have no lower end
        low, self.high = np.log(1.0 if isinstance(load, Indentation) else low), np.log(high)
        log_modulus = np.linspace(low, self.high, 400)
        modulus, finger = np.exp(log_modulus)[None], scene.finger
        fields = StressFields(scene.tables, [load] * log_modulus.size, finger)
        log_peak = np.log(fields.at(modulus, Loads(load).radius(modulus, finger), finger).peak[0])
        if not (np.diff(log_peak) > 0).all():
            raise InputError(
                "raters' own fingers: the stress at the receptors does not rise with stiffness at "
                f"{load} under these readings; omit 'individual'"
            )
        self._inverse, self._ends = CubicSpline(log_peak, log_modulus), (log_peak[0], log_peak[-1])

    def __call__(self, stress: Array) -> Array:
        """Return ln E_star [ln Pa]; the lower end of the table if receptors always fire, infinity if they never do."""
        with np.errstate(divide="ignore"):
            log_stress = np.log(np.maximum(stress, 0.0))
        first, last = self._ends
        found = self._inverse(np.clip(log_stress, first, last))
        return np.where(log_stress >= last, np.inf, found)


class FingerFamily:
    """Responses of all fingers of a grid touching the fabrics of a scene.

    Parameters
    ----------
    scene
        Fabrics and loads.
    grid
        The fingers, in standard deviations from the typical one.
    response_nodes, skin_nodes
        Resolution of the interpolation.

    Raises
    ------
    InputError
        If the stress at the receptors does not rise with E_star under a load, or the finger's shape is not known.
    """

    def __init__(
        self, scene: Scene, grid: FingerGrid, response_nodes: int = RESPONSE_NODES, skin_nodes: int = SKIN_NODES
    ) -> None:
        self.scene, self.grid = scene, grid
        if scene.finger_box is not None:
            raise InputError("raters' own fingers: expected a scene whose finger has a known radius and depth")
        loads = [scene.loads[scene.load[columns[0]]] for columns in scene.columns]
        self._thresholds = [_Threshold(scene, load) for load in loads]
        self._b, self._to_b = np.zeros(1), np.ones((1, 1))
        if "b" in grid.names:
            x = chebyshev.chebpts1(skin_nodes)
            fine = chebyshev.chebvander(grid.axis("b") / grid.reach, skin_nodes - 1)
            self._b, self._to_b = grid.reach * x, fine @ np.linalg.inv(chebyshev.chebvander(x, skin_nodes - 1))
        self._u = chebyshev.chebpts1(response_nodes)
        self._series = np.linalg.inv(chebyshev.chebvander(self._u, response_nodes - 1))
        # all fields at the nodes, load by load
        every = [load for load in loads for _ in range(response_nodes)]
        self._fields, self._loads = StressFields(scene.tables, every, scene.finger), Loads(every)

    def total_rate(
        self,
        parameters: TouchParameters,
        spreads: FingerSpreads,
        modulus: Array | None = None,
        known: SkinLaws | None = None,
    ) -> Array:
        """Return the total rate [spikes/s] of every finger of the grid in every condition.

        Parameters
        ----------
        parameters
            Parameters of the typical finger: arrays of one batch shape (...), or scalars.
        spreads
            Spreads of fingers, of that shape.
        modulus
            E_fab [Pa] of each fabric, shape (..., fabrics); by default that of the scene.
        known
            Laws of the skins of people with plate forces, arrays (..., people).

        Returns
        -------
        ndarray
            Shape (..., fingers, conditions), the fingers in the order of `FingerGrid.z`; then, for each person in
            `known`, the same number of fingers at the same distances, in standard deviations, from the mean of that
            person's law.

        Raises
        ------
        InputError
            As for `Scene.total_rate`.
        """
        batch = (np.shape(value) for value in (*parameters, *spreads))
        shape = np.broadcast_shapes(*batch, () if modulus is None else modulus.shape[:-1])
        parameters = parameters.broadcast(shape)
        spread = FingerSpreads(*(np.broadcast_to(np.asarray(value, float), shape).reshape(-1) for value in spreads))
        _, flat = checked_rows(parameters)
        if modulus is not None:
            modulus = np.broadcast_to(modulus, (*shape, modulus.shape[-1])).reshape(-1, modulus.shape[-1])
        laws = _laws(spread, known, shape)
        size, width = self.grid.size * laws.log_b.shape[-1], self.scene.n_conditions
        found = np.empty((flat.b.size, size, width))
        rows = max(1, POINTS // (size * width))
        for start in range(0, flat.b.size, rows):
            k = slice(start, start + rows)
            part = TouchParameters(*(value[k] for value in flat))
            few = SkinLaws(*(value[k] for value in laws))
            rates = self._rates(part, few, spread.sigma_0[k], None if modulus is None else modulus[k])
            found[k] = rates.reshape(-1, size, width)
        return found.reshape(*shape, size, width)

    def _rates(self, p: TouchParameters, laws: SkinLaws, spread: Array, modulus: Array | None) -> Array:
        """Return rates of shape (batch, 1 + people, sigma_0, b, m, conditions); `spread` is that of ln sigma_0."""
        log_modulus = self._log_reduced(p, laws, modulus)
        people = log_modulus.shape[1]
        log_modulus = log_modulus.reshape(len(log_modulus), -1, *log_modulus.shape[3:])  # people and b on one axis
        sigma_0 = p.sigma_0[:, None] * np.exp(np.multiply.outer(spread, self.grid.axis("sigma_0")))
        found = np.empty((len(p.b), sigma_0.shape[1], *log_modulus.shape[1:]))
        curve = self.scene.firing.curves(p.channels, p.alpha)
        vector = np.repeat(np.arange(len(p.b)), sigma_0.shape[1])
        own = curve.take(vector) if curve.rheobase.ndim else curve
        drive = Drive(p.alpha[vector], p.beta[vector], sigma_0.reshape(-1), own)
        onset = drive.onset.reshape(sigma_0.shape)
        tops = [log_modulus[..., columns].max(axis=(1, 2, 3)) for columns in self.scene.columns]
        begins = np.stack([at(onset) for at in self._thresholds], axis=-1)
        top = np.maximum(np.stack(tops, axis=-1)[:, None], begins)  # (batch, sigma_0, loads)
        extent = np.sqrt(np.where(np.isfinite(begins), top - np.where(np.isfinite(begins), begins, 0.0), 0.0))
        series = self._along(drive, begins, extent)
        for k, columns in enumerate(self.scene.columns):
            start, far = begins[:, :, k, None, None, None], extent[:, :, k, None, None, None]
            squared = log_modulus[:, None][..., columns] - start
            silent = ~(squared > 0)
            t = np.sqrt(np.where(silent, 0.0, squared))
            x = np.divide(2.0 * t, far, out=np.ones_like(t), where=far > 0) - 1.0
            rate = clenshaw(series[:, :, :, k, None, None, None], x) * t * t
            rate[silent] = 0.0
            found[..., columns] = np.maximum(rate, 0.0)
        batch, sensitivities = found.shape[:2]
        return np.swapaxes(found.reshape(batch, sensitivities, people, -1, *found.shape[3:]), 1, 2)

    def _log_reduced(self, p: TouchParameters, laws: SkinLaws, modulus: Array | None) -> Array:
        """Return ln E_star of every finger in every condition, shape (batch, 1 + people, b, m, conditions)."""
        log_b, m, b_by_b, m_by_b, m_by_m = (value[..., None] for value in laws)
        b = p.b[:, None, None] * np.exp(log_b + b_by_b * self._b)
        away = (m + m_by_b * self._b)[..., None] + (m_by_m * self.grid.axis("m"))[..., None, :]
        own_m = np.maximum(p.m[:, None, None, None] + away, 0.0)
        few = TouchParameters(*(value[:, None, None, None] for value in p))._replace(b=b[..., None], m=own_m)
        few = TouchParameters(*np.broadcast_arrays(*few))
        touched = None if modulus is None else modulus[:, None, None, None]
        known = np.log(self.scene.contact(few, touched).reduced_modulus)
        return np.einsum("jq,inqmc->injmc", self._to_b, known, optimize=True)

    def _along(self, drive: Drive, begins: Array, extent: Array) -> Array:
        """Return the series of (rate / t²) in t under every load, shape (nodes, batch, sigma_0, loads)."""
        nodes, scene = self._u.size, self.scene
        batch, sensitivities, loads = extent.shape
        t = 0.5 * extent[..., None] * (self._u + 1.0)
        # for a load under which nothing fires, any modulus of its table will do
        anywhere = np.array([at.high for at in self._thresholds])
        log_modulus = np.where(np.isfinite(begins), begins, anywhere)[..., None] + t * t
        reduced = np.exp(log_modulus).reshape(batch * sensitivities, loads * nodes)
        fields = self._fields.at(reduced, self._loads.radius(reduced, scene.finger), scene.finger)
        rate = scene.population.sums(fields, drive).rate
        smooth = rate.reshape(batch, sensitivities, loads, nodes)
        smooth = np.divide(smooth, t * t, out=np.zeros_like(smooth), where=t > 0)
        return np.moveaxis(smooth @ self._series.T, -1, 0)


def _laws(spread: FingerSpreads, known: SkinLaws | None, shape: tuple[int, ...]) -> SkinLaws:
    """Return the population law of the skin, followed by those of the people in `known`, each (batch, 1 + people)."""
    nothing = np.zeros_like(spread.b)
    anybody = SkinLaws(nothing, nothing, spread.b, nothing, spread.m)
    if known is None:
        return SkinLaws(*(value[:, None] for value in anybody))
    own = (np.broadcast_to(v, (*shape, v.shape[-1])).reshape(-1, v.shape[-1]) for v in known)
    return SkinLaws(*(np.column_stack([value, more]) for value, more in zip(anybody, own, strict=True)))
