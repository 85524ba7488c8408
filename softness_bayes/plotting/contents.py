"""Contents of each figure, taken from the stored results of a finished run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.plotting.chains import rank_figure, trace_figure
from softness_bayes.plotting.checks import Means, Replicated, checks_figure, loo_pit_figure
from softness_bayes.plotting.choices import (
    categories_figure,
    counts_of,
    psychometric_figure,
    rows_of_pairs,
    wins_of,
)
from softness_bayes.plotting.compression import compression_figure
from softness_bayes.plotting.inflection import inflection_figure
from softness_bayes.plotting.membrane import membrane_figure
from softness_bayes.plotting.names import short_name
from softness_bayes.plotting.panels import say_grouped
from softness_bayes.plotting.parameters import corner_figure, informative, prior_figure
from softness_bayes.plotting.rating import Observed, observed_ratings, rating_figure
from softness_bayes.plotting.response import ratio_figure, response_figure
from softness_bayes.plotting.style import Style
from softness_bayes.plotting.touch import Touches, touch_figure
from softness_bayes.readable import counted
from softness_bayes.touch.load_groups import LoadGroup, LoadGroups, groups_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from softness_bayes.parameters.priors import Prior
    from softness_bayes.plotting.drawing import Drawable
    from softness_bayes.touch.contact import Load

Array = NDArray[np.float64]

TOLD: Mapping[str, str] = MappingProxyType(
    {
        "turns over": "turns over [–]",
        "inflection e_fab_kpa": "turning point [kPa]",
        "drop beyond inflection": "drop [{scale}]",
        "spread of participants": "spread of participants [{scale}]",
        "residual spread": "residual spread [{scale}]",
        "largest residual / sd": "largest residual / sd [–]",
        "smallest residual / sd": "smallest residual / sd [–]",
    }
)
"""Axis labels of the test quantities; `scale` is replaced by the unit of the additive rating scale."""


class _Some(NamedTuple):
    """The loads of a result that are drawn: each load, or groups of loads if there are many."""

    result: Drawable
    groups: LoadGroups

    @classmethod
    def of(cls, result: Drawable) -> _Some:
        return cls(result, groups_of(result.loads))

    @property
    def loads(self) -> tuple[Load | LoadGroup, ...]:
        return self.groups.called

    @property
    def load(self) -> NDArray[np.intp]:
        """Index (rows,) of the group of each rating's load."""
        return np.asarray(self.groups.of[self.result.group("constant_data")["load_index"].values])

    def observed(self) -> Observed:
        """Return the ratings by condition: a fabric under one load or under one group of loads."""
        constant, modulus = self.result.group("constant_data"), _fabric_modulus(self.result)
        count, limits = self.groups.at.size, _modulus_limits(self.result)
        found = observed_ratings(
            self.result.group("observed_data")["rating"].values,
            self.load * modulus.size + constant["fabric_index"].values,
            constant["participant_index"].values,
            np.tile(modulus, count),
            np.repeat(np.arange(count), modulus.size),
            scale=self.result.scale,
        )
        return (
            found if limits is None else found._replace(limits=(np.tile(limits[0], count), np.tile(limits[2], count)))
        )

    def said(self, figure: Figure, style: Style, curves: bool = True) -> Figure:
        """Add a note to a figure if it shows groups of loads, and return the figure."""
        with style.applied():
            say_grouped(figure, self.groups, style, curves)
        return figure


def response(result: Drawable, style: Style) -> Figure:
    """Draw the response against E_fab."""
    some = _Some.of(result)
    drawn = response_figure(
        result.curves(),
        some.loads,
        _fabric_modulus(result),
        inflection=result.inflections(),
        finger_radius=_finger_radius(result),
        names=_fabric_names(result),
        style=style,
    )
    return some.said(drawn, style)


