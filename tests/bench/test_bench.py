"""The benchmark: what peers compute, how they are compared, what is drawn, and that all of it runs."""

import json
import sys
import time

import numpy as np
import pandas as pd
import pytest

from softness_bayes.bench import peers, scale
from softness_bayes.bench.brian import ABSENT, brian_peers
from softness_bayes.bench.jax_cells import ABSENT as NO_JAX
from softness_bayes.bench.jax_cells import jax_peers
from softness_bayes.bench.limit import Limit, limit
from softness_bayes.bench.peers import PEERS, Peer, Ratio, Work, faster, measure_peer, solve_each, step_all
from softness_bayes.bench.precision import FIELD, LIKELIHOOD, POPULATION, RATES, Point
from softness_bayes.bench.scaling import SamplerSpeed, Size, scaling
from softness_bayes.bench.subject import BATCH, QUICK, machine, machine_name, quickest, subject
from softness_bayes.bench.words import summary
from softness_bayes.errors import InputError
from softness_bayes.plotting.benchmark import work_precision_figure
from softness_bayes.touch.neuron.rate import firing_rate
from softness_bayes.touch.resolution import first
from softness_bayes.touch.scene import Discretisation
from support.command_line import call, refused
from support.paths import ROOT

CURRENT = np.array([20.3, 22.0])


def test_peers_simulate_the_same_membrane():
    exact = firing_rate(CURRENT)
    np.testing.assert_allclose(solve_each("LSODA", 1e-6)(CURRENT[:1], 120.0), exact[:1], rtol=3e-3)
    coarse, fine = (np.abs(step_all(step)(CURRENT, 150.0) / exact - 1) for step in (0.1, 0.025))
    assert fine.max() < 0.03
    # a first-order method: a quarter of the step, about a quarter of the error
    np.testing.assert_allclose(fine / coarse, 0.25, atol=0.12)


def test_a_silent_train_has_no_rate():
    assert step_all(0.1)(np.array([5.0]), 50.0) == [0.0]
    assert solve_each("RK45", 1e-3)(np.array([5.0]), 30.0) == [0.0]


def test_a_peer_is_scaled_by_receptor_and_judged_by_exact_rates(monkeypatch):
    def law(current):
        return 10.0 * np.sqrt(current - 18.0)

    monkeypatch.setattr(peers, "firing_rate", law)
    work = Work(1000.0, 21.0, 18.0)
    exact = Peer("ours", "again", lambda current, _: law(current), True)
    wrong = Peer("wrong", "by 2 %", lambda current, _: 1.02 * law(current), False)
    assert measure_peer(exact, work, QUICK).max_peak == 0.0
    point = measure_peer(wrong, work, QUICK)
    assert point.max_peak == pytest.approx(0.02)
    assert point.seconds > 0
    assert (work.currents(5) <= 21.0).all()
    assert (work.currents(5) > 18.0).all()


def test_the_ratio_is_of_the_quickest_setting_that_is_no_worse():
    def ours(seconds, error, setting="channels held, accuracy 1"):
        return Point(LIKELIHOOD, setting, seconds, error, error, error, error)

    points = [
        ours(1e-5, 1e-2),
        ours(2e-5, 1e-3, "channels held, accuracy 2"),
        ours(4e-5, 1e-5),
        ours(1e-6, 1e-9, "channels free, accuracy 1"),
    ]
    peer = Point("peer", "p", 1.0, 5e-3, 5e-3, np.nan, np.nan)
    ratio, setting = faster(peer, points)
    assert ratio == pytest.approx(5e4)
    assert setting == "channels held, accuracy 2"
    assert faster(peer._replace(max_peak=1e-7), points) is None


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # of other projects
def test_brian_simulates_the_same_membrane():
    found = brian_peers()
    if not found:
        pytest.skip(ABSENT)
    exact = firing_rate(CURRENT)
    coarse, fine = (np.abs(peer.rates(CURRENT, 600.0) / exact - 1).max() for peer in found)
    assert fine <= coarse < 5e-3


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # of other projects
def test_jax_simulates_the_same_membrane():
    found = jax_peers()
    if not found:
        pytest.skip(NO_JAX)
    exact = firing_rate(CURRENT)
    errors = [float(np.abs(peer.rates(CURRENT, 600.0) / exact - 1).max()) for peer in found]
    assert len(errors) == 4
    assert max(errors) < 5e-3
    assert errors[1] < errors[0]
    assert errors[3] < errors[2]


