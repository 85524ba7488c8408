"""A run on a table in which every touch has a force of its own: what it costs, and what it says."""

import functools
import re

import numpy as np
import pytest

from softness_bayes.base.files.run_files import MODULUS_ERRORS
from softness_bayes.checking import inflection
from softness_bayes.cli.running import print_result
from softness_bayes.likelihood.scales import FALLS, FREE
from softness_bayes.model import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.results import predictions
from softness_bayes.results.data_groups import experiment_of
from softness_bayes.results.fitted import options_of
from softness_bayes.results.run_options import Request, RunOptions
from softness_bayes.runs.run import sample
from softness_bayes.touch.load_groups import groups_of
from support.report_runs import OPTIONS, quickly
from support.variants import MEANT, TOUCHES, measured_loads


@pytest.fixture(scope="module")
def run():
    """The result of a brief run, and the loads of each grid of fabrics whose responses it asked for."""
    asked, original = [], inflection.response_curves

    def counted(grid, parameters):
        asked.append(len(grid.loads))
        return original(grid, parameters)

    with quickly(), pytest.MonkeyPatch.context() as patch:
        for module in (inflection, predictions):
            patch.setattr(module, "response_curves", counted)
        return sample(measured_loads(), **OPTIONS), asked


def test_curves_and_turning_points_are_made_for_groups_of_loads(run):
    result, asked = run
    assert len(result.loads) == TOUCHES * len(MEANT)
    assert asked
    assert set(asked) == {len(MEANT)}
    assert result.curves().total_rate.shape[1] == len(MEANT)
    for group in ("predictions", "inflection", "prior_inflection"):
        assert result.group(group).sizes["load_group"] == len(MEANT)
        assert "load" not in result.group(group).dims
    assert result.inflection().index.tolist() == result.load_groups.names
    assert [*result.group("inflection")["load_group"].values] == result.load_groups.names


def test_each_group_is_shown_by_its_middle_load(run):
    result, _ = run
    shown = np.array([result.loads[k].newton for k in result.load_groups.at])
    np.testing.assert_allclose(shown, MEANT, rtol=0.06)
    # under force control the contact's force is the load itself
    force = result.curves().force
    np.testing.assert_allclose(force, np.broadcast_to(shown[:, None], force.shape), rtol=1e-5)
    found = result.inflections()
    at_peak = np.broadcast_to(shown, found.force.shape)[np.isfinite(found.force)]
    np.testing.assert_allclose(found.force[np.isfinite(found.force)], at_peak, rtol=1e-5)


def test_what_is_said_names_groups_and_no_single_load(run, tmp_path, capsys):
    result, _ = run
    print_result(result, tmp_path)
    said = capsys.readouterr().out
    names, single = result.load_groups.names, {str(load) for load in result.loads}
    assert f"({TOUCHES * len(MEANT)} loads in 3 groups; each row is at the middle load of its group)" in said
    assert all(name in said for name in names)
    assert not [load for load in single if re.search(rf"(?<![\d.]){re.escape(load)}", said)]
    shifts = [name for name in result.tables[MODULUS_ERRORS].index if "turning point" in name]
    assert shifts == [f"turning point at {name}" for name in names]


def test_a_group_is_shown_as_its_middle_load_among_curves_of_every_load(run):
    result, _ = run
    with quickly():
        posterior = build.build(experiment_of(result), options_of(result)).posterior
    drawn, at = result.group("predictions").isel(chain=0, draw=slice(5)), result.load_groups.at
    theta = np.stack([drawn[f"at_{name}"].values for name in posterior.names], axis=-1)
    touch = posterior.space.touch(theta).broadcast(5)
    every = inflection.response_curves(inflection.curve_scene(posterior.scene), touch).total_rate
    assert every.shape[1] == len(result.loads)
    shown = result.curves().total_rate[:5]
    np.testing.assert_allclose(every[:, at], shown, rtol=1e-5)
    assert not np.allclose(every[:, at - 1], shown, rtol=1e-3)  # control: another load of the group


def test_falling_ratings_of_single_measured_loads_are_taken_as_falling(monkeypatch):
    """No load alone shows an order of fabrics; groups of them do."""
    with quickly():
        options = Request(ModelOptions(), RunOptions()).with_options(**OPTIONS).model
        found = build.ExperimentModel(measured_loads(), options).direction
        assert found.direction is FALLS
        assert found.sentence.startswith("--direction falls-with-firing was chosen from the data")
        # each load alone, as it was before: nothing is seen, and both directions are sampled
        monkeypatch.setattr(build, "groups_of", functools.partial(groups_of, most=1000))
        assert build.ExperimentModel(measured_loads(), options).direction.direction is FREE
