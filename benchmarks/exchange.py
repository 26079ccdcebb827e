"""One sample out, one force back: ours in the fast lane and over zenoh, and with other tools.

Each way is a pair of processes where that is possible; all are measured in turn, round after round,
so that whatever else the machine does meets all of them.
"""

import importlib.util
import multiprocessing
import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from benchmarks.baseline import child, in_turn, over_zenoh, timed
from benchmarks.exchange_kernels import ask, echo
from benchmarks.program import (
    JsonOption,
    OutDirOption,
    QuickOption,
    RoundsOption,
    check_json,
    conclude,
    number_table,
    out,
    results_in,
    start,
    write_json,
    write_records,
    written,
)
from hertzloop.bus import lane
from hertzloop.bus.messages_pb2 import Hello, LaneOffer
from hertzloop.bus.sockets import reserved_ports

META = {
    "api_version": "3.0",
    "type": "time-based",
    "models": {"End": {"public": True, "params": [], "attrs": ["value"]}},
}


_TRIPS, _LANE_TRIPS, _ROUNDS = 300, 30_000, 7
_RUN = 1
_PATIENCE = 3000  # waits of 20 ms for the other end of the lane, which may compile first
_SAMPLE = bytes(8)
HELICS = "HELICS, two federates, ZMQ core"
_OURS = ("hertzloop, fast lane", "hertzloop, zenoh port")


@dataclass(frozen=True)
class Row:
    """One way: us per exchange, and how many times as fast as HELICS, None without that."""

    way: str
    median_us: float
    least_us: float
    times_helics: float | None


@dataclass(frozen=True)
class Found:
    """All ways that could be measured, why others could not, and how it was measured."""

    rows: list[Row]
    left_out: dict[str, str]
    conditions: str


def _echo_lane(offer: bytes, rounds: Connection) -> None:
    end, _ = lane.join(Hello(run_id=_RUN, lane=LaneOffer.FromString(offer)))
    at, over = 0, 0
    if end is not None:
        end = end._replace(rest_us=0)  # each sample waits for its answer
    while end is not None and rounds.recv_bytes() == _SAMPLE:  # asleep while others are measured
        over += _LANE_TRIPS
        while at < over:
            at = echo(end, at, over - at)


@contextmanager
def _lane() -> Iterator[Callable[[], float]]:
    segment, at = lane.Segment(_RUN, 1, 1), 0
    here, there = multiprocessing.Pipe()
    with child(_echo_lane, segment.offer.SerializeToString(), there):
        ask(segment.end, 0, 0)  # compiled before anybody waits

        def await_samples(end: int) -> None:
            nonlocal at
            silent = 0
            while at < end and silent < _PATIENCE:
                before, at = at, ask(segment.end, at, end - at)
                silent += at == before

        def trips() -> float:
            here.send_bytes(_SAMPLE)
            end = at + _LANE_TRIPS
            await_samples(at + 1)  # the other end is awake
            return timed(lambda: await_samples(end), _LANE_TRIPS - 1)

        yield trips
        here.send_bytes(b"over")
    segment.withdraw()


def _echo_pipe(pipe: Connection) -> None:
    while data := pipe.recv_bytes():
        pipe.send_bytes(data)


@contextmanager
def _pipe() -> Iterator[Callable[[], float]]:
    here, there = multiprocessing.Pipe()
    with child(_echo_pipe, there):

        def trips() -> None:
            for _ in range(_TRIPS):
                here.send_bytes(_SAMPLE)
                here.recv_bytes()

        yield lambda: timed(trips, _TRIPS)
        here.send_bytes(b"")


def _echo_zmq(url: str) -> None:
    import zmq

    socket = zmq.Context().socket(zmq.REP)
    socket.connect(url)
    while data := socket.recv():
        socket.send(data)
    socket.send(b"")


