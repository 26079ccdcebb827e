"""A run that is watched: the same bytes, whatever the watcher does."""

import os
import signal
import subprocess
from pathlib import Path

import pytest

from hertzloop.recordings.compare import first_difference
from hertzloop.recordings.reader import read
from tests.commands import as_options, refused
from tests.hertzloop.commands import (
    LONG,
    child_of,
    ended,
    finish,
    hertzloop,
    next_line,
    start,
)
from tests.hertzloop.scenes import aluminium_3mm, recorded
from tests.ports import free_ports
from tests.recordings.test_replay import rerun

RUN = ["run.duration_s=0.1", "run.accuracy=0.1"]
NO_SCREEN = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}


@pytest.mark.full
@pytest.mark.parametrize("hangs", [False, True])
def test_who_watches_sees_the_run_and_changes_nothing(tmp_path, hangs):
    ports, rrd = free_ports(3), tmp_path / "a.rrd"
    keys, more = RUN, list[str]()
    if hangs:  # it may miss the end of the run, and has that of its standard input then
        watcher = watching(ports, rrd, "--machine", stdin=subprocess.PIPE)
        watcher.send_signal(signal.SIGSTOP)
    else:  # seconds for a watcher to link, more on a busy machine: nobody waits for it
        keys, more = (
            ["run.duration_s=1", RUN[1]],
            ["--no-shared-memory", "--max-exchange-steps", "200"],
        )
        watcher = watching(ports, rrd, stdin=subprocess.DEVNULL)
    try:
        run = ["run", "aluminium-3mm", *as_options(keys), *more, "--out", str(tmp_path / "a.mcap")]
        hertzloop(*run, "--name", "mine", "--port", str(ports[0]))
    finally:
        watcher.send_signal(signal.SIGCONT)
    alone = recorded(aluminium_3mm(*keys), tmp_path / "b.mcap")
    assert first_difference(read(tmp_path / "a.mcap"), alone) is None
    ended(watcher)
    if not hangs:
        assert "/live/velocity/v_p" in rerun("rrd", "stats", rrd)


@pytest.mark.full
def test_what_an_interrupted_watcher_saw_is_kept(tmp_path):
    run, watcher, rrd = watched_run(tmp_path)
    watcher.send_signal(signal.SIGTERM)
    said = f"interrupted; what was seen until now is in {rrd}"
    assert finish(watcher) == (130, said)
    assert "/live/velocity/v_p" in rerun("rrd", "stats", rrd)
    run.send_signal(signal.SIGINT)
    ended(run, 130)


@pytest.mark.full
def test_a_watcher_ends_when_the_plant_does_without_a_word(tmp_path):
    run, watcher, rrd = watched_run(tmp_path)
    child_of(run, "plant").kill()
    lost = "the plant left the run without a final message"
    assert finish(watcher) == (1, f"{lost}; what was seen until now is in {rrd}")
    assert "/live/velocity/v_p" in rerun("rrd", "stats", rrd)
    ended(run, 1)


def watched_run(tmp_path: Path) -> tuple[subprocess.Popen, subprocess.Popen, Path]:
    """A long run that is well under way, a watcher of it, and that watcher's file."""
    ports, rrd, mcap = free_ports(3), tmp_path / "a.rrd", tmp_path / "a.mcap"
    watcher = watching(ports, rrd, stdin=subprocess.DEVNULL)
    run = start("run", *LONG, "--out", str(mcap), "--name", "mine", "--port", str(ports[0]))
    assert "watching run 'mine'" in next_line(watcher, watcher.stderr)
    return run, watcher, rrd


def watching(ports: list[int], rrd: Path, *more: str, stdin: int) -> subprocess.Popen:
    """A watcher of the run "mine", from its first words on."""
    connect = [word for port in ports for word in ("--connect", f"tcp/127.0.0.1:{port}")]
    words = ["--name", "mine", *connect, "--save", str(rrd), *more]
    watcher = start("node", "watch", *words, stdin=stdin)
    assert "waiting for run 'mine'" in next_line(watcher, watcher.stderr)
    return watcher


@pytest.mark.full
def test_a_viewer_that_cannot_be_there_changes_nothing(tmp_path):
    live = ["run", "aluminium-3mm", *as_options(RUN), "--live", "--out", str(tmp_path / "a.mcap")]
    assert "no screen is available" in hertzloop(*live, env=NO_SCREEN).stderr
    assert read(tmp_path / "a.mcap").problems == []
    compiled = ["--live", "--transport", "compiled"]
    refused("--live: not available with transport = 'compiled'", "run", *compiled)
