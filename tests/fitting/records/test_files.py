"""Records in text tables, in files of arrays, and in recordings of hertzloop."""

import numpy as np
import pytest

from hertzloop.fitting.errors import RecordError
from hertzloop.fitting.records.reading import read_record, read_records
from tests.commands import as_options, invoke
from tests.fitting.fitting import RADIUS, fitted, scene
from tests.recordings.rewriting import messages, record, rewrite
from tests.tiers import default

TIME = 5e-7 * np.arange(30)
FORCE = np.round(np.sin(np.arange(30.0)) + 0.01, 6)


def table(names: str, sign: str = ",", decimal: str = ".", factor: float = 1.0) -> str:
    """A text table of the time and the force."""
    rows = [
        sign.join((f"{t:.7g}", f"{f:.9g}")) if decimal == "." else
        sign.join((f"{t:.7g}", f"{f:.9g}")).replace(".", decimal)
        for t, f in zip(TIME, factor * FORCE, strict=True)
    ]  # fmt: skip
    return "\n".join([names, *rows]) + "\n"


@pytest.mark.parametrize(
    ("text", "given"),
    [
        (table("time_s,contact_force_n"), {}),
        (table("Time [s];Force [N]", ";"), {}),
        (table("time_s\tforce_kN", "\t", factor=1e-3), {}),
        ("# a comment\n" + table('"time_s","force (mN)"', factor=1e3), {}),
        (table("time_s;force_n", ";", ","), {"decimal": ","}),
        (table("time,contact_force"), {"time_unit": "s", "unit": "N"}),
        (table("time_s,voltage_v", factor=0.01),
         {"quantity": "contact_force", "unit": "N", "sensitivity": 0.01}),
        (table("x;y", ";"),
         {"quantity": "force", "unit": "N", "column": 2, "time_column": "x", "time_unit": "s"}),
    ],
)  # fmt: skip
def test_text_tables_are_read(tmp_path, text, given):
    path = tmp_path / "drop.csv"
    path.write_text(text)
    one = read_record(path, given)
    assert one.quantity == "contact_force"
    np.testing.assert_allclose(one.time_s, TIME, atol=1e-12)
    np.testing.assert_allclose(one.value, FORCE, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize(
    ("text", "given", "words"),
    [
        (table("time_s,contact_force"), {}, r"it may be in N or in kN\. Give record\.unit"),
        (table("time,force_n"), {}, r"it may be in s or in ms\. Give record\.time_unit"),
        (table("time_s,force [MN]"), {}, r"is in 'MN', which is not one of N, kN"),
        (table("time_s,force_kn"), {"unit": "N"}, r"'N': the column 'force_kn' .* says 'kN'"),
        (table("time_s,force_v"), {}, r"is in 'V', .* or record\.sensitivity"),
        (table("time_s;force_n", ";", ","), {}, r"decimal sign, give record\.decimal = ','"),
        (table("time_s;force_n", ";"), {"decimal": ","}, "invalid value"),
        (table("time_s,force_n").replace("\n", ",\n")[len("x"):], {}, "columns|name its columns"),
        ("sep=;\n" + table("time_s;force_n", ";"), {}, r"hertzloop\.Record\(\"drop\.csv\""),
        (table("time_s,force_n").replace("\n", "\n\n", 3), {}, "an empty line between"),
        (table("time_s,force_n"), {"rate_hz": 2e6}, "has times in the column 'time_s'"),
        ("# [record]\n# unit = \"kN\"\n" + table("time_s,force_n"), {}, r"Write .* drop\.toml"),
        (table("force_n,contact_force_n"), {"rate_hz": 2e6}, "several columns could be meant"),
        (table("time_s,force_n"), {"column": "f"}, r"'f': not a column .* time_s, force_n"),
    ],
)  # fmt: skip
def test_what_could_mean_two_things_is_refused(tmp_path, text, given, words):
    path = tmp_path / "drop.csv"
    path.write_text(text)
    with pytest.raises(RecordError, match=words):
        read_record(path, given)


def test_missing_values_are_left_out(tmp_path):
    path = tmp_path / "drop.csv"
    path.write_text(table("time_s,force_n").replace(f",{FORCE[3]}", ",", 1).replace(
        f",{FORCE[4]}", ",inf", 1))  # fmt: skip
    one = read_record(path)
    assert list(np.flatnonzero(np.isnan(one.value))) == [3, 4]
    assert "2 samples are not numbers" in one.notes[0]


def test_array_files_hold_records(tmp_path):
    import pyarrow
    import pyarrow.parquet

    np.savez(tmp_path / "a.npz", time_us=1e6 * TIME, force_kN=1e-3 * FORCE, name=np.array("drop"))
    columns = pyarrow.table({"time_s": TIME, "contact_force_n": FORCE, "note": ["a"] * 30})
    pyarrow.parquet.write_table(columns, tmp_path / "b.parquet")
    np.savez(tmp_path / "c.npz", force_n=FORCE)
    for name, given in (("a.npz", {}), ("b.parquet", {}), ("c.npz", {"rate_hz": 2e6})):
        one = read_record(tmp_path / name, given)
        np.testing.assert_allclose(one.value, FORCE, atol=1e-12)
        np.testing.assert_allclose(one.time_s, TIME, atol=1e-12)
    np.savez(tmp_path / "d.npz", time_s=TIME[:20], force_n=FORCE)
    with pytest.raises(RecordError, match="'time_s' has 20 values, 'force_n' 30"):
        read_record(tmp_path / "d.npz")


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.tdms", b"TDSm", r"'\.tdms' is not a known format.*hertzloop\.Record of arrays"),
        ("a.npz", b"anything", r"a\.npz: cannot be read as npz"),
        ("a.csv", b"time_s,force_n\n0,\xf6\n", "is not in UTF-8"),
        ("a.csv", b"", "has no rows"),
    ],
)
def test_other_files_are_refused(tmp_path, name, content, words):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(RecordError, match=words):
        read_record(tmp_path / name)


