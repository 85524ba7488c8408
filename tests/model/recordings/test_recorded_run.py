"""Recorded afferents from their file to a result: alone, beside plates, simulated and real."""

import dataclasses
import json

import numpy as np
import pandas as pd
import pytest
from scipy.stats import kstest, norm

from softness_bayes.base.errors import InputError
from softness_bayes.checking.provenance import Agreement, Provenance, attributes_of
from softness_bayes.checking.sentences import recorded_faults, recorded_sentences
from softness_bayes.data import Afferents, Compression, Experiment, Fabrics, Measurements
from softness_bayes.likelihood.contract import NO_RESPONSE
from softness_bayes.likelihood.error_laws import NORMAL
from softness_bayes.likelihood.scales import RISES
from softness_bayes.model.build import build, build_skin
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.scenes import usual_values
from softness_bayes.model.simulation import simulate_afferents, simulate_compression, simulate_ratings
from softness_bayes.plotting.figures import figures_of
from softness_bayes.results.other_data import agreements, log_additive_sd, shifts
from softness_bayes.results.result import Result
from softness_bayes.runs.comparison import compare
from softness_bayes.runs.run import sample
from softness_bayes.touch.contact import Force
from softness_bayes.touch.readings import MENDED
from support.command_line import call, refused

TRUTH = {"b_rec": 8.0, "m_rec": 3.9, "alpha_rec": 40.0, "beta_rec": 0.02, "rest_rec": 0.97, "sd_rate": 4.0}
COUNTED = {**{name: TRUTH[name] for name in TRUTH if name != "sd_rate"}, "tau_afferent": 0.25, "fano": 0.6}


pytestmark = pytest.mark.usefixtures("short_pilot")


def probed(**columns):
    """Return a table of three forces and seven curvatures, with placeholders for the rates."""
    force, curvature = np.meshgrid([0.1, 0.15, 0.2], [0.0, 80.0, 170.0, 260.0, 340.0, 520.0, 690.0])
    table = {"force_n": force.ravel(), "probe_curvature_per_m": curvature.ravel(), "distance_mm": 0.0}
    return pd.DataFrame(table | (columns or {"rate_hz": 30.0}))


def simulated(seed, truth=TRUTH, table=None, recording=""):
    """Return a table whose responses the package draws at known parameters."""
    table = probed() if table is None else table.copy()
    made = simulate_afferents(np.random.default_rng(seed), Afferents.read(table), truth)
    table["count" if "count" in table else "rate_hz"] = made.count if "count" in table else made.rate
    return table.assign(recording=recording) if recording else table


def spiking():
    """Return a table of counts of three named afferents."""
    one = probed(count=10.0, window_s=0.5)[::2]
    return pd.concat([one.assign(afferent=name) for name in ("u1", "u2", "u3")], ignore_index=True)


def plates(seed, b=8.0):
    """Return forces of a plate on eight fingers of known skin."""
    skin = {"b": b, "m": 3.9, "tau_b": 0.1, "tau_m": 0.1, "varsigma_f": 0.1}
    return simulate_compression(np.random.default_rng(seed), skin).compression


# the file


def written(tmp_path, text):
    path = tmp_path / "afferents.csv"
    path.write_text(text)
    return path


