"""The formats of measured records, and the reader of each."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from hertzloop.identification.records.contents import FileContents
from hertzloop.identification.records.readers.hdf5 import read_hdf5
from hertzloop.identification.records.readers.matlab import read_mat
from hertzloop.identification.records.readers.mdf import read_mdf
from hertzloop.identification.records.readers.numpy_files import read_npy, read_npz
from hertzloop.identification.records.readers.oscilloscope import read_oscilloscope
from hertzloop.identification.records.readers.parquet import read_parquet
from hertzloop.identification.records.readers.recording import read_recording
from hertzloop.identification.records.readers.tdms import read_tdms
from hertzloop.identification.records.readers.text import read_lvm, read_text_table
from hertzloop.identification.records.readers.universal_file import read_uff
from hertzloop.identification.records.readers.wav import read_wav


class Format(NamedTuple):
    """A format: its name, the endings of its files, the extra that reads it, its reader."""

    name: str
    endings: tuple[str, ...]
    extra: str
    read: Callable[[Path], FileContents]


FORMATS = (
    Format("text table", (".csv", ".txt", ".tsv", ".dat", ".asc", ".prn"), "", read_text_table),
    Format("Parquet", (".parquet",), "", read_parquet),
    Format("NumPy", (".npz",), "", read_npz),
    Format("NumPy array", (".npy",), "", read_npy),
    Format("MATLAB", (".mat",), "", read_mat),
    Format("WAV", (".wav",), "", read_wav),
    Format("recording of hertzloop", (".mcap",), "", read_recording),
    Format("HDF5", (".h5", ".hdf5"), "h5", read_hdf5),
    Format("TDMS", (".tdms",), "records", read_tdms),
    Format("UFF 58", (".uff", ".unv"), "records", read_uff),
    Format("LabVIEW LVM", (".lvm",), "", read_lvm),
    Format("MDF", (".mf4", ".mdf"), "mdf", read_mdf),
    Format("oscilloscope", (".wfm", ".bin", ".isf", ".trc"), "scopes", read_oscilloscope),
)
ENDINGS = {ending: one for one in FORMATS for ending in one.endings}
