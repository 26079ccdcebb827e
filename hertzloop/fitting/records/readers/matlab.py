"""Read MATLAB's .mat files."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from hertzloop.fitting.records.contents import FileContents
from hertzloop.fitting.records.readers.arrays import contents_of_arrays
from hertzloop.fitting.records.readers.hdf5 import read_hdf5


def read_mat(path: Path) -> FileContents:
    """Read a MATLAB file; a field of a structure has the structure's name as its group."""
    import scipy.io

    try:
        data = scipy.io.loadmat(path, squeeze_me=True, struct_as_record=False)
    except NotImplementedError:  # version 7.3 is HDF5
        return read_hdf5(path)

    def flat(named: Mapping[str, Any], group: str) -> Iterator[tuple[str, tuple[Any, dict]]]:
        for name, value in named.items():
            if hasattr(value, "_fieldnames"):
                yield from flat(
                    {f: getattr(value, f) for f in value._fieldnames}, f"{group}{name}/"
                )
            elif not name.startswith("__"):
                yield group + name, (value, {})

    return contents_of_arrays(dict(flat(data, "")))
