"""Reading measured records: text tables as programs write them, other formats, and choices."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hertzloop.common.optional_dependencies import EXTRAS
from hertzloop.identification.fit.file_description import describe_file
from hertzloop.identification.records.errors import RecordError
from hertzloop.identification.records.formats import FORMATS
from hertzloop.identification.records.reading import read_record
from hertzloop.identification.records.text.facts import stated_spacing
from hertzloop.identification.records.text.reading import read_table
from hertzloop.identification.records.units import name_and_unit, unit_of
from tests.commands import invoke
from tests.identification.text_tables import draw, judged
from tests.tiers import default

ROOT = Path(__file__).resolve().parents[2]
TIME = 5e-7 * np.arange(30)
FORCE = np.round(np.sin(np.arange(30.0)) + 0.01, 6)
ROWS = [f"{t:.9g},{v:.9g}" for t, v in zip(TIME, FORCE, strict=True)]


def read(folder: Path, text: str, **given: Any) -> Any:
    """Read a text as a record."""
    path = folder / "r.csv"
    path.write_text(text, encoding="utf-8")
    return read_record(path, given)


def test_drawn_tables_are_read_rightly_or_refused(tmp_path: Path) -> None:
    """The program `python -m tests.identification.text_tables` reads many more."""
    found = [judged(draw(seed), seed, tmp_path) for seed in range(20_000, 20_060)]
    assert not [one for one in found if one.result == "wrong"]
    assert sum(one.result == "right" for one in found) > 40


@pytest.mark.parametrize(("text", "si", "size"), [
    ("(us)", "s", 1e-6), ("\u00b5s", "s", 1e-6), ("Volts", "V", 1.0), ("mV", "V", 1e-3),
    ("kN", "N", 1e3), ("mN", "N", 1e-3), ("Newtons", "N", 1.0), ("m/s\u00b2", "m/s^2", 1.0),
    ("mm / s", "m/s", 1e-3), ("m s^-2", "m/s^2", 1.0), ("g", "m/s^2", 9.80665),
    ("MSa/s", "Hz", 1e6), ("milliseconds", "s", 1e-3), ("in", "m", 0.0254),
])  # fmt: skip
def test_units_are_known_by_many_names(text: str, si: str, size: float) -> None:
    unit = unit_of(text)
    assert unit is not None
    assert (unit.si, unit.size) == (si, pytest.approx(size, rel=1e-12))


def test_a_unit_that_could_be_two_is_not_known() -> None:
    """A meganewton in no record; a kilogram is no kilo-g."""
    assert [unit_of(text) for text in ("MN", "kg", "lb", "Nm", "foo", "")] == [None] * 6
    assert name_and_unit("Zeit / s", ()) == ("Zeit", "s")
    assert name_and_unit("channel_A", ()) == ("channel_A", "")


@pytest.mark.parametrize(("text", "given", "words"), [
    ("Time,Force [lb]\n", {}, "is in 'lb', which is no unit that is known"),
    ("Time,Force [V]\n", {}, "is in 'V', which is not a unit of contact_force.*record.sensitivity"),
    ("Time,Force\ns,counts\n", {}, "is in 'counts'"),
    ("Time [foo],Force\n", {}, "'foo' .* is not a known unit of time"),
    ("Time,Force [kN]\ns,N\n", {}, "two units, 'kN' and 'N'"),
    ("Time,Velocity [m/s]\n", {"quantity": "contact_force", "sensitivity": 2}, "not a unit of"),
    ("Time,Force\n", {"rate_hz": 1e6}, "record.rate_hz = 1e\\+06: the times .* say 2e\\+06 Hz"),
    ("Sample Interval,0.5 foo\nn,Force\n", {"column": "Force", "quantity": "contact_force"},
     "no column time_s.*has no known unit of time"),
    ("Sample Interval,1e-7\nSample Rate,2e6\nForce,CH2\n", {}, "disagree about the time"),
    ("Time,Force\n", {"column": 7}, "record.column = 7: not a column"),
    ("Time,Force\n", {"channel": True}, "record.channel = True: must be a name or a number"),
])  # fmt: skip
def test_what_can_mean_two_things_is_refused(
    tmp_path: Path, text: str, given: dict[str, Any], words: str
) -> None:
    with pytest.raises(RecordError, match=words):
        read(tmp_path, text + "\n".join(ROWS), **given)


def test_a_unit_can_be_told(tmp_path: Path) -> None:
    rows = "\n".join(ROWS)
    assert read(tmp_path, f"Time,Force [lb]\n{rows}", unit="lbf").value[1] == pytest.approx(
        4.4482216 * FORCE[1]
    )
    one = read(tmp_path, f"Time [foo],Force\n{rows}", time_unit="ms")
    assert one.interval_s == pytest.approx(5e-10)
    volts = read(tmp_path, f"Time,Force [mV]\n{rows}", sensitivity=10.0)
    assert volts.value[1] == pytest.approx(FORCE[1] / 10.0)
    assert "in mV, 10 for one N" in volts.source


def test_two_series_of_one_kind_are_refused_until_one_is_chosen(tmp_path: Path) -> None:
    rows = "\n".join(f"{row},{row}" for row in ROWS)
    text = f"Time (us),Force (N),Time (ms),Force (kN)\n{rows}"
    with pytest.raises(RecordError, match=r"2 series could be the record: column 2 .*column 4 "):
        read(tmp_path, text)
    for given in ({"column": 4}, {"group": 2}, {"group": "2"}, {"channel": 2}):
        one = read(tmp_path, text, **given)
        assert one.value[1] == pytest.approx(1e3 * FORCE[1])
        assert one.interval_s == pytest.approx(5e-10)
    assert read(tmp_path, text, column=4, time_column=1).interval_s == pytest.approx(5e-13)


def test_a_table_below_a_long_preamble_says_what_it_is(tmp_path: Path) -> None:
    above = "".join(f"Key {i},{i}\n" for i in range(400))
    one = read(tmp_path, f"{above}Time,Force\n(ms),(N)\n" + "\n".join(ROWS) + "\nEND\n")
    assert one.source == (
        "time: column 1 'Time' in ms; contact_force: column 2 'Force' in N; 402 lines above the "
        "table"
    )
    assert one.notes == ("r.csv: not used below the table: 1 lines from 'END' on.",)
    np.testing.assert_array_equal(one.value, FORCE)


@pytest.mark.parametrize(("above", "row", "given"), [
    ("t/us,F/kN", "{us},{kn}", {"column": 2}),
    ("in s,C1 in kN", "{s},{kn}", {}),
    ("Vertical Units,CH1:kN\nSource,CH1\nSecond,Value", "{s},{kn}", {}),
    ("Force [N],Time [ms]", "{n},{ms}", {}),
    ("Date,Time,Elapsed (ms),Force", "2024-01-02,10:11:12.{i:07d},{ms},{n}", {}),
    ('"TraceName","CH1"\n"HResolution",5e-7\n"VUnit","kN"\n', ",{kn}", {}),
    ("#Sample rate: 2e6Hz\nx,CH1\nSequence,kN", "{k},{kn}", {}),
    ("Time;Force\ns;kN\n# remark", "{s};{kn}", {}),
    (",time_s,Force", "{k},{s},{n}", {}),
])  # fmt: skip
def test_layouts_of_other_programs(
    tmp_path: Path, above: str, row: str, given: dict[str, Any]
) -> None:
    rows = [row.format(k=k, i=5 * k, s=f"{t:.9g}", ms=f"{1e3 * t:.9g}", us=f"{1e6 * t:.9g}",
                       n=f"{v:.9g}", kn=f"{1e-3 * v:.9g}")
            for k, (t, v) in enumerate(zip(TIME, FORCE, strict=True))]  # fmt: skip
    one = read(tmp_path, "\n".join([above, *rows]), quantity="contact_force", **given)
    np.testing.assert_allclose(one.value, FORCE, rtol=1e-12)
    np.testing.assert_allclose(np.diff(one.time_s), 5e-7, atol=2e-15)


def test_values_before_their_times_side_by_side_are_refused(tmp_path: Path) -> None:
    rows = "\n".join(f"{v},{t:.9g},{v},{3 * t:.9g}" for t, v in zip(TIME, FORCE, strict=True))
    with pytest.raises(RecordError, match="two columns of times disagree"):
        read(tmp_path, f"Force,Time,Velocity,Time\n{rows}", column=3, quantity="v_p")


def test_dates_count_from_the_first_one(tmp_path: Path) -> None:
    for form in ("2024-05-06 23:59:59.{:06d}", "06.05.2024 23:59:59.{:06d}", "23:59:59.{:06d}",
                 "2024-05-06T23:59:59.{:06d}Z", "11:59:59.{:06d} PM"):  # fmt: skip
        rows = "\n".join(f"{form.format(10 * i)},{v}" for i, v in enumerate(FORCE))
        one = read(tmp_path, f"Timestamp,Force\n{rows}")
        np.testing.assert_allclose(np.diff(one.time_s), 1e-5, atol=2e-11)
    over = [f"06.05.2024 23:59:59.{i}" for i in range(5)] + ["07.05.2024 00:00:00.0"] * 5
    with pytest.raises(RecordError, match="may name the day or the month first"):
        read(tmp_path, "Timestamp,Force\n" + "\n".join(f"{t},1" for t in over))


def test_facts_give_the_times(tmp_path: Path) -> None:
    path = tmp_path / "f.csv"
    for fact in ("Sample Interval,5e-07", "Sampling Rate: 2 MHz", "dt = 0.5 us", "# fs: 2e6"):
        path.write_text(f"{fact}\nForce\n" + "\n".join(map(str, FORCE)))
        found = stated_spacing(read_table(path, ("force",)))
        assert found is not None
        assert found[0] == pytest.approx(5e-7, rel=1e-12)


def test_large_times_are_refused(tmp_path: Path) -> None:
    rows = "\n".join(f"{1.7e9 + i * 1e-5:.6f},{v}" for i, v in enumerate(FORCE))
    with pytest.raises(RecordError, match="its times"):
        read(tmp_path, f"Time,Force\n{rows}")


def test_array_files_hold_records(tmp_path: Path) -> None:
    import scipy.io

    np.save(tmp_path / "a.npy", FORCE)
    np.save(tmp_path / "b.npy", np.stack([FORCE, -FORCE], axis=1))
    np.savez(tmp_path / "c.npz", force=FORCE[None], fs=2e6)
    scipy.io.savemat(tmp_path / "d.mat", {"time": TIME, "force": FORCE})
    scipy.io.savemat(tmp_path / "e.mat", {"drop": {"t": TIME, "force_kN": 1e-3 * FORCE}})
    of = {"quantity": "contact_force", "rate_hz": 2e6}
    with pytest.raises(RecordError, match="2 series could be the record"):
        read_record(tmp_path / "b.npy", of)
    cases: list[tuple[str, dict[str, Any]]] = [
        ("a.npy", of), ("b.npy", {**of, "channel": 1}), ("c.npz", {}), ("d.mat", {}), ("e.mat", {}),
    ]  # fmt: skip
    for name, given in cases:
        one = read_record(tmp_path / name, given)
        np.testing.assert_allclose(one.value, FORCE, rtol=1e-12)
        np.testing.assert_allclose(one.time_s, TIME, atol=1e-15)


def test_wav_channels_are_chosen_and_scaled(tmp_path: Path) -> None:
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


@pytest.mark.parametrize("ending", default(["npz", "csv", "parquet", "h5"], ["npz"]))
def test_exports_of_runs_are_records(tmp_path: Path, ending: str) -> None:
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


def test_channels_of_tdms_start_where_their_times_of_day_say(tmp_path: Path) -> None:
    nptdms = pytest.importorskip("nptdms")
    begun = np.datetime64("2026-05-06T12:00:00.250000")
    starts = {"Force": begun + np.timedelta64(1250, "us"), "Accel": begun, "Later": None}

    def written(starts: dict[str, Any]) -> Path:
        channels = [
            nptdms.ChannelObject("hits", name, FORCE, properties={
                "wf_increment": 5e-7, "wf_start_offset": 1e-6, "unit_string": unit,
            } | ({} if start is None else {"wf_start_time": start}))
            for (name, start), unit in zip(starts.items(), ("N", "m/s^2", "m/s"), strict=False)
        ]  # fmt: skip
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
def test_lvm_and_scope_files_are_read(tmp_path: Path) -> None:
    head = ("LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nDecimal_Separator\t,\n"
            "X_Columns\tOne\n***End_of_Header***\t\n\t\nChannels\t2\t\t\nSamples\t30\t30\n"
            "Y_Unit_Label\tkN\tm/s^2\nDelta_X\t5,0E-7\t5,0E-7\nX0\t0,0E+0\t0,0E+0\n"
            "***End_of_Header***\t\t\nX_Value\tForce\tAccel\tComment\n")  # fmt: skip
    rows = "\n".join(f"{t:.9e}\t{v:.9e}\t{2 * v:.9e}\t".replace(".", ",")
                     for t, v in zip(TIME, FORCE, strict=True))  # fmt: skip
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


def test_check_of_a_record_alone_shows_what_was_read(tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    path.write_text("Time [us],Force [kN]\n" + "\n".join(ROWS))
    done = invoke(["fit", "--check", str(path)])
    assert done.exit_code == 0, done.output
    assert "time: column 1 'Time [us]' in us; contact_force: column 2 'Force [kN]' in kN" in (
        " ".join(done.output.split())
    )
    assert len(describe_file(path, samples=3)) == 5


def test_the_documentation_lists_every_format() -> None:
    page = (ROOT / "docs" / "how-to" / "fit.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| ([\w .]+) \| ((?:`\.\w+`(?:, )?)+) \| (.*?) \|$", page, re.MULTILINE)
    listed = [(name, tuple(re.findall(r"`(\.\w+)`", endings)), extra.strip("`"))
              for name, endings, extra in rows]  # fmt: skip
    assert listed == [(one.name, one.endings, one.extra) for one in FORMATS]
    assert {one.extra for one in FORMATS} - {""} <= set(EXTRAS.values())
