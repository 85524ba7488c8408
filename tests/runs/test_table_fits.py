"""Studies on workers that do not share the directory: the same draws, and nothing is lost."""

from concurrent.futures import ThreadPoolExecutor

import pytest

from softness_bayes.base.files.lock import Lock
from softness_bayes.base.files.run_files import CHECKPOINT, LOCK, RUNS
from softness_bayes.data import Compression
from softness_bayes.model.options import ModelOptions
from softness_bayes.results.result import Result
from softness_bayes.results.run_options import Request, RunOptions
from softness_bayes.runs import table_fits
from softness_bayes.runs.study import study
from softness_bayes.runs.table_fits import REFUSED, Fit, fit_table, packed
from support.report_runs import quickly

OPTIONS = ModelOptions(fix={"m": 2.0, "tau_b": 0.3, "tau_m": 0.5, "varsigma_f": 0.1}, prior_set="wide")
LIMITED = {"max_steps": 60, "processes": 1, "seed": 4}
FORCES = "participant,indentation_mm,force_n\n" + "".join(
    f"{who},{mm},{mm * (0.2 + 0.01 * k)}\n" for k, who in enumerate("AB") for mm in (0.5, 1.0, 1.5)
)


class Elsewhere(ThreadPoolExecutor):
    """An executor whose workers are said not to share the directory."""

    shares_files = False


@pytest.fixture(scope="module", autouse=True)
def brief():
    with quickly():
        yield


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    path = tmp_path_factory.mktemp("data") / "forces.csv"
    path.write_text(FORCES)
    return dict.fromkeys(("P1", "P2"), Compression.read(path))


@pytest.fixture(scope="module")
def here(tables, tmp_path_factory):
    return study(tables, tmp_path_factory.mktemp("here"), OPTIONS, **LIMITED)


def draws(directory):
    return Result.load(directory).group("posterior")["b"].values.tobytes()


def there(tables, directory, **options):
    with Elsewhere(2) as executor:
        return study(tables, directory, OPTIONS, **{**LIMITED, **options}, executor=executor)


def test_the_same_draws(tables, here, tmp_path):
    found = there(tables, tmp_path)
    assert found.outcomes == here.outcomes
    for name in tables:
        assert draws(tmp_path / RUNS / name) == draws(here.directory / RUNS / name)


def test_a_finished_study_sends_nothing(tables, here, monkeypatch):
    monkeypatch.setattr(table_fits, "packed", None)
    assert there(tables, here.directory).outcomes == here.outcomes


def test_a_directory_in_use_is_named(tables, here, tmp_path):
    home = tmp_path / RUNS / "P1" / CHECKPOINT
    home.mkdir(parents=True)
    with Lock(home / LOCK):
        found = there(tables, tmp_path)
    assert found.named(REFUSED) == ["P1"]
    assert "another run is using it" in found.outcomes[0].said


def test_messages_name_the_directory_of_the_client(tables, here):
    """Not the temporary one of a worker."""
    request = Request(OPTIONS, RunOptions(seed=9))
    home = here.directory / RUNS / "P1"
    found, _ = fit_table(request, Fit("P1", tables["P1"], str(home), None, files=packed(home)))
    assert found.outcome == REFUSED
    assert found.said.startswith(f"{home}: cannot be continued")
