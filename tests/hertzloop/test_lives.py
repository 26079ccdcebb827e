"""Processes in terminals of their own, and the launcher's own end: every wait is bounded,
signals work at any moment, the right one is blamed, and nothing stays behind."""

import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import psutil
import pytest

from hertzloop.bus.sockets import own_folder
from hertzloop.bus.zenoh_config import _ids
from tests.hertzloop.processes import (
    EVENTUALLY_S,
    LONG,
    WELL_UNDER_WAY,
    child_of,
    finish,
    grown_to,
    hertzloop,
    leftovers,
    next_line,
    start,
    wait_for,
)
from tests.ports import free_ports
from tests.tiers import default

PATIENCE_S = 20.0


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    return tmp_path / "run.mcap"


@contextmanager
def terminals(
    recording: Path, *words: str, timeout_s: float = EVENTUALLY_S
) -> Iterator[dict[str, subprocess.Popen]]:
    """Plant, controller and recorder as three people would start them."""
    a, b, c = (f"tcp/127.0.0.1:{port}" for port in free_ports(3))
    patience = ["--wait", str(EVENTUALLY_S), "--timeout", str(timeout_s)]
    bus = ["--name", f"terminals-{os.getpid()}", *patience]
    started = {
        "recorder": start("node", "recorder", "--out", str(recording), *bus, "--listen", c,
                          "--connect", a, "--connect", b),
        "controller": start("node", "controller", *bus, "--listen", b, "--connect", a),
        "plant": start("node", "plant", *bus, "--listen", a, *words),
    }  # fmt: skip
    try:
        yield started
    finally:
        for process in started.values():
            process.kill()
            process.communicate()


@pytest.mark.full
def test_a_frozen_recorder_is_named_by_the_plant(recording: Path) -> None:
    with terminals(recording, *LONG, timeout_s=5.0) as roles:
        wait_for(grown_to(recording, WELL_UNDER_WAY))
        roles["recorder"].send_signal(signal.SIGSTOP)
        code, err, _ = finish(roles["plant"], 60)
        assert code == 1
        # By itself, or told by the controller, which sends to the recorder, too.
        assert "recorder accepted no message for 5 s" in err
        assert "Traceback" not in err
        code, err, _ = finish(roles["controller"], 60)
        assert code == 1, err
        assert "Traceback" not in err


@pytest.mark.full
@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
def test_a_plant_that_waits_for_a_frozen_recorder_hears_signals(
    recording: Path, sent: signal.Signals
) -> None:
    """The patience with the recorder is an hour here: what ends the wait is the signal."""
    with terminals(recording, *LONG, "--timeout", "3600") as roles:
        wait_for(grown_to(recording, WELL_UNDER_WAY))
        roles["recorder"].send_signal(signal.SIGSTOP)
        plant = psutil.Process(roles["plant"].pid)
        wait_for(lambda: plant.cpu_percent(0.5) < 2, 60)  # it is inside a call that waits
        roles["plant"].send_signal(sent)
        code, err, _ = finish(roles["plant"], 60)
        assert code == 130, err
        assert "interrupted" in err
        assert "Traceback" not in err


@pytest.mark.full
def test_all_exit_codes_tell_of_a_failed_run(recording: Path) -> None:
    with terminals(recording, *LONG) as roles:
        wait_for(grown_to(recording, WELL_UNDER_WAY))
        roles["plant"].send_signal(signal.SIGINT)
        said = {role: finish(process) for role, process in roles.items()}
    assert {role: code for role, (code, _, _) in said.items()} == {
        "plant": 130, "controller": 1, "recorder": 1
    }  # fmt: skip
    assert "the plant ended the run: interrupted at step" in said["controller"][1]


def test_all_exit_codes_tell_of_a_good_run(recording: Path) -> None:
    with terminals(recording, "--set", "run.duration_s=0.002") as roles:
        for role, process in roles.items():
            code, err, _ = finish(process)
            assert code == 0, (role, err)


@pytest.mark.full
def test_a_recording_that_is_not_completed_fails_the_others(recording: Path) -> None:
    """The recorder dies when much was sent to it, and before it has closed its file. As a rule that
    is heard at once, at the latest when the patience with a message to it is over: see
    bus/zenoh_config.py."""
    with terminals(recording, *LONG, timeout_s=PATIENCE_S) as roles:
        wait_for(grown_to(recording, WELL_UNDER_WAY))
        roles["recorder"].kill()
        for role in ("plant", "controller"):
            code, err, _ = finish(roles[role])
            assert code == 1, (role, err)
            known = "recorder (left the run|accepted no message for 20 s)"
            assert re.search(known, err), (role, err)


