"""The table of figures: what each shows of a result, how it is chosen, styled and written."""

from __future__ import annotations

import matplotlib
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from click.testing import CliRunner
from numpy.testing import assert_allclose

from softness_bayes.base.errors import InputError
from softness_bayes.checking.check_table import posterior_quantities
from softness_bayes.checking.quantities import Columns, simultaneous_band
from softness_bayes.cli import main
from softness_bayes.plotting.checks import FEW, loo_pit
from softness_bayes.plotting.figures import FIGURES, figures_of
from softness_bayes.plotting.style import USUAL, Style
from softness_bayes.results.result import Result
from support.figures import artist, drawn, invented_run, outline


@pytest.fixture(scope="module")
def run(report_run) -> Result:
    return report_run("ratings")


@pytest.fixture(scope="module")
def directory(run, tmp_path_factory):
    path = tmp_path_factory.mktemp("run") / "results"
    run.save(path)
    return path


def test_touch_shows_the_stored_profiles_and_every_receptor_once(run):
    figure, stored = drawn(run.plot.touch()), run.group("illustration_data")
    middle = stored.sel(quantile=0.5)
    places = np.stack([stored["receptor_x_mm"], stored["receptor_y_mm"]], axis=-1)
    for k, load in enumerate(stored["touch_load"].values):
        for fabric in range(stored.sizes["touch_fabric"]):
            for what in ("stress", "pressure"):
                line = artist(figure, f"{what}/{load}/{fabric}")
                assert_allclose(line.get_xdata(), stored["distance_mm"])
                assert_allclose(line.get_ydata(), middle[f"touch_{what}_kpa"][k, fabric])
            limits = [stored["touch_stress_kpa"].sel(quantile=q)[k, fabric] for q in (0.05, 0.95)]
            assert_allclose(outline(artist(figure, f"band90/{load}/{fabric}")), limits)
            firing, silent = (artist(figure, f"{kind}/{load}/{fabric}") for kind in ("firing", "silent"))
            shown = np.concatenate([firing.get_offsets(), silent.get_xydata()])
            assert_allclose(np.sort(shown, axis=0), np.sort(places, axis=0))
            away = np.hypot(*(np.asarray(firing.get_offsets()) - stored["contact_centre_mm"].values).T)
            rate = np.interp(away, stored["distance_mm"], middle["touch_rate_hz"][k, fabric])
            assert_allclose(firing.get_array(), rate, rtol=1e-12)
            assert (rate > 0).all()


def test_membrane_shows_the_quantiles_of_the_rates_and_the_trains(run):
    figure = drawn(run.plot.membrane())
    rate = run.group("predictions")["firing_rate_hz"].values[0]
    assert_allclose(artist(figure, "median/rate").get_ydata(), np.median(rate, axis=0))
    for level, limits in ((50, (0.25, 0.75)), (90, (0.05, 0.95))):
        assert_allclose(outline(artist(figure, f"band{level}/rate")), np.quantile(rate, limits, axis=0))
    rheobase = run.group("predictions")["rheobase_ua_cm2"].values.ravel()
    assert_allclose(artist(figure, "rheobase").get_xdata(), np.quantile(rheobase, [0.05, 0.95]))
    for k, train in enumerate(run.group("illustration_data")["spike_time_ms"].values):
        assert artist(figure, f"train/{k}").get_positions() == train[np.isfinite(train)].tolist()


