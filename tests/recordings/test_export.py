"""Exports hold every sample of a recording, bit for bit, with its unit."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as arrow_csv
import pyarrow.parquet as parquet
import pytest
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from mcap_protobuf.decoder import DecoderFactory
from mcap_ros2_support_fast.decoder import DecoderFactory as Ros2Decoders

from hertzloop.recordings.export import samples as samples_module
from hertzloop.recordings.export.tables import columns_file
from hertzloop.recordings.reader import read
from hertzloop.recordings.recording import Recording
from tests.commands import refused, succeed
from tests.recordings import rewriting

Columns = dict[str, np.ndarray]  # by stream/column
KINDS: dict[str, Any] = {"time_ns": np.int64, "daq_code": np.int32, "daq_saturated": np.uint8}
SLOW_CONVERTER = ("sensors.bits=10", "sensors.every_steps=3")


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """A short run with a converter that is slower than the steps."""
    path = tmp_path_factory.mktemp("export") / "run.mcap"
    return rewriting.record(path, *SLOW_CONVERTER, compiled=True)


def expected(recording: Recording) -> Columns:
    """Every sample of a recording, read by the reader that all commands use."""
    found = {f"truth/{name}": values for name, values in recording.truth.arrays.items()}
    found["daq/daq_code"] = recording.daq.arrays["code"]
    found["daq/daq_value"] = recording.daq.values
    found["daq/daq_saturated"] = recording.daq.arrays["saturated"]
    found["force/command_n"] = recording.force.arrays["force_n"]
    for name in ("truth", "daq", "force"):
        found[f"{name}/time_ns"] = getattr(recording, name).time_ns
    return found


def by_stream(table: pa.Table, kinds: dict[str, Any]) -> Columns:
    """Columns of a table, cut into streams where they have values."""
    found: Columns = {}
    times = table["time_ns"].to_numpy()
    for name in table.column_names:
        if name not in ("step", "time_ns"):
            stream = {"daq": "daq", "com": "force"}.get(name[:3], "truth")
            present, values = ~table[name].is_null().to_numpy(), table[name].fill_null(0).to_numpy()
            found[f"{stream}/{name}"] = values[present].astype(kinds.get(name, float))
            found[f"{stream}/time_ns"] = times[present]
    return found


def from_parquet(path: Path) -> Columns:
    table = parquet.read_table(path)
    assert table.schema.field("v_p_m_s").metadata[b"unit"] == b"m/s"
    assert b"aluminium-3mm" in table.schema.metadata[b"scene.toml"]
    return by_stream(table, {field.name: field.type.to_pandas_dtype() for field in table.schema})


def from_csv(path: Path) -> Columns:
    """By a program that is told nothing of the format."""
    table, about = arrow_csv.read_csv(path), arrow_csv.read_csv(columns_file(path))
    assert table.column_names == about["column"].to_pylist()
    [velocity] = [row for row in about.to_pylist() if row["column"] == "v_p_m_s"]
    assert velocity["unit"] == "m/s"
    assert velocity["meaning"] == "plate velocity at the contact point at the start of the step"
    return by_stream(table, KINDS)


def from_mcap(path: Path) -> Columns:
    """Through the official readers, in order of the file and by its index."""
    with path.open("rb") as handle:
        list(StreamReader(handle, validate_crcs=True).records)
    found: dict[str, list[float]] = {}
    with path.open("rb") as handle:
        reader = make_reader(handle, decoder_factories=[Ros2Decoders(), DecoderFactory()])
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            assert message.log_time == message.publish_time
            if channel.topic == "/events":
                assert schema.name == "foxglove.Log"
                continue
            assert schema.name == "std_msgs/msg/Float64MultiArray"
            assert channel.metadata.keys() == {"unit", "meaning"}
            stream, column = channel.topic.removeprefix("/").split("/")
            [value] = decoded.data
            found.setdefault(f"{stream}/{column}", []).append(value)
            if column in ("xi_m", "daq_value", "command_n"):
                found.setdefault(f"{stream}/time_ns", []).append(message.log_time)
    return {
        name: np.array(values, KINDS.get(name.partition("/")[2], float))
        for name, values in found.items()
    }


READERS: dict[str, Callable[[Path], Columns]] = {
    "parquet": from_parquet,
    "csv": from_csv,
    "mcap": from_mcap,
}
each_format = pytest.mark.parametrize("ending", READERS)


@each_format
def test_read_back_every_sample_has_the_same_bits(file, tmp_path, ending, monkeypatch):
    monkeypatch.setattr(samples_module, "WINDOW_STEPS", 700)  # several pieces, cut anyhow
    succeed("export", file, "-o", tmp_path / f"x.{ending}")
    back, there = READERS[ending](tmp_path / f"x.{ending}"), expected(read(file))
    assert set(back) == set(there)
    for name, values in there.items():
        assert back[name].dtype == values.dtype, name
        assert back[name].tobytes() == values.tobytes(), name


@pytest.mark.parametrize(
    ("span", "words"),
    [
        (("--from", 5), "--from = 5: has no samples. Give a span within 0 to 2.499 ms"),
        (("--from", 0.0001, "--to", 0.0002), "--from = 0.0001, --to = 0.0002: has no samples"),
        (("--from", "inf"), "--from = inf: must be a finite number"),
    ],
)
def test_a_span_without_samples_is_refused(file, tmp_path, span, words):
    refused(words, "export", file, "-o", tmp_path / "x.csv", *span)
    assert not list(tmp_path.iterdir())


def test_what_is_missing_in_a_recording_is_missing_in_the_table(file, tmp_path):
    def without_second_block(sent: rewriting.Sent) -> bool:
        return not (sent.stream == "truth" and sent.number == 1)

    holed = rewriting.rewrite(file, tmp_path / "holed.mcap", without_second_block)
    assert "stream 'truth'" in succeed("export", holed, "-o", tmp_path / "x.parquet")
    table = parquet.read_table(tmp_path / "x.parquet")
    assert table["step"].to_pylist() == list(range(2500))
    assert table["xi_m"].is_null().to_numpy().nonzero()[0].tolist() == list(range(1000, 2500))
    assert table["command_n"].null_count == 0


def test_an_export_is_told_from_a_recording(file, tmp_path):
    for name, sentence in (
        ("x.mcap", "is an export of a recording, with one message a sample. Give the recording"),
        ("x.csv", "is not an MCAP recording of hertzloop. Its exports cannot be read back"),
    ):
        succeed("export", file, "-o", tmp_path / name)
        assert f"{tmp_path / name}" in refused(sentence, "inspect", tmp_path / name)


def test_the_users_mistakes(file, tmp_path):
    taken, beside = tmp_path / "taken.csv", tmp_path / "free-columns.csv"
    for path in (taken, beside):
        path.write_text("mine")
    for words, sentence in (
        (
            ("-o", tmp_path / "x.xlsx"),
            "unknown format. Use a name that ends in .mcap, .parquet, .csv",
        ),
        (("-o", taken), "exists. Choose another name"),
        (("-o", tmp_path / "free.csv"), "free-columns.csv exists"),
        (("-o", tmp_path / "x.csv", "--from", 2, "--to", 1), "--to = 1: is before --from = 2"),
    ):
        refused(sentence, "export", file, *words)
    assert taken.read_text() == "mine"