@contextmanager
def _zmq() -> Iterator[Callable[[], float]]:
    import zmq

    with tempfile.TemporaryDirectory() as folder:
        url = f"ipc://{folder}/exchange"
        socket = zmq.Context().socket(zmq.REQ)
        socket.bind(url)
        with child(_echo_zmq, url):

            def trips() -> None:
                for _ in range(_TRIPS):
                    socket.send(_SAMPLE)
                    socket.recv()

            yield lambda: timed(trips, _TRIPS)
            socket.send(b"")
            socket.recv()
        socket.close(0)


def _federate(name: str, other: str, port: int) -> tuple[Any, Any, Any]:
    """A HELICS federate with one value out and one in."""
    import helics as h

    info = h.helicsCreateFederateInfo()
    h.helicsFederateInfoSetCoreTypeFromString(info, "zmq")
    h.helicsFederateInfoSetCoreInitString(info, f"--federates=1 --broker_port={port}")
    h.helicsFederateInfoSetTimeProperty(info, h.helics_property_time_delta, 0.5)
    federate = h.helicsCreateValueFederate(name, info)
    out = h.helicsFederateRegisterGlobalPublication(federate, name, h.helics_data_type_double, "")
    into = h.helicsFederateRegisterSubscription(federate, other, "")
    h.helicsFederateEnterExecutingMode(federate)
    return federate, out, into


def _echo_helics(port: int) -> None:
    import helics as h

    federate, out, into = _federate("force", "sample", port)
    time = 0.5
    while h.helicsFederateRequestTime(federate, time) < 1e9:
        value = h.helicsInputGetDouble(into)
        if value < 0.0:
            break
        h.helicsPublicationPublishDouble(out, value)
        time += 1.0
    h.helicsFederateDisconnect(federate)


@contextmanager
def _helics() -> Iterator[Callable[[], float]]:
    """The sample at whole times, the force at the halves between: two grants an exchange."""
    import helics as h

    with ExitStack() as stack:
        [port] = stack.enter_context(reserved_ports(1))
        broker = h.helicsCreateBroker("zmq", "exchange", f"-f 2 --port={port}")
        stack.callback(h.helicsBrokerDisconnect, broker)
        stack.enter_context(child(_echo_helics, port))
        federate, out, into = _federate("sample", "force", port)
        time = 0.0

        def trips() -> None:
            nonlocal time
            for _ in range(_TRIPS):
                h.helicsPublicationPublishDouble(out, 1.0)
                time = h.helicsFederateRequestTime(federate, time + 1.0)
                h.helicsInputGetDouble(into)

        yield lambda: timed(trips, _TRIPS)
        h.helicsPublicationPublishDouble(out, -1.0)
        h.helicsFederateRequestTime(federate, time + 1.0)
        h.helicsFederateDisconnect(federate)


@contextmanager
def _mosaik() -> Iterator[Callable[[], float]]:
    """Two simulators in one process, which is mosaik's fastest way; a step of both an exchange."""
    import mosaik
    from loguru import logger

    logger.disable("mosaik")

    def trips() -> None:
        module = "benchmarks.mosaik_ends:End"
        world = mosaik.World({"End": {"python": module}}, skip_greetings=True)
        plant, law = (world.start("End").End() for _ in range(2))
        world.connect(plant, law, "value")
        world.connect(law, plant, "value", time_shifted=True, initial_data={"value": 0.0})
        world.run(until=_TRIPS, print_progress=False)

    yield lambda: timed(trips, _TRIPS)


_WAYS: dict[str, tuple[str, Callable[[], Any]]] = {
    _OURS[0]: ("", _lane),
    _OURS[1]: ("", over_zenoh),
    "multiprocessing Pipe": ("", _pipe),
    "pyzmq REQ/REP over ipc": ("zmq", _zmq),
    HELICS: ("helics", _helics),
    "mosaik, one process": ("mosaik", _mosaik),
}
_PACKAGES = {"zmq": "pyzmq"}


