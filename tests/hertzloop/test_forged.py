"""Strangers and doubles on the bus of real processes: no run goes on with what they say."""

import math
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
import zenoh

from hertzloop.bus import codec
from hertzloop.bus.codec import decoded
from hertzloop.bus.messages_pb2 import DaqBlock, Hello
from hertzloop.bus.port import PeerLost
from hertzloop.bus.streams import CONTROLLER, PLANT, RECORDER, Envelope
from hertzloop.bus.zenoh_port import ZenohPort
from hertzloop.loop.controller_node import ControllerNode
from hertzloop.loop.in_process import record_in_process
from hertzloop.plant.actuator_kernels import MOST_N
from hertzloop.recordings.reader import read
from hertzloop.recordings.recorder import Recorder
from hertzloop.results.recorded import truth_of
from hertzloop.scene.setup import load
from hertzloop.scene.toml import to_toml
from tests.hertzloop.processes import EVENTUALLY_S, finish, start
from tests.ports import free_ports

SHORT = ["--set", "run.duration_s=0.0025", "--set", "run.accuracy=0.1"]


class Bus:
    """Endpoints of a run in separate processes, full mesh, and a stranger's way to it."""

    def __init__(self, name: str) -> None:
        self.name = name
        ports = free_ports(3)
        self.urls = dict(
            zip((PLANT, CONTROLLER, RECORDER), (f"tcp/127.0.0.1:{p}" for p in ports), strict=True)
        )

    def words(self, role: str, listen: str = "") -> list[str]:
        """Options of a process."""
        before = list(self.urls)[: list(self.urls).index(role)]
        connect = [w for r in before for w in ("--connect", self.urls[r])]
        return [
            "--name",
            self.name,
            "--wait",
            "40",
            "--listen",
            listen or self.urls[role],
            *connect,
        ]

    @contextmanager
    def stranger(self, role: str) -> Iterator[zenoh.Session]:
        """A session that reaches one process alone: peers do not relay."""
        config = zenoh.Config()
        config.insert_json5("scouting/multicast/enabled", "false")
        config.insert_json5("scouting/gossip/enabled", "false")
        config.insert_json5("listen/endpoints", "[]")
        config.insert_json5("connect/endpoints", f'["{self.urls[role]}"]')
        with zenoh.open(config) as session:
            yield session


class Foreign:
    """A controller of somebody else's in this process; `change` is what it makes of forces."""

    def __init__(self, bus: Bus, change: Callable[[Any, np.ndarray], np.ndarray]) -> None:
        self.port = ZenohPort(CONTROLLER, bus.name, [bus.urls[CONTROLLER]], [bus.urls[PLANT]])
        self.change = change
        self.role = CONTROLLER
        self.thread = threading.Thread(target=self._run)

    def publish(self, envelope: Envelope) -> None:
        """As the port of a node: changes what it says."""
        if envelope.stream == "force":
            block = decoded(envelope)
            force = self.change(block.header, block.arrays["force_n"].copy())
            envelope = Envelope("force", codec.encode(block.header, force_n=force))
        self.port.publish(envelope)

    def _run(self) -> None:
        node = ControllerNode(self)  # type: ignore[arg-type]
        try:
            self.port.liveliness.announce()
            self.port.liveliness.wait_for([PLANT, RECORDER], EVENTUALLY_S)
            while not node.done:
                node.handle(self.port.receive(EVENTUALLY_S, "samples"))
        except PeerLost:
            pass

    def __enter__(self) -> "Foreign":
        self.thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.thread.join(2 * EVENTUALLY_S)
        assert not self.thread.is_alive()
        self.port.close()


def ended(process: Any, code: int, *words: str) -> None:
    found, err, _ = finish(process)
    assert found == code, err
    assert "Traceback" not in err
    for word in words:
        assert word in err


@pytest.mark.full
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_foreign_controllers_force_that_is_no_number(tmp_path: Path, value: float) -> None:
    bus = Bus("foreign")

    def change(header: Any, force: np.ndarray) -> np.ndarray:
        force[-1:] = value
        return force

    recorder = start("node", "recorder", "--out", str(tmp_path / "a.mcap"), *bus.words(RECORDER))
    plant = start("node", "plant", "aluminium-3mm", *SHORT, *bus.words(PLANT))
    with Foreign(bus, change):
        ended(plant, 1, "stream 'force' sequence", f"holds force_n = {value:g}")
        ended(recorder, 1, "holds force_n")
    kept = read(tmp_path / "a.mcap")
    assert kept.result["complete"] == "no"
    assert "holds force_n" in kept.result["fault"]
    assert all(np.isfinite(rows).all() for rows in kept.truth.arrays.values())


def test_a_fault_that_the_recorder_hears_first(tmp_path: Path) -> None:
    """It waits until the others have heard it, too: they name the cause, not its departure."""
    bus = Bus("first-heard")
    heard: list[bytes] = []

    def change(header: Any, force: np.ndarray) -> np.ndarray:
        force[-1:] = math.inf
        if not heard:
            heard.append(codec.encode(header, force_n=force))
            publisher.put(heard[0])
            time.sleep(1.0)  # the link to the plant is slow
        return force

    recorder = start("node", "recorder", "--out", str(tmp_path / "a.mcap"), *bus.words(RECORDER))
    with bus.stranger(RECORDER) as mouth:
        publisher = mouth.declare_publisher(f"hertzloop/{bus.name}/force")
        wait_until(lambda: bool(publisher.matching_status.matching))
        plant = start("node", "plant", "aluminium-3mm", *SHORT, *bus.words(PLANT))
        with Foreign(bus, change):
            ended(plant, 1, "stream 'force' sequence", "holds force_n = inf")
            ended(recorder, 1, "holds force_n = inf")


