"""NetCDF files: what xarray's own writer would write, which is slower by a factor of ten."""

import io

import h5py
import numpy as np
import pytest
import xarray as xr

from softness_bayes.files.netcdf import netcdf_of


@pytest.fixture
def tree(rng):
    draws = xr.Dataset(
        {
            "b": (("chain", "draw"), rng.normal(size=(3, 4)), {"units": "kPa", "note": ""}),
            "single": (("draw", "load"), rng.normal(size=(4, 2)).astype(np.float32)),
            "outcome": (("draw",), rng.integers(3, size=4).astype(np.int8)),
            "missing": (("draw", "fabric"), np.where(rng.random((4, 3)) < 0.5, np.nan, 1.0)),
            "words": (("load",), np.array(["", "weiß"], object)),
            "alone": ((), 2.5),
            "none": (("nothing",), np.empty(0)),
        },
        {
            "chain": [0, 1, 2],
            "load": ["1 mm", "2 µm"],
            "e": ("fabric", [0.5, 1.0, 2.0]),
            "ensemble": ("chain", [0, 0, 1]),
        },
    )
    few = xr.Dataset({"rating": (("row",), rng.normal(size=5))})
    attributes = {"command": "softness-bayes", "seed": 1, "share": 0.5, "empty": "", "names": ["a", "ö"], "nan": np.nan}
    root = xr.Dataset(attrs=attributes | {f"reading_{k}": "x" for k in range(200)})
    return xr.DataTree.from_dict({"/": root, "/posterior": draws, "/observed_data": few})


def read(content):
    with xr.open_datatree(io.BytesIO(content), engine="h5netcdf") as tree:
        return tree.load()


def test_xarray_reads_what_was_written(tree):
    again = read(netcdf_of(tree))
    assert again.identical(tree)
    assert [*again.children] == [*tree.children]
    assert [*again["posterior"].data_vars] == [*tree["posterior"].data_vars]
    assert netcdf_of(again) == netcdf_of(tree)
    # negative control: one number of one group
    tree["observed_data"]["rating"][0] += 1e-15
    assert not again.identical(tree)


def test_a_file_holds_what_xarray_would_have_written(tree):
    """Types, dimensions, coordinates, attributes and fill values of every array, as HDF5 has them."""
    with (
        h5py.File(io.BytesIO(netcdf_of(tree))) as own,
        h5py.File(io.BytesIO(bytes(tree.to_netcdf(None, engine="h5netcdf")))) as other,
    ):
        assert {*own.attrs} == {*other.attrs} - {"_NCProperties"}
        for group in other:
            assert {*own[group]} == {*other[group]}
            for name, theirs in other[group].items():
                ours = own[group][name]
                assert (ours.dtype, ours.shape, ours.is_scale) == (theirs.dtype, theirs.shape, theirs.is_scale), name
                assert [scale.keys() for scale in ours.dims] == [scale.keys() for scale in theirs.dims], name
                # the number of the first dimension, which netCDF writes anew and never reads where scales are attached
                dimension = {"_Netcdf4Dimid", "_Netcdf4Coordinates", "REFERENCE_LIST", "DIMENSION_LIST"}
                assert {*ours.attrs} - dimension == {*theirs.attrs} - dimension, name
                for key in {*ours.attrs} - dimension:
                    np.testing.assert_array_equal(ours.attrs[key], theirs.attrs[key], err_msg=f"{name} {key}")
