"""What a listener that is no part of a run costs it: one that is slow, one that has stopped."""

import json
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.synchronize import Event
from pathlib import Path
from tempfile import TemporaryDirectory

import zenoh

from bus.port import BusError
from bus.sockets import on_loopback
from bus.wire import LOOPBACK, reserved_ports
from hertzloop.one_run import RunOptions, Transport, record
from hertzloop.setup import Setup

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
