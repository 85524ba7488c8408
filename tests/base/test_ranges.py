"""The ranges of parameters, loads, counts and priors: said where a value enters, and answered for up to their ends."""

import itertools
import math

import numpy as np
import pytest
from click.testing import CliRunner

from softness_bayes.base.errors import InputError
from softness_bayes.base.ranges import FORCES, INDENTATIONS, PARTICIPANTS, PROCESSES, STEPS, Count, Range
from softness_bayes.cli import main
from softness_bayes.data import Fabrics
from softness_bayes.model.scenes import touch_parameters, usual_values
from softness_bayes.model.simulation import simulate_ratings
from softness_bayes.parameters.choice import require_values
from softness_bayes.parameters.declared import EVERY_PARAMETER, PARAMETERS
from softness_bayes.parameters.priors import parse_prior
from softness_bayes.sampler.sampling import Settings
from softness_bayes.touch.contact import Force, Indentation
from softness_bayes.touch.neuron.membrane import PAPER_CHANNELS
from softness_bayes.touch.readings import NAMED_READINGS
from softness_bayes.touch.scene import Scene

LOADS = (Indentation(INDENTATIONS.low), Indentation(INDENTATIONS.high), Force(FORCES.low), Force(FORCES.high))
CHAIN = ("b", "m", "alpha", "beta", "sigma_0")


@pytest.mark.parametrize(
    ("among", "words", "inside", "outside"),
    [
        (Range(), "a finite number", [0, -1e308], [math.inf, math.nan]),
        (Range(0, above=True), "a finite number above 0", [5e-324], [0, -1]),
        (Range(-1, 0.5, above=True), "a finite number above -1 and at most 0.5", [0.5], [-1, 0.51]),
        (Range(1e-6, 1e6, "kPa"), "a number from 1e-06 to 1e+06 kPa", [1e-6, 1e6], [0, 1e7, math.nan]),
        (Range(1, 2, zero=True), "0, or a number from 1 to 2", [0, 1, 2], [0.5, -1, 3]),
    ],
)
def test_a_range_holds_what_it_says(among, words, inside, outside):
    assert str(among) == words
    assert all(map(among.holds, inside))
    assert not any(map(among.holds, outside))


@pytest.mark.parametrize("name", EVERY_PARAMETER)
def test_a_parameter_may_be_held_at_its_ends_and_not_beyond(name):
    among = EVERY_PARAMETER[name].range
    for value in (among.low, among.high):
        require_values({name: value})
    beyond = among.low / 1.01 if among.low else -0.01
    for value in (beyond, among.high * 1.01, -among.low or beyond, math.nan, math.inf):
        with pytest.raises(InputError, match=f"^{name} is .*, expected .*a number from .* to"):
            require_values({name: value})


@pytest.mark.parametrize("readings", ["mended", "hertz"])
def test_the_chain_answers_at_every_corner_of_the_ranges(readings, smooth_firing):
    scene = Scene(np.geomspace(1e3, 1e8, 4), 0.3, LOADS, smooth_firing(), readings=NAMED_READINGS[readings])
    ends = [
        (0.0, PARAMETERS[n].range.high)
        if n == "m"
        else (PARAMETERS[n].range.low, 60.0 if n == "alpha" else PARAMETERS[n].range.high)
        for n in CHAIN
    ]
    corners = np.array(list(itertools.product(*ends))).T
    named = dict(zip(CHAIN, corners, strict=True)) | PAPER_CHANNELS._asdict()
    found = scene.respond(touch_parameters(named))
    fires = found.responding > 0
    assert fires.any()
    assert np.isfinite(found.total_rate).all()
    assert ((found.total_rate > 0) == fires).all()
    assert ((found.responding >= 0) & (found.responding <= scene.n_receptors + 1e-6)).all()
    assert np.isfinite(found.mean_interval[fires]).all()


@pytest.mark.parametrize(
    "text",
    [
        "lognormal(80,0.3,1e-300)",
        "lognormal(80,1e-9)",
        "lognormal(80,6)",
        "lognormal(1e308,0.3)",
        "halfnormal(1e300)",
        "normal(100,1e-9)",
        "uniform(1,1.0000000001)",
        "uniform(0,1e308)",
    ],
)
def test_priors_without_width_or_beyond_floating_point_are_refused_with_the_range(text):
    with pytest.raises(InputError, match="expected a"):
        parse_prior(text)


def test_loads_are_checked_where_they_are_made():
    for kind, among in ((Indentation, INDENTATIONS), (Force, FORCES)):
        for value in (1e308, 5e-324, 0.0, -1.0, math.nan, math.inf):
            with pytest.raises(InputError, match=r"expected a number from .* to .* (m|N)$"):
                kind(value)
        assert str(kind(among.high))


def test_counts_are_checked_where_they_enter():
    fabrics = Fabrics(("a",), effective_modulus=1e5)
    values = usual_values(NAMED_READINGS["mended"])
    for count in (0, 10**23):
        with pytest.raises(InputError, match=f"participants is {count}, expected a whole number from 1 to 10000"):
            simulate_ratings(np.random.default_rng(0), fabrics, LOADS[:1], values, participants=count)
        for name in ("processes", "max_steps"):
            with pytest.raises(InputError, match=f"{name} is {count}, expected"):
                Settings(**{name: count})
    assert Settings(processes=PROCESSES.high, max_steps=STEPS.high)
    assert str(Count(1, 3)) == "a whole number from 1 to 3"
    assert PARTICIPANTS.high == 10_000


ENTRIES = [
    ("sample --fix varsigma=1e-8", "varsigma is 1e-08, expected a number from 0.0001 to 100"),
    ("sample --prior b=lognormal(80,0.3,1e-300)", "a fraction from 1e-06"),
    ("sample --prior b=lognormal(1e9,0.3)", "expected a number from 1e-06 to 1e+06 kPa"),
    ("sample --noise nan", "expected a number from 0 to 100"),
    ("sample --max-steps 100000000000000000000000", "a whole number from 1 to 1000000000, got"),
    ("sample --force-n 1e308", "expected a number from 1e-09 to 100 (a finger cannot bear more)"),
    ("predict --fabrics x.csv --set c_Na=1e308", "c_Na is 1e+308, expected a number from 0.1 to 10"),
    ("simulate --fabrics x.csv --fingers 100000000000000000000000", "a whole number from 0 to 10000, got"),
    ("simulate --fabrics x.csv --typical-rating inf", "expected a number from 1e-300"),
    ("claims --force-n 0", "expected a number from 1e-09 to 100"),
    ("compare x --max-steps 100000000000000000000000", "a whole number from 1 to 1000000000, got"),
]


@pytest.mark.parametrize(("line", "words"), ENTRIES, ids=[line for line, _ in ENTRIES])
def test_an_option_out_of_range_is_refused_with_the_range(line, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(main, line.split())
    assert done.exit_code == 2, done.output
    assert words in " ".join(done.output.replace("│", " ").split())
    assert not list(tmp_path.iterdir())
