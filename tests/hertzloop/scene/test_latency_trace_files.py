"""Latency traces from tables of latencies or time stamps, and histograms of cyclictest."""

from pathlib import Path
from typing import Any

import pytest
from mcap.writer import Writer

from hertzloop.scene.latency_trace import MOST_LATENCIES, latencies_of_file
from tests.hertzloop.own_laws import EXAMPLES

HISTOGRAM = (
    "# Histogram\n000000 000000\t000000\n000003 000005\t000000\n000007 000001\t000002\n"
    "# Total: 000000006 000000002\n# Histogram Overflows: 00000 00001\n"
)
STAMPS = "sample_ns;command_ns\n1764288000000000001;1764288000000000501\n"


def latencies(folder: Path, content: str, use: str | None = None, **table: Any) -> list[float]:
    """The latencies of a file with this content."""
    (folder / "trace.txt").write_text(content)
    return latencies_of_file({"file": "trace.txt", **table}, use, folder)


@pytest.mark.parametrize(
    ("content", "table", "expected"),
    [
        (STAMPS, {}, [0.5]),
        (
            "callback_start;callback_end\n5000;7500\n",
            {"sample": "callback_start", "command": "callback_end", "unit": "ns"},
            [2.5],
        ),
        ("sample_us,command_us\n10,8\n20,19\n", {"offset_us": 4.0}, [2.0, 3.0]),
        (
            "t,/arm.stats/execution_time/current_value\n0,12\n1,14\n",
            {"column": "/arm.stats/execution_time/current_value", "unit": "us"},
            [12.0, 14.0],
        ),
        ("callback_start_timestamp [ns],latency [ms]\n7,0.25\n", {}, [250.0]),
        ("4\n5.8\n2.6\n", {}, [4.0, 5.8, 2.6]),
        ("force [N],latency\n9.1,4\n9.2,5.8\n9.3,2.6\n", {}, [4.0, 5.8, 2.6]),
    ],
)
def test_formats(tmp_path, content, table, expected):
    assert latencies(tmp_path, content, **table) == pytest.approx(expected, abs=1e-9)


def test_a_histogram_is_drawn_as_often_as_it_counts(tmp_path):
    found = latencies(tmp_path, HISTOGRAM, "resample", thread=0)
    assert sorted(found) == [3.0] * 5 + [7.0]
    long = HISTOGRAM.replace("000003 000005", "000003 90000000")
    found = latencies(tmp_path, long, "resample", thread=0)
    assert len(found) <= MOST_LATENCIES
    assert found.count(7.0) == 1  # rare latencies stay
    with pytest.raises(ValueError, match="may be us, or ns of cyclictest -N"):
        latencies(tmp_path, HISTOGRAM.replace("000003", "082469"), "resample", thread=0)


@pytest.mark.parametrize(
    ("content", "table", "message"),
    [
        (HISTOGRAM, {}, "has the threads 0, 1. Choose one"),
        (HISTOGRAM, {"thread": 0}, "does not say in what order"),
        (HISTOGRAM, {"thread": 1}, "1 cycles are above the histogram"),
        (HISTOGRAM[:60], {"thread": 0}, "cut off or damaged"),
        ("sample_us,command_us\n10,8\n", {}, "2 us earlier than its sample, as their clocks"),
        ("a,b\n1,2\n", {}, "several columns"),
        ("a,b\n1,2\n", {"column": "c"}, "0 columns are called 'c'. The columns are 'a', 'b'"),
        ("latency_ms\n1\n", {"unit": "us"}, "names another unit"),
        ("1\n", {"topic": "/x"}, "topic: unknown scene key"),
        ("1\n", {"sample": "a"}, "belong together"),
        ("", {}, "has 0 latencies"),
        ("1\nx\n", {}, "line 2: 'x' is not a number. Give a latency"),
        ("latency_kg\n1\n2\n", {}, "'kg'"),
        ("t_us;latency_us\n1;2;9\n", {}, "line 2: has 3 columns, not 2"),
        ("4,0\n5,8\n", {}, "line 1: '4,0' is not a number. Give a latency in every line, with a"),
        ("latency_us\n4.0\n5,8\n", {}, "line 3: '5,8' is not a number"),
    ],
)
def test_what_can_mean_two_things_is_refused(tmp_path, content, table, message):
    with pytest.raises(ValueError, match=r"controller\.latency_trace") as error:
        latencies(tmp_path, content, **table)
    assert message in str(error.value)


@pytest.mark.parametrize("name", ["cyclictest-histogram.txt", "stamps.csv"])
def test_examples(name):
    assert all(
        1.0 < latency < 1e5
        for latency in latencies_of_file({"file": name}, "resample", EXAMPLES / "latency")
    )


def test_what_is_not_a_file_of_latencies_is_refused(tmp_path):
    with (tmp_path / "bag.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        writer.finish()
    for table, message in (
        ({"file": "bag.mcap"}, "is not a recording of a run. Give a recording of a paced run"),
        ({"median_us": 3.0, "sigma": 0.4}, r"latency_trace\.median_us: unknown scene key"),
    ):
        with pytest.raises(ValueError, match=message):
            latencies_of_file(table, None, tmp_path)
