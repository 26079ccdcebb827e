"""docs/reference/wire.md says what the code does: streams, keys, fields, ports."""

import re
from pathlib import Path

import pytest
import zenoh

from hertzloop.bus import messages_pb2
from hertzloop.bus.streams import CONTROLLER, PLANT, RECORDER, STREAMS, SUBSCRIPTIONS, Envelope
from hertzloop.bus.zenoh_port import ZenohPort
from hertzloop.processes.program import BASE_PORT
from hertzloop.processes.roles import default_endpoints
from tests.bus.meshes import stranger, url
from tests.hertzloop.commands import wait_for
from tests.ports import free_ports

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
        [listens], _ = default_endpoints(role, ports)
        assert re.search(rf"{role}\s(listens )?on\s`{listens}`", PAGE), role


def test_keys_and_numbers_on_a_real_bus():
    """A session that knows the page alone hears what our port says."""
    keys = [key for key in KNOWN if key.startswith("hertzloop/<name>/")]
    [alive] = [key for key in keys if "alive" in key]
    [stream] = [key for key in keys if "<stream>" in key]
    assert {key.split("/")[2] for key in keys if key not in (alive, stream)} == {"complete"}
    [number] = free_ports(1)
    port = ZenohPort(CONTROLLER, "page", [url(number)])
    tokens: list[str] = []
    heard: list[zenoh.Sample] = []
    try:
        with stranger(url(number)) as session:
            key = stream.replace("<name>", "page").replace("<stream>", "events/controller")
            session.declare_subscriber(key, zenoh.handlers.Callback(heard.append))
            token = alive.replace("<name>", "page").replace("<role>", "controller")
            session.liveliness().declare_subscriber(
                token.replace("<instance>", "*"),
                zenoh.handlers.Callback(lambda sample: tokens.append(str(sample.key_expr))),
                history=True,
            )
            port.liveliness.announce()
            wait_for(lambda: tokens)
            done: list[zenoh.Sample] = []
            [complete] = [key for key in keys if "complete" in key]
            mine = complete.replace("<name>", "page").replace("recorder", "controller")
            session.liveliness().declare_subscriber(mine, zenoh.handlers.Callback(done.append))
            port.liveliness.confirm_completion()
            wait_for(lambda: done)

            def said() -> bool:
                port.publish(Envelope("events/controller", b"event", 5))
                return bool(heard)

            wait_for(said)
            attachment = heard[0].attachment
            assert attachment is not None
            assert attachment.to_bytes() == (5).to_bytes(8, "little")
    finally:
        port.close()