def test_rows_are_read_with_their_units_and_missing_ones_dropped(tmp_path):
    head = "afferent,force (gf),probe_curvature_per_m,distance_mm,rate_hz,n,sd_hz,species\n"
    read = Afferents.read(written(tmp_path, f"{head}u2,10,0,1,20,,,monkey\n,20,80.6,0,30,9,4,monkey\nu1,20,0,2,,,,\n"))
    assert (read.names, read.afferent.tolist(), read.species) == (("u2",), [0, -1], ("monkey",))
    assert [load.newton for load in read.loads] == pytest.approx([10 * 9.80665e-3, 20 * 9.80665e-3])
    assert (read.distance.tolist(), read.n.tolist(), read.rows.tolist()) == ([1e-3, 0.0], [1.0, 9.0], [2, 3])
    assert "1 response is missing" in " ".join(read.notes)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("force_n,probe_curvature_per_m,rate_hz\n0.1,0,20\n", "no column 'distance_mm'"),
        ("probe_curvature_per_m,distance_mm,rate_hz\n0,0,20\n", "no column 'force_n' or 'indentation_mm'"),
        ("force_n,probe_curvature_per_m,distance_mm\n0.1,0,0\n", "no column 'rate_hz' or 'count'"),
        ("force_n,probe_curvature_per_m,distance_mm,rate_hz\n0.1,0,-1,20\n", "row 2, column 'distance_mm': expected a"),
        ("force_n,probe_curvature_per_m,distance_mm,rate_hz\n0.1,,0,20\n", "column 'probe_curvature_per_m': expected"),
        ("force_n,probe_curvature_per_m,distance_mm,rate_hz\n,0,0,20\n", "row 2, column 'force_n': expected a load"),
        ("force_n,probe_curvature_per_m,distance_mm,count\n0.1,0,0,20\n", "with its duration in column 'window_s'"),
        ("force_n,probe_curvature_per_m,distance_mm,count,window_s\n0.1,0,0,2.5,1\n", "expected a whole number of"),
        ("force_n,probe_curvature_per_m,distance_mm,rate_hz,count,window_s\n0.1,0,0,3,2,1\n", "a rate or a count, got"),
    ],
)
def test_bad_tables_name_the_place(tmp_path, text, expected):
    done = call("check", "--afferents", written(tmp_path, text))
    refused(done, expected)
    assert "afferents.csv" in done.stderr


def test_check_describes_the_table(tmp_path):
    path = written(tmp_path, simulated(1).assign(species="monkey").to_csv(index=False))
    done = call("check", "--afferents", path)
    assert "21 rates and 0 counts" in done.stdout
    assert "curvature 0 to 690 /m" in done.stdout
    known = json.loads(call("check", "--afferents", path, "--json").stdout)["afferents"]
    assert (known["rates"], known["species"], len(known["loads"])) == (21, ["monkey"], 3)


# the run


@pytest.fixture(scope="module")
def result():
    return sample(Afferents.read(simulated(1)), max_steps=400, processes=1, seed=1)


def test_a_run_has_rates_findings_and_a_figure(result, tmp_path):
    assert not result.has_ratings
    assert result.has_afferents
    assert "recorded" in figures_of(result)
    found = result.provenance.recorded
    assert found.rate_residual_sd < 6.0
    assert found.rate_additive_sd < 6.0
    assert recorded_faults(found) == ()
    assert found.fires_at_rest == 0.0
    assert any("residual sd" in line for line in recorded_sentences(found))
    # the paper's constants lie far from those that fire like recorded afferents
    assert found.rate_shifts["beta"] < -5
    table = result.tables["recorded_rates"]
    assert (len(table), table["expected_hz"].corr(table["rate_hz"]) > 0.95) == (21, True)
    inside = (table["low_hz"] <= table["rate_hz"]) & (table["rate_hz"] <= table["high_hz"])
    assert inside.sum() >= 16
    drawn = result.plot.recorded()
    assert sum(str(artist.get_gid()).startswith("data/") for axes in drawn.axes for artist in axes.lines) == 10
    result.save(tmp_path / "run")
    again = Result.load(tmp_path / "run")
    assert again.provenance.recorded == found
    with pytest.raises(InputError, match="without ratings"):
        again.curves()


def test_plates_and_recordings_say_whether_they_agree_about_the_skin():
    """The control: plates on a skin five times as stiff contradict the recording, and a run would say so."""
    for b, contradicts in ((8.0, False), (40.0, True)):
        data = Measurements(plates(1, b), Afferents.read(simulated(1)))
        (found,) = agreements(build_skin(data, ModelOptions(prior_set="wide")).posterior)
        assert (found.first, found.about, found.contradicts) == ("plates", ("b", "m"), contradicts)
        assert not found.shared


