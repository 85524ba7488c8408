"""Names of fabrics in figures, their thinning, and the tables of figures' data."""

from __future__ import annotations

import io

import numpy as np
import pandas as pd
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import findfont, get_font
from matplotlib.text import Annotation
from numpy.testing import assert_allclose

from softness_bayes.base.laws import LogNormal, Truncated
from softness_bayes.checking import check_table
from softness_bayes.checking.check_table import ALL, CheckedQuantity
from softness_bayes.checking.quantities import DROP, PLACE, QUANTITIES, QuantityCheck
from softness_bayes.parameters.declared import EVERY_PARAMETER
from softness_bayes.plotting import style as styles
from softness_bayes.plotting.checks import FEW, checks
from softness_bayes.plotting.figures import FIGURES
from softness_bayes.plotting.panels import LONGEST, name_fabrics, short_name, short_names
from softness_bayes.plotting.parameters import informative, prior
from softness_bayes.plotting.style import DATA, USUAL, files_of
from support.figures import FABRICS, LOADS, artist, drawn, invented_curves, invented_draws, invented_run


def named(figure: Figure, load: str) -> list[Annotation]:
    return [
        each
        for each in figure.findobj(Annotation)
        if str(each.get_gid()).startswith(f"name/{load}/") and each.get_text()
    ]


@pytest.mark.parametrize("count", [12, 600])
def test_names_stand_apart_at_any_number_of_fabrics(count: int) -> None:
    """At 12 all are named, at 600 as many as fit, and no two touch."""
    loads = LOADS["mixture"]
    curves = invented_curves(loads, 5)
    # some lie close together
    moduli = np.geomspace(FABRICS.min(), FABRICS.max(), count) ** np.linspace(0.999, 1.0, count)
    names = [f"fabric number {k:03d}" for k in range(count)]
    figure = drawn(FIGURES["response"](invented_run(loads, curves, moduli, names)))
    renderer = FigureCanvasAgg(figure).get_renderer()
    for load in map(str, loads):
        labels = named(figure, load)
        assert len(labels) == count if count <= 12 else 12 <= len(labels) < count
        boxes = sorted((label.get_window_extent(renderer) for label in labels), key=lambda box: box.x0)
        # an annotation's extent includes its line: the letters alone are as wide as the text is high
        centres = np.array([label.get_transform().transform(label.get_position())[0] for label in labels])
        assert np.diff(np.sort(centres)).min() >= labels[0].get_size() * figure.dpi / 72.0
        assert all(box.x0 >= -1 and box.x1 <= figure.bbox.x1 + 1 for box in boxes)
    said = figure.legends[0].get_title().get_text()
    assert said == ("" if count <= 12 else f"{len(labels)} of 600 fabrics are named")


def test_long_names_keep_what_tells_them_apart() -> None:
    assert [short_name("lawn"), short_name("$lawn$")] == ["lawn", r"\$lawn\$"]
    first, second = (short_name(f"cotton twill, bleached, number {k}") for k in (1, 2))
    assert len(first) == LONGEST
    assert first != second
    assert first.startswith("cotton")
    names = [f"fabric number {k:03d} of the lot" for k in range(600)]
    assert short_names(names)[7] == "…007…"
    assert len({*short_names(names)}) == 600
    assert short_names(["lawn", "felt"]) == ["lawn", "felt"]
    assert short_names(["cloth", "cloth"]) == ["cloth", "cloth"]  # nothing tells them apart


def test_fabrics_outside_of_a_panel_are_not_named() -> None:
    axes = Figure().subplots()
    axes.set(xscale="log", xlim=(1.0, 10.0))
    assert name_fabrics(axes, [0.5, 2.0, 20.0], ["a", "b", "c"], USUAL, "x") == 1
    assert [text.get_text() for text in axes.texts] == ["b"]


def test_the_data_of_a_figure_are_those_of_its_artists() -> None:
    loads = LOADS["mixture"]
    curves = invented_curves(loads, 20)
    figure = FIGURES["response"](invented_run(loads, curves, names=["=gauze", "lawn", "felt"]))
    files = files_of(figure, "response", (DATA,))
    assert [*files] == ["response.csv"]
    table = pd.read_csv(io.BytesIO(files["response.csv"]))
    panel = table[table["panel"] == "3 mm"].set_index("element")
    assert_allclose(panel.loc["median", "x"], curves.modulus / 1e3, rtol=1e-6)
    assert_allclose(panel.loc["median", "y"], np.median(curves.total_rate[:, 1], axis=0), rtol=1e-6, atol=1e-6)
    limits = np.quantile(curves.total_rate[:, 1], [0.05, 0.95], axis=0)
    assert_allclose(panel.loc["band90", ["y", "y_end"]].to_numpy().T, limits, rtol=1e-6, atol=1e-6)
    assert panel.loc["fabrics", "name"].tolist() == ["'=gauze", "lawn", "felt"]  # no formula
    assert panel.loc["fabrics", "y"].isna().all()  # marks at the foot have no height
    assert {*table["x_axis"]} == {"fabric modulus E_fab [kPa]"}
    assert {*table["y_axis"].dropna()} == {"total rate [spikes/s]"}
    assert not {"name", "guide"} & {*table["element"]}


