"""NumPy's .npz and .npy, for reading: arrays by name, with `sample_rate` or `time` among them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from daq.errors import LogError
from daq.formats.arrays import Arrays
from daq.formats.boundary import opened
from daq.formats.contents import Contents
from daq.formats.file_format import FileFormat
from daq.formats.samples import Scratch


def read(path: Path, scratch: Scratch) -> Contents:
    """Read the arrays of a file, or the fields of a structured array; raises LogError.

    Nothing in the file is run: pickled objects are refused.
    """
    arrays = Arrays(scratch)
    with opened(path) as file:
        loaded = np.load(file, allow_pickle=False)
        if isinstance(loaded, np.ndarray):
            _add_array(loaded, arrays)
        else:
            with loaded:
                for name in loaded.files:
                    arrays.add(name, loaded[name])
        return arrays.contents()


def _add_array(array: np.ndarray, arrays: Arrays) -> None:
    if array.dtype.names is None:
        arrays.add("array", array)
        return
    if array.ndim != 1:
        raise LogError(f"a structured array of {array.ndim} dimensions")
    for name in array.dtype.names:
        arrays.add(name, array[name])


FORMAT = FileFormat("numpy", (".npz", ".npy"), read)