def test_a_run_shares_a_skin_with_plates():
    data = Measurements(plates(1), Afferents.read(simulated(1)))
    run = sample(data, max_steps=40, processes=1, shared=("b", "m"))
    assert "b_rec" not in run.summary().index
    assert {"recorded", "compression"} <= {*figures_of(run)}
    assert [one.second for one in run.provenance.recorded.agreements] == ["recorded afferents"]


def test_parameters_are_recovered(result):
    summary = result.summary()
    for name, value in TRUTH.items():
        row = summary.loc[name]
        assert abs(row["mean"] - value) < 3.5 * row["sd"], name
    assert summary.loc["beta_rec", "sd"] < 0.3 * summary.loc["beta_rec", "prior_sd"]


def test_counts_of_named_afferents_run_too():
    result = sample(Afferents.read(simulated(2, COUNTED, spiking())), max_steps=60, processes=1, seed=1)
    assert result.group("posterior")["log_rate_effect"].sizes["afferent"] == 3
    assert {"tau_afferent", "fano"} <= {*result.summary().index}
    assert "sd_rate" not in result.summary().index


def test_shared_parameters_are_stated():
    recorded, forces = Afferents.read(simulated(1)), plates(1)
    both = build_skin(Measurements(forces, recorded), ModelOptions(shared=("b", "m"))).posterior
    assert {"b", "m", "alpha_rec"} <= {*both.names}
    assert "b_rec" not in both.names
    theta = both.space.draw_prior(np.random.default_rng(0), 3)
    apart = sum(term.log_likelihood(NO_RESPONSE, both.parameters_of(term, theta)) for term in both.terms)
    assert both.log_likelihood(theta) == pytest.approx(apart)
    with pytest.raises(InputError, match="shared: b occurs in no other data"):
        build_skin(recorded, ModelOptions(shared=("b",)))
    with pytest.raises(InputError, match="no recorded afferents"):
        build_skin(forces, ModelOptions(shared=("b",)))
    with pytest.raises(InputError, match="expected some of b, m, alpha"):
        ModelOptions(shared=("gamma",))


# calibration, with controls that must fail


def ranks(draws, law):
    """Return ranks of true alpha among draws of its posterior on a grid, the other parameters known.

    `law` maps the observed rates to those that the likelihood is given.
    """
    known = {name: value for name, value in TRUTH.items() if name != "alpha_rec"}
    density = build_skin(Afferents.read(probed()), ModelOptions(fix=known)).posterior
    term, rng = density.terms[0], np.random.default_rng(4)
    true = density.space.draw_prior(rng, draws)
    true = true[(true[:, 0] < 145.0)]
    given = density.parameters_of(term, true)
    made = term.replicate(rng, term.rate(given), given, term.new_effects(rng, given, (len(true),)))
    grid = np.exp(np.linspace(np.log(3.0), np.log(149.0), 2000))
    cells, expected = np.gradient(grid), term.rate(density.parameters_of(term, grid[:, None]))
    sd, found = law * TRUTH["sd_rate"], np.empty(len(true))
    prior = density.log_prior(grid[:, None])
    for k, values in enumerate(made):
        apart = (values - expected) / sd
        log = prior + np.where(values > 0.0, -0.5 * apart**2, norm.logcdf(apart)).sum(axis=1)
        weight = np.exp(log - log.max()) * cells
        found[k] = np.interp(true[k, 0], grid, np.cumsum(weight) / weight.sum())
    if law == 1.0:
        # the grid's likelihood is the package's, up to a constant
        own = term.with_values(made[-1]).log_likelihood(NO_RESPONSE, density.parameters_of(term, grid[::100, None]))
        assert np.ptp(own - (log - prior)[::100]) < 1e-8
    return found


def test_ranks_of_simulations_are_uniform_and_those_of_a_wrong_noise_are_not():
    """The control: a likelihood with half the noise gives posteriors that are too narrow."""
    assert kstest(ranks(300, 1.0), "uniform").pvalue > 0.01
    assert kstest(np.abs(ranks(300, 0.5) - 0.5), "uniform", (0.0, 0.5)).pvalue < 0.001