@pytest.mark.full
@pytest.mark.parametrize("number", [None, 1, 2**70])
def test_a_second_hello_to_the_controller_alone(tmp_path: Path, number: int | None) -> None:
    """With the run's id and other parameters, between the plant's hello and the first contact."""
    bus = Bus("second-hello")
    recorder = start("node", "recorder", "--out", str(tmp_path / "a.mcap"), *bus.words(RECORDER))
    controller = start("node", "controller", *bus.words(CONTROLLER))
    run_id: list[int] = []

    def note(sample: zenoh.Sample) -> None:
        run_id.append(codec.decode(DaqBlock, sample.payload.to_bytes()).header.run_id)

    long = ["--set", "run.duration_s=20"]
    plant = start("node", "plant", "aluminium-3mm", *long, *bus.words(PLANT))
    with bus.stranger(PLANT) as ear, bus.stranger(CONTROLLER) as mouth:
        ear.declare_subscriber(f"hertzloop/{bus.name}/daq", zenoh.handlers.Callback(note))
        publisher = mouth.declare_publisher(f"hertzloop/{bus.name}/hello")
        wait_until(lambda: bool(run_id) and publisher.matching_status.matching)
        scene = load("aluminium-3mm", ["run.duration_s=20", "controller.kappa=-5"])
        forged = Hello(
            run_id=run_id[0], scene="aluminium-3mm", scene_toml=to_toml(scene.scene),
            steps=scene.steps, step_ns=1000, stiffness=1e9,
        )  # fmt: skip
        attachment = None if number is None else number.to_bytes(16 if number > 1 else 8, "little")
        publisher.put(forged.SerializeToString(), attachment=attachment)
        sentence = "stream 'hello'"
        ended(controller, 1, sentence)
        ended(plant, 1, "the controller ended the run", sentence)
        ended(recorder, 1, sentence)
    kept = read(tmp_path / "a.mcap")
    assert kept.result["complete"] == "no"
    assert sentence in kept.result["fault"]


def wait_until(look: Callable[[], bool]) -> None:
    from tests.hertzloop.processes import wait_for

    wait_for(look, 40.0)


def waits(pid: int) -> bool:
    """Whether a process has done its start-up work and has nothing to do."""
    process = psutil.Process(pid)
    return process.cpu_times().user > 0.3 and process.cpu_percent(1.0) < 10.0


@pytest.mark.full
@pytest.mark.parametrize("role", [PLANT, CONTROLLER, RECORDER])
def test_a_role_that_is_there_twice(tmp_path: Path, role: str) -> None:
    """Each reaches the two others; who sees both says so, and no run begins."""
    bus = Bus("doubles")
    [free] = free_ports(1)
    other = f"tcp/127.0.0.1:{free}"
    commands = {
        PLANT: ["node", "plant", "aluminium-3mm", *SHORT],
        CONTROLLER: ["node", "controller"],
        RECORDER: ["node", "recorder", "--out", str(tmp_path / "a.mcap")],
    }
    twin = [*commands[role], *bus.words(role, other)]
    if role == RECORDER:
        twin[3] = str(tmp_path / "b.mcap")
    for third in (PLANT, CONTROLLER, RECORDER):
        if third != role:  # the twin is the one that connects
            twin += [w for w in ("--connect", bus.urls[third]) if bus.urls[third] not in twin]
    processes = [start(*twin), start(*commands[role], *bus.words(role))]
    for process in processes:  # both wait for the others before a run could begin without one
        wait_until(lambda process=process: waits(process.pid))  # type: ignore[misc]
    processes += [start(*commands[r], *bus.words(r)) for r in commands if r != role]
    said = [finish(process) for process in processes]
    # A process that comes when the other is in a run already hears of two runs or of nobody.
    assert 1 in {code for code, _, _ in said[:2]}, said
    if {code for code, _, _ in said} == {1}:
        wanted = [f"2 processes are the {role} on bus 'doubles'; a run has one"]
        if role == PLANT:  # both may have announced their run before anybody saw the other
            wanted.append("two runs share one name on the bus")
        assert any(sentence in err for _, err, _ in said for sentence in wanted), said
    assert not any("Traceback" in err for _, err, _ in said)


def test_a_run_in_one_process_is_reconciled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Here nobody but the run itself can look at what the recorder heard."""
    honest = Recorder.handle

    def deaf(self: Recorder, envelope: Envelope) -> None:
        if envelope.stream != "balance":
            honest(self, envelope)

    monkeypatch.setattr(Recorder, "handle", deaf)
    scene = load("aluminium-3mm", ["run.duration_s=0.0015", "run.accuracy=0.1"])
    for compiled in (False, True):
        path = tmp_path / f"{compiled}.mcap"
        with pytest.raises(Exception, match="stream 'balance' is incomplete"):
            record_in_process(scene, path, compiled=compiled)
        assert "stream 'balance' is incomplete" in read(path).result["fault"]


@pytest.mark.parametrize("compiled", [False, True])
def test_forces_that_explode(tmp_path: Path, compiled: bool) -> None:
    """A law that answers itself is held before its numbers overflow: the run ends, as unstable."""
    scene = load(
        "aluminium-3mm",
        ["run.duration_s=0.0025", "run.accuracy=0.1", "controller.law=velocity_feedback",
         "controller.kappa=-100", "sensors.quantity=auto"],
    )  # fmt: skip
    path = tmp_path / "a.mcap"
    record_in_process(scene, path, compiled=compiled)
    kept = read(path)
    assert not kept.result.get("fault")
    assert set(kept.ends) == {"plant", "controller"}
    rows = truth_of(kept)
    assert np.isfinite(rows).all()
    assert np.abs(rows[5]).max() == MOST_N
