"""Read HDF5 files."""

from pathlib import Path
from typing import Any

from hertzloop.fitting.records.contents import FileContents
from hertzloop.fitting.records.readers.arrays import contents_of_arrays
from hertzloop.fitting.records.record_tables import tables_in_comments


def read_hdf5(path: Path) -> FileContents:
    """Read an HDF5 file; its attribute `record` may hold `[record]` tables."""
    import h5py

    named: dict[str, tuple[Any, dict]] = {}
    with h5py.File(path) as file:

        def keep(name: str, item: Any) -> None:
            if isinstance(item, h5py.Dataset):
                around = {k: v for k, v in item.parent.attrs.items() if k not in ("unit", "units")}
                own = {k: v.decode() if isinstance(v, bytes) else v for k, v in item.attrs.items()}
                named[name] = item[()], around | own

        file.visititems(keep)
        inside = file.attrs.get("record", "")
    found = contents_of_arrays(named)
    found.tables = tables_in_comments(inside)
    return found
