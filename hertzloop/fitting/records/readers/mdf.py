"""Read MDF files."""

from pathlib import Path

import numpy as np

from hertzloop.fitting.records.contents import FileContents
from hertzloop.fitting.records.readers.arrays import add_array


def read_mdf(path: Path) -> FileContents:
    """Read an MDF file, channel by channel with the times of each."""
    from asammdf import MDF

    found = FileContents([], kind="channel")
    with MDF(path) as file:
        for signal in file.iter_channels():
            time_s = np.asarray(signal.timestamps, float)
            unit, group = str(signal.unit or ""), str(signal.group_index + 1)
            add_array(found, signal.name, signal.samples, unit, group, time_s)
    return found