def test_channels_of_one_file_share_its_clock(tmp_path):
    path = tmp_path / "two.npz"
    np.savez(path, time_s=TIME, f=FORCE, a=2.0 * FORCE)
    path.with_suffix(".toml").write_text(
        '[[record]]\nquantity = "contact_force"\ncolumn = "f"\nunit = "N"\nsensitivity = 0.5\n'
        '[[record]]\nquantity = "acceleration"\ncolumn = 3\nunit = "m/s^2"\n'
    )
    first, second = read_records(path)
    assert first.clock == second.clock != ""
    assert (first.name, second.name) == ("two.npz, contact_force", "two.npz, acceleration")
    np.testing.assert_allclose(first.value, second.value)
    with pytest.raises(RecordError, match="holds 2 records"):
        read_record(path)


@pytest.mark.parametrize("ending", default(["csv", "parquet"], ["csv"]))
def test_exports_of_runs_are_records(tmp_path, ending):
    run = ["run", "aluminium-3mm", "--set", "run.duration_s=0.0012", "--set", "controller.law=off",
           "--transport", "compiled", "-o", str(tmp_path / "r.mcap")]  # fmt: skip
    path = tmp_path / f"r.{ending}"
    assert invoke(run).exit_code == 0
    assert invoke(["export", str(tmp_path / "r.mcap"), "-o", str(path)]).exit_code == 0
    one = read_record(path, {"column": "f_c_n"})
    assert one.interval_s == pytest.approx(1e-6)
    assert 40.0 < np.nanmax(one.value) < 120.0


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


@pytest.mark.parametrize(("first", "last"), [(0, 0), (2, 2), (2, 99)])
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
        assert ("gap on stream 'daq'" in " ".join(found.notes)) == (last < len(sizes))
