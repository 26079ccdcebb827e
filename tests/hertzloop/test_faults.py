"""Whatever dies, hangs or lies: the run ends soon with one sentence and exit code 1,
no process is left behind, and what was recorded is readable."""

import resource
import signal
import socket
from pathlib import Path

import pytest
import zenoh

from hertzloop.recordings.reader import read
from tests.hertzloop.processes import (
    LONG,
    WELL_UNDER_WAY,
    child_of,
    finish,
    grown_to,
    hertzloop,
    leftovers,
    start,
    wait_for,
)
from tests.ports import free_ports
from tests.tiers import default

SECONDS = 60  # far from for ever, even if other processes keep the cores busy


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    return tmp_path / "run.mcap"


def check_ended(recording: Path, code: int, err: str, seconds: float, *words: str) -> None:
    assert code == 1, err
    assert err.count("error:") == 1, err
    for word in words:
        assert word in err
    assert "Traceback" not in err
    assert seconds < SECONDS
    assert not leftovers(recording)
    kept = read(recording)
    assert kept.truth.samples > 10_000
    assert kept.problems
    assert hertzloop("inspect", str(recording)).returncode == 1  # and no traceback


@pytest.mark.parametrize("role", default(["plant", "controller", "recorder"], ["controller"]))
def test_killed_process(recording: Path, role: str) -> None:
    command = role
    run = start("run", *LONG, "--out", str(recording))
    child = child_of(run, command)
    wait_for(grown_to(recording, WELL_UNDER_WAY))
    child.send_signal(signal.SIGKILL)
    check_ended(recording, *finish(run), f"{role} was killed by SIGKILL")


@pytest.mark.full
def test_hung_controller_is_named(recording: Path) -> None:
    run = start("run", *LONG, "--out", str(recording), "--timeout", "5")
    child = child_of(run, "controller")
    wait_for(grown_to(recording, WELL_UNDER_WAY))
    child.send_signal(signal.SIGSTOP)
    check_ended(recording, *finish(run), "controller does not respond")


@pytest.mark.full
def test_hung_recorder_is_named(recording: Path) -> None:
    run = start("run", *LONG, "--out", str(recording), "--timeout", "5")
    child = child_of(run, "recorder")
    wait_for(grown_to(recording, WELL_UNDER_WAY))
    child.send_signal(signal.SIGSTOP)
    check_ended(recording, *finish(run), "recorder does not respond")


def test_interrupt_keeps_the_recording(recording: Path) -> None:
    run = start("run", *LONG, "--out", str(recording))
    wait_for(grown_to(recording, WELL_UNDER_WAY))
    run.send_signal(signal.SIGINT)
    code, err, seconds = finish(run)
    assert code == 130
    assert "interrupted" in err
    assert seconds < SECONDS
    assert not leftovers(recording)
    kept = read(recording)
    assert kept.truth.samples > 10_000
    # The plant heard of it and said so on the bus: the counts reconcile up to there.
    assert set(kept.ends) == {"plant", "controller"}
    assert "interrupted" in kept.result["fault"]


@pytest.mark.full
def test_full_disk(recording: Path) -> None:
    """The recorder may write 3 MB and no more; the kernel refuses the rest."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (3_000_000, 3_000_000))
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)

    run = start("run", *LONG, "--out", str(recording), preexec_fn=limit)
    check_ended(recording, *finish(run), "cannot write the recording", str(recording))


def test_port_in_use(recording: Path) -> None:
    ports = free_ports(3, in_a_row=True)
    with socket.create_server(("127.0.0.1", ports[0])):
        code, err, seconds = finish(start("run", "--out", str(recording), "--port", str(ports[0])))
    assert code == 1
    assert "is the port in use?" in err
    assert str(ports[0]) in err
    assert seconds < SECONDS
    assert not leftovers(recording)


@pytest.mark.full
def test_controller_never_started(recording: Path) -> None:
    a, b, c = (f"tcp/127.0.0.1:{port}" for port in free_ports(3))
    bus = ["--name", "lonely", "--wait", "10"]
    recorder = start(
        "node",
        "recorder",
        "--out",
        str(recording),
        *bus,
        "--listen",
        c,
        "--connect",
        a,
        "--connect",
        b,
    )
    plant = start("node", "plant", *bus, "--listen", a)
    code, err, seconds = finish(plant)
    assert code == 1
    assert "controller" in err
    assert "not there" in err
    assert seconds < SECONDS
    code, err, _ = finish(recorder)
    assert code == 1
    assert "controller" in err
    assert not recording.exists()  # nothing was to be recorded


@pytest.mark.full
@pytest.mark.parametrize("stream", ["daq", "force", "truth"])
def test_malformed_message(recording: Path, stream: str) -> None:
    """A stranger who knows the port publishes rubbish on a stream."""
    base = free_ports(3, in_a_row=True)[0]
    run = start("run", *LONG, "--out", str(recording), "--port", str(base), "--name", "victim")
    wait_for(grown_to(recording, WELL_UNDER_WAY))
    config = zenoh.Config()
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("listen/endpoints", "[]")
    urls = ",".join(f'"tcp/127.0.0.1:{base + i}"' for i in range(3))
    config.insert_json5("connect/endpoints", f"[{urls}]")
    with zenoh.open(config) as stranger:
        publisher = stranger.declare_publisher(f"hertzloop/victim/{stream}")
        wait_for(lambda: publisher.matching_status.matching)
        publisher.put(b"\xff" * 11)
        check_ended(
            recording, *finish(run), f"malformed message on stream '{stream}' where sequence"
        )