def _finger_radius(result: Drawable) -> float:
    """Return the radius of the finger [m]; it is the default radius if the result does not record one."""
    from softness_bayes.touch.contact import Finger

    constant = result.group("constant_data")
    return float(constant["finger_radius_mm"]) * 1e-3 if "finger_radius_mm" in constant else Finger().radius


def response_ratio(result: Drawable, style: Style) -> Figure:
    """Draw the response against E_fab / E_skin."""
    some, names = _Some.of(result), _fabric_names(result)
    drawn = ratio_figure(result.curves(), some.loads, _fabric_modulus(result), names=names, style=style)
    return some.said(drawn, style)


def rating(result: Drawable, style: Style, against_ratio: bool = False) -> Figure:
    """Draw predicted and observed ratings against E_fab, or against E_fab / E_skin."""
    curves, some = result.curves(), _Some.of(result)
    drawn = rating_figure(
        curves.modulus,
        result.typical_ratings(),
        some.observed(),
        some.loads,
        scale=result.scale,
        skin_modulus=curves.skin_modulus if against_ratio else None,
        names=_fabric_names(result) * len(some.loads),
        style=style,
    )
    return some.said(drawn, style)


def rating_ratio(result: Drawable, style: Style) -> Figure:
    """Draw predicted and observed ratings against E_fab / E_skin."""
    return rating(result, style, against_ratio=True)


def inflection(result: Drawable, style: Style) -> Figure:
    """Draw the posterior of the turning point of the response."""
    some = _Some.of(result)
    drawn = inflection_figure(result.inflections(), some.loads, _fabric_modulus(result), style=style)
    return some.said(drawn, style)


def corner(result: Drawable, style: Style) -> Figure:
    """Draw the posterior of the most correlated pairs of parameters."""
    every = _sampled(result)
    draws = _draws(result, "posterior", every)
    first = informative(draws)
    names = [every[k] for k in first]
    left_out = len(every) - len(first)
    note = ""
    if left_out:
        hidden = counted(left_out, "less correlated parameter is", "less correlated parameters are")
        note = f"{hidden} not shown:\n'softness-bayes plot --all'"
    return corner_figure(draws[:, first], _labels(names), names=names, note=note, style=style)


def corner_all(result: Drawable, style: Style) -> Figure:
    """Draw the posterior of every pair of parameters."""
    names = _sampled(result)
    return corner_figure(_draws(result, "posterior", names), _labels(names), names=names, style=style)


def prior(result: Drawable, style: Style) -> Figure:
    """Draw prior against posterior of every parameter."""
    names = _sampled(result)
    posterior, prior = (_draws(result, group, names) for group in ("posterior", "prior"))
    return prior_figure(posterior, prior, _labels(names), laws=_laws(result, names), style=style)


def _laws(result: Drawable, names: Sequence[str]) -> list[Prior | None]:
    """Return each parameter's prior distribution, truncated to its range; None where the result has none."""
    from softness_bayes.parameters.declared import EVERY_PARAMETER
    from softness_bayes.parameters.priors import Truncated
    from softness_bayes.provenance import Provenance

    declared = Provenance(result.tree.attrs).priors
    return [
        Truncated(declared[name], -np.inf, EVERY_PARAMETER[name].largest) if name in declared else None
        for name in names
    ]


def trace(result: Drawable, style: Style) -> Figure:
    """Draw the traces of the ensembles."""
    names = _sampled(result)
    return trace_figure(*_walkers(result, names), _labels(names), style=style)


def rank(result: Drawable, style: Style) -> Figure:
    """Draw rank histograms of each ensemble's draws."""
    names = _sampled(result)
    return rank_figure(*_walkers(result, names), _labels(names), style=style)


def compression(result: Drawable, style: Style) -> Figure:
    """Draw the force of a rigid plate against indentation."""
    stored, constant = result.group("predictions").isel(chain=0), result.group("constant_data")
    return compression_figure(
        stored["plate_indentation_mm"].values * 1e-3,
        stored["typical_force_n"].values,
        constant["force_indentation_mm"].values * 1e-3,
        result.group("observed_data")["plate_force_n"].values,
        constant["finger_index"].values,
        style=style,
    )