def test_checks_show_every_quantity_of_the_table(run):
    figure, table = drawn(run.plot.predictive_checks()), run.tables["predictive_checks"].loc["posterior"]
    means = table.loc[["mean log rating"]]
    for load in map(str, run.loads):
        rows = means[means["load"] == load]
        assert_allclose(artist(figure, f"observed/{load}").get_ydata(), rows["observed"])
        ends = np.array([segment[:, 1] for segment in artist(figure, f"limits/{load}").get_segments()])
        assert_allclose(ends, rows[["low", "high"]])
    scalar = [q for q in posterior_quantities(run.tree) if q.quantity.columns in (Columns.ALL, Columns.LOAD)]
    columns = [(found.observed, q.replicated[:, k]) for q in scalar for k, found in enumerate(q.findings)]
    # what neither data nor replicates have is left out
    columns = [(seen, values) for seen, values in columns if np.isfinite(seen) or np.isfinite(values).any()]
    assert len(figure.axes) == len(run.loads) + len(columns)
    for place, (observed, replicated) in enumerate(columns):
        drawn_steps = figure.findobj(lambda each, gid=f"replicates/{place}": each.get_gid() == gid)
        assert [steps.get_data().values.sum() for steps in drawn_steps] == pytest.approx([1.0] * len(drawn_steps))
        assert drawn_steps or np.isfinite(replicated).sum() < FEW
        lines = figure.findobj(lambda each, gid=f"observed/{place}": each.get_gid() == gid)
        assert [line.get_xdata()[0] for line in lines] == ([observed] if np.isfinite(observed) else [])


def test_loo_pit_shows_the_distribution_of_the_values_and_the_band(run):
    figure = drawn(run.plot.loo_pit())
    pit = run.group("constant_data")["loo_pit"].values
    x = np.arange(1, 100) / 100
    assert_allclose(artist(figure, "ecdf").get_ydata(), (pit[:, None] <= x).mean(axis=0) - x, atol=1e-12)
    low, high = simultaneous_band(pit.size, x, 0.9)
    corners = artist(figure, "band").get_paths()[0].vertices[:, 1]
    assert_allclose([corners.min(), corners.max()], [(low - x).min(), (high - x).max()])
    assert "approximate" in " ".join(text.get_text() for text in figure.legends[0].get_texts())
    # the figure tells uniform values from those of predictions that are far too wide
    for values, inside in ((np.random.default_rng(4).uniform(size=200), True), (0.5 + 0.1 * (pit - 0.5), False)):
        groups = {"constant_data": xr.Dataset({"loo_pit": ("rating_row", values)})}
        figure = drawn(loo_pit(invented_run(groups=groups), USUAL))
        shown, (low, high) = artist(figure, "ecdf").get_ydata() + x, simultaneous_band(values.size, x, 0.95)
        assert ((shown >= low) & (shown <= high)).all() == inside


def test_ratings_against_the_ratio_stand_at_each_draws_own(run):
    figure, load = drawn(run.plot.rating_ratio()), run.loads[0]
    stored = run.group("predictions").isel(chain=0)
    log_modulus = np.log(stored["e_fab_kpa"].values)
    log_ratio = log_modulus - np.log(stored["e_skin_kpa"].values[:, 0])
    median = artist(figure, f"median/{load}")
    x = np.log(median.get_xdata())
    assert [x[0], x[-1]] == pytest.approx([log_ratio[:, 0].max(), log_ratio[:, -1].min()])
    ratings = [np.interp(x, *pair) for pair in zip(log_ratio, stored["typical_rating"].values[:, 0], strict=True)]
    assert_allclose(median.get_ydata(), np.median(ratings, axis=0), rtol=1e-9)
    fabrics = np.log(run.group("constant_data")["effective_modulus_kpa"].values)
    places = np.exp(np.median([np.interp(fabrics, log_modulus, ratio) for ratio in log_ratio], axis=0))
    assert_allclose(artist(figure, f"ratings/{load}").get_xdata(), places)
    # the same ratings over E_fab: the two axes differ by nothing else
    plain = artist(drawn(run.plot.rating()), f"ratings/{load}")
    assert_allclose(plain.get_ydata(), artist(figure, f"ratings/{load}").get_ydata())


def test_every_figure_is_a_method_that_says_what_it_shows(run):
    for name, drawing in FIGURES.items():
        method = getattr(type(run.plot), name)
        assert method.__doc__ == f"Draw {drawing.shows}."
    others = {"compression", "recorded", "category_counts", "psychometric"}
    assert figures_of(run, every=True) == [name for name in FIGURES if name not in others]
    assert {*figures_of(run, every=True)} - {*figures_of(run)} == {"corner_all"}
    with pytest.raises(InputError, match="no compression data"):
        run.plot.compression()
    with pytest.raises(InputError, match="'histogram'; expected some of response, "):
        run.plot("histogram")
    with pytest.raises(AttributeError):
        run.plot.histogram  # noqa: B018


