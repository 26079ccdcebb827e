"""A run that is watched: the same bytes, whatever the watcher does."""

import os
import signal
import subprocess
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from hertzloop.commands.cli import app
from hertzloop.loop.inprocess import record_in_process
from hertzloop.scenes.scene import load
from recordings.compare import first_difference
from recordings.reader import read
from recordings.replay import live, viewer
from tests.hertzloop.processes import finish, hertzloop, start
from tests.ports import free_ports

RUN = ["--set", "run.duration_s=0.1", "--set", "run.accuracy=0.1"]
NO_SCREEN = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}


def test_a_few_samples_keep_the_extremes_of_a_block() -> None:
    values = np.zeros(1000)
    values[[17, 801]] = -3.0, 5.0
    chosen = live.extremes_of(values)
    assert {17, 801} <= set(chosen.tolist())
    assert len(chosen) <= 8
    long = np.tile(values, 10)  # a fast plant's blocks are as long; each thousand steps count
    assert {17 + 1000 * i for i in range(10)} <= set(live.extremes_of(long).tolist())
    assert live.extremes_of(np.array([2.0])).tolist() == [0]


@pytest.mark.parametrize("hangs", [False, True])
def test_who_watches_sees_the_run_and_changes_nothing(tmp_path: Path, hangs: bool) -> None:
    ports, rrd = free_ports(3), tmp_path / "a.rrd"
    connect = [word for port in ports for word in ("--connect", f"tcp/127.0.0.1:{port}")]
    watcher = start("watch", "--name", "mine", *connect, "--save", str(rrd), stdin=subprocess.PIPE)
    assert watcher.stderr is not None
    assert "watching run 'mine'" in watcher.stderr.readline()
    if hangs:
        watcher.send_signal(signal.SIGSTOP)
    try:
        run = ["run", *RUN, "--out", str(tmp_path / "a.mcap")]
        done = hertzloop(*run, "--name", "mine", "--port", str(ports[0]))
        assert done.returncode == 0, done.stderr
    finally:
        watcher.send_signal(signal.SIGCONT)
    record_in_process(load("aluminium-3mm", RUN[1::2]), tmp_path / "b.mcap", compiled=True)
    assert first_difference(read(tmp_path / "a.mcap"), read(tmp_path / "b.mcap")) is None
    code, error, _ = finish(watcher)
    assert code == 0, error
    if not hangs:
        printed = subprocess.run(
            [str(viewer.executable()), "rrd", "stats", str(rrd)],
            capture_output=True, text=True, timeout=120,
        ).stdout  # fmt: skip
        assert "/live/velocity/v_p" in printed


def test_a_viewer_that_cannot_be_there_changes_nothing(tmp_path: Path) -> None:
    done = hertzloop("run", *RUN, "--live", "--out", str(tmp_path / "a.mcap"), env=NO_SCREEN)
    assert done.returncode == 0, done.stderr
    assert "there is no screen to watch on" in done.stderr
    assert read(tmp_path / "a.mcap").problems == []
    refused = CliRunner().invoke(app, ["run", "--live", "--transport", "compiled"])
    assert refused.exit_code == 2
    assert "--live listens on the bus" in refused.output
