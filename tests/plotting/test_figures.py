"""The table of figures: what each shows of a result, how it is chosen, styled and written."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose

from softness_bayes.arviz_bridge import to_tree
from softness_bayes.checking.agreement import TYPICAL
from softness_bayes.checking.check_table import check_table, posterior_quantities
from softness_bayes.checking.quantities import Columns
from softness_bayes.checking.turning_check import EXCESS, PLATEAU, TurnQuantities
from softness_bayes.checking.uniformity import simultaneous_band
from softness_bayes.cli import main
from softness_bayes.errors import InputError
from softness_bayes.plotting import FIGURES, USUAL, Style, figures_of, rating_figure
from softness_bayes.results.result import Result
from support.figures import artist, drawn, finished_run, outline

FABRICS, LOADS, RATINGS = 3, 2, 24


def whole_run() -> Result:
    """Return the finished run of other tests with all that newer figures show, as a run stores it."""
    rng = np.random.default_rng(21)
    result = finished_run()
    quantiles, distance, current = np.array([0.025, 0.25, 0.5, 0.75, 0.975]), np.linspace(0, 20, 41), np.arange(16, 25)
    fall = np.exp(-((distance / 3) ** 2)) * np.arange(1, 4)[:, None]
    level = np.arange(1.0, 6.0)[:, None, None, None] * np.arange(1.0, 3.0)[:, None, None] * fall
    along = ("quantile", "touch_load", "touch_fabric", "distance_mm")
    pairs = {"receptor_x_mm": rng.uniform(0, 30, 200), "receptor_y_mm": rng.uniform(0, 20, 200)}
    illustrations = {
        "touch_pressure_kpa": 1.2 * level,
        "touch_stress_kpa": level,
        "touch_rate_hz": np.maximum(level - 2.0, 0.0),
        "touch_radius_mm": np.full((5, 2, 3), 4.0),
        "touch_e_fab_kpa": np.array([3.0, 200.0, 500.0]),
        **pairs,
        "pad_mm": np.array([30.0, 20.0]),
        "contact_centre_mm": np.array([12.0, 10.0]),
        "spike_time_ms": np.array([[40.0, np.nan, np.nan], [20.0, 60.0, 100.0]]),
        "train_current_ua_cm2": np.array([18.5, 21.0]),
        "train_duration_ms": np.array(250.0),
    }
    rate = 10 * np.sqrt(np.maximum(current - rng.normal(18, 0.3, (20, 1)), 0.0))
    more = to_tree(
        {
            "illustrations": illustrations,
            "posterior_predictive": {
                name: np.exp(rng.standard_normal((1, 60, RATINGS))) for name in ("rating", "rating_of_new_participants")
            },
            "prior_predictive": {"rating": np.exp(rng.standard_normal((1, 50, RATINGS)))},
            "log_likelihood_participant": {"ratings_of_participant": np.zeros((1, 60, 4))},
            "constant_data": {"loo_pit": rng.uniform(size=RATINGS), EXCESS: np.zeros(RATINGS)},
            PLATEAU: {f"levelled_{name}": np.full((1, 60, LOADS), np.nan) for name in TurnQuantities._fields},
            "predictions": {
                "firing_rate_hz": rate[None],
                TYPICAL: np.exp(rng.standard_normal((1, 20, FABRICS * LOADS))),
                "rheobase_ua_cm2": rng.normal(18, 0.3, (1, 20)),
                "largest_current_ua_cm2": rng.normal(21, 0.5, (1, 20)),
            },
        },
        {
            **dict.fromkeys(["touch_pressure_kpa", "touch_stress_kpa", "touch_rate_hz"], along),
            "touch_radius_mm": along[:3],
            "touch_e_fab_kpa": ("touch_fabric",),
            **dict.fromkeys(pairs, ("receptor",)),
            **dict.fromkeys(["pad_mm", "contact_centre_mm"], ("side",)),
            "spike_time_ms": ("train", "spike"),
            "train_current_ua_cm2": ("train",),
            **dict.fromkeys(["rating", "rating_of_new_participants", "loo_pit", EXCESS], ("rating_row",)),
            "ratings_of_participant": ("participant",),
            **{f"levelled_{name}": ("load",) for name in TurnQuantities._fields},
            "firing_rate_hz": ("current_ua_cm2",),
            TYPICAL: ("condition",),
        },
        {
            "quantile": quantiles,
            "touch_load": ["1 mm", "0.5 N"],
            "touch_fabric": ["softest fabric", "at the turning point", "stiffest fabric"],
            "distance_mm": distance,
            "current_ua_cm2": current,
            "participant": ["P1", "P2", "P3", "P4"],
        },
    )
    tree = result.tree.copy()
    for name, child in more.children.items():
        dataset = child.to_dataset()
        tree[name] = tree[name].to_dataset().merge(dataset) if name in tree.children else dataset
    found = {
        "direction": "rises-with-firing",
        "rating_scale": "magnitude",
        "schema_version": 1,
        "verdict": "Converged <fine>.",
    }
    tree.attrs.update(found)
    summary = pd.DataFrame({"mean": [1.23456, 2.0]}, index=pd.Index(["b", "gamma"], name="parameter"))
    return Result(tree, summary, {"predictive_checks": check_table(tree)})


@pytest.fixture(scope="module")
def run() -> Result:
    return whole_run()


@pytest.fixture(scope="module")
def directory(run, tmp_path_factory):
    path = tmp_path_factory.mktemp("run") / "results"
    run.save(path)
    return path


def test_touch_shows_the_stored_profiles_and_every_receptor_once(run):
    figure, stored = drawn(run.plot.touch()), run.group("illustrations")
    middle = stored.sel(quantile=0.5)
    places = np.stack([stored["receptor_x_mm"], stored["receptor_y_mm"]], axis=-1)
    for k, load in enumerate(stored["touch_load"].values):
        for fabric in range(3):
            for what in ("stress", "pressure"):
                line = artist(figure, f"{what}/{load}/{fabric}")
                assert_allclose(line.get_xdata(), stored["distance_mm"])
                assert_allclose(line.get_ydata(), middle[f"touch_{what}_kpa"][k, fabric])
            limits = [stored["touch_stress_kpa"].sel(quantile=q)[k, fabric] for q in (0.025, 0.975)]
            assert_allclose(outline(artist(figure, f"band95/{load}/{fabric}")), limits)
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
    for level, limits in ((50, (0.25, 0.75)), (95, (0.025, 0.975))):
        assert_allclose(outline(artist(figure, f"band{level}/rate")), np.quantile(rate, limits, axis=0))
    rheobase = run.group("predictions")["rheobase_ua_cm2"].values.ravel()
    assert_allclose(artist(figure, "rheobase").get_xdata(), np.quantile(rheobase, [0.025, 0.975]))
    assert artist(figure, "train/0").get_positions() == [40.0]
    assert artist(figure, "train/1").get_positions() == [20.0, 60.0, 100.0]


def test_checks_show_every_quantity_of_the_table(run):
    figure, table = drawn(run.plot.predictive_checks()), run.tables["predictive_checks"].loc["posterior"]
    means = table.loc[["mean log rating"]]
    for load in ("1 mm", "0.5 N"):
        rows = means[means["load"] == load]
        assert_allclose(artist(figure, f"observed/{load}").get_ydata(), rows["observed"])
        ends = np.array([segment[:, 1] for segment in artist(figure, f"limits/{load}").get_segments()])
        assert_allclose(ends, rows[["low", "high"]])
    scalar = [q for q in posterior_quantities(run.tree) if q.quantity.columns in (Columns.ALL, Columns.LOAD)]
    columns = [(found.observed, q.replicated[:, k]) for q in scalar for k, found in enumerate(q.findings)]
    # what neither data nor replicates have is left out
    columns = [(seen, values) for seen, values in columns if np.isfinite(seen) or np.isfinite(values).any()]
    assert len(figure.axes) == LOADS + len(columns)
    for place, (observed, replicated) in enumerate(columns):
        heights = artist(figure, f"replicates/{place}").get_data().values
        assert heights.sum() == pytest.approx(1.0 if np.isfinite(replicated).any() else 0.0)
        lines = figure.findobj(lambda each, gid=f"observed/{place}": each.get_gid() == gid)
        assert [line.get_xdata()[0] for line in lines] == ([observed] if np.isfinite(observed) else [])


def test_quantities_agree_with_the_table_of_checks(run):
    table = run.tables["predictive_checks"].loc["posterior"]
    for found in posterior_quantities(run.tree):
        rows = table.loc[[found.quantity.name]]
        observed = [finding.observed for finding in found.findings]
        assert_allclose(observed, rows["observed"])
        assert_allclose([finding.high for finding in found.findings], rows["high"])
        above = np.array(
            [
                np.mean(known > value) if known.size and np.isfinite(value) else np.nan
                for value, column in zip(observed, found.replicated.T, strict=True)
                for known in [column[np.isfinite(column)]]
            ]
        )
        if found.quantity.columns is not Columns.LOAD:  # no ties
            assert_allclose(above, rows["p_value"])


def test_loo_pit_lies_in_the_band_only_if_uniform(run):
    figure = drawn(run.plot.loo_pit())
    pit = run.group("constant_data")["loo_pit"].values
    x = np.arange(1, 100) / 100
    share = (pit[:, None] <= x).mean(axis=0)
    assert_allclose(artist(figure, "ecdf").get_ydata(), share - x, atol=1e-12)
    band = simultaneous_band(RATINGS, x)
    assert ((share >= band.low) & (share <= band.high)).all()
    corners = artist(figure, "band").get_paths()[0].vertices[:, 1]
    assert_allclose([corners.min(), corners.max()], [(band.low - x).min(), (band.high - x).max()])
    assert "approximate" in " ".join(text.get_text() for text in figure.legends[0].get_texts())
    narrow = 0.5 + 0.1 * (pit - 0.5)  # predictions far too wide
    share = (narrow[:, None] <= x).mean(axis=0)
    assert not ((share >= band.low) & (share <= band.high)).all()


def test_ratings_against_the_ratio_stand_at_each_draws_own(run):
    figure = drawn(run.plot.rating_ratio())
    stored = run.group("predictions").isel(chain=0)
    log_ratio = np.log(stored["e_fab_kpa"].values / stored["e_skin_kpa"].values[:, 0])
    median = artist(figure, "median/1 mm")
    x = np.log(median.get_xdata())
    assert x[0] == pytest.approx(log_ratio[:, 0].max())
    assert x[-1] == pytest.approx(log_ratio[:, -1].min())
    own = [np.interp(x, *pair) for pair in zip(log_ratio, stored["typical_rating"].values[:, 0], strict=True)]
    assert_allclose(median.get_ydata(), np.median(own, axis=0), rtol=1e-9)
    fabrics = run.group("constant_data")["effective_modulus_kpa"].values
    skin = stored["e_skin_kpa"].values[:, 0, 0]  # the same along the invented curves
    assert_allclose(
        artist(figure, "ratings/1 mm").get_xdata(), np.exp(np.median(np.log(fabrics[:, None] / skin), axis=1))
    )
    # the same ratings over E_fab: the two axes differ by nothing else
    plain = artist(drawn(run.plot.rating()), "ratings/1 mm")
    assert_allclose(plain.get_ydata(), artist(figure, "ratings/1 mm").get_ydata())


def test_every_figure_is_a_method_that_says_what_it_shows(run):
    for name, drawing in FIGURES.items():
        method = getattr(type(run.plot), name)
        assert method.__doc__ == f"Draw {drawing.shows}."
    others = {"compression", "category_counts", "psychometric"}
    assert figures_of(run, every=True) == [name for name in FIGURES if name not in others]
    assert {*figures_of(run, every=True)} - {*figures_of(run)} == {"corner_all"}
    with pytest.raises(InputError, match="no compression data"):
        run.plot.compression()
    with pytest.raises(InputError, match="'histogram'; expected some of response, "):
        run.plot("histogram")
    with pytest.raises(AttributeError):
        run.plot.histogram  # noqa: B018


def test_a_figure_without_its_data_says_what_is_missing(run):
    lacking = Result(run.tree.drop_nodes("illustrations"), run.table, run.tables)
    assert {*figures_of(run)} - {*figures_of(lacking)} == {"touch"}
    with pytest.raises(InputError, match="no stored touches"):
        lacking.plot.touch()


def test_what_a_notebook_shows(run):
    assert run.plot.loo_pit()._repr_png_().startswith(b"\x89PNG")
    page = run._repr_html_()
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
    figure = drawn(run.plot.response(style))
    assert figure.get_size_inches()[0] == 3.4
    assert artist(figure, "median/1 mm").get_color() == "#010203"
    assert {**style.rc}["font.size"] == 11


@pytest.mark.parametrize("text", [b"no.such.setting: 1\n", b"lines.linewidth: wide\n", b"\xff\xfe\x00"])
def test_a_style_file_that_matplotlib_does_not_know_is_refused(tmp_path, text):
    path = tmp_path / "bad.mplstyle"
    path.write_bytes(text)
    with pytest.raises(InputError, match=r"bad\.mplstyle: not a style file"):
        Style.read(path)


def test_a_narrow_page_folds_its_panels(run, tmp_path):
    path = tmp_path / "column.mplstyle"
    path.write_text("figure.figsize: 3.4, 2\n")
    style = Style.read(path)
    wide, narrow = drawn(run.plot.prior()), drawn(run.plot.prior(style))
    columns = [len({round(axes.get_position().x0, 3) for axes in figure.axes}) for figure in (wide, narrow)]
    assert columns == [3, 2] or columns == [2, 2]
    for figure in (narrow, drawn(run.plot.touch(style))):
        assert figure.get_size_inches()[0] == pytest.approx(3.4)


def test_figures_are_laid_out_once_and_stay_as_they_were(run, tmp_path):
    from softness_bayes.plotting import save

    figure = run.plot.loo_pit()
    engine = figure.get_layout_engine()
    save(figure, tmp_path / "first", ("png", "pdf"))
    assert figure.get_layout_engine() is engine
    save(figure, tmp_path / "second", ("png",))
    assert (tmp_path / "first.png").read_bytes() == (tmp_path / "second.png").read_bytes()


def test_rating_figure_needs_a_load_for_each_curve(run):
    with pytest.raises(InputError, match="1 loads for 2"):
        rating_figure([1.0, 2.0], np.ones((3, 2, 2)), None, run.loads[:1], skin_modulus=np.ones((3, 2, 2)))
