"""What it costs to keep other users of a host off the bus: Unix sockets in a private folder, and
certificates made on the fly, against ports on loopback."""

import importlib.util
import json
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from pathlib import Path

from benchmarks.baseline import (
    NAME,
    ROUNDS,
    Cost,
    Meets,
    exchange_costs,
    in_turn,
    loop_costs,
    on_ports,
    over_zenoh,
    step_costs,
    stranger_costs,
    timed,
)
from benchmarks.cases import mode_file_costs
from hertzloop.bus.sockets import on_loopback, own_endpoints
from hertzloop.bus.streams import PLANT, ROLES
from hertzloop.bus.wire import LOOPBACK, reserved_ports
from hertzloop.bus.zenoh_port import ZenohPort

_OPENED = 3
_PAUSE_S = 0.05  # after a session: what closes it must not be counted with the next


@contextmanager
def ways() -> Iterator[dict[str, Meets]]:
    """All that are possible here, each with endpoints of its own; loopback first."""
    with ExitStack() as stack:
        loopback = on_loopback(stack.enter_context(reserved_ports(len(ROLES))))
        found = {"loopback": on_ports(loopback)}
        sockets = stack.enter_context(own_endpoints())
        if sockets[0].startswith("unixsock"):
            found["Unix sockets"] = on_ports(sockets)
        if importlib.util.find_spec("cryptography"):
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            numbers = stack.enter_context(reserved_ports(len(ROLES)))
            files = _certified(folder, numbers)
            found["TLS on loopback"] = lambda role: ([], [], files[role])
        yield found


def _certified(folder: Path, ports: list[int]) -> dict[str, Path]:
    """Configurations with certificates of an authority that is forgotten at once."""
    from hertzloop.certificates import Authority, configurations

    places = {role: (LOOPBACK, port) for role, port in zip(ROLES, ports, strict=True)}
    files = {role: folder / f"{role}.json5" for role in ROLES}
    for role, configuration in configurations(Authority(days=1), places).items():
        files[role].touch(mode=0o600)
        files[role].write_text(json.dumps(configuration))
    return files


def link_costs(rounds: int = ROUNDS) -> list[Cost]:
    """us per round trip of 100 B through the zenoh port, by each way; yardstick: loopback."""
    with ExitStack() as stack:
        found = stack.enter_context(ways())
        cases = {name: stack.enter_context(over_zenoh(meets)) for name, meets in found.items()}
        return in_turn(cases, rounds)


def opening_costs(rounds: int = ROUNDS) -> list[Cost]:
    """us to open a port, certificates not counted; yardstick: loopback."""

    def case(meets: Meets) -> Callable[[], float]:
        def measure() -> float:
            spent = 0.0
            for _ in range(_OPENED):
                started = time.perf_counter()
                port = ZenohPort(PLANT, NAME, *meets(PLANT))
                spent += 1e6 * (time.perf_counter() - started)
                port.close()
                time.sleep(_PAUSE_S)
            return spent / _OPENED

        return measure

    with ways() as found:
        return in_turn({name: case(meets) for name, meets in found.items()}, rounds)


def certificate_costs(rounds: int = ROUNDS) -> list[Cost]:
    """us to make what a run by certificates needs: an authority, and one for each role."""
    if not importlib.util.find_spec("cryptography"):
        return []
    with tempfile.TemporaryDirectory() as folder:
        ports = list(range(1, 1 + len(ROLES)))  # nobody listens there
        cases = {"TLS, certificates": lambda: timed(lambda: _certified(Path(folder), ports), 1)}
        return in_turn(cases, rounds)


def measure() -> dict[str, list[dict[str, object]]]:
    """Costs by group, as plain data."""
    groups = {
        "plant step (us)": step_costs(),
        "plate by its modes (us per step)": mode_file_costs(),
        "exchange (us per round trip of 100 B)": exchange_costs(),
        "ways on one host (us per round trip of 100 B)": link_costs(),
        "opening a port (us)": opening_costs() + certificate_costs(),
        "whole loop (us per step)": loop_costs(),
        "beside strangers (us per step)": stranger_costs(),
    }
    return {name: [asdict(cost) for cost in costs] for name, costs in groups.items()}