def measure(rounds: int = _ROUNDS) -> Found:
    """us per exchange of every way whose package is installed."""
    left_out: dict[str, str] = {}
    with ExitStack() as stack:
        cases: dict[str, Callable[[], float]] = {}
        for way, (module, open_way) in _WAYS.items():
            if module and importlib.util.find_spec(module) is None:
                left_out[way] = f"{_PACKAGES.get(module, module)} is not installed"
                continue
            try:
                cases[way] = stack.enter_context(open_way())
            except Exception as error:  # somebody else's tool: say what it said, and go on
                left_out[way] = f"{type(error).__name__}: {error}"
        costs = in_turn(cases, rounds)
    helics = next((cost.median_us for cost in costs if cost.case == HELICS), None)
    rows = [
        Row(c.case, c.median_us, c.least_us, None if helics is None else helics / c.median_us)
        for c in costs
    ]
    cores = len(os.sched_getaffinity(0))
    load = os.getloadavg()[0]
    return Found(
        sorted(rows, key=lambda row: row.median_us),
        left_out,
        f"median of {rounds} rounds in turn, {_TRIPS} exchanges each ({_LANE_TRIPS} in the lane); "
        f"{cores} cores, load {load:.1f}; {', '.join(_versions())}",
    )


def _versions() -> Iterator[str]:
    for package in ("eclipse-zenoh", "pyzmq", "helics", "mosaik"):
        try:
            yield f"{package} {version(package)}"
        except PackageNotFoundError:
            continue


def draw(found: Found, picture: Path) -> None:
    """Bars of exchanges per second, on a logarithmic axis."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 0.5 * len(found.rows) + 1.6), layout="constrained")
    axes = figure.add_subplot()
    rows = found.rows[::-1]
    bars = axes.barh([row.way for row in rows], [1e6 / row.median_us for row in rows])
    axes.bar_label(bars, [f"{1e6 / row.median_us:,.0f}/s" for row in rows], padding=4)
    axes.set_xscale("log")
    axes.margins(x=0.15)
    axes.set_xlabel("exchanges per second (one sample out, one force back)")
    axes.set_title(found.conditions, fontsize=6)
    figure.savefig(picture, dpi=130)


def main(
    folder: OutDirOption = None,
    rounds: RoundsOption = _ROUNDS,
    quick: QuickOption = False,
    json_file: JsonOption = None,
) -> None:
    """Measure one sample out and one force back: by hertzloop's ways and by other tools.

    Other tools are measured where they are installed: pip install -e '.[others]'.

    Example: python -m benchmarks.exchange --quick
    """
    check_json(json_file)
    with results_in(folder, "exchange") as made:
        found = measure(1 if quick else rounds)
        write_records(made / "exchange.csv", found.rows)
        draw(found, made / "exchange.png")
    rows = []
    for row in found.rows:
        ratio = "" if row.times_helics is None else f"{row.times_helics:.2g}"
        us = f"{row.median_us:.3g}", f"{row.least_us:.3g}"
        rows.append((row.way, *us, f"{1e6 / row.median_us:,.0f}", ratio))
    headings = ("way", "us, median", "us, least", "exchanges/s", "times HELICS")
    out.print(number_table("One sample out, one force back", headings, rows, text=1))
    for way, why in found.left_out.items():
        out.print(f"not measured: {way}: {why}", soft_wrap=True)
    out.print(found.conditions, soft_wrap=True)
    written(made, "exchange.csv", "exchange.png")
    us_of = {row.way: row.median_us for row in found.rows}
    lane_us, others = us_of.pop(_OURS[0]), {w: us for w, us in us_of.items() if w not in _OURS}
    fastest = min(others, key=others.__getitem__)
    conclude(
        f"An exchange in the fast lane takes {_short(lane_us)} us, "
        f"{_short(others[fastest] / lane_us)} times as fast as the fastest other tool "
        f"that was measured ({fastest})."
    )
    write_json(json_file, asdict(found))


def _short(value: float) -> str:
    """Two digits, without an exponent."""
    return f"{float(f'{value:.2g}'):,g}"


if __name__ == "__main__":
    start("benchmarks.exchange")
