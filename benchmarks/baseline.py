"""What a step and an exchange cost on this machine: the baseline for later work.

Machines are shared and noisy, so all cases of a group are measured in turn, round after
round, and each is set against a yardstick measured in the same rounds.
"""

import json
import multiprocessing
import os
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from multiprocessing.synchronize import Event
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import zenoh

from benchmarks import integrator_kernels as ik
from benchmarks.program import tracked
from benchmarks.schemes import discrete_gradient
from hertzloop.bus.port import BusError, PeerLost
from hertzloop.bus.sockets import LOOPBACK, mesh_endpoints, on_loopback, reserved_ports
from hertzloop.bus.streams import CONTROLLER, PLANT, ROLES, Envelope
from hertzloop.bus.zenoh_port import ZenohPort
from hertzloop.loop.run_options import RunOptions, Transport
from hertzloop.plant.plant import Plant
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.plant.state_kernels import FLIGHT_X
from hertzloop.processes.record import record
from hertzloop.results.assessed_run import run_and_assess
from hertzloop.scene.setup import Setup, load
from hertzloop.views.run_json import run_as_json

SLOW_S = 0.5  # that the slow one takes for a message


def _listen(urls: list[str], pause_s: float, ready: Event) -> None:
    """Hear everything, then take `pause_s` for every message, or stop for ever if that is 0."""
    config = zenoh.Config()
    settings: dict[str, object] = {
        "scouting/multicast/enabled": False,
        "listen/endpoints": [],
        "connect/endpoints": urls,
        "connect/retry": {"period_init_ms": 20, "period_max_ms": 50},
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    heard = threading.Event()

    def hear(sample: zenoh.Sample) -> None:
        heard.set()
        time.sleep(pause_s)

    session = zenoh.open(config)
    kept = session.declare_subscriber("hertzloop/**", zenoh.handlers.Callback(hear, indirect=False))
    ready.set()
    heard.wait()
    if not pause_s:
        os.kill(os.getpid(), signal.SIGSTOP)
    while kept:
        time.sleep(1.0)


@contextmanager
def _stranger(ports: list[int], pause_s: float | None) -> Iterator[None]:
    """A process that listens at all three roles; None: nobody. Raises BusError."""
    if pause_s is None:
        yield
        return
    context = multiprocessing.get_context("spawn")
    ready = context.Event()
    urls = [f"tcp/{LOOPBACK}:{port}" for port in ports]
    process = context.Process(target=_listen, args=(urls, pause_s, ready), daemon=True)
    process.start()
    try:
        while not ready.wait(0.1):
            if not process.is_alive():
                raise BusError("the listener that a run was to be beside did not start")
        yield
    finally:
        process.kill()
        process.join()


def run_beside(setup: Setup, pause_s: float | None) -> Callable[[], float]:
    """A measurement: us per step of a run over zenoh beside such a stranger."""

    def measure() -> float:
        with (
            reserved_ports(3) as ports,
            _stranger(ports, pause_s),
            TemporaryDirectory() as folder,
        ):
            options = RunOptions(Transport.ZENOH, endpoints=on_loopback(ports))
            stats = record(setup, Path(folder) / "a.mcap", options)
        return float(stats["wall_s"]) * 1e6 / setup.steps

    return measure


ROUNDS = 9
_STEPS = 600
_TRIPS = 400
_PAYLOAD = bytes(100)  # about a block with one sample, or its answer
_STOP = b"stop"
_PATIENCE_S = 300.0  # of an echo, while others are measured
NAME = "baseline"  # of the bus
Meets = Callable[[str], tuple[list[str], list[str], Path | None]]  # what a role listens on ...


@dataclass(frozen=True)
class Cost:
    """Median and smallest time of one case over all rounds, and the ratio of the medians to
    the group's yardstick (the first case)."""

    case: str
    median_us: float
    least_us: float
    ratio: float


def in_turn(cases: dict[str, Callable[[], float]], rounds: int) -> list[Cost]:
    """Measure every case once a round; each returns microseconds per unit."""
    for measure in cases.values():
        measure()  # warm
    found = {name: [measure()] for name, measure in cases.items()}
    for _ in tracked("rounds", range(rounds - 1)):
        for name, measure in cases.items():
            found[name].append(measure())
    medians = {name: float(np.median(values)) for name, values in found.items()}
    yardstick = next(iter(medians.values()))
    return [
        Cost(name, medians[name], min(values), medians[name] / yardstick)
        for name, values in found.items()
    ]


def timed(work: Callable[[], object], units: int) -> float:
    started = time.perf_counter()
    work()
    return (time.perf_counter() - started) * 1e6 / units


def plant_case(plant: Plant, *, contact: bool) -> Callable[[], float]:
    """Steps within the first contact, or in flight over a plate that still rings."""
    ik.plant_steps(plant.model, plant.state, 0.0, 100)
    if not contact:
        plant.state.body[FLIGHT_X] += 1.0
        ik.plant_steps(plant.model, plant.state, 0.0, 2)
    kept = [array.copy() for array in plant.state]

    def measure() -> float:
        for array, value in zip(plant.state, kept, strict=True):
            array[:] = value
        return timed(lambda: ik.plant_steps(plant.model, plant.state, 0.0, _STEPS), _STEPS)

    return measure


def two_pass_case(frequencies: int) -> Callable[[], float]:
    z, grown = np.zeros(frequencies, complex), np.full(frequencies, 1e-6 + 1e-6j)
    turn = np.exp(1j * np.linspace(0.01, 3.0, frequencies))
    return lambda: timed(lambda: ik.two_pass_steps(z, turn, grown, _STEPS), _STEPS)


def step_costs(rounds: int = ROUNDS) -> list[Cost]:
    """us per step of the plant kernels on `aluminium-20mm`; yardstick: a plain two-pass loop
    over all frequencies up to pi/dt. The default scheme with all of them and as many as an
    accuracy asks for, then the second-order scheme."""
    cases: dict[str, Callable[[], float]] = {}
    settings = ["run.accuracy=1e-9", "run.accuracy=1e-3", "run.accuracy=1e-2"]
    with discrete_gradient.known_to_scenes():
        for scheme, limits in (("modal", settings), (discrete_gradient.NAME, settings[:1])):
            for limit in limits:
                setup = load("aluminium-20mm", [limit, "run.lead_in_s=0", f"run.scheme={scheme}"])
                make = SCHEMES[scheme].load()
                count = len(make(setup.plant).modes.omega)
                if not cases:
                    cases[f"two-pass loop, {count} frequencies"] = two_pass_case(count)
                for name, contact in (("flight", False), ("contact", True)):
                    cases[f"{scheme}, {name}, {count} frequencies"] = plant_case(
                        make(setup.plant), contact=contact
                    )
    return in_turn(cases, rounds)


def _echo_zenoh(listen: list[str], connect: list[str], file: Path | None) -> None:
    port = ZenohPort(CONTROLLER, NAME, listen, connect, file)
    port.liveliness.announce()
    port.liveliness.wait_for([PLANT], _PATIENCE_S)
    try:
        while (envelope := port.receive(_PATIENCE_S, "a message to echo")).payload != _STOP:
            port.publish(Envelope("force", envelope.payload))
    except PeerLost:
        pass
    port.close()


def _echo_tcp(port: int) -> None:
    with socket.create_connection(("127.0.0.1", port)) as peer:
        peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        while data := peer.recv(4096):
            peer.sendall(data)


@contextmanager
def child(target: Callable[..., None], *arguments: object) -> Iterator[None]:
    """Another process that runs a function meanwhile; killed if it does not end in time."""
    process = multiprocessing.get_context("spawn").Process(
        target=target, args=arguments, daemon=True
    )
    process.start()
    try:
        yield
    finally:
        process.join(5.0)
        process.kill()


@contextmanager
def _tcp() -> Iterator[Callable[[], float]]:
    """Round trips over a plain TCP connection to another process."""
    with (
        socket.create_server(("127.0.0.1", 0)) as server,
        child(_echo_tcp, server.getsockname()[1]),
    ):
        peer, _ = server.accept()
        peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

        def trips() -> None:
            for _ in range(_TRIPS):
                peer.sendall(_PAYLOAD)
                peer.recv(4096)

        yield lambda: timed(trips, _TRIPS)
        peer.close()


def on_ports(endpoints: Sequence[str]) -> Meets:
    """Roles meet at these endpoints."""
    return lambda role: (*mesh_endpoints(role, endpoints), None)


@contextmanager
def over_zenoh(meets: Meets | None = None) -> Iterator[Callable[[], float]]:
    """Round trips through the zenoh port to another process; on loopback, if not told where."""
    with ExitStack() as stack:
        if meets is None:
            endpoints = on_loopback(stack.enter_context(reserved_ports(len(ROLES))))
            meets = on_ports(endpoints)
        stack.enter_context(child(_echo_zenoh, *meets(CONTROLLER)))
        port = ZenohPort(PLANT, NAME, *meets(PLANT))
        port.liveliness.announce()
        port.liveliness.wait_for([CONTROLLER], 30.0)

        def trips() -> None:
            for _ in range(_TRIPS):
                port.publish(Envelope("daq", _PAYLOAD))
                port.receive(10.0, "the echo")

        yield lambda: timed(trips, _TRIPS)
        port.publish(Envelope("daq", _STOP))
        port.liveliness.wait_until_gone(CONTROLLER, 5.0)
        port.close()


@contextmanager
def _threads() -> Iterator[Callable[[], float]]:
    """Waking another thread and being woken: what any exchange has to pay at least."""
    there, here, over = threading.Event(), threading.Event(), threading.Event()

    def echo() -> None:
        while not over.is_set():
            there.wait()
            there.clear()
            here.set()

    thread = threading.Thread(target=echo, daemon=True)
    thread.start()

    def trips() -> None:
        for _ in range(_TRIPS):
            there.set()
            here.wait()
            here.clear()

    yield lambda: timed(trips, _TRIPS)
    over.set()
    there.set()
    thread.join()


def exchange_costs(rounds: int = ROUNDS) -> list[Cost]:
    """us per round trip of 100 B between two processes; yardstick: plain TCP."""
    with _tcp() as tcp, over_zenoh() as zenoh, _threads() as threads:
        cases = {"TCP between processes": tcp, "zenoh port between processes": zenoh}
        return in_turn({**cases, "two threads of a process": threads}, rounds)


def loop_costs() -> list[Cost]:
    """us per step of the whole loop, recorded, as it is run; yardstick: one compiled call."""

    def case(transport: Transport, duration_s: float, horizon: int | None) -> Callable[[], float]:
        setup = load("aluminium-3mm", [f"run.duration_s={duration_s}"])

        def measure() -> float:
            with TemporaryDirectory() as folder:
                options = RunOptions(transport, horizon=horizon)
                report = run_as_json(run_and_assess(setup, Path(folder) / "a.mcap", options))
            return float(report["wall_s"]) * 1e6 / setup.steps

        return measure

    return in_turn(
        {
            "compiled": case(Transport.COMPILED, 0.1, None),
            "in-process bus": case(Transport.INPROCESS, 0.1, None),
            "processes over zenoh": case(Transport.ZENOH, 0.1, None),
            "the same, horizon 1: one exchange a step": case(Transport.ZENOH, 0.003, 1),
        },
        rounds=3,
    )


def stranger_costs(rounds: int = 5) -> list[Cost]:
    """us per step of a run over zenoh, alone (yardstick) and beside somebody who listens."""
    setup = load("aluminium-3mm", ["run.duration_s=0.3"])
    cases: dict[str, float | None] = {
        "alone": None,
        f"beside a listener that takes {SLOW_S:g} s a message": SLOW_S,
        "beside a listener that has stopped": 0.0,
    }
    return in_turn({name: run_beside(setup, pause) for name, pause in cases.items()}, rounds)
