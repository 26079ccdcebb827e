"""Read Parquet files."""

from pathlib import Path

import numpy as np

from hertzloop.fitting.records.contents import FileContents
from hertzloop.fitting.records.readers.arrays import add_array
from hertzloop.fitting.records.record_tables import tables_in_comments


def read_parquet(path: Path) -> FileContents:
    """Read a Parquet file; its metadata `record` may hold `[record]` tables."""
    import pyarrow
    import pyarrow.parquet

    table = pyarrow.parquet.read_table(path)
    found = FileContents([], tables_in_comments((table.schema.metadata or {}).get(b"record", b"")))
    for name in table.column_names:
        values, part = table[name], table.schema.field(name)
        if pyarrow.types.is_time(part.type):  # of day
            whole = values.cast(f"int{part.type.bit_width}")
            values = np.asarray(whole).astype(f"m8[{part.type.unit}]")
        about = part.metadata or {}
        unit = (about.get(b"unit") or about.get(b"units") or b"").decode()
        add_array(found, name, values, unit)
    return found