def test_the_most_correlated_parameters_come_first(rng) -> None:
    draws = rng.standard_normal((2000, 5))
    draws[:, 3] = -draws[:, 1] + 0.1 * rng.standard_normal(2000)
    draws[:, 4] = np.exp(draws[:, 0] + rng.standard_normal(2000))
    assert informative(draws, 2) == [1, 3]
    assert informative(draws, 4) == [1, 3, 0, 4]
    assert sorted(informative(draws, 9)) == [0, 1, 2, 3, 4]


def test_a_prior_is_drawn_exactly(rng) -> None:
    law = Truncated(LogNormal(2.0, 0.3), -np.inf, EVERY_PARAMETER["b"].largest)
    run, _ = invented_draws(rng.uniform(1.8, 2.2, (1, 500, 2)), np.full((1, 10, 2), 2.0))
    run.tree.attrs["prior_b"] = "lognormal(2,0.3)"
    figure = drawn(prior(run, USUAL))
    line = artist(figure, "prior/0")
    x, y = line.get_xdata(), line.get_ydata()
    assert_allclose(y, np.exp(law.log_density(x)))
    assert x[0] == pytest.approx(law.quantile(0.05))
    within = law.cumulative(x[-1]) - law.cumulative(x[0])
    assert np.trapezoid(y, x) == pytest.approx(float(within), rel=1e-3)
    assert artist(figure, "prior/1").get_data().values.size  # without a law, its draws


def checked(quantity, observed, replicated, labels, low=-1.0, high=1.0):
    """A test quantity as figures receive it."""
    findings = [QuantityCheck(value, 0.0, low, high, 0.5, 0.5) for value in np.atleast_1d(observed)]
    return CheckedQuantity(quantity, labels, findings, np.asarray(replicated, float))


def test_few_replicates_are_drawn_one_by_one_and_what_neither_has_is_left_out(rng, monkeypatch) -> None:
    of = {one.name: one for one in QUANTITIES}
    labels = [("1 mm", "lawn", ALL), ("1 mm", "felt", ALL)]
    means = checked(of["mean log rating"], [0.0, 2.0], np.zeros((500, 2)), labels)
    some, many = (np.where(np.arange(500) < n, rng.uniform(1, 2, 500), np.nan)[:, None] for n in (FEW - 1, FEW))
    spreads = [checked(of[n], 1.5, v, [(ALL, ALL, ALL)]) for n, v in (("residual spread", some), (DROP, many))]
    absent = checked(of[PLACE], np.nan, np.full((500, 1), np.nan), [("1 mm", ALL, ALL)])
    monkeypatch.setattr(check_table, "posterior_quantities", lambda tree: [means, *spreads, absent])
    figure = drawn(checks(invented_run(moduli=[1e3, 1e4], names=["lawn", "felt"]), USUAL))
    ticks = np.array([segment[0, 0] for segment in artist(figure, "each/0").get_segments()])
    assert_allclose(ticks, some[: FEW - 1, 0])
    assert artist(figure, "replicates/1").get_data().values.sum() == pytest.approx(1.0)
    words = [text.get_text() for axes in figure.axes[1:] for text in axes.texts]
    assert words == [f"p = 0.50\nin {n} of 500 replicates" for n in (FEW - 1, FEW)]
    # the one fabric that lies outside of its limits is named
    assert [text.get_text() for text in figure.axes[0].texts] == ["felt"]
    assert figure.legends[0].get_title().get_text().endswith("1 of 3 quantities")


def test_letters_that_the_usual_font_lacks_come_from_another_that_is_installed(monkeypatch):
    """A letter of STIX stands for those of other scripts; without that family it is missing, which matplotlib says."""
    usual, other = (get_font(findfont(family)).get_charmap() for family in ("DejaVu Sans", "STIXGeneral"))
    letter = chr(min(set(other) - set(usual)))

    def drawn():
        with USUAL.applied():
            figure = Figure()
            figure.text(0.5, 0.5, f"satin {letter}")
            FigureCanvasAgg(figure).draw()

    monkeypatch.setattr(styles, "OTHER_SCRIPTS", ("No such family", "STIXGeneral"))
    styles._other_families.cache_clear()
    drawn()
    monkeypatch.setattr(styles, "OTHER_SCRIPTS", ("No such family",))
    styles._other_families.cache_clear()
    with pytest.warns(UserWarning, match="missing from font"):
        drawn()
    styles._other_families.cache_clear()