def ranks_of_runs(numbers, names):
    """Return ranks of the true noise among draws of runs, whose afferents may have lost their names."""
    table = pd.concat([probed()[::2].assign(afferent=name) for name in ("u1", "u2", "u3")], ignore_index=True)
    density = build_skin(Afferents.read(table), ModelOptions()).posterior
    found = []
    for k in numbers:
        (point,) = density.space.draw_prior(np.random.default_rng([8, k]), 1)
        truth = dict(zip(density.names, point.tolist(), strict=True))
        # not by way of a table, which may hold at most 1000 Hz
        made = simulate_afferents(np.random.default_rng(k), Afferents.read(table), truth)
        if not names:
            made = dataclasses.replace(made, names=(), afferent=np.full(len(made), -1))
        run = sample(made, max_steps=300, processes=1, seed=k)
        found.append((run.group("posterior")["sd_rate"].values.ravel() < truth["sd_rate"]).mean())
    return found


@pytest.mark.slow
@pytest.mark.parametrize(("names", "runs", "uniform"), [(True, 200, True), (False, 40, False)])
def test_ranks_of_full_runs_are_uniform_unless_sensitivities_are_left_out(names, runs, uniform):
    """All parameters drawn from their priors; without names, the spread of afferents is taken for noise of rates."""
    assert (kstest(ranks_of_runs(range(runs), names), "uniform").pvalue > 0.01) == uniform


def test_a_parameter_that_no_draw_defines_has_no_shift():
    """Where the current at rest exceeds half of the largest in all draws, sigma_0 is negative or NaN in all."""
    draws = {"b": np.full(3, 7.0), "sigma_0": np.array([-1.0, -2.0, np.nan])}
    assert {*shifts(draws, MENDED.skin_displacement)} == {"b"}
    assert {*shifts({**draws, "sigma_0": np.full(3, 9.0)}, MENDED.skin_displacement)} == {"b", "sigma_0"}


def test_sources_of_one_truth_agree_and_those_of_two_do_not():
    """The control: another steepness of transduction, in a second recording of the same table."""
    other = {**TRUTH, "alpha_rec": 60.0, "beta_rec": 0.06}
    for second, contradicts in ((TRUTH, False), (other, True)):
        tables = [simulated(5, TRUTH, recording="one"), simulated(6, second, recording="two")]
        density = build_skin(Afferents.read(pd.concat(tables)), ModelOptions()).posterior
        (found,) = agreements(density)
        assert (found.first, found.second, len(found.about)) == ("recording one", "recording two", 5)
        assert found.shared
        assert found.contradicts == contradicts


def test_ratings_are_a_source_of_their_own(rng):
    """Their chain, with the paper's transduction, contradicts recordings of another one."""
    cloth = Fabrics(tuple("abcdef"), effective_modulus=np.geomspace(1e4, 1e6, 6))
    rated = simulate_ratings(rng, cloth, (Force(2.0),), usual_values(MENDED, "in-vivo"), participants=6).ratings
    data = Experiment(rated, cloth, (), afferents=Afferents.read(simulated(5)))
    options = ModelOptions(prior_set="in-vivo", direction=RISES, errors=NORMAL)
    (apart,) = agreements(build(data, options).posterior)
    assert (apart.first, apart.second, apart.about) == ("ratings", "recorded afferents", ("b", "m", "alpha", "beta"))
    assert (apart.shared, apart.contradicts) == (False, True)
    (found,) = agreements(build(data, dataclasses.replace(options, shared=("b", "m"))).posterior)
    assert (found.about, found.shared) == (("b", "m"), True)


