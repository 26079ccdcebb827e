"""Read TDMS files."""

from pathlib import Path

from hertzloop.fitting.records.contents import FileContents
from hertzloop.fitting.records.errors import TableError
from hertzloop.fitting.records.readers.arrays import add_array
from hertzloop.fitting.records.spacing import StatedSpacing

_BEGINS = b"TDSm"


def read_tdms(path: Path) -> FileContents:
    """Read a TDMS file; channels may start at different times. Raises TableError."""
    from nptdms import TdmsFile

    with path.open("rb") as file:
        if file.read(len(_BEGINS)) != _BEGINS:
            raise TableError("is not a TDMS file, which begins with the letters TDSm")
    found = FileContents([], kind="channel")
    # Times of day with all their digits; the numbers are read apart, as their dates would be raw.
    starts = {
        channel.path: channel.properties.get("wf_start_time")
        for group in TdmsFile.read_metadata(path, raw_timestamps=True).groups()
        for channel in group.channels()
        if "wf_increment" in channel.properties
    }
    known = [(start.seconds, start.second_fractions) for start in starts.values() if start]
    first = min(known, default=(0, 0))
    if known and len(known) < len(starts) and len(set(known)) > 1:
        found.notes.append("channels without wf_start_time are taken to start with the first.")
    for group in TdmsFile.read(path).groups():
        for channel in group.channels():
            about, spacing = channel.properties, None
            if channel.path in starts:
                start, late_s = starts[channel.path], 0.0
                if start:
                    late_s = start.seconds - first[0] + (start.second_fractions - first[1]) / 2**64
                late_s += float(about.get("wf_start_offset", 0.0))
                spacing = StatedSpacing(float(about["wf_increment"]), late_s, "wf_increment")
            unit = str(about.get("unit_string", about.get("Unit", "")))
            add_array(found, channel.name, channel[:], unit, group.name, spacing)
    return found
