"""Readers that know nothing of hertzloop find in a recording what hertzloop finds there.

MCAP's Python reader is in `test_writer_reader.py`. Here: the importer of Rerun.
"""

import re
from collections import Counter

import pytest

from hertzloop.bus.streams import STREAMS
from tests.recordings.rewriting import messages, record
from tests.recordings.test_replay import rerun

pytestmark = pytest.mark.full


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    return record(tmp_path_factory.mktemp("foreign") / "run.mcap", "sensors.bits=16", compiled=True)


@pytest.fixture(scope="module")
def counts(file):
    """Messages by topic."""
    return Counter(STREAMS[message.stream].topic for message in messages(file))


def test_rerun_finds_nothing_wrong(file, counts):
    told = re.findall(
        r"^(\w+) +\d+ +\d+ +(/\w+) +(.*)$", rerun("mcap", "check", file), re.MULTILINE
    )
    assert {topic: (status, issues) for status, topic, issues in told} == dict.fromkeys(
        counts, ("ok", "—")
    )


def test_rerun_imports_every_message(file, counts, tmp_path):
    """Events as a log that its viewer shows, the others by their schemas."""
    rerun("mcap", "convert", file, "-o", tmp_path / "run.rrd")
    printed = rerun("rrd", "print", tmp_path / "run.rrd")
    rows: Counter[str] = Counter()
    for count, topic in re.findall(
        r"with (\d+) rows .* - (/\w+) - .*(?:hertzloop\.\w+:message|TextLog:text)", printed
    ):
        rows[topic] += int(count)
    assert rows == counts
