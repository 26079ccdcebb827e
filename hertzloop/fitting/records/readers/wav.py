"""Read WAV files."""

from pathlib import Path

import numpy as np

from hertzloop.fitting.records.contents import FileContents, Series
from hertzloop.fitting.records.spacing import StatedSpacing


def read_wav(path: Path) -> FileContents:
    """Read a WAV file; integers are parts of full scale."""
    import scipy.io.wavfile

    rate, data = scipy.io.wavfile.read(path)
    table = np.atleast_2d(data.T)
    whole = np.issubdtype(data.dtype, np.integer)
    # Eight bits have no sign, and rest at 128.
    zero = 128.0 if data.dtype == np.uint8 else 0.0
    scale = 2.0 ** (8 * data.dtype.itemsize - 1) if whole else 1.0
    found = FileContents([], spacing=StatedSpacing(1.0 / rate, 0.0, "rate"), kind="channel")
    unit = "full scale" if whole else ""
    found.series += [
        Series("value", unit, row, number, zero=zero, levels=scale)
        for number, row in enumerate(table, 1)
    ]
    return found
