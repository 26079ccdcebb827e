"""Records in text tables: layouts of instruments and programs, units, choices, refusals."""

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hertzloop.common.optional_dependencies import EXTRAS
from hertzloop.fitting.fit.reports.file_description import describe_file
from hertzloop.fitting.records.errors import RecordError
from hertzloop.fitting.records.formats import FORMATS
from hertzloop.fitting.records.reading import read_record, read_records
from hertzloop.fitting.records.units import name_and_unit, unit_of
from hertzloop.recordings.recording_file import UnreadableRecording
from tests.commands import invoke
from tests.fitting.records.text_tables import draw, judged

COUNT, STEP_S = 40, 5e-7
TIME = STEP_S * np.arange(COUNT) - 2e-6
FORCE = np.round(np.sin(np.arange(COUNT)) + 0.01, 6)
KIND = {"quantity": "contact_force"}


def read(folder: Path, text: str, **given: Any) -> Any:
    """Read a text as a record."""
    (folder / "r.csv").write_text(text, encoding="utf-8")
    return read_record(folder / "r.csv", given)


def rows(*columns: Any, form: str = "{},{}") -> str:
    """Lines of a table, one for each sample."""
    return "\n".join(form.format(*cells) for cells in zip(*columns, strict=True)) + "\n"


def table(above: str, row: str) -> str:
    """Lines `above`, and a row for each sample."""
    lines = [above]
    for k, (t, v) in enumerate(zip(TIME, FORCE, strict=True)):
        since = f"{13.25 + STEP_S * k:.7f}"
        lines.append(row.format(
            k=k, i=5 * k, s=f"{t:.9g}", ms=f"{1e3 * t:.9g}", us=f"{1e6 * t:.9g}", n=f"{v:.9g}",
            kn=f"{1e-3 * v:.9g}", hms=f"10:12:{since.replace('.', ':')}", d=f"{500 * k:09d}",
        ))  # fmt: skip
    return "\n".join(lines) + "\n"


XY = rows(TIME, FORCE)
Y = rows(FORCE, form="{}")


# What stands above the rows, and a row.
LAYOUTS = {
    "Yokogawa, one trace": (
        '"TraceName","CH1"\n"VUnit","N"\n"HResolution",5.0E-07\n"HUnit","s"\n"Date","2026/11/26"\n'
        '"Time","10:15:33.44"\n', "{n},"),
    "Yokogawa, facts just above the values": (
        '"VUnit","N"\n"HUnit","s"\n"SampleRate",2.0E+06\n"HResolution",5.0E-07', ",{n}"),
    "Yokogawa, other units": ('"TraceName","CH1"\n"HResolution",5e-7\n"VUnit","kN"\n', ",{kn}"),
    "DIAdem": ("Channel;Time;Force\nUnit;s;N\nLength;40;40", ";{s};{n}"),
    "Pulse, numbered rows without names": (
        "Header Size: 18\nX-axis unit: s\nX-axis delta: 5e-07\nY-axis unit: N\nTitle 1: Hammer\n",
        "{k}\t{s}\t{n}"),
    "Rigol, times in the heading": ("CH1(N),t0 = -2.0e-06, tInc = 5.0e-07,", "{n},"),
    "a time of day above the values": (
        "Vertical Units,N\nHorizontal Units,S\nSampling Period,5e-07\nTime,26-Nov-26 10:12:13\n"
        "Waveform Data,", "{n},"),
    "a title above two columns": ("Waveform Data,,", "{s},{n},"),
    "OWON": ("Channel :,CH1\nTime interval :,0.50000uS\n\nindex,CH1(N)", "{k},{n}"),
    "facts in comments, run together": (
        "# XAxisUnit = s\n# YAxisUnit = N\n# DeltaX = 5e-07", "{n}"),
    "a rate with a prefix": ("Sampling Rate: 2 MHz\nForce", "{n}"),
    "an interval behind an equals sign": ("dt = 0.5 us\nForce", "{n}"),
    "milliseconds after a colon": ("Time;Force [N]", "{hms};{n}"),
    "pandas timedelta": (",force_n", "0 days 00:00:00.{d},{n}"),
    "MATLAB timetable": ("Time,force_n", "{s} sec,{n}"),
    "columns of units": ("Time,Unit,Force,Unit", "{us},us,{kn},kN"),
    "a unit that ends in a digit": ("Time [s];Force [N];Acc [m/s2]", "{s};{n};{n}"),
    "another rate above the times": ("Sample rate: 1 MHz\nTime (s),Force (N)", "{s},{n}"),
    "units after a stroke": ("t/us,F/kN,n", "{us},{kn},{k}"),
    "units after a word": ("in s,C1 in kN", "{s},{kn}"),
    "the unit of a channel": ("Vertical Units,CH1:kN\nSource,CH1\nSecond,Value", "{s},{kn}"),
    "times behind the values": ("Force [N],Time [ms]", "{n},{ms}"),
    "a date beside the times": (
        "Date,Time,Elapsed (ms),Force", "2024-01-02,10:11:12.{i:07d},{ms},{n}"),
    "a rate above a sequence": ("#Sample rate: 2e6Hz\nx,CH1\nSequence,kN", "{k},{kn}"),
    "units and a remark": ("Time;Force\ns;kN\n# remark", "{s};{kn}"),
    "an index without a name": (",time_s,Force", "{k},{s},{n}"),
    "spaces": ("time_s contact_force_n", "{s} {n}"),
    "a line of units": ("time_s,contact_force_n\ns,N", "{s},{n}"),
    "units in brackets": ("Time,Force\n(us),(kN)", "{us},{kn}"),
    "quotes": ('"time_s","contact_force_n"', '"{s}","{n}"'),
}  # fmt: skip


