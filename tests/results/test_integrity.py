"""Whether what is read of a result is what was written: damage, edits, tables, missing parts."""

import json
import shutil

import h5py
import pandas as pd
import pytest

from softness_bayes.base import arviz_bridge
from softness_bayes.base.errors import InputError
from softness_bayes.results.data_groups import experiment_of
from softness_bayes.results.fitted import options_of
from softness_bayes.results.result import Result
from softness_bayes.results.run_options import Request
from softness_bayes.results.stored import SCHEMA
from support.small_result import small_result


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    path = tmp_path_factory.mktemp("small")
    small_result().save(path)
    return path


@pytest.fixture(scope="module")
def runs(tmp_path_factory, report_run):
    """A run on ratings and one on compression data, in their directories."""
    path = tmp_path_factory.mktemp("runs")
    for name in ("ratings", "skin"):
        report_run(name).save(path / name)
    return path


def assert_same(one, other):
    assert one.tree.identical(other.tree)
    pd.testing.assert_frame_equal(one.table, other.table, check_exact=True)
    assert [*one.tables] == [*other.tables]
    for name, table in one.tables.items():
        pd.testing.assert_frame_equal(table, other.tables[name], check_exact=True)


# damage


def flips(directory, tmp_path, rng, count):
    """Load a result once for each of some flipped bits; return how many were refused and how many did no harm."""
    whole, path = (directory / "posterior.nc").read_bytes(), tmp_path / "posterior.nc"
    expected, refused, same = Result.load(directory), 0, 0
    for _ in range(count):
        damaged = bytearray(whole)
        damaged[rng.integers(len(whole))] ^= 1 << rng.integers(8)
        path.write_bytes(damaged)
        try:
            found = Result.load(path)
        except InputError as error:
            refused += str(path) in str(error)
        else:
            assert_same(found, expected)
            same += 1
    return refused, same


def test_no_flipped_bit_changes_what_is_loaded(small, tmp_path, rng):
    refused, same = flips(small, tmp_path, rng, 150)
    assert refused + same == 150
    assert refused > 75


def test_damage_is_found_before_hdf5_reads_the_file(small, tmp_path, rng, monkeypatch):
    """Some flipped bits send HDF5 into an endless loop."""
    whole, path = bytearray((small / "posterior.nc").read_bytes()), tmp_path / "posterior.nc"
    whole[rng.integers(len(whole))] ^= 1
    path.write_bytes(whole)
    opened = []
    monkeypatch.setattr(arviz_bridge, "read_netcdf", opened.append)
    with pytest.raises(InputError, match=r"posterior\.nc: damaged, .* checksum; .* 'softness-bayes resume'"):
        Result.load(path)
    assert not opened
    with pytest.raises(AttributeError):
        Result.load(path, verify=False)
    assert opened == [path]


@pytest.mark.parametrize("share", [0.0, 0.9])
def test_a_truncated_file_is_refused(small, tmp_path, share):
    whole = (small / "posterior.nc").read_bytes()
    (tmp_path / "posterior.nc").write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(InputError, match=r"posterior\.nc: damaged"):
        Result.load(tmp_path)


def rewritten(directory, change):
    """Change the file of a result as another program would, its checksums left as they are."""
    path = directory / "posterior.nc"
    tree = arviz_bridge.read_netcdf(path)
    change(tree)
    path.write_bytes(arviz_bridge.netcdf(tree))


def in_place(directory):
    with h5py.File(directory / "posterior.nc", "r+") as file:
        file.attrs["sd"] = 0.25


@pytest.mark.parametrize(
    "change",
    [
        in_place,  # HDF5 writes over the checksum, or cuts it off
        lambda directory: rewritten(directory, lambda tree: tree.attrs.update(sd=0.25)),
        lambda directory: rewritten(directory, lambda tree: tree["posterior"]["b"].values.__setitem__((0, 0), 7.0)),
    ],
)
def test_a_change_is_refused_and_can_be_accepted(small, tmp_path, change):
    shutil.copytree(small, tmp_path / "run")
    assert_same(Result.load(tmp_path / "run"), small_result())
    change(tmp_path / "run")
    path = tmp_path / "run" / "posterior.nc"
    with pytest.raises(InputError, match="changed since it was written") as error:
        Result.load(tmp_path / "run")
    assert f"Result.load('{path}', verify=False).save(DIRECTORY)" in str(error.value)
    accepted = Result.load(tmp_path / "run", verify=False)
    accepted.save(tmp_path / "mine")
    again = Result.load(tmp_path / "mine")
    assert again.tree.identical(accepted.tree)


@pytest.mark.parametrize("schema", [0, SCHEMA + 1, "two"])
def test_another_schema_is_refused(small, tmp_path, schema):
    shutil.copytree(small, tmp_path / "run")
    rewritten(tmp_path / "run", lambda tree: tree.attrs.update(schema_version=schema))
    with pytest.raises(InputError, match=f"schema .*{schema}.*, expected {SCHEMA}, the only one"):
        Result.load(tmp_path / "run", verify=False)


# missing parts


def test_what_a_result_lacks_is_named(small):
    found = Result.load(small)
    place = str(small / "posterior.nc")
    for look, said in (
        (lambda: found.attributes["verdict"], "no attribute 'verdict'"),
        (lambda: found.group("prior"), "no group 'prior'"),
        (lambda: found.group("posterior")["alpha"], "group 'posterior': no variable 'alpha'"),
        (lambda: found.group("posterior").isel(chain=0)["alpha"], "group 'posterior': no variable 'alpha'"),
        (lambda: found.group("observed_data").drop_vars("row")["row"], "group 'observed_data': no variable 'row'"),
        (lambda: found.tables["directions"], "no table 'directions'"),
        (lambda: found.loads, "no group 'constant_data'|no variable 'indentation_mm'"),
        (lambda: experiment_of(found), "no (group|variable|attribute)"),
        (lambda: options_of(found), "no attribute 'options'"),
    ):
        with pytest.raises(InputError, match=said) as error:
            look()
        assert place in str(error.value)
    assert "alpha" not in found.group("posterior")
    assert found.attributes.get("noise", 0.0) == 0.0


def test_options_that_lack_something_are_refused(runs):
    found = Result.load(runs / "ratings")
    options = json.loads(found.attributes["options"])
    found.tree.attrs["options"] = json.dumps({**options, "scale": "another"})
    with pytest.raises(InputError, match=r"options of a run that this version cannot read: .*'another'"):
        Request.of(found)
    found.tree.attrs["options"] = json.dumps({key: options[key] for key in options if key != "discretisation"})
    for read in (options_of, Request.of):
        with pytest.raises(InputError, match="'discretisation'"):
            read(found)