def checks(result: Drawable, style: Style) -> Figure:
    """Draw test quantities of the ratings and of the replicates."""
    from softness_bayes.checking.check_table import ALL, posterior_quantities
    from softness_bayes.checking.quantities import Columns

    modulus = dict(zip(result.group("constant_data")["fabric"].values, _fabric_modulus(result), strict=True))
    means, shown, scale = [], [], result.scale.short
    for found in posterior_quantities(result.tree):
        if found.quantity.columns is Columns.CONDITION:
            for load in dict.fromkeys(load for load, _, _ in found.labels):
                here = [k for k, label in enumerate(found.labels) if label[0] == load]
                limits = np.array(
                    [[getattr(found.findings[k], name) for k in here] for name in ("observed", "low", "high")]
                )
                called = [found.labels[k][1] for k in here]
                means.append(
                    Means(load, np.array([modulus[name] for name in called]), limits[0], limits[1], limits[2], called)
                )
        elif found.quantity.columns is not Columns.PARTICIPANT:
            told = TOLD[found.quantity.name].format(scale=scale)
            shown += [
                Replicated(told + (f", {load}" if load != ALL else ""), finding.observed, values, finding.p_value)
                for (load, _, _), finding, values in zip(found.labels, found.findings, found.replicated.T, strict=True)
            ]
    return _Some.of(result).said(checks_figure(means, shown, scale, style=style), style, curves=False)


def category_counts(result: Drawable, style: Style) -> Figure:
    """Draw the number of ratings in each category."""
    some = _Some.of(result)
    load = some.load
    observed, again = _answers(result)
    most = int(max(observed.max(), again.max()))
    counts = [
        counts_of(name, observed[load == k], again[:, load == k], most)
        for k, name in enumerate(some.groups.names)
        if (load == k).any()
    ]
    return some.said(categories_figure(counts, style=style), style, curves=False)


def psychometric(result: Drawable, style: Style) -> Figure:
    """Draw the answers to pairs that contain the most frequently compared fabric."""
    constant, some = result.group("constant_data"), _Some.of(result)
    load, fabric = some.load, constant["fabric_index"].values
    fallback = constant["participant_index"].values * len(result.loads) + constant["load_index"].values
    rows = rows_of_pairs(constant["list_index"].values if "list_index" in constant else fallback)
    observed, again = (values[..., rows[:, 0]] for values in _answers(result))
    shown, names, modulus = [], _fabric_names(result), _fabric_modulus(result)
    for k, name in enumerate(some.groups.names):
        here = load[rows[:, 0]] == k
        if here.any():
            asked = fabric[rows[here]]
            shown.append(wins_of(name, names, modulus, asked, observed[here], again[:, here]))
    return some.said(psychometric_figure(shown, style=style), style, curves=False)


def _answers(result: Drawable) -> tuple[Array, Array]:
    """Return observed ratings, shape (rows,), and replicated ratings, shape (draws, rows)."""
    return result.group("observed_data")["rating"].values, result.group("posterior_predictive")["rating"].values[0]


def loo_pit(result: Drawable, style: Style) -> Figure:
    """Draw the LOO-PIT values of the ratings."""
    from softness_bayes.checking.check_table import LOO_PIT, PIT_POINTS

    return loo_pit_figure(result.group("constant_data")[LOO_PIT].values, PIT_POINTS, style=style)


