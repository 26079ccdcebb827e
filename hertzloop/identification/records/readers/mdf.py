"""Read MDF files."""

from pathlib import Path

import numpy as np

from hertzloop.identification.records.contents import FileContents
from hertzloop.identification.records.readers.arrays import series_of_array


def read_mdf(path: Path) -> FileContents:
    """Read an MDF file, channel by channel with the times of each."""
    from asammdf import MDF

    found = FileContents([], kind="channel")
    with MDF(path) as file:
        for signal in file.iter_channels():
            made = series_of_array(
                signal.name,
                signal.samples,
                str(signal.unit or ""),
                len(found.series) + 1,
                found.notes,
            )
            time_s = np.asarray(signal.timestamps, float)
            group = str(signal.group_index + 1)
            found.series += [one._replace(time_s=time_s, group=group) for one in made]
    return found