def layouts() -> Iterator[tuple[str, str]]:
    """Layouts, each with a text that gives the record."""
    for name, (above, row) in LAYOUTS.items():
        yield name, table(above, row)
    for name, cell in (("semicolons", ";"), ("tabs", "\t")):
        text = table(f"time_s{cell}contact_force_n", f"{{s}}{cell}{{n}}")
        yield f"{name} and decimal commas", text.replace(".", ",")
    facts = ['"Points",40', f'"Sample Interval",{STEP_S}', '"Trigger Time",0.01']
    yield (
        "Tektronix, facts beside the rows",
        "".join(
            f'{facts[i]},"s",{t},{v}\n' if i < 3 else f",,,{t},{v}\n"
            for i, (t, v) in enumerate(zip(TIME, FORCE, strict=True))
        ),
    )


@pytest.mark.parametrize(("layout", "text"), list(layouts()))
def test_a_layout_gives_the_record(tmp_path, layout, text):
    record = read(tmp_path, text, quantity="contact_force")
    assert record.value == pytest.approx(FORCE, abs=1e-9), layout
    assert record.interval_s == pytest.approx(STEP_S, rel=1e-4), record.source


def test_units_of_time_and_names_in_another_alphabet(tmp_path):
    rows = "\n".join(f"{i};{i % 5}" for i in range(20))
    (tmp_path / "r.csv").write_text(f"Time (\u00b5s);Velocity [mm/s]\n{rows}\n", "cp1252")
    one = read_record(tmp_path / "r.csv")
    np.testing.assert_allclose(one.time_s, 1e-6 * np.arange(20), rtol=1e-12)
    assert (one.quantity, one.value[3]) == ("v_p", pytest.approx(3e-3))


def test_drawn_tables_are_read_rightly_or_refused(tmp_path):
    """The program `python -m tests.fitting.records.text_tables` reads many more."""
    found = [judged(draw(seed), seed, tmp_path) for seed in range(20_000, 20_060)]
    assert not [one for one in found if one.result == "wrong"]
    assert sum(one.result == "right" for one in found) > 40


