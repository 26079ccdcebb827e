"""Readers that know nothing of hertzloop find in a recording what hertzloop finds there.

MCAP's Python reader is in `test_writer_reader.py`. Here: MCAP's TypeScript reader, by npm, and the
importer of Rerun.
"""

import json
import re
import shutil
import subprocess
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hertzloop.bus.streams import STREAMS
from hertzloop.recordings.reader import read
from tests.recordings.rewriting import messages, record
from tests.recordings.test_replay import rerun

pytestmark = pytest.mark.full

SCRIPT = Path(__file__).with_name("read_mcap.mjs")
PACKAGES = ("@mcap/core@2.2.2", "fzstd@0.1.1", "protobufjs@7.6.6")


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    return record(tmp_path_factory.mktemp("foreign") / "run.mcap", "sensors.bits=16", compiled=True)


@pytest.fixture(scope="module")
def recording(file):
    return read(file)


@pytest.fixture(scope="module")
def counts(file):
    """Messages by topic."""
    return Counter(STREAMS[message.stream].topic for message in messages(file))


@pytest.fixture(scope="module")
def by_typescript(file, tmp_path_factory):
    """What `read_mcap.mjs` prints."""
    if not (shutil.which("node") and shutil.which("npm")):
        pytest.skip("needs node and npm")
    folder = tmp_path_factory.mktemp("npm")
    (folder / "package.json").write_text('{"private": true}')
    installed = subprocess.run(
        ["npm", "install", "--no-audit", "--no-fund", "--ignore-scripts", *PACKAGES],
        cwd=folder,
        capture_output=True,
        text=True,
    )
    if installed.returncode:
        pytest.skip(f"npm cannot install {PACKAGES[0]}: {installed.stderr[-300:]}")
    shutil.copy(SCRIPT, folder)
    done = subprocess.run(
        ["node", SCRIPT.name, str(file)], cwd=folder, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def test_typescript_finds_every_message(by_typescript, recording, counts):
    assert by_typescript["messages"] == counts
    assert by_typescript["schemas"]["/events"] == "foxglove.Log"
    assert by_typescript["schemas"]["/truth"] == "hertzloop.TruthBlock"
    assert by_typescript["attachments"]["scene.toml"] == recording.scene_toml
    assert by_typescript["attachments"]["law"] == recording.law_source
    assert by_typescript["result"] == recording.result


def test_typescript_decodes_by_the_embedded_schemas(by_typescript, recording):
    assert np.array(by_typescript["xi_m"]).tobytes() == recording.truth.arrays["xi_m"].tobytes()
    data = [[event.message, event.data.kind] for event in recording.events]
    kinds = STREAMS["events/plant"].message.DESCRIPTOR.fields_by_name["kind"].enum_type
    named = [
        [message, kinds.values_by_name[kind].number] for message, kind in by_typescript["events"]
    ]
    assert named == data


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
