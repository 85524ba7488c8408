"""Whether what is read of a result is what was written: damage, edits, files of the past, tables, missing parts."""

import json
import shutil

import h5py
import numpy as np
import pandas as pd
import pytest
import xarray as xr

from softness_bayes import arviz_bridge
from softness_bayes.errors import InputError
from softness_bayes.results.checksums import CHECKSUMS
from softness_bayes.results.from_result import experiment_of, options_of
from softness_bayes.results.request import Request
from softness_bayes.results.result import Result
from softness_bayes.results.result_file import SCHEMA, TABLES
from softness_bayes.results.seal import is_broken
from support.command_line import call, refused
from support.paths import DATA


def small_result():
    """Return a result of a few numbers, so that most of its file is what HDF5 adds."""
    rng = np.random.default_rng(3)
    tree = arviz_bridge.to_tree(
        {
            "posterior": {
                "b": rng.lognormal(4, 0.1, (4, 6)),
                "participant_effect": rng.normal(size=(4, 6, 3)),
                "inside": rng.integers(0, 2, (4, 6)).astype(np.int8),
            },
            "predictions": {"total_rate": rng.normal(size=(1, 5)).astype(np.float32)},
            "observed_data": {"rating": np.array([1.0, np.nan, -np.nan, -0.0])},
            "constant_data": {"omega": np.array(0.0)},
        },
        dims={"participant_effect": ["participant"], "rating": ["row"]},
        coords={"participant": ["Änne", "Bo", "NA"], "ensemble": np.repeat([0, 1], 2)},
        attrs={"schema_version": SCHEMA, "command": "softness-bayes sample", "sd": 0.5, "empty": ""},
        variable_attrs={"b": {"units": "kPa"}},
    )
    index = pd.Index(["b", "NA"], name="parameter")
    table = pd.DataFrame({"mean": [0.1 + 0.2, np.nan], "n": [1, 2], "says": ["=1+1", ""], "fine": [True, False]}, index)
    return Result(tree, table, {"checks": table.reset_index().set_index(["parameter", "says"])})


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
            assert found.verified
            same += 1
    return refused, same


def test_no_flipped_bit_changes_what_is_loaded(small, tmp_path, rng):
    refused, same = flips(small, tmp_path, rng, 150)
    assert refused + same == 150
    assert refused > 75


def test_no_flipped_bit_changes_what_is_loaded_of_a_run(runs, tmp_path, rng):
    assert sum(flips(runs / "skin", tmp_path, rng, 5)) == 5


@pytest.mark.slow
@pytest.mark.parametrize(("name", "count"), [("small", 3000), ("ratings", 150), ("skin", 150)])
def test_no_flipped_bit_of_many_changes_what_is_loaded(name, count, small, runs, tmp_path, rng):
    assert sum(flips(small if name == "small" else runs / name, tmp_path, rng, count)) == count


def test_damage_is_found_before_hdf5_reads_the_file(small, tmp_path, rng, monkeypatch):
    """Some flipped bits send HDF5 into an endless loop."""
    whole, path = bytearray((small / "posterior.nc").read_bytes()), tmp_path / "posterior.nc"
    whole[rng.integers(len(whole) - 200)] ^= 1
    path.write_bytes(whole)
    assert is_broken(path)
    assert not is_broken(small / "posterior.nc")
    opened = []
    monkeypatch.setattr(arviz_bridge, "read_netcdf", opened.append)
    with pytest.raises(InputError, match=r"posterior\.nc: damaged since .* checksum .* 'softness-bayes resume'"):
        Result.load(path)
    assert not opened
    with pytest.raises(AttributeError):
        Result.load(path, verify=False)
    assert opened == [path]


@pytest.mark.parametrize("where", [-1, -2, -30, -66, -100])
def test_a_damaged_seal_is_no_worse_than_none(where, small, tmp_path):
    """Digits that changed show damage; without the words before them the checksums of the content decide."""
    whole, path = bytearray((small / "posterior.nc").read_bytes()), tmp_path / "posterior.nc"
    whole[where] ^= 1
    path.write_bytes(whole)
    if where in (-2, -30):
        with pytest.raises(InputError, match="damaged since it was written"):
            Result.load(path)
    else:
        assert_same(Result.load(path), Result.load(small))


def test_a_change_in_place_is_named(small, tmp_path):
    """HDF5 writes over the seal, or cuts it off."""
    path = tmp_path / "posterior.nc"
    path.write_bytes((small / "posterior.nc").read_bytes())
    with h5py.File(path, "r+") as file:
        file.attrs["sd"] = 0.25
    with pytest.raises(InputError, match="changed or added attribute 'sd'"):
        Result.load(path)


@pytest.mark.parametrize("share", [0.0, 0.1, 0.9, 0.99])
def test_a_truncated_file_is_refused(small, tmp_path, share):
    whole = (small / "posterior.nc").read_bytes()
    (tmp_path / "posterior.nc").write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(InputError, match=r"posterior\.nc: not a readable result"):
        Result.load(tmp_path)


