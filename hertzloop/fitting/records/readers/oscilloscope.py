"""Read binary files of oscilloscopes."""

from pathlib import Path

import numpy as np

from hertzloop.fitting.records.contents import FileContents, Series


def read_oscilloscope(path: Path) -> FileContents:
    """Read a binary file of an oscilloscope, whose channels have times of their own."""
    from RigolWFM.wfm import Wfm

    found = FileContents([], kind="channel")
    for channel in Wfm.from_file(str(path)).channels:
        if channel.volts is None or not len(channel.volts):
            continue
        unit = {"w": "W", "a": "A", "v": "V"}.get(getattr(channel.unit, "name", ""), "?")
        values, time_s = (np.asarray(x, float) for x in (channel.volts, channel.times))
        found.series.append(
            Series(channel.name, unit, values, channel.channel_number, time_s=time_s)
        )
    return found