@pytest.mark.parametrize(("text", "si", "size"), [
    ("(us)", "s", 1e-6), ("\u00b5s", "s", 1e-6), ("Volts", "V", 1.0), ("mV", "V", 1e-3),
    ("kN", "N", 1e3), ("mN", "N", 1e-3), ("Newtons", "N", 1.0), ("m/s\u00b2", "m/s^2", 1.0),
    ("mm / s", "m/s", 1e-3), ("m s^-2", "m/s^2", 1.0), ("g", "m/s^2", 9.80665),
    ("MSa/s", "Hz", 1e6), ("milliseconds", "s", 1e-3), ("in", "m", 0.0254),
])  # fmt: skip
def test_units_are_known_by_many_names(text, si, size):
    unit = unit_of(text)
    assert (unit.si, unit.size) == (si, pytest.approx(size, rel=1e-12))


def test_a_unit_that_could_be_two_is_not_known():
    """A meganewton in no record; a kilogram is no kilo-g."""
    assert [unit_of(text) for text in ("MN", "kg", "lb", "Nm", "foo", "")] == [None] * 6
    assert name_and_unit("Zeit / s", ()) == ("Zeit", "s")
    assert name_and_unit("channel_A", ()) == ("channel_A", "")


@pytest.mark.parametrize(("text", "given", "words"), [
    ("Time,Force [lb]\n" + XY, {}, "is in 'lb', which is no unit that is known"),
    ("Time,Force [V]\n" + XY, {}, "which is not a unit of contact_force.*record.sensitivity"),
    ("Time,Force\ns,counts\n" + XY, {}, "is in 'counts'"),
    ("Time [foo],Force\n" + XY, {}, "'foo' .* is not a known unit of time"),
    ("Time,Force [kN]\ns,N\n" + XY, {}, "two units, 'kN' and 'N'"),
    ("Time,Velocity [m/s]\n" + XY, KIND | {"sensitivity": 2}, "not a unit of"),
    ("Time,Force\n" + XY, {"rate_hz": 1e6}, "rate_hz = 1e\\+06: the times .* say 2e\\+06 Hz"),
    ("Sample Interval,0.5 foo\nn,Force\n" + XY, {"column": "Force", "quantity": "contact_force"},
     "no column time_s.*has no known unit of time"),
    ("Sample Interval,1e-7\nSample Rate,2e6\nForce,CH2\n" + XY, {}, "disagree about the time"),
    ("Time,Force\n" + XY, {"column": 7}, "record.column = 7: not a column"),
    ("Time,Force\n" + XY, {"channel": True}, "record.channel = True: must be a name or a number"),
    ("Force,Time,Velocity,Time\n" + rows(FORCE, TIME, FORCE, 3 * TIME, form="{},{},{},{}"),
     {"column": 3, "quantity": "v_p"}, "two columns of times disagree"),
    ("Time,Force\n" + rows(TIME + 1.7e9, FORCE, form="{:.6f},{}"), {}, "its times"),
    ("", {}, "no samples"), ("time_s,contact_force_n\n", {}, "no samples"),
    ("time_s,what\n0,1\n1,2\n", {}, "known quantity"),
    ("contact_force_n\n" + "1\n" * 20, {}, "rate_hz"),
    ("time_s,contact_force_n\n" + "1,1\n" * 20, {}, "rise.*sample 2 at 1 s follows sample 1"),
    ("zeit,contact_force_n\n" + "1,1\n" * 20, {}, "no column time_s; the columns are zeit"),
    ("time_s,contact_force_n\n" + "0,1,1,5\n" * 20, {}, "decimal commas"),
    ("t_ms;force_mn\n1.600;497\n1.601;9,884\n", {}, "'9,884' may be 9.884 or 9884"),
    ('t_ms\tforce_mn\n1.600\t497\n1.601\t"9,884"\n', {}, "'9,884' may be 9.884 or 9884"),
    ('t_ms,force_mn\n1.600,497\n1.601,"9,884"\n', {}, "'9,884' may be 9.884 or 9884"),
    ("t_ms;force_mn\n1,600;497\n1,601;9.884\n", {}, "'1,600' may be 1.600 or 1600"),
    ("t_ms;force_mn\n0,600;497\n0,601;9.884\n", {}, "'9.884' may be 9.884 or 9884"),
    ("Time,Force\n" + rows(-TIME, FORCE), {}, "do not rise.*sample 2 at .* follows sample 1"),
    ("Time,Force\n" + XY, {"point_m": (0.1, 0.1)}, "a contact_force has no measuring point"),
    ("0,1\n" * 20, {}, "two whole numbers or one with a decimal comma"),
    ("Time,Force\ns,N\nx1,x1000\n" + XY, KIND, "'x1, x1000', which may be part of them"),
    ("Time,Force\ns,N\nMultiplier,1000\n" + XY, KIND, "a factor of its values, '1000'"),
    (f"{COUNT}\n" + Y, KIND | {"rate_hz": 2e6}, "counts those below it"),
    ("dt;5e-07\nforce_n;\n" + rows(FORCE[:9], form="{};") + ";\n" + rows(FORCE[9:], form="{};"),
     KIND, "empty lines stand between rows without times"),
    ("Sample Interval,5e-07\nforce_n,Time,other_v\n"
     + rows(FORCE[:9], TIME[:9], FORCE[:9], form="{},{},{}") + ",,\n"
     + rows(FORCE[9:], TIME[9:], FORCE[9:], form="{},{},{}"),
     KIND, "empty lines stand between rows without times"),
    ("Time (s),-Force (N)\n" + XY, {}, "no column is a known quantity"),
    ("Time,force_n\n" + rows(TIME, FORCE, form="{} sec,{} N"), KIND, "is not used: column force_n"),
])  # fmt: skip
def test_a_table_that_can_mean_two_things_is_refused(tmp_path, text, given, words):
    with pytest.raises(RecordError, match=words):
        read(tmp_path, text, **given)