def rewritten(directory, change):
    """Change the file of a result as another program would, its checksums left as they are."""
    path = directory / "posterior.nc"
    tree = arviz_bridge.read_netcdf(path)
    change(tree)
    arviz_bridge.write_netcdf(tree, path)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (
            lambda tree: tree["posterior"]["b"].values.__setitem__((0, 0), 7.0),
            "changed or added variable 'b' of group 'posterior'",
        ),
        (
            lambda tree: tree["posterior"]["b"].attrs.update(units="Pa"),
            "changed or added variable 'b' of group 'posterior'",
        ),
        (lambda tree: tree.attrs.update(sd=0.25), "changed or added attribute 'sd'"),
        (lambda tree: tree.attrs.update(schema_version=np.int64(0)), "schema .*0.*, expected a number from 1"),
        (lambda tree: tree.attrs.pop("command"), "no attribute 'command'"),
        (lambda tree: tree.attrs.pop(CHECKSUMS), f"changed or added attribute '{CHECKSUMS}'"),
        (lambda tree: tree["posterior"].attrs.update(mine=1), "changed or added group 'posterior'"),
        (lambda tree: tree.attrs.update(mine=1), "changed or added attribute 'mine'"),
    ],
)
def test_a_change_is_named_and_can_be_accepted(small, tmp_path, change, named):
    shutil.copytree(small, tmp_path / "run")
    assert_same(Result.load(tmp_path / "run"), small_result())
    rewritten(tmp_path / "run", change)
    with pytest.raises(InputError, match=named) as error:
        Result.load(tmp_path / "run")
    assert str(tmp_path / "run" / "posterior.nc") in str(error.value)
    if "schema" not in named:
        assert f"Result.load('{tmp_path / 'run' / 'posterior.nc'}', verify=False).save(DIRECTORY)" in str(error.value)
        accepted = Result.load(tmp_path / "run", verify=False)
        assert not accepted.verified
        accepted.save(tmp_path / "mine")
        again = Result.load(tmp_path / "mine")
        assert again.verified
        assert again.tree.identical(accepted.tree)


def test_a_file_saved_by_arviz_is_told_from_one_it_changed(small, tmp_path):
    import arviz

    shutil.copytree(small, tmp_path / "run")
    path = tmp_path / "run" / "posterior.nc"
    for factor, holds in ((1.0, True), (2.0, False)):
        data = arviz.from_netcdf(small / "posterior.nc")
        data["posterior"]["b"] = data["posterior"]["b"] * factor
        data["posterior"]["b"].attrs["units"] = "kPa"
        path.unlink()
        data.to_netcdf(str(path), engine="h5netcdf")
        if holds:
            assert_same(Result.load(path), small_result())
        else:
            with pytest.raises(InputError, match="changed or added variable 'b' of group 'posterior'"):
                Result.load(path)


# files of the first layout


@pytest.fixture
def old(small, tmp_path):
    """The small result as the first layout had it."""
    shutil.copytree(small, tmp_path / "old")
    tree = small_result().tree
    tree.attrs["schema_version"] = 1
    arviz_bridge.write_netcdf(tree, tmp_path / "old" / "posterior.nc")
    return tmp_path / "old"


def test_a_file_without_checksums_loads_and_says_so(old, tmp_path):
    found = Result.load(old)
    assert not found.verified
    assert found.group("posterior").identical(small_result().group("posterior"))
    np.testing.assert_array_equal(found.table["mean"], small_result().table["mean"])
    found.save(tmp_path / "anew")
    assert Result.load(tmp_path / "anew").verified


@pytest.mark.parametrize(
    "resaved",
    [
        lambda text: text.replace(",", ";").encode(),
        lambda text: text.replace("b", "bé").encode("latin-1"),
        lambda text: b"",
        lambda text: text.encode("utf-16"),
    ],
    ids=["separator", "latin-1", "empty", "utf-16"],
)
def test_tables_that_a_spreadsheet_saved(small, old, tmp_path, resaved):
    shutil.copytree(small, tmp_path / "run")
    for directory in (tmp_path / "run", old):
        path = directory / "summary.csv"
        path.write_bytes(resaved(path.read_text()))
    assert_same(Result.load(tmp_path / "run"), small_result())
    with pytest.raises(InputError, match=r"old/summary\.csv: .*was it saved by a spreadsheet program\?"):
        Result.load(old)


# missing parts


def parts(tree):
    """Return every attribute, group and variable of a tree, the tables' among them."""
    found = [("attribute", name) for name in tree.attrs]
    for group, child in tree.children.items():
        found += [("group", group), *(("variable", group, name) for name in child.to_dataset().variables)]
    return found


