"""The formats of measured records, and the reader of each."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from hertzloop.fitting.records.contents import FileContents
from hertzloop.fitting.records.errors import RecordError
from hertzloop.fitting.records.readers.hdf5 import read_hdf5
from hertzloop.fitting.records.readers.matlab import read_mat
from hertzloop.fitting.records.readers.mdf import read_mdf
from hertzloop.fitting.records.readers.numpy_files import read_npy, read_npz
from hertzloop.fitting.records.readers.oscilloscope import read_oscilloscope
from hertzloop.fitting.records.readers.parquet import read_parquet
from hertzloop.fitting.records.readers.recording import read_recording
from hertzloop.fitting.records.readers.sigrok import SIGROK_BEGINNING, read_sigrok
from hertzloop.fitting.records.readers.tdms import read_tdms
from hertzloop.fitting.records.readers.text import read_lvm, read_text_table
from hertzloop.fitting.records.readers.universal_file import read_uff
from hertzloop.fitting.records.readers.wav import read_wav


class Format(NamedTuple):
    """A format of files.

    Attributes:
        name: in the table of formats of docs/how-to/fit.md.
        endings: of its files.
        read: its reader.
        beginning: what its files begin with, where other formats have the same endings.
    """

    name: str
    endings: tuple[str, ...]
    read: Callable[[Path], FileContents]
    beginning: re.Pattern[str] | None = None


# `format_of` takes the first row that fits a file, so a special text format stands above "text
# table", which fits every text.
FORMATS = (
    Format("sigrok CSV", (".csv", ".txt"), read_sigrok, SIGROK_BEGINNING),
    Format("text table", (".csv", ".txt", ".tsv", ".dat", ".asc", ".prn"), read_text_table),
    Format("Parquet", (".parquet",), read_parquet),
    Format("NumPy", (".npz",), read_npz),
    Format("NumPy array", (".npy",), read_npy),
    Format("MATLAB", (".mat",), read_mat),
    Format("WAV", (".wav",), read_wav),
    Format("recording of hertzloop", (".mcap",), read_recording),
    Format("HDF5", (".h5", ".hdf5"), read_hdf5),
    Format("TDMS", (".tdms",), read_tdms),
    Format("UFF 58", (".uff", ".unv"), read_uff),
    Format("LabVIEW LVM", (".lvm",), read_lvm),
    Format("MDF", (".mf4", ".mdf"), read_mdf),
    Format("oscilloscope", (".wfm", ".bin", ".isf", ".trc"), read_oscilloscope),
)
ENDINGS = frozenset(ending for one in FORMATS for ending in one.endings)
_LONGEST_BEGINNING = 4096  # bytes


def format_of(path: Path) -> Format:
    """Return the format of a file with one of the `ENDINGS`: the first row of `FORMATS` that fits.

    The first bytes tell formats with the same ending apart.

    Raises:
        RecordError: no format with this ending begins like the file.
        OSError: the file cannot be read.
    """
    fitting = [one for one in FORMATS if path.suffix.lower() in one.endings]
    if len(fitting) > 1:
        with path.open("rb") as file:
            start = file.read(_LONGEST_BEGINNING).decode("latin-1")
        fitting = [one for one in fitting if one.beginning is None or one.beginning.search(start)]
        if not fitting:
            raise RecordError(
                f"{path}: does not begin like a format with the ending '{path.suffix}'. Give the "
                "file as its program wrote it, or rename it by its format."
            )
    return fitting[0]