def test_sizes_and_limit_are_counted():
    of = subject(Discretisation(6, 4.0, 1e-3), True, 8)
    sizes = scaling(of, QUICK._replace(repeats=1, most_fabrics=4, most_vectors=4))
    assert {size.what for size in sizes} == {"conditions", "batch"}
    for size in sizes:
        assert size.per_condition == pytest.approx(size.seconds / size.conditions)
    found = limit(of, QUICK._replace(repeats=1))
    # an exponential for each of 12 nodes of the gain and the last one of a vector, and of its conditions that do not
    # saturate; one for each condition that fires, and one for each condition, whose contact comes from polynomials
    firing = (of.model.scene.total_rate(first(of.draws.parameters, BATCH)) > 0).sum(axis=-1).mean()
    assert 0 < firing < 36
    assert min(of.model.scene.mechanics.polynomials) > 0
    least = round(13 + firing) + 36
    assert least < found.exponentials < least + 13 * firing
    assert found.over_bare == pytest.approx(found.seconds / found.bare_seconds)
    assert min(found.bare_seconds, found.flop_seconds, found.megabytes) > 0


def test_the_machine_is_named_and_the_quickest_call_counts(monkeypatch):
    assert {"processor", "vectors", "cores", "numpy", "python"} <= machine().keys()
    ticks = iter([0.0, 3.0, 10.0, 11.0, 20.0, 22.0])
    monkeypatch.setattr(time, "process_time", lambda: next(ticks))
    assert quickest(lambda: None, 3) == 1.0


@pytest.mark.parametrize(
    ("flags", "vectors"),
    [
        ("flags\t\t: fpu sse2 avx avx2 avx512f avx512bw", "AVX-512"),
        ("flags\t\t: fpu sse2 avx avx2", "AVX2"),
        ("Features\t: fp asimd crc32", "NEON"),
        ("flags\t\t: fpu sse2", "unknown vector instructions"),
    ],
)
def test_the_vector_instructions_are_the_widest_of_the_processor(tmp_path, flags, vectors):
    info = tmp_path / "cpuinfo"
    info.write_text(
        f"processor\t: 0\nmodel name\t: Some Processor 7\n{flags}\n\nprocessor\t: 1\nmodel name\t: Another\n"
    )
    about = machine(info)
    assert about["vectors"] == vectors
    assert machine_name(about).startswith(f"Some Processor 7 with {vectors}, ")
    assert machine(tmp_path / "none")["vectors"] == "unknown vector instructions"