def without(tree, part):
    kind, name, *variable = part
    if kind == "group":
        left = tree.filter(lambda node: node.name != name)
        left.attrs = tree.attrs
        return left
    tree = tree.copy()
    if kind == "attribute":
        tree.attrs = {key: value for key, value in tree.attrs.items() if key != name}
    else:
        tree[name].dataset = tree[name].to_dataset().drop_vars(variable)
    return tree


def test_every_part_of_a_file_is_missed(small, tmp_path, rng):
    whole, path = arviz_bridge.read_netcdf(small / "posterior.nc"), tmp_path / "posterior.nc"
    every = parts(whole)
    for part in [every[k] for k in sorted(rng.choice(len(every), 12, replace=False))]:
        arviz_bridge.write_netcdf(without(whole, part), path)
        with pytest.raises(InputError) as error:
            Result.load(path)
        assert str(path) in str(error.value)
        assert repr(part[-1]) in str(error.value) or part[-1] in ("posterior", "schema_version")
        # nor does what is accepted all the same end in another error than this
        try:
            found = Result.load(path, verify=False)
        except InputError:
            continue
        found.save(tmp_path / "accepted")
        assert Result.load(tmp_path / "accepted").tree.identical(found.tree)


def test_what_a_result_lacks_is_named(small):
    found = Result.load(small)
    place = str(small / "posterior.nc")
    for look, said in (
        (lambda: found.attributes["verdict"], "no attribute 'verdict'"),
        (lambda: found.group("prior"), "no group 'prior'"),
        (lambda: found.group("posterior")["alpha"], "group 'posterior': no variable 'alpha'"),
        (lambda: found.group("posterior").isel(chain=0)["alpha"], "group 'posterior': no variable 'alpha'"),
        (lambda: found.group("observed_data")["row"], "group 'observed_data': no variable 'row'"),
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


def test_json_nested_deeply_is_refused(small, tmp_path):
    """Every JSON text of a result: of its checksums, its options and its tables."""
    deep = "[" * 20_000 + "]" * 20_000
    found, path = Result.load(small), tmp_path / "posterior.nc"
    found.tree.attrs["options"] = deep
    with pytest.raises(InputError, match=r"attribute 'options' cannot be '.*nested too deeply"):
        Request.of(found)
    whole = arviz_bridge.read_netcdf(small / "posterior.nc")
    for name, said in ((CHECKSUMS, CHECKSUMS), ("summary", "'summary' of group 'tables'")):
        tree = whole.copy()
        if name == CHECKSUMS:
            tree.attrs = {**tree.attrs, CHECKSUMS: deep}
        else:
            tree[TABLES].dataset = tree[TABLES].to_dataset().assign({name: deep})
        arviz_bridge.write_netcdf(tree, path)
        with pytest.raises(InputError, match=said):
            Result.load(path)


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


def test_no_verb_ends_in_a_traceback(runs, tmp_path, few_pictures):
    whole, other = tmp_path / "whole", tmp_path / "run"
    for directory in (whole, other):
        shutil.copytree(runs / "ratings", directory)
    touched = ["--fabrics", DATA / "fabrics.csv", "--indentation-mm", 2]
    verbs = [
        ["report", other],
        ["plot", other, "--figures", "trace"],
        ["compare", whole, other, "--out", tmp_path],
        ["predict", "--posterior", other, *touched],
    ]
    rewritten(other, lambda tree: tree["posterior"].__delitem__("b"))
    for verb in verbs:
        refused(call(*verb), str(other / "posterior.nc"), "no variable 'b' of group 'posterior'")
    accepted = tmp_path / "accepted"  # is not complete for that
    Result.load(other, verify=False).save(accepted)
    for verb in (["report", accepted], ["predict", "--posterior", accepted, *touched]):
        refused(call(*verb), str(accepted / "posterior.nc"))


def test_a_file_of_the_past_is_said_to_be_unverified(runs, tmp_path):
    shutil.copytree(runs / "ratings", tmp_path / "old")
    tree = Result.load(tmp_path / "old").tree
    tree.attrs["schema_version"] = 1
    arviz_bridge.write_netcdf(tree, tmp_path / "old" / "posterior.nc")
    done = call("plot", tmp_path / "old", "--figures", "trace", "--format", "svg")
    assert done.returncode == 0
    assert "old/posterior.nc: written by an earlier version without checksums" in done.stderr
    done = call("plot", runs / "ratings", "--figures", "trace", "--format", "svg", "--out", tmp_path / "figures")
    assert "checksums" not in done.stderr


def test_tables_are_json_of_their_columns(small):
    """The file says what it holds to whoever reads it without this package."""
    with xr.open_datatree(small / "posterior.nc", engine="h5netcdf") as tree:
        columns = json.loads(str(tree[TABLES]["summary"].values))["columns"]
        digests = json.loads(tree.attrs[CHECKSUMS])
    assert columns["mean"][0] == 0.1 + 0.2
    assert len(digests["variable 'b' of group 'posterior'"]) == 64