def touch(result: Drawable, style: Style) -> Figure:
    """Draw pressure and stress under the finger pad, and the firing rates of its receptors."""
    stored = result.group("illustrations")
    low, middle, high = (stored.sel(quantile=level) for level in (0.025, 0.5, 0.975))

    def limits(name: str) -> Array:
        return np.stack([part[name].values for part in (low, middle, high)]) * 1e3

    touches = Touches(
        stored["distance_mm"].values * 1e-3,
        limits("touch_pressure_kpa"),
        limits("touch_stress_kpa"),
        middle["touch_rate_hz"].values,
        middle["touch_radius_mm"].values * 1e-3,
        [str(name) for name in stored["touch_load"].values],
        _touched_names(result),
        stored["touch_e_fab_kpa"].values * 1e3,
        np.stack([stored[f"receptor_{side}_mm"].values for side in "xy"], axis=-1) * 1e-3,
        stored["pad_mm"].values * 1e-3,
        stored["contact_centre_mm"].values * 1e-3,
    )
    return touch_figure(touches, style=style)


def _touched_names(result: Drawable) -> list[str]:
    """Return labels of the fabrics in the touch figure, including the names of rated fabrics."""
    stored, modulus = result.group("illustrations"), _given_modulus(result)
    found = []
    for what, at in zip(stored["touch_fabric"].values, stored["touch_e_fab_kpa"].values * 1e3, strict=True):
        same = np.flatnonzero(np.isclose(modulus, at, rtol=1e-6))
        found.append(f"{what} ({short_name(_fabric_names(result)[same[0]])})" if same.size else str(what))
    return found


def membrane(result: Drawable, style: Style) -> Figure:
    """Draw the firing rate against current, and example spike trains."""
    stored, examples = result.group("predictions").isel(chain=0), result.group("illustrations")
    return membrane_figure(
        stored["current_ua_cm2"].values,
        stored["firing_rate_hz"].values,
        stored["rheobase_ua_cm2"].values,
        stored["largest_current_ua_cm2"].values,
        examples["spike_time_ms"].values,
        examples["train_current_ua_cm2"].values,
        float(examples["train_duration_ms"]),
        style=style,
    )


def _given_modulus(result: Drawable) -> Array:
    """Return E_fab [Pa] of the fabrics as given; the middle of its law where it is sampled."""
    return np.asarray(result.group("constant_data")["effective_modulus_kpa"].values * 1e3)


def _fabric_modulus(result: Drawable) -> Array:
    """Return E_fab [Pa] of the fabrics; its posterior median where it is sampled."""
    limits = _modulus_limits(result)
    return _given_modulus(result) if limits is None else limits[1]


def _modulus_limits(result: Drawable) -> Array | None:
    """Return lower limit, median and upper limit of E_fab [Pa], (3, fabrics), all equal where it is known.

    None if no modulus is sampled.
    """
    from softness_bayes.checking.individual import MODULUS_LAW, UNCERTAIN, modulus_limits

    if MODULUS_LAW not in result.group("constant_data"):
        return None
    found, posterior, names = np.tile(_given_modulus(result), (3, 1)), result.group("posterior"), _fabric_names(result)
    found[:, [names.index(str(name)) for name in posterior[UNCERTAIN].values]] = 1e3 * modulus_limits(posterior)
    return found


def _fabric_names(result: Drawable) -> list[str]:
    return [str(name) for name in result.group("constant_data")["fabric"].values]


def _sampled(result: Drawable) -> list[str]:
    from softness_bayes.parameters.declared import EVERY_PARAMETER

    stored = result.group("posterior")
    return [name for name in EVERY_PARAMETER if name in stored]


def _labels(names: Sequence[str]) -> list[str]:
    from softness_bayes.parameters.declared import EVERY_PARAMETER

    return [EVERY_PARAMETER[name].label for name in names]


def _draws(result: Drawable, group: str, names: Sequence[str]) -> Array:
    """Return the draws of all chains, interleaved in time, shape (draws, parameters)."""
    stored = result.group(group)
    return np.stack([stored[name].values.T.ravel() for name in names], axis=-1)


def _walkers(result: Drawable, names: Sequence[str]) -> tuple[Array, NDArray[np.intp]]:
    stored = result.group("posterior")
    return np.stack([stored[name].values for name in names], axis=-1), stored["ensemble"].values