@pytest.mark.parametrize(("shared", "advice"), [(True, "do not pool them"), (False, "should not be shared")])
def test_only_what_is_shared_counts_against_a_run(result, shared, advice):
    """A run that gives each source its own parameters claims nothing that their difference could contradict."""
    apart = Agreement("plates", "recording A", 40.0, ("b", "m"), shared)
    found = dataclasses.replace(result.provenance.recorded, agreements=(apart,))
    assert recorded_faults(found) == (("plates and recording A together",) if shared else ())
    assert advice in recorded_sentences(found)[-1]
    told = Provenance({**result.attributes, **attributes_of(found)}).recorded
    assert told == found


# comparison


def test_readings_of_recordings_are_compared(result):
    """Below 0.2 N the attenuation of the pressure changes hardly anything; the paper's transduction is the control."""
    data = Afferents.read(simulated(1))

    def fitted(**options):
        return sample(data, max_steps=400, processes=1, seed=1, **options)

    found = compare({"attenuated": result, "hertz": fitted(readings=MENDED.override({"pressure": "hertz"}))})
    assert "do not distinguish" in found.sentence
    assert found.sentence.endswith("holding out each recorded response")
    assert found.interior.empty
    other = compare({"free": result, "paper": fitted(fix={"alpha_rec": 20.3, "beta_rec": 0.6})})
    assert "free predicts better than paper" in other.sentence
    with pytest.raises(InputError, match="has no fabric to hold out"):
        compare({"attenuated": result, "hertz": result}, "fabric")


# the real recordings


def test_two_real_recordings_contradict_each_other(recording_a, recording_b):
    both = Afferents.read(pd.concat([recording_a, recording_b]))
    (found,) = agreements(build_skin(both, ModelOptions()).posterior)
    assert found.chi_square > 50
    assert found.contradicts


def test_the_recordings_disagree_at_the_contact_centre(recording_a, recording_b):
    """Where both were recorded, under 15 gf: ratios of B to A, as the page on recordings says."""
    first = recording_a[np.isclose(recording_a.force_n, 0.1471, atol=1e-3)]
    second = recording_b[recording_b.distance_mm == 0.0]
    assert first.probe_curvature_per_m.tolist() == second.probe_curvature_per_m.tolist()
    flat, *spheres = second.rate_hz.to_numpy() / first.rate_hz.to_numpy()
    assert (flat, min(spheres), max(spheres)) == pytest.approx((0.85, 0.93, 1.49), abs=0.005)


@pytest.mark.slow
def test_held_out_forces_are_predicted_with_the_coverage_that_is_stated(recording_a):
    """Each force from the other two: 90 % intervals are too narrow at the smallest, and the page says so."""
    inside = []
    for force, rows in recording_a.groupby("force_n"):
        run = sample(Afferents.read(recording_a[recording_a.force_n != force]), processes=1, seed=1)
        left = build_skin(Afferents.read(rows), ModelOptions()).posterior
        theta = np.column_stack([run.group("posterior")[name].values.ravel() for name in left.names])
        term, at = left.terms[0], left.parameters_of(left.terms[0], theta)
        rng = np.random.default_rng(0)
        made = term.replicate(rng, term.rate(at), at, term.new_effects(rng, at, (len(theta),)))
        low, high = np.quantile(made, [0.05, 0.95], axis=0)
        inside.append(int(((low <= rows.rate_hz) & (rows.rate_hz <= high)).sum()))
    assert inside[0] == pytest.approx(2, abs=1)
    assert sum(inside) == pytest.approx(16, abs=1)


def test_a_table_of_effects_fits_the_recording_better(recording_a):
    """2.5 Hz by least squares of rates (2.8 by least squares of their logs), where the chain leaves 5.8."""
    assert log_additive_sd(Afferents.read(recording_a)) == pytest.approx(2.54, abs=0.02)


def test_real_plates_and_a_recording_agree_about_the_skin(recording_a, pressed):
    names = {"participant": "subject", "indentation_mm": "displacement_mm", "force_n": "force_N"}
    plates = Compression.read(pressed, columns=names)
    data = Measurements(plates, Afferents.read(recording_a))
    (found,) = agreements(build_skin(data, ModelOptions(prior_set="wide")).posterior)
    assert found.chi_square < 6
    assert not found.contradicts
