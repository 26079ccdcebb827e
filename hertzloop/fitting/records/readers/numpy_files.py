"""Read NumPy's .npz and .npy files."""

from pathlib import Path
from typing import Any

import numpy as np

from hertzloop.fitting.records.contents import FileContents
from hertzloop.fitting.records.readers.arrays import contents_of_arrays
from hertzloop.fitting.records.record_tables import tables_in_comments


def read_npz(path: Path) -> FileContents:
    """Read an .npz file; its array `record` may hold `[record]` tables."""
    with np.load(path, allow_pickle=False) as data:
        named: dict[str, tuple[Any, dict]] = {name: (data[name], {}) for name in data.files}
    inside = named.pop("record", ("", {}))[0]
    named.pop("metadata", None)
    found = contents_of_arrays(named)
    found.tables = tables_in_comments(str(inside))
    return found


def read_npy(path: Path) -> FileContents:
    """Read an .npy file."""
    return contents_of_arrays({path.stem: (np.load(path, allow_pickle=False), {})})
