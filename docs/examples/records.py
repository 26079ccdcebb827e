"""Read records of other programs: times in s and values in SI units, for `hertzloop.Record`.

Copy the function that reads your kind of file, and change names, columns and sensitivity.
"""

import numpy as np


def oscilloscope(path="drop.csv"):
    """A table with semicolons and decimal commas; 0.01 V for one N."""
    import pandas

    table = pandas.read_csv(path, sep=";", decimal=",", skiprows=[1], encoding="latin-1")
    return 1e-3 * table["Time"].to_numpy(), table["Channel A"].to_numpy() / 0.01


def labview(path="drop.tdms"):
    """A TDMS file, in kN."""
    import nptdms

    channel = nptdms.TdmsFile.read(path)["Impact 1"]["Force"]
    return channel.time_track(), 1e3 * channel[:]


def hdf5(path="drop.h5"):
    """An HDF5 file with a sampling rate."""
    import h5py

    with h5py.File(path) as file:
        values = file["daq/force"][:]
        return np.arange(len(values)) / file["daq"].attrs["rate_hz"], values


def mdf(path="drop.mf4"):
    """An MDF file."""
    import asammdf

    signal = asammdf.MDF(path).get("Force")
    return signal.timestamps, signal.samples


def matlab(path="drop.mat"):
    """A MAT file with two vectors."""
    import scipy.io

    table = scipy.io.loadmat(path, squeeze_me=True)
    return table["time"], table["force"]


def wav(path="drop.wav"):
    """A WAV file of 16 bits, whose full scale is 500 N."""
    import scipy.io.wavfile

    rate_hz, counts = scipy.io.wavfile.read(path)
    return np.arange(len(counts)) / rate_hz, counts / 32768 * 500.0


def sigrok(path="drop.csv"):
    """What `sigrok-cli -i drop.sr -C A0 -O csv:header=false -o drop.csv` writes, at 1 MHz."""
    values = np.loadtxt(path, comments=";") / 0.01  # 0.01 V for one N
    return np.arange(len(values)) / 1e6, values
