"""NetCDF-4 files of groups of labelled arrays, written with h5py in a tenth of the time that general writers take."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping
from itertools import count
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import h5py
    import xarray

_NO_VARIABLE = "This is a netCDF dimension but not a netCDF variable.{:10d}"
"""Name, prescribed by NetCDF-4, of a dimension without coordinates, with its length."""

_BLOCK = 1 << 20
"""Size of the pieces [bytes] by which a file grows in memory."""


def netcdf_of(tree: xarray.DataTree) -> bytes:
    """Return groups of arrays as the bytes of a NetCDF-4 file, in which missing numbers are NaN.

    Parameters
    ----------
    tree
        One level of groups, whose arrays are numbers or text. All attributes are text, numbers or sequences of these.
    """
    import h5py

    with h5py.File(
        "made in memory", "w", driver="core", backing_store=False, block_size=_BLOCK, track_order=True
    ) as file:
        _write_attributes(file, tree.attrs)
        numbers = count()
        for name, group in tree.children.items():
            _write_group(file.create_group(name, track_order=True), group.to_dataset(), numbers)
        file.flush()
        return file.id.get_file_image()


def _write_group(group: h5py.Group, data: xarray.Dataset, numbers: Iterator[int]) -> None:
    """Write the arrays of one group; `numbers` continues the numbers of the dimensions of the file."""
    _write_attributes(group, data.attrs)
    along = {name: next(numbers) for name in data.sizes}
    scales = {name: _written_scale(group, name, size, data, along[name]) for name, size in data.sizes.items()}
    for name, array in data.variables.items():
        if name not in scales:
            written = _written(group, name, array)
            for axis, dimension in enumerate(array.dims):
                written.dims[axis].attach_scale(scales[dimension])
            if array.dims:
                written.attrs["_Netcdf4Coordinates"] = np.array([along[one] for one in array.dims], np.int32)
            others = [one for one in data.coords if one not in scales and {*data[one].dims} <= {*array.dims}]
            if others and name in data.data_vars:
                written.attrs["coordinates"] = " ".join(map(str, others))


def _written_scale(group: h5py.Group, name: Hashable, size: int, data: xarray.Dataset, number: int) -> h5py.Dataset:
    """Write a dimension, with its coordinates if it has any."""
    if name in data.variables:
        scale, said = _written(group, name, data.variables[name]), str(name)
    else:
        scale, said = group.create_dataset(str(name), (size,), ">f4"), _NO_VARIABLE.format(size)
    scale.make_scale(said)
    scale.attrs["_Netcdf4Dimid"] = np.int32(number)
    return scale


def _written(group: h5py.Group, name: Hashable, array: xarray.Variable) -> h5py.Dataset:
    """Write one array and its attributes."""
    import h5py

    values = np.asarray(array.values)
    if values.dtype.kind in "UO":
        return _described(group.create_dataset(str(name), data=values.astype(object), dtype=h5py.string_dtype()), array)
    missing = values.dtype.type(np.nan) if values.dtype.kind == "f" else None
    written = group.create_dataset(str(name), data=values, fillvalue=missing, track_order=True)
    if missing is not None:
        written.attrs["_FillValue"] = np.array([missing])
    return _described(written, array)


def _described(written: h5py.Dataset, array: xarray.Variable) -> h5py.Dataset:
    _write_attributes(written, array.attrs)
    return written


def _write_attributes(place: h5py.Group | h5py.Dataset, attributes: Mapping[Any, Any]) -> None:
    """Write attributes; NetCDF stores a number as an array of one."""
    for name, value in attributes.items():
        many = np.atleast_1d(value)
        place.attrs[str(name)] = (
            value if isinstance(value, str) else many.astype(object if many.dtype.kind == "U" else many.dtype)
        )