def test_a_figure_without_its_data_says_what_is_missing(run):
    lacking = Result(run.tree.drop_nodes("illustration_data"), run.table, run.tables)
    assert {*figures_of(run)} - {*figures_of(lacking)} == {"touch"}
    with pytest.raises(InputError, match="no stored touches"):
        lacking.plot.touch()


def test_what_a_notebook_shows(run):
    assert run.plot.loo_pit()._repr_png_().startswith(b"\x89PNG")
    tree = run.tree.copy()
    tree.attrs = {**run.tree.attrs, "verdict": "Converged <fine>."}
    summary = pd.DataFrame({"mean": [1.23456, 2.0]}, index=pd.Index(["b", "gamma"], name="parameter"))
    page = Result(tree, summary, run.tables)._repr_html_()
    assert "Converged &lt;fine&gt;." in page
    assert page.count("<table") == 2
    assert "p_interior" in page
    assert "1.235" in page
    assert "1.23456" not in page


def test_plot_draws_what_is_asked_for(directory, tmp_path):
    style = tmp_path / "thin.mplstyle"
    style.write_text("lines.linewidth: 3\naxes.prop_cycle: cycler('color', ['112233', 'aa0000'])\n")
    shown = ["--figures", "membrane", "--figures", "response", "--format", "svg", "--style", str(style)]
    done = CliRunner().invoke(main, ["plot", str(directory), *shown, "--out", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    drawn = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert drawn == [".softness-bayes.json", "membrane.svg", "response.svg"]
    assert done.output.split() == [str(tmp_path / "out" / f"{name}.svg") for name in ("membrane", "response")]
    drawing = (tmp_path / "out" / "membrane.svg").read_text()
    assert "#112233" in drawing
    assert USUAL.posterior.lower() not in drawing.lower()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--figures", "response", "--figures", "histogram"], "no 'histogram'; expected some of response, response_ra"),
        (["--figures", "compression"], "no compression data"),
        (["--format", "bmp"], "unknown format 'bmp', expected one of png, pdf, svg"),
        (["--style", "absent.mplstyle"], "absent.mplstyle: no such file"),
    ],
)
def test_plot_refuses_what_it_cannot_draw(directory, tmp_path, arguments, said):
    done = CliRunner().invoke(main, ["plot", str(directory), *arguments, "--out", str(tmp_path / "out")])
    assert done.exit_code == 2
    assert said in done.output
    assert not (tmp_path / "out").exists() or not any((tmp_path / "out").iterdir())


def test_a_style_file_sets_colours_widths_and_settings(tmp_path, run):
    path = tmp_path / "mine.mplstyle"
    path.write_text("font.size: 11\nfigure.figsize: 3.4, 2\naxes.prop_cycle: cycler('color', ['010203', '0a0b0c'])\n")
    style = Style.read(path)
    assert (style.posterior, style.data, style.inflection) == ("#010203", "#0a0b0c", USUAL.inflection)
    assert (style.page, style.column) == (3.4, 3.4)
    before = dict(matplotlib.rcParams)
    figure = drawn(run.plot.response(style))
    assert dict(matplotlib.rcParams) == before
    assert figure.get_size_inches()[0] == 3.4
    assert artist(figure, f"median/{run.loads[0]}").get_color() == "#010203"
    assert {**style.rc}["font.size"] == 11


@pytest.mark.parametrize("text", [b"no.such.setting: 1\n", b"\xff\xfe\x00"])
def test_a_style_file_that_matplotlib_does_not_know_is_refused(tmp_path, text):
    path = tmp_path / "bad.mplstyle"
    path.write_bytes(text)
    with pytest.raises(InputError, match=r"bad\.mplstyle: not a style file"):
        Style.read(path)