def test_a_record_that_is_no_table_is_refused(tmp_path):
    for text in ("record = 3", "record = [1, 2]"):
        (tmp_path / "rig.toml").write_text(text)
        with pytest.raises(RecordError, match=r"rig\.toml: .* is not a table. Write \[record\]"):
            read_records(tmp_path / "rig.toml")


def test_a_unit_and_a_factor_can_be_told(tmp_path):
    pounds = read(tmp_path, f"Time,Force [lb]\n{XY}", unit="lbf")
    assert pounds.value == pytest.approx(4.4482216 * FORCE)
    one = read(tmp_path, f"Time [foo],Force\n{XY}", time_unit="ms")
    assert one.interval_s == pytest.approx(5e-10)
    volts = read(tmp_path, f"Time,Force [mV]\n{XY}", sensitivity=10.0)
    assert volts.value == pytest.approx(FORCE / 10.0)
    assert "in mV, 10 for one N" in volts.source
    scaled = read(tmp_path, f"Scale factor: 1000\nTime (s),Force (N)\n{XY}", sensitivity=1e-3)
    assert scaled.value == pytest.approx(1e3 * FORCE)


def test_two_series_of_one_kind_are_refused_until_one_is_chosen(tmp_path):
    four = rows(TIME, FORCE, TIME, FORCE, form="{},{},{},{}")
    text = f"Time (us),Force (N),Time (ms),Force (kN)\n{four}"
    with pytest.raises(RecordError, match=r"2 series could be the record: column 2 .*column 4 "):
        read(tmp_path, text)
    for given in ({"column": 4}, {"group": 2}, {"group": "2"}, {"channel": 2}):
        one = read(tmp_path, text, **given)
        assert one.value == pytest.approx(1e3 * FORCE)
        assert one.interval_s == pytest.approx(5e-10)
    assert read(tmp_path, text, column=4, time_column=1).interval_s == pytest.approx(5e-13)