def test_a_configuration_without_endpoints_stays_on_loopback(tmp_path: Path) -> None:
    config = tmp_path / "bus.json5"
    config.write_text("{}")
    plant = start("node", "plant", "--zenoh-config", str(config), "--name", "filed", "--wait", "60")
    try:
        look = psutil.Process(plant.pid)
        found = wait_for(lambda: [c for c in look.net_connections() if c.status == "LISTEN"])
        assert {c.laddr.ip for c in found} == {"127.0.0.1"}
    finally:
        plant.kill()
        plant.communicate()


class TestLauncher:
    """`hertzloop run` and its own end."""

    @pytest.fixture
    def temporary(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
        folder = tmp_path / "temporary"
        folder.mkdir()
        monkeypatch.setenv("TMPDIR", str(folder))
        monkeypatch.setattr(tempfile, "tempdir", None)
        return folder

    @pytest.mark.parametrize(
        "sent",
        default([signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGINT], [signal.SIGINT]),
    )
    def test_signals_end_it_in_order(
        self, recording: Path, temporary: Path, sent: signal.Signals
    ) -> None:
        # Who runs the tests may ignore a closed terminal.
        heeding = partial(signal.signal, sent, signal.SIG_DFL)
        run = start("run", *LONG, "--out", str(recording), preexec_fn=heeding)
        wait_for(grown_to(recording, WELL_UNDER_WAY))
        assert list(temporary.glob("hertzloop-*"))
        run.send_signal(sent)
        code, err, _ = finish(run)
        assert code == 130, err
        assert "interrupted; the recording" in err
        assert not leftovers(recording)
        assert not list(temporary.glob("hertzloop-*"))

    def test_a_second_interrupt_leaves_no_process(self, recording: Path) -> None:
        run = start("run", *LONG, "--out", str(recording))
        child = child_of(run, "plant")
        wait_for(grown_to(recording, WELL_UNDER_WAY))
        child.send_signal(signal.SIGSTOP)  # it cannot end in order
        run.send_signal(signal.SIGINT)
        time.sleep(0.5)
        run.send_signal(signal.SIGINT)
        code, err, _ = finish(run)
        assert code == 130, err
        assert "Traceback" not in err
        assert not leftovers(recording)

    def test_a_killed_launcher_leaves_no_process_and_its_folder_to_the_next_run(
        self, recording: Path, temporary: Path
    ) -> None:
        run = start("run", *LONG, "--out", str(recording))
        children = [child_of(run, command) for command in ("plant", "controller", "recorder")]
        wait_for(grown_to(recording, WELL_UNDER_WAY))
        run.kill()
        run.communicate()
        _, alive = psutil.wait_procs(children, timeout=60)
        assert not alive
        for folder in temporary.iterdir():
            os.utime(folder, (0, 0))
        with own_folder():
            pass
        assert not list(temporary.iterdir())

    @pytest.mark.full
    @pytest.mark.parametrize("command", ["plant", "controller", "recorder"])
    def test_a_death_before_the_start_is_told_at_once(self, recording: Path, command: str) -> None:
        run = start("run", *LONG, "--out", str(recording))
        child_of(run, command).send_signal(signal.SIGKILL)
        code, err, seconds = finish(run)
        assert code == 1
        role = command
        assert err.endswith(f"error: {role} was killed by SIGKILL"), err
        assert seconds < 60  # of the 180 that all have to appear
        assert not leftovers(recording)

    @pytest.mark.full
    def test_an_interrupt_of_a_process_that_only_starts_is_told(self, recording: Path) -> None:
        """It comes before the interpreter is there, and waits until somebody can say so."""

        def interrupted() -> None:
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # as the launcher does
            os.kill(os.getpid(), signal.SIGINT)

        code, err, _ = finish(
            start("node", "recorder", "--out", str(recording), preexec_fn=interrupted)
        )
        assert (code, err) == (130, "interrupted")
        run = start("run", *LONG, "--out", str(recording))
        child_of(run, "recorder").send_signal(signal.SIGINT)
        code, err, _ = finish(run)
        assert code == 1
        assert err.endswith("recorder was interrupted"), err

    @pytest.mark.parametrize("delay_s", [0.15, 0.4, 0.8, 1.2])
    def test_an_early_interrupt_shows_no_traceback(self, recording: Path, delay_s: float) -> None:
        run = start("run", *LONG, "--out", str(recording))
        # After the interpreter's own start, in which no program can say anything.
        wait_for(lambda: any("zoneinfo" in m.path or "numpy" in m.path or "typer" in m.path
                             or "_json" in m.path or "_socket" in m.path
                             for m in psutil.Process(run.pid).memory_maps()))  # fmt: skip
        time.sleep(delay_s)
        run.send_signal(signal.SIGINT)
        code, err, _ = finish(run)
        assert code == 130, err
        assert "Traceback" not in err
        assert "interrupted" in err


@pytest.mark.full
def test_a_recorder_that_was_stopped_is_named(recording: Path) -> None:
    run = start("run", *LONG, "--out", str(recording), "--timeout", "2", "--no-fast-lane")
    recorder = child_of(run, "recorder")
    wait_for(grown_to(recording, WELL_UNDER_WAY))
    recorder.send_signal(signal.SIGSTOP)
    wait_for(lambda: child_of(run, "plant").cpu_percent(0.5) < 2)  # its message waits
    time.sleep(3.0)
    recorder.send_signal(signal.SIGCONT)
    code, err, _ = finish(run)
    assert code == 1
    assert "error: recorder does not respond; no sign of life for 3 s" in err


@pytest.mark.full
@pytest.mark.parametrize("paced", [True, False])
def test_a_run_whose_processes_were_all_stopped_goes_on(
    tmp_path: Path, recording: Path, paced: bool
) -> None:
    """At a pace the launcher goes on meanwhile. In lock-step it is stopped, too, and messages wait
    for the recorder: all arrive."""
    words = ["aluminium-3mm", "--set", f"run.duration_s={0.2 if paced else 1}"]
    pace = ["--pace", "0.02"] if paced else []
    run = start("run", *words, *pace, "--timeout", "2", "--out", str(recording))
    roles = [child_of(run, role) for role in ("plant", "controller", "recorder")]
    wait_for(grown_to(recording, 50_000))
    stopped = roles if paced else [psutil.Process(run.pid), *roles]
    for process in stopped:
        process.send_signal(signal.SIGSTOP)
    time.sleep(8.0)  # longer than any of them waits
    for process in stopped:
        process.send_signal(signal.SIGCONT)
    code, err, _ = finish(run)
    assert code == 0, err
    if not paced:
        alone = tmp_path / "alone.mcap"
        compiled = ["--transport", "compiled", "--out", str(alone)]
        assert hertzloop("run", *words, *compiled).returncode == 0
        assert hertzloop("compare", str(alone), str(recording)).returncode == 0


STRANGER = """
import json, os, signal, sys, time, zenoh
config = zenoh.Config()
config.insert_json5("scouting/multicast/enabled", "false")
config.insert_json5("listen/endpoints", "[]")
config.insert_json5("connect/endpoints", sys.argv[1])
config.insert_json5("transport/link/tx/lease", "1000")
if len(sys.argv) > 3:
    config.insert_json5("id", json.dumps(sys.argv[3]))
config.insert_json5("connect/retry", '{"period_init_ms": 20, "period_max_ms": 50}')
heard = []
def hear(sample):
    heard.append(1)
    time.sleep(float(sys.argv[2]))
session = zenoh.open(config)
kept = session.declare_subscriber("hertzloop/**", zenoh.handlers.Callback(hear, indirect=False))
print("listening", flush=True)
while not heard:
    time.sleep(0.01)
print("heard", flush=True)
if sys.argv[2] == "0":
    os.kill(os.getpid(), signal.SIGSTOP)
time.sleep(600)
"""


@pytest.mark.full
@pytest.mark.parametrize(
    "words", [["0"], ["0.5"], ["0", _ids("victim", "recorder")[7]]], ids=["stops", "lags", "id"]
)
def test_a_stranger_that_does_not_keep_up_changes_nothing(tmp_path: Path, words: list[str]) -> None:
    """It has an id that follows from the run's name, or not. It hears something, then stops (0), or
    takes half a second for every message. Its lease is short, so that zenoh gives its link up."""
    base = free_ports(3, in_a_row=True)[0]
    run = ["--set", "run.duration_s=1", "--port", str(base), "--timeout", "30", "--name", "victim"]
    alone, beside = tmp_path / "alone.mcap", tmp_path / "beside.mcap"
    assert hertzloop("run", "aluminium-3mm", *run, "--out", str(alone)).returncode == 0
    urls = json.dumps([f"tcp/127.0.0.1:{base + i}" for i in range(3)])
    with subprocess.Popen(
        [sys.executable, "-c", STRANGER, urls, *words], stdout=subprocess.PIPE, text=True
    ) as stranger:
        try:
            assert next_line(stranger) == "listening\n"
            done = hertzloop("run", "aluminium-3mm", *run, "--out", str(beside))
            assert done.returncode == 0, done.stderr
            assert next_line(stranger) == "heard\n"
        finally:
            stranger.kill()
    assert hertzloop("compare", str(alone), str(beside)).returncode == 0
