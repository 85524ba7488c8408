"""Studies and calibrations on workers that do not share the directory: the same draws, and nothing is lost."""

import io
import zipfile
from concurrent.futures import ThreadPoolExecutor

import pytest

from softness_bayes.checkpoints.status import read_status
from softness_bayes.data import Compression
from softness_bayes.errors import InputError
from softness_bayes.files.lock import Lock
from softness_bayes.files.run_files import CHECKPOINT, LOCK, RUNS
from softness_bayes.model.options import ModelOptions
from softness_bayes.results.request import Request
from softness_bayes.results.result import Result
from softness_bayes.results.run_options import RunOptions
from softness_bayes.runs import table_fits
from softness_bayes.runs.study import study
from softness_bayes.runs.table_fits import REFUSED, UNCONVERGED, fit_slice, packed, unpack
from softness_bayes.sampler import sampling
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


@pytest.mark.parametrize(
    "name", ["../out.csv", "checkpoint/../../out.csv", "/tmp/out.csv", "C:/out.csv", "..\\out.csv", "."]
)
def test_names_from_a_worker_that_leave_the_directory_of_its_run_are_refused(tmp_path, name):
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        archive.writestr("checkpoint/state-0000001.npz", b"state")
        archive.writestr(name, b"outside")
    with pytest.raises(InputError, match="a worker returned a file named"):
        unpack(content.getvalue(), tmp_path / "runs" / "A")
    assert not [*tmp_path.rglob("*")]


def test_the_same_draws(tables, here, tmp_path):
    found = there(tables, tmp_path)
    assert found.outcomes == here.outcomes
    for name in tables:
        assert draws(tmp_path / RUNS / name) == draws(here.directory / RUNS / name)


def test_a_finished_study_sends_nothing(tables, here, monkeypatch):
    monkeypatch.setattr(table_fits, "fit_slice", None)
    assert there(tables, here.directory).outcomes == here.outcomes


def test_slices(tables, here, tmp_path, monkeypatch):
    """A run that many tasks continue, each after a moment, has the draws of one that runs in one go."""
    monkeypatch.setattr(table_fits, "SLICE", 1e-3)
    monkeypatch.setattr(sampling, "PATIENCE", 0.0)  # a slice sees the clock after its first step
    slices, fit = [], table_fits.fit_slice

    def counted(*task):
        slices.append(task[1])
        return fit(*task)

    monkeypatch.setattr(table_fits, "fit_slice", counted)
    one = {"P1": tables["P1"]}
    assert there(one, tmp_path).outcomes == here.outcomes[:1]
    assert len(slices) > 1
    assert draws(tmp_path / RUNS / "P1") == draws(here.directory / RUNS / "P1")
    # a limit of the time holds for all tasks of a run together
    slices.clear()
    found = there(one, tmp_path / "limited", max_seconds=5e-4)
    assert found.named(UNCONVERGED) == ["P1"]
    assert slices == ["P1"]


def test_a_killed_client_goes_on(tables, here, tmp_path, monkeypatch):
    """It stops after the first slice that it wrote; the next call continues from there."""
    monkeypatch.setattr(table_fits, "SLICE", 1e-3)
    monkeypatch.setattr(sampling, "PATIENCE", 0.0)
    write = table_fits.unpack

    def killed(files, directory):
        write(files, directory)
        if RUNS in directory.parts:
            raise KeyboardInterrupt

    monkeypatch.setattr(table_fits, "unpack", killed)
    one = {"P1": tables["P1"]}
    with pytest.raises(KeyboardInterrupt):
        there(one, tmp_path)
    assert (tmp_path / RUNS / "P1" / CHECKPOINT).exists()
    monkeypatch.undo()
    there(one, tmp_path)
    assert draws(tmp_path / RUNS / "P1") == draws(here.directory / RUNS / "P1")


def test_a_directory_in_use_is_named(tables, here, tmp_path):
    home = tmp_path / RUNS / "P1" / CHECKPOINT
    home.mkdir(parents=True)
    with Lock(home / LOCK):
        found = there(tables, tmp_path)
    assert found.named(REFUSED) == ["P1"]
    assert "another run is using it" in found.outcomes[0].said


def test_archives(here, tmp_path):
    """They are whole, without the lock; files of an earlier state go."""
    source, copy = here.directory / RUNS / "P1", tmp_path / "copy"
    assert packed(tmp_path) == b""
    unpack(b"", copy)
    assert not copy.exists()
    stale = copy / CHECKPOINT / "piece-0000000.npz"
    stale.parent.mkdir(parents=True)
    stale.write_bytes(b"")
    unpack(packed(source), copy)
    assert not stale.exists()
    assert packed(copy) == packed(source)
    assert read_status(copy)[:9] == read_status(source)[:9]


def test_messages_name_the_directory_of_the_client(tables, here):
    """Not the temporary one of a worker."""
    request = Request(OPTIONS, RunOptions(seed=9))
    home = here.directory / RUNS / "P1"
    found = fit_slice(request, "P1", tables["P1"], str(home), None, packed(home), 0.0)
    assert (found[0].outcome, found[2]) == (REFUSED, True)
    assert found[0].said.startswith(f"{home}: cannot be continued")
