"""Layouts of text tables and attributes that instruments and programs write."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hertzloop.identification.records.errors import RecordError
from hertzloop.identification.records.reading import read_record

COUNT, STEP_S = 40, 5e-7
TIME = STEP_S * np.arange(COUNT) - 2e-6
FORCE = np.round(np.sin(np.arange(COUNT)) + 0.01, 6)
HMS = [f"10:12:{13.25 + s:.7f}" for s in STEP_S * np.arange(COUNT)]
KIND = {"quantity": "contact_force"}


def rows(*columns: Any, form: str = "{},{}") -> str:
    """Lines of a table, one for each sample."""
    return "\n".join(form.format(*cells) for cells in zip(*columns, strict=True)) + "\n"


XY = rows(TIME, FORCE)
Y = rows(FORCE, form="{}")
SIX = [("Points", 40), ("Sample Interval", STEP_S), ("Trigger Time", 0.01)]


def right() -> Iterator[tuple[str, str]]:
    """Layouts, each with a text that gives the record."""
    yield "Tektronix, facts beside the rows", "".join(
        f'"{SIX[i][0]}",{SIX[i][1]},"s",{t},{v}\n' if i < 3 else f",,,{t},{v}\n"
        for i, (t, v) in enumerate(zip(TIME, FORCE, strict=True)))  # fmt: skip
    yield "Yokogawa, one trace", (
        '"TraceName","CH1"\n"VUnit","N"\n"HResolution",5.0E-07\n"HUnit","s"\n"Date","2026/11/26"\n'
        '"Time","10:15:33.44"\n\n' + rows(FORCE, form="{},"))  # fmt: skip
    yield "Yokogawa, facts just above the values", (
        '"VUnit","N"\n"HUnit","s"\n"SampleRate",2.0E+06\n"HResolution",5.0E-07\n'
        + rows(FORCE, form=",{}"))  # fmt: skip
    yield (
        "DIAdem",
        "Channel;Time;Force\nUnit;s;N\nLength;40;40\n" + rows(TIME, FORCE, form=";{};{}"),
    )
    yield "Pulse, numbered rows without names", (
        "Header Size: 18\nX-axis unit: s\nX-axis delta: 5e-07\nY-axis unit: N\nTitle 1: Hammer\n\n"
        + rows(range(1, COUNT + 1), TIME, FORCE, form="{}\t{}\t{}"))  # fmt: skip
    yield "Rigol, times in the heading", (
        "CH1(N),t0 = -2.0e-06, tInc = 5.0e-07,\n" + rows(FORCE, form="{},"))  # fmt: skip
    yield "a time of day above the values", (
        "Vertical Units,N\nHorizontal Units,S\nSampling Period,5e-07\nTime,26-Nov-26 10:12:13\n"
        "Waveform Data,\n" + rows(FORCE, form="{},"))  # fmt: skip
    yield "a title above two columns", "Waveform Data,,\n" + rows(TIME, FORCE, form="{},{},")
    yield (
        "OWON",
        "Channel :,CH1\nTime interval :,0.50000uS\n\nindex,CH1(N)\n" + rows(range(COUNT), FORCE),
    )
    yield (
        "facts in comments, run together",
        "# XAxisUnit = s\n# YAxisUnit = N\n# DeltaX = 5e-07\n" + Y,
    )
    yield "milliseconds after a colon", "Time;Force [N]\n" + rows(
        [one.replace(".", ":") for one in HMS], FORCE, form="{};{}")  # fmt: skip
    yield (
        "pandas timedelta",
        ",force_n\n"
        + rows([f"0 days 00:00:00.{round(1e9 * s):09d}" for s in STEP_S * np.arange(COUNT)], FORCE),
    )
    yield "MATLAB timetable", "Time,force_n\n" + rows(TIME, FORCE, form="{} sec,{}")
    yield (
        "columns of units",
        "Time,Unit,Force,Unit\n" + rows(1e6 * TIME, FORCE / 1e3, form="{:.3f},us,{},kN"),
    )
    yield (
        "a unit that ends in a digit",
        "Time [s];Force [N];Acc [m/s2]\n" + rows(TIME, FORCE, FORCE, form="{};{};{}"),
    )
    yield "another rate above the times", "Sample rate: 1 MHz\nTime (s),Force (N)\n" + XY


@pytest.mark.parametrize(("layout", "text"), list(right()))
def test_a_layout_gives_the_record(tmp_path: Path, layout: str, text: str) -> None:
    path = tmp_path / "r.csv"
    path.write_text(text, "utf-8")
    record = read_record(path, KIND)
    assert record.value == pytest.approx(FORCE, abs=1e-9), layout
    assert record.interval_s == pytest.approx(STEP_S, rel=1e-4), record.source
    assert "in N" in record.source or "in kN" in record.source


@pytest.mark.parametrize(("text", "given", "words"), [
    ("Time,Force\ns,N\nx1,x1000\n" + XY, {}, "'x1, x1000', which may be part of them"),
    ("Time,Force\ns,N\nMultiplier,1000\n" + XY, {}, "a factor of its values, '1000'"),
    (f"{COUNT}\n" + Y, {"rate_hz": 2e6}, "counts those below it"),
    ("dt;5e-07\nforce_n;\n" + rows(FORCE[:9], form="{};") + ";\n" + rows(FORCE[9:], form="{};"),
     {}, "empty lines stand between rows without times"),
    ("Sample Interval,5e-07\nforce_n,Time,other_v\n"
     + rows(FORCE[:9], TIME[:9], FORCE[:9], form="{},{},{}") + ",,\n"
     + rows(FORCE[9:], TIME[9:], FORCE[9:], form="{},{},{}"),
     {"quantity": None}, "empty lines stand between rows without times"),
    ("Time (s),-Force (N)\n" + XY, {"quantity": None}, "no column is a known quantity"),
    ("Time,force_n\n" + rows(TIME, FORCE, form="{} sec,{} N"), {}, "is not used: column force_n"),
])  # fmt: skip
def test_what_a_careful_reader_would_ask_is_refused(
    tmp_path: Path, text: str, given: dict, words: str
) -> None:
    path = tmp_path / "r.csv"
    path.write_text(text, "utf-8")
    keys = {key: value for key, value in (KIND | given).items() if value is not None}
    with pytest.raises(RecordError, match=words):
        read_record(path, keys)


def test_a_factor_is_settled_by_a_sensitivity(tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    path.write_text("Scale factor: 1000\nTime (s),Force (N)\n" + XY, "utf-8")
    assert read_record(path, {"sensitivity": 1e-3}).value == pytest.approx(1e3 * FORCE)


@pytest.mark.parametrize("facts", [
    {"fs_khz": 2000.0}, {"dt_us": 0.5}, {"sampling_frequency": 2e6}, {"Tinterval": STEP_S},
])  # fmt: skip
def test_arrays_state_their_rate_in_any_unit(tmp_path: Path, facts: dict[str, float]) -> None:
    path = tmp_path / "r.npz"
    np.savez(path, force=FORCE, **facts)
    assert read_record(path).interval_s == pytest.approx(STEP_S)


def test_a_structured_array_holds_columns(tmp_path: Path) -> None:
    path = tmp_path / "r.npy"
    np.save(path, np.array(list(zip(TIME, FORCE, strict=True)), [("time", "f8"), ("force", "f8")]))
    record = read_record(path)
    assert record.interval_s == pytest.approx(STEP_S)
    assert record.value == pytest.approx(FORCE)


def test_groups_of_hdf5_state_the_rate_of_their_data(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "r.h5", "w") as file:
        group = file.create_group("Daq")
        group.attrs["Sampling Frequency (Hz)"] = 2e6
        group.create_dataset("force", data=FORCE)
    assert read_record(tmp_path / "r.h5").interval_s == pytest.approx(STEP_S)


def test_levels_of_a_converter_are_no_values(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "r.h5", "w") as file:
        data = file.create_dataset("force", data=np.round(100.0 * FORCE).astype("i2"))
        data.attrs.update({"XInc": STEP_S, "YInc": 0.01, "YOrg": 0.0})
    with pytest.raises(RecordError, match="a factor of its values, 'YInc = "):
        read_record(tmp_path / "r.h5")
    record = read_record(tmp_path / "r.h5", {"sensitivity": 100.0})
    assert record.value == pytest.approx(FORCE, abs=0.006)