def test_a_second_column_that_could_be_the_record_is_named(tmp_path):
    rows = "\n".join(f"{1e-6 * i},{i % 5},{i % 3}" for i in range(20))
    (tmp_path / "r.csv").write_text(f"time_s,contact_force_n,v_p_m_s\n{rows}\n")
    one = read_record(tmp_path / "r.csv")
    assert one.quantity == "contact_force"
    assert "v_p_m_s is not. Choose with record.column" in one.notes[0]
    assert read_record(tmp_path / "r.csv", {"column": "v_p_m_s"}).quantity == "v_p"


def test_a_table_below_a_long_preamble_says_what_it_is(tmp_path):
    above = "".join(f"Key {i},{i}\n" for i in range(400))
    one = read(tmp_path, f"{above}Time,Force\n(ms),(N)\n" + XY + "END\n")
    assert one.source == (
        "time: column 1 'Time' in ms; contact_force: column 2 'Force' in N; 402 lines above the "
        "table"
    )
    assert one.notes == ("r.csv: not used below the table: 1 lines from 'END' on.",)
    assert one.value == pytest.approx(FORCE)


def test_dates_count_from_the_first_one(tmp_path):
    for form in (
        "2024-05-06 23:59:59.{:06d}",
        "06.05.2024 23:59:59.{:06d}",
        "23:59:59.{:06d}",
        "2024-05-06T23:59:59.{:06d}Z",
        "11:59:59.{:06d} PM",
    ):
        one = read(
            tmp_path, f"Timestamp,Force\n{rows(range(0, 400, 10), FORCE, form=form + ',{}')}"
        )
        np.testing.assert_allclose(np.diff(one.time_s), 1e-5, atol=2e-11)
    over = [f"06.05.2024 23:59:59.{i}" for i in range(5)] + ["07.05.2024 00:00:00.0"] * 5
    with pytest.raises(RecordError, match="may name the day or the month first"):
        read(tmp_path, f"Timestamp,Force\n{rows(over, over, form='{},1')}")


def test_a_file_beside_the_table_describes_it(tmp_path):
    text = f"time_s,v_p_mm_s\n{rows(TIME, FORCE)}"
    one = read(tmp_path, text)
    assert one.quantity == "v_p"
    assert one.value == pytest.approx(1e-3 * FORCE)
    beside = tmp_path / "r.toml"
    beside.write_text("[record]\nsensitivity = 10.0\nclock_tolerance_ppm = 5\n")
    one = read(tmp_path, text)
    assert one.value == pytest.approx(1e-4 * FORCE)
    assert one.measurement.clock_tolerance_ppm == 5
    beside.write_text("[record]\nsensitvity = 10.0\n")
    with pytest.raises(RecordError, match="sensitvity"):
        read(tmp_path, text)


def test_check_of_a_record_alone_shows_what_was_read(tmp_path):
    path = tmp_path / "r.csv"
    path.write_text(f"Time [us],Force [kN]\n{XY}")
    done = invoke(["fit", "--check", str(path)])
    assert done.exit_code == 0, done.output
    assert "time: column 1 'Time [us]' in us; contact_force: column 2 'Force [kN]' in kN" in (
        " ".join(done.output.split())
    )
    assert len(describe_file(path)) == 7


def test_the_documentation_lists_every_format(tmp_path, monkeypatch):
    page = (Path(__file__).resolve().parents[3] / "docs" / "how-to" / "fit.md").read_text(
        encoding="utf-8"
    )
    rows = re.findall(r"^\| ([\w .]+) \| ((?:`\.\w+`(?:, )?)+) \| (.*?) \|$", page, re.MULTILINE)
    listed = [
        (name, tuple(re.findall(r"`(\.\w+)`", endings)), extra.strip("`"))
        for name, endings, extra in rows
    ]
    for name in {*EXTRAS, *(one for one in sys.modules if one.partition(".")[0] in EXTRAS)}:
        monkeypatch.setitem(sys.modules, name, None)

    def extra_of(row):
        try:
            row.read(tmp_path / "missing")
        except ModuleNotFoundError as error:
            return EXTRAS[error.name.partition(".")[0]]
        except (OSError, UnreadableRecording):
            return ""

    assert listed == [(one.name, one.endings, extra_of(one)) for one in FORMATS]