def test_the_figure_holds_its_numbers():
    series = {"stress field": ([1e-6, 2e-6], [1e-2, 1e-4])}
    figure = work_precision_figure(series, {"loop": (1.0, 1e-3)}, [(2e-6, 1e-4)], "a machine")
    lines = {line.get_gid(): line for line in figure.axes[0].lines}
    np.testing.assert_allclose(lines["series/stress field"].get_ydata(), [1.0, 2.0])
    np.testing.assert_allclose(lines["series/stress field"].get_xdata(), [1e-2, 1e-4])
    np.testing.assert_allclose(lines["peer/loop"].get_ydata(), [1e6])
    assert list(lines["dial"].get_xdata()) == [1e-4]
    assert figure.axes[0].get_title(loc="left") == "a machine"
    with pytest.raises(InputError, match="at least one series"):
        work_precision_figure({}, {})


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # of other projects
def test_all_of_it_runs_and_every_stage_is_in_the_table(tmp_path):
    done = call("bench", "--quick", "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    table = pd.read_csv(tmp_path / "work_precision.csv")
    assert {FIELD, POPULATION, RATES, LIKELIHOOD, "peer"} == set(table["stage"])
    assert (table["seconds"] > 0).all()
    assert (table["max_peak"] >= table["median_peak"]).all()
    whole = table[(table["stage"] == LIKELIHOOD) & table["dial"].notna()]
    assert (whole["max_peak"] <= whole["dial"]).all()
    assert len(table[table["stage"] == "peer"]) >= len(PEERS)
    assert set(pd.read_csv(tmp_path / "scaling.csv")["what"]) == {"conditions", "batch"}
    facts = json.loads((tmp_path / "bench.json").read_text())
    assert facts["machine"]["processor"] in done.stdout
    words = (tmp_path / "summary.md").read_text(encoding="utf-8")
    assert words.count("| channels") == len(whole)
    assert facts["machine"]["processor"] in words
    assert (tmp_path / "work_precision.png").stat().st_size > 0
    assert (tmp_path / "work_precision.pdf").stat().st_size > 0
    refused(call("bench", "--quick", "--out", tmp_path), "work_precision.csv", "--force")


def test_without_brian_there_is_a_reason_instead_of_a_peer(monkeypatch):
    monkeypatch.setitem(sys.modules, "brian2", None)
    assert brian_peers() == ()
    assert "softness-bayes[peers]" in ABSENT


def test_the_kept_words_are_those_of_the_kept_measurements():
    kept = ROOT / "notebooks" / "results" / "bench"
    points, sizes = (
        [kind(*row) for row in pd.read_csv(kept / name).itertuples(index=False)]
        for kind, name in ((Point, "work_precision.csv"), (Size, "scaling.csv"))
    )
    facts = json.loads((kept / "bench.json").read_text(encoding="utf-8"))
    ratios = {name: Ratio(**ratio) for name, ratio in facts["ratios"].items()}
    bare = Limit(**{name: value for name, value in facts["limit"].items() if name in Limit._fields})
    name = machine_name(facts["machine"])
    words = summary(points, ratios, sizes, bare, SamplerSpeed(**facts["sampler"]), name)
    assert words == (kept / "summary.md").read_text(encoding="utf-8")


def test_growth_is_the_slope_between_neighbouring_sizes(monkeypatch):
    """Of known times: quadratic in the ratings, constant in the loads."""
    times = {"ratings": lambda n: 1e-6 * n**2, "loads": lambda n: 2.0}
    monkeypatch.setattr(scale, "_measured", lambda table: (times[table.what](table.size), 100.0))
    found = [*scale.grown([table for table in scale.TABLES if table.what in times])]
    assert [one.size for one in found] == [1020, 10_200, 102_000, 30, 300, 3000]
    np.testing.assert_allclose([one.exponent for one in found], [np.nan, 2.0, 2.0, np.nan, 0.0, 0.0], atol=1e-12)


def test_time_and_memory_are_those_of_the_process():
    seconds, megabytes = scale._run(["--help"])
    assert 0.0 < seconds < 60.0
    assert 10.0 < megabytes < 2000.0
    with pytest.raises(RuntimeError, match=r"(?s)ended with 2: .*--nothing"):
        scale._run(["--nothing"])


@pytest.mark.slow
def test_whole_runs_from_the_command_line(tmp_path):
    done = call("bench", "--scale", "--quick", "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    table = pd.read_csv(tmp_path / "out" / "whole_runs.csv")
    assert table["what"].tolist() == ["ratings", "conditions", "loads", "predictions"]
    assert (table["seconds"] > 0).all()
    assert table["megabytes"].between(50, 4000).all()
