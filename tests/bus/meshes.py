"""All three roles in one process, joined in-process or by zenoh."""

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import zenoh

from hertzloop.bus.port import InProcessBus, InProcessPort
from hertzloop.bus.streams import CONTROLLER, PLANT, RECORDER
from hertzloop.bus.zenoh_port import ZenohPort
from tests.ports import free_ports

ROLES = (PLANT, CONTROLLER, RECORDER)
PATIENCE_S = 20.0  # for what has to come: generous, nothing is timed here
ABSENCE_S = 0.2  # for what must not come


def url(port: int) -> str:
    """Endpoint of a port of this machine."""
    return f"tcp/127.0.0.1:{port}"


def stranger(*endpoints: str) -> zenoh.Session:
    """A session that reaches these endpoints alone: peers do not relay."""
    config = zenoh.Config()
    for key, value in {
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "listen/endpoints": [],
        "connect/endpoints": list(endpoints),
    }.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


@contextmanager
def zenoh_mesh(name: str = "contract", ports: Sequence[int] = ()) -> Iterator[dict[str, ZenohPort]]:
    """All three roles in this process, each with a session of its own, a full mesh."""
    urls = [url(port) for port in ports or free_ports(3)]
    mesh = {
        role: ZenohPort(role, name, [urls[place]], urls[:place]) for place, role in enumerate(ROLES)
    }
    for port in mesh.values():
        port.liveliness.announce()
    for role, port in mesh.items():
        port.liveliness.wait_for([other for other in ROLES if other != role], PATIENCE_S)
    try:
        yield mesh
    finally:
        for port in mesh.values():
            port.close()


def in_process_mesh() -> dict[str, InProcessPort]:
    """All three roles on one bus."""
    bus = InProcessBus()
    return {role: InProcessPort(bus, role) for role in ROLES}
