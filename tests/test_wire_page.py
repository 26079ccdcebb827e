"""docs/reference/wire.md says what the code does: streams, keys, fields, ports."""

import re
from pathlib import Path

import pytest

from hertzloop.bus import messages_pb2
from hertzloop.bus.sockets import mesh_endpoints, on_loopback
from hertzloop.bus.streams import CONTROLLER, PLANT, RECORDER, STREAMS, SUBSCRIPTIONS
from hertzloop.processes.program import BASE_PORT

ROOT = Path(__file__).resolve().parent.parent
PAGE = (ROOT / "docs" / "reference" / "wire.md").read_text()
KNOWN = set(re.findall(r"`([^`]+)`", re.sub(r"```.*?```", "", PAGE, flags=re.S)))


def test_the_table_of_streams():
    rows = re.findall(r"^\| `(\S+)` \| (\w+) \| `(\w+)` \| ([\w, ]+) \| (\w+) \|$", PAGE, re.M)
    roles = (PLANT, CONTROLLER, RECORDER)
    assert rows == [
        (
            stream.name,
            stream.publisher,
            stream.message.DESCRIPTOR.name,
            ", ".join(role for role in roles if stream.name in SUBSCRIPTIONS[role]),
            "header" if stream.numbered else "none" if stream.once else "attachment",
        )
        for stream in STREAMS.values()
    ]


@pytest.mark.parametrize(
    "name", ["DaqBlock", "ForceBlock", "StreamCount", "ControllerReport", "RunEnd"]
)
def test_every_field_that_a_controller_meets(name):
    fields = {field.name for field in getattr(messages_pb2, name).DESCRIPTOR.fields}
    assert fields <= KNOWN


def test_ports():
    ports = range(BASE_PORT, BASE_PORT + 3)
    for role in (PLANT, CONTROLLER, RECORDER):
        [listens], _ = mesh_endpoints(role, on_loopback(ports))
        assert re.search(rf"{role}\s(listens )?on\s`{listens}`", PAGE), role
