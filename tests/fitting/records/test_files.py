"""Records in files of arrays, of sounds, of instruments and of hertzloop itself."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hertzloop.fitting.records.errors import RecordError
from hertzloop.fitting.records.reading import read_record
from tests.commands import as_options, invoke
from tests.fitting.fitting import RADIUS, fitted, scene
from tests.recordings.rewriting import messages, record, rewrite
from tests.tiers import default

TIME = 5e-7 * np.arange(30)
FORCE = np.round(np.sin(np.arange(30.0)) + 0.01, 6)


def test_array_files_hold_records(tmp_path):
    import pyarrow
    import pyarrow.parquet
    import scipy.io

    np.save(tmp_path / "a.npy", FORCE)
    np.save(tmp_path / "b.npy", np.stack([FORCE, -FORCE], axis=1))
    np.savez(tmp_path / "c.npz", force=FORCE[None], fs=2e6)
    scipy.io.savemat(tmp_path / "d.mat", {"time": TIME, "force": FORCE})
    scipy.io.savemat(tmp_path / "e.mat", {"drop": {"t": TIME, "force_kN": 1e-3 * FORCE}})
    pairs = list(zip(TIME, FORCE, strict=True))
    np.save(tmp_path / "f.npy", np.array(pairs, [("time", "f8"), ("force", "f8")]))
    table = pyarrow.table({"time_s": TIME, "contact_force_n": FORCE})
    pyarrow.parquet.write_table(table, tmp_path / "g.parquet")
    scipy.io.wavfile.write(tmp_path / "h.wav", 2_000_000, FORCE.astype(np.float32) / 2)
    of = {"quantity": "contact_force", "rate_hz": 2e6}
    with pytest.raises(RecordError, match="2 series could be the record"):
        read_record(tmp_path / "b.npy", of)
    sound = {"quantity": "contact_force", "sensitivity": 0.5}
    cases: list[tuple[str, dict[str, Any]]] = [
        ("a.npy", of),
        ("b.npy", {**of, "channel": 1}),
        ("c.npz", {}),
        ("d.mat", {}),
        ("e.mat", {}),
        ("f.npy", {}),
        ("g.parquet", {}),
        ("h.wav", sound),
    ]
    for name, given in cases:
        one = read_record(tmp_path / name, given)
        np.testing.assert_allclose(one.value, FORCE, atol=1e-7 if name == "h.wav" else 1e-12)
        np.testing.assert_allclose(one.time_s, TIME, atol=1e-12)


@pytest.mark.parametrize("kind", ["M8[ns]", "m8[us]", "time64[us]", "M8[us] in npz", "h5 in us"])
def test_times_of_other_kinds_are_seconds(tmp_path, kind):
    import pyarrow
    import pyarrow.parquet

    micro = np.arange(20) + 1_622_505_599_999_700 * ("M8" in kind)
    force = np.arange(20.0)
    path = tmp_path / f"r.{'npz' if 'npz' in kind else 'h5' if 'h5' in kind else 'parquet'}"
    if path.suffix == ".npz":
        np.savez(path, time=micro.astype("M8[us]"), contact_force_n=force)
    elif path.suffix == ".h5":
        h5py = pytest.importorskip("h5py")
        with h5py.File(path, "w") as file:
            file["time"], file["contact_force_n"] = micro, force
            file["time"].attrs["units"] = "us"
    else:
        of_day = pyarrow.array(micro, pyarrow.int64()).cast(pyarrow.time64("us"))
        times = of_day if "time64" in kind else micro.astype("M8[us]" if "M8" in kind else kind)
        table = pyarrow.table({"time": times, "contact_force_n": force})
        pyarrow.parquet.write_table(table, path)
    one = read_record(path)
    np.testing.assert_allclose(one.time_s - one.time_s[0], 1e-6 * np.arange(20), atol=1e-12)


@pytest.mark.parametrize(
    "facts",
    [
        {"fs_khz": 2000.0},
        {"dt_us": 0.5},
        {"sampling_frequency": 2e6},
        {"Tinterval": 5e-7},
    ],
)
def test_arrays_state_their_rate_in_any_unit(tmp_path, facts):
    path = tmp_path / "r.npz"
    np.savez(path, force=FORCE, **facts)
    assert read_record(path).interval_s == pytest.approx(5e-7)


def test_wav_channels_are_chosen_and_scaled(tmp_path):
    import scipy.io.wavfile

    stereo = np.stack([np.arange(40), np.arange(40)[::-1]], axis=1).astype(np.int16)
    scipy.io.wavfile.write(tmp_path / "s.wav", 48_000, stereo)
    given = {"quantity": "v_p", "sensitivity": 0.5}
    with pytest.raises(RecordError, match="channel 1 'value', channel 2 'value'"):
        read_record(tmp_path / "s.wav", given)
    with pytest.raises(RecordError, match="is in 'full scale'"):
        read_record(tmp_path / "s.wav", {"quantity": "v_p", "channel": 2})
    one = read_record(tmp_path / "s.wav", {**given, "channel": 2})
    assert one.value[0] == pytest.approx(39 / 32768 / 0.5)
    scipy.io.wavfile.write(tmp_path / "u.wav", 48_000, np.full(40, 192, np.uint8))
    assert read_record(tmp_path / "u.wav", given).value[0] == pytest.approx(0.5 / 0.5)


def test_hdf5_files_state_the_rate_and_the_levels_of_their_data(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "r.h5", "w") as file:
        group = file.create_group("Daq")
        group.attrs["Sampling Frequency (Hz)"] = 2e6
        group.create_dataset("force", data=FORCE)
    assert read_record(tmp_path / "r.h5").interval_s == pytest.approx(5e-7)
    with h5py.File(tmp_path / "r.h5", "w") as file:
        data = file.create_dataset("force", data=np.round(100.0 * FORCE).astype("i2"))
        data.attrs.update({"XInc": 5e-7, "YInc": 0.01, "YOrg": 0.0})
    with pytest.raises(RecordError, match="a factor of its values, 'YInc = "):
        read_record(tmp_path / "r.h5")
    record = read_record(tmp_path / "r.h5", {"sensitivity": 100.0})
    assert record.value == pytest.approx(FORCE, abs=0.006)


def test_a_file_that_is_no_tdms_is_refused(tmp_path):
    pytest.importorskip("nptdms")
    (tmp_path / "r.tdms").write_bytes(b"anything else" * 20)
    with pytest.raises(RecordError, match=r"r\.tdms: is not a TDMS file"):
        read_record(tmp_path / "r.tdms")


def test_channels_of_tdms_start_where_their_times_of_day_say(tmp_path):
    nptdms = pytest.importorskip("nptdms")
    begun = np.datetime64("2026-05-06T12:00:00.250000")
    starts = {"Force": begun + np.timedelta64(1250, "us"), "Accel": begun, "Later": None}

    def written(starts: dict[str, Any]) -> Path:
        channels = [
            nptdms.ChannelObject(
                "hits",
                name,
                FORCE,
                properties={
                    "wf_increment": 5e-7,
                    "wf_start_offset": 1e-6,
                    "unit_string": unit,
                }
                | ({} if start is None else {"wf_start_time": start}),
            )
            for (name, start), unit in zip(starts.items(), ("N", "m/s^2", "m/s"), strict=False)
        ]
        with nptdms.TdmsWriter(tmp_path / "r.tdms") as writer:
            writer.write_segment(channels)
        return tmp_path / "r.tdms"

    path = written(starts)
    force, accel = (read_record(path, {"channel": name}) for name in ("Force", "Accel"))
    np.testing.assert_allclose(accel.time_s, TIME + 1e-6, atol=1e-15)
    np.testing.assert_allclose(force.time_s, TIME + 1e-6 + 1.25e-3, atol=1e-15)
    assert any("without wf_start_time" in note for note in force.notes)
    alike = read_record(written({"Force": begun, "Accel": begun}), {"channel": "Force"})
    np.testing.assert_allclose(alike.time_s, TIME + 1e-6, atol=1e-15)
    assert not any("wf_start" in note for note in alike.notes)


@pytest.mark.full
def test_lvm_and_scope_files_are_read(tmp_path):
    head = (
        "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nDecimal_Separator\t,\n"
        "X_Columns\tOne\n***End_of_Header***\t\n\t\nChannels\t2\t\t\nSamples\t30\t30\n"
        "Y_Unit_Label\tkN\tm/s^2\nDelta_X\t5,0E-7\t5,0E-7\nX0\t0,0E+0\t0,0E+0\n"
        "***End_of_Header***\t\t\nX_Value\tForce\tAccel\tComment\n"
    )
    rows = "\n".join(
        f"{t:.9e}\t{v:.9e}\t{2 * v:.9e}\t".replace(".", ",")
        for t, v in zip(TIME, FORCE, strict=True)
    )
    (tmp_path / "h.lvm").write_text(head + rows)
    one = read_record(tmp_path / "h.lvm", {"channel": "Force"})
    np.testing.assert_allclose(one.value, 1e3 * FORCE, rtol=1e-8)
    np.testing.assert_allclose(one.time_s, TIME, atol=1e-12)
    segment = head[head.index("Channels") :] + rows
    (tmp_path / "two.lvm").write_text(f"{head}{rows}\n\t\n{segment}")
    with pytest.raises(RecordError, match=r"Choose one.*record\.group = \"1\""):
        read_record(tmp_path / "two.lvm", {"quantity": "contact_force", "column": "Force"})
    one = read_record(tmp_path / "two.lvm", {"group": 2, "column": "Force"})
    np.testing.assert_allclose(one.value, 1e3 * FORCE, rtol=1e-8)
    np.testing.assert_allclose(one.time_s, TIME, atol=1e-12)
    no_times = head.replace("X_Columns\tOne", "X_Columns\tNo")
    bare = "\n".join(line.split("\t", 1)[1] for line in rows.split("\n"))
    parts = no_times + bare, segment.replace(rows, bare)
    (tmp_path / "bare.lvm").write_text("\n\t\n".join(p.replace("X_Value\t", "") for p in parts))
    one = read_record(tmp_path / "bare.lvm", {"group": 2, "column": "Accel"})
    np.testing.assert_allclose(one.value, 2.0 * FORCE, rtol=1e-8)
    np.testing.assert_allclose(one.time_s, TIME, atol=1e-12)
    pytest.importorskip("RigolWFM")
    codes = np.round(100 * FORCE).astype(">i2").tobytes()
    (tmp_path / "j.isf").write_bytes(
        b':WFMPRE:BYT_NR 2;BIT_NR 16;ENCDG BIN;BN_FMT RI;BYT_OR MSB;NR_PT 30;WFID "Ch1";PT_FMT Y;'
        b'XINCR 5.0E-7;PT_OFF 0;XZERO 0.0E0;XUNIT "s";YMULT 1.0E-2;YZERO 0.0E0;YOFF 0.0E0;'
        b'YUNIT "V";:CURVE #260' + codes
    )
    one = read_record(tmp_path / "j.isf", {"quantity": "contact_force", "sensitivity": 0.01})
    np.testing.assert_allclose(one.value, 100 * np.round(FORCE, 2), atol=1e-9)
    np.testing.assert_allclose(np.diff(one.time_s), 5e-7, rtol=1e-9)


@pytest.mark.parametrize("ending", default(["npz", "csv", "parquet", "h5"], ["npz"]))
def test_exports_of_runs_are_records(tmp_path, ending):
    if ending == "h5":
        pytest.importorskip("h5py")
    run = ["run", "aluminium-3mm", "--set", "run.duration_s=0.0012", "--set", "controller.law=off",
           "--transport", "compiled", "-o", str(tmp_path / "r.mcap")]  # fmt: skip
    path = tmp_path / f"r.{ending}"
    assert invoke(run).exit_code == 0
    assert invoke(["export", str(tmp_path / "r.mcap"), "-o", str(path)]).exit_code == 0
    one = read_record(path, {"quantity": "contact_force"})
    assert one.interval_s == pytest.approx(1e-6)
    assert 40.0 < np.max(one.value) < 120.0
    assert one.measurement.control in (None, False)


def test_recordings_of_runs_are_records(tmp_path):
    """The recording says which filters its sensor has; a run under a law needs one."""
    path = tmp_path / "r.mcap"
    run = ["run", "aluminium-3mm", "--set", "run.duration_s=0.0012", "--set", "run.lead_in_s=3e-4",
           "--transport", "inprocess", "--overwrite", "--out", str(path)]  # fmt: skip
    sensor = [
        "sensors.quantity=v_p",
        "sensors.low_pass_hz=80e3",
        "sensors.noise_rms=1e-3",
        "sensors.low_pass=bessel",
        "sensors.low_pass_order=4",
        "run.accuracy=1e-4",
        "controller.law=off",
    ]
    assert invoke([*run, *as_options(sensor)]).exit_code == 0
    one = read_record(path)
    found = one.measurement
    filters = found.low_pass_hz, found.low_pass, found.low_pass_order
    assert (one.quantity, *filters) == ("v_p", 80e3, "bessel", 4)
    [estimate] = fitted(scene("sphere.radius_m=0.0031"), one, RADIUS).estimates
    assert estimate.value == pytest.approx(3e-3, rel=5e-3)
    assert invoke(run).exit_code == 0
    under = read_record(path)
    assert under.measurement.control is True
    with pytest.raises(RecordError, match="law = off: a record is under"):
        fitted(scene(), under, RADIUS)


@pytest.mark.parametrize(("first", "last"), [(0, 0), (2, 2), (2, 99), (0, 99)])
def test_a_damaged_recording_gives_the_samples_before_its_first_gap(tmp_path, first, last):
    whole = record(tmp_path / "a.mcap")
    sizes = [m.header.first_step for m in messages(whole) if m.stream == "daq"]
    cut = rewrite(
        whole,
        tmp_path / "b.mcap",
        lambda m: m.stream != "daq" or not first <= m.number <= last,
    )
    if first == 0:
        with pytest.raises(RecordError, match="is damaged: its first samples are missing"):
            read_record(cut)
    else:
        expected, found = read_record(whole), read_record(cut)
        np.testing.assert_array_equal(found.time_s, expected.time_s[: sizes[first]])
        np.testing.assert_array_equal(found.value, expected.value[: sizes[first]])
        assert ("later ones are not used" in " ".join(found.notes)) == (last < len(sizes))


@pytest.mark.parametrize(
    "given", [{"quantity": "contact_force"}, {"quantity": "force"}, {"column": 2}]
)
def test_a_chosen_column_keeps_what_its_table_says(tmp_path, given):
    path = tmp_path / "two.csv"
    rows = zip(TIME, FORCE, 2.0 * FORCE, strict=True)
    path.write_text("time_s,f,a\n" + "".join(f"{t:.9g},{f},{a}\n" for t, f, a in rows))
    path.with_suffix(".toml").write_text(
        '[[record]]\nquantity = "contact_force"\ncolumn = "f"\nunit = "N"\nsensitivity = 0.5\n'
        '[[record]]\nquantity = "acceleration"\ncolumn = "a"\nunit = "m/s^2"\n'
    )
    np.testing.assert_allclose(read_record(path, given).value, 2.0 * FORCE)
    assert read_record(path, {"quantity": "acceleration"}).quantity == "acceleration"


def _tdms(path, columns):
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment(
            [
                nptdms.ChannelObject("g", name, values, properties={"wf_increment": 5e-7})
                for name, values in columns.items()
            ]
        )


def _parquet(path, columns):
    import pyarrow.parquet

    pyarrow.parquet.write_table(pyarrow.table(columns), path)


def _hdf5(path, columns):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        for name, values in columns.items():
            file[name] = values


def _uff(path, columns):
    pyuff = pytest.importorskip("pyuff")
    plain = {"type": 58, "rsp_node": 1, "rsp_dir": 3, "ref_node": 1, "ref_dir": 3,
             "ordinate_spec_data_type": 9, "orddenom_spec_data_type": 0,
             "ordinate_axis_units_lab": "N", "abscissa_spec_data_type": 17, "x": TIME}  # fmt: skip
    pyuff.UFF(str(path)).write_sets(
        [
            plain
            | (
                {"func_type": 4, "data": FORCE + 1j}
                if name == "note"
                else {"func_type": 1, "data": values}
            )
            | {"id1": name}
            for name, values in columns.items()
        ],
        "overwrite",
    )


def _mdf(path, columns):
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF() as file:
        file.append(
            [
                asammdf.Signal(
                    np.array(values, "S4" if name == "note" else "f8"),
                    TIME,
                    name=name,
                    encoding="utf-8",
                )
                for name, values in columns.items()
            ]
        )
        file.save(path)


def _text(path, columns):
    rows = zip(*columns.values(), strict=True)
    path.write_text("\n".join([",".join(columns), *(",".join(map(str, row)) for row in rows)]))


def _lvm(path, columns):
    segment = "Channels\t3\n***End_of_Header***\n" + "\n".join(
        "\t".join(map(str, row)) for row in [[*columns], *zip(*columns.values(), strict=True)]
    )
    head = "LabVIEW Measurement\nSeparator\tTab\n***End_of_Header***\n\n"
    path.write_text(f"{head}{segment}\n\n{segment}")


def _npz(path, columns):
    np.savez(path, **columns)


def _mat(path, columns):
    import scipy.io

    scipy.io.savemat(path, columns)


@pytest.mark.parametrize(("ending", "write", "channel"), [
    ("csv", _text, 2), ("lvm", _lvm, 2), ("npz", _npz, 2), ("mat", _mat, 2),
    ("parquet", _parquet, 2), ("h5", _hdf5, 2),
    ("tdms", _tdms, 4), ("uff", _uff, 4), ("mf4", _mdf, 4),
])  # fmt: skip
def test_every_format_counts_columns_of_times_and_unused_ones(tmp_path, ending, write, channel):
    path = tmp_path / f"r.{ending}"
    notes = ["ab", "cd"] * 15
    write(path, {"note": notes, "time_s": TIME, "u": -FORCE, "v": FORCE})
    told = {"quantity": "contact_force", "unit": "N"} | ({"group": 2} if ending == "lvm" else {})
    for given in ({"column": 4}, {"channel": channel}):
        one = read_record(path, told | given)
        np.testing.assert_allclose(one.value, FORCE, rtol=1e-6)
    assert "4 'v'" in one.source
    with pytest.raises(RecordError, match=r"record\.column = 5: not a column"):
        read_record(path, {**told, "column": 5})
