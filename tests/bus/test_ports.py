"""The contract of a port, kept by the in-process and by the zenoh port alike."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import psutil
import pytest

from bus import wire
from bus.inprocess import InProcessBus, InProcessPort
from bus.messages_pb2 import TruthBlock
from bus.port import BusError, PeerLost, Port
from bus.streams import CONTROLLER, PLANT, RECORDER, STREAMS, SUBSCRIPTIONS, Envelope
from bus.zenoh_port import ZenohPort
from hertzloop.launcher import free_ports

ROLES = (PLANT, CONTROLLER, RECORDER)
PATIENCE_S = 20.0  # for what has to come: generous, nothing is timed here
ABSENCE_S = 0.2  # for what must not come


def url(port: int) -> str:
    return f"tcp/127.0.0.1:{port}"


def zenoh_mesh(ports: list[int], name: str = "contract") -> dict[str, ZenohPort]:
    """All three roles in this process, each with a session of its own, a full mesh."""
    urls = [url(port) for port in ports]
    mesh = {
        role: ZenohPort(role, name, [urls[place]], urls[:place]) for place, role in enumerate(ROLES)
    }
    for port in mesh.values():
        port.announce()
    for role, port in mesh.items():
        port.wait_for([other for other in ROLES if other != role], PATIENCE_S)
    return mesh


def in_process_mesh() -> dict[str, InProcessPort]:
    bus = InProcessBus()
    return {role: InProcessPort(bus, role) for role in ROLES}


@pytest.fixture(params=["in-process", "zenoh"])
def mesh(request: pytest.FixtureRequest) -> Iterator[dict[str, Port]]:
    ports: dict[str, Port] = {}
    ports.update(in_process_mesh() if request.param == "in-process" else zenoh_mesh(free_ports(3)))
    yield ports
    for port in ports.values():
        port.close()


@pytest.fixture
def zenoh() -> Iterator[dict[str, ZenohPort]]:
    ports = zenoh_mesh(free_ports(3))
    yield ports
    for port in ports.values():
        port.close()


def text(i: int) -> bytes:
    return f"message {i}".encode()


class TestContract:
    """What every port does."""

    @pytest.mark.parametrize("stream", ["truth", "events/plant"])
    def test_all_messages_arrive_in_order(self, mesh: dict[str, Port], stream: str) -> None:
        """2000 messages as fast as they go, some of a megabyte: congestion loses nothing."""
        noise = np.random.default_rng(1).bytes(1_000_000)
        sent = [noise[i : i + 20_000] if i % 100 else noise for i in range(2000)]
        for i, payload in enumerate(sent):
            mesh[PLANT].publish(Envelope(stream, payload, i))
        numbered = STREAMS[stream].message is TruthBlock
        for i, payload in enumerate(sent):
            got = mesh[RECORDER].receive(PATIENCE_S, "truth")
            assert got.stream == stream
            assert got.payload == payload
            assert got.sequence == i or (numbered and got.sequence is None)
        assert not mesh[RECORDER].pending()

    def test_streams_of_one_publisher_keep_their_order(self, mesh: dict[str, Port]) -> None:
        streams = ["hello", "daq", "truth", "events/plant", "books", "end/plant"] * 20
        for i, stream in enumerate(streams):
            mesh[PLANT].publish(Envelope(stream, text(i), i // 6))
        got = [mesh[RECORDER].receive(PATIENCE_S, "anything") for _ in streams]
        assert [(e.stream, e.payload) for e in got] == [(s, text(i)) for i, s in enumerate(streams)]

    def test_each_role_hears_what_the_table_says(self, mesh: dict[str, Port]) -> None:
        for stream in STREAMS.values():
            mesh[stream.publisher].publish(Envelope(stream.name, b"", 0))
        for role in ROLES:
            heard = {mesh[role].receive(PATIENCE_S, "").stream for _ in SUBSCRIPTIONS[role]}
            assert heard == set(SUBSCRIPTIONS[role])
            with pytest.raises(PeerLost):
                mesh[role].receive(ABSENCE_S, "nothing more")

    def test_question_and_answer(self, mesh: dict[str, Port]) -> None:
        for i in range(50):
            mesh[PLANT].publish(Envelope("daq", text(i)))
            question = mesh[CONTROLLER].receive(PATIENCE_S, "samples")
            mesh[CONTROLLER].publish(Envelope("force", question.payload[::-1]))
            assert mesh[PLANT].receive(PATIENCE_S, "forces").payload == text(i)[::-1]

    def test_a_message_is_the_bytes_that_were_sent(self, mesh: dict[str, Port]) -> None:
        values = np.linspace(-1.0, 1.0, 1000)
        payload = wire.encode(TruthBlock(run_id=1, sequence=3), xi_m=values)
        mesh[PLANT].publish(Envelope("truth", payload))
        block = wire.decode(TruthBlock, mesh[RECORDER].receive(PATIENCE_S, "truth").payload)
        assert np.array_equal(block.arrays["xi_m"], values)

    @pytest.mark.parametrize("stream", ["daq", "events/plant"])
    def test_an_empty_payload_arrives(self, mesh: dict[str, Port], stream: str) -> None:
        mesh[PLANT].publish(Envelope(stream, b"", 0))
        assert mesh[RECORDER].receive(PATIENCE_S, "it").payload == b""

    def test_silence_names_who_waits_and_for_what(self, mesh: dict[str, Port]) -> None:
        with pytest.raises(PeerLost, match=r"^plant wait.* for the force for step 7"):
            mesh[PLANT].receive(ABSENCE_S, "the force for step 7")

    def test_pending(self, mesh: dict[str, Port]) -> None:
        assert not mesh[PLANT].pending()
        mesh[CONTROLLER].publish(Envelope("force", b"a"))
        mesh[CONTROLLER].publish(Envelope("force", b"b"))
        assert mesh[PLANT].receive(PATIENCE_S, "a").payload == b"a"
        assert mesh[PLANT].receive(PATIENCE_S, "b").payload == b"b"
        assert not mesh[PLANT].pending()


def test_answers_published_from_a_handler_wait_their_turn() -> None:
    """In one process: all subscribers see all streams in the same order."""
    bus, seen = InProcessBus(), []
    controller: InProcessPort

    def answer(envelope: Envelope) -> None:
        controller.publish(Envelope("force", b"to " + envelope.payload))
        controller.publish(Envelope("events/controller", b"after " + envelope.payload))

    controller = InProcessPort(bus, CONTROLLER, answer)
    InProcessPort(bus, RECORDER, lambda envelope: seen.append(envelope.payload))
    plant = InProcessPort(bus, PLANT)
    plant.publish(Envelope("daq", b"1"))
    plant.publish(Envelope("daq", b"2"))
    assert seen == [b"1", b"to 1", b"after 1", b"2", b"to 2", b"after 2"]


def test_a_failing_handler_leaves_the_bus_usable() -> None:
    bus, seen = InProcessBus(), []

    def fail(envelope: Envelope) -> None:
        raise ValueError("no")

    InProcessPort(bus, CONTROLLER, fail)
    InProcessPort(bus, RECORDER, lambda envelope: seen.append(envelope.stream))
    plant = InProcessPort(bus, PLANT)
    with pytest.raises(ValueError, match="no"):
        plant.publish(Envelope("daq", b""))
    plant.publish(Envelope("truth", b""))
    assert seen == ["truth"]


class TestPresence:
    """Who is there: only ports between processes can tell."""

    def test_a_departure_is_reported_after_what_was_sent(self, zenoh: dict[str, ZenohPort]) -> None:
        zenoh[PLANT].publish(Envelope("daq", b"last words"))
        zenoh[PLANT].close()
        assert zenoh[CONTROLLER].receive(PATIENCE_S, "samples").payload == b"last words"
        with pytest.raises(PeerLost, match=r"plant left the run; controller was .* samples"):
            zenoh[CONTROLLER].receive(PATIENCE_S, "samples")
        with pytest.raises(PeerLost, match=r"plant left the run; controller was sending 'force'"):
            zenoh[CONTROLLER].publish(Envelope("force", b""))

    def test_a_role_that_was_released_may_leave(self, zenoh: dict[str, ZenohPort]) -> None:
        for role in (CONTROLLER, RECORDER):
            zenoh[role].release(PLANT)
        zenoh[PLANT].close()
        assert zenoh[RECORDER].wait_until_gone(PLANT, PATIENCE_S)
        zenoh[CONTROLLER].publish(Envelope("force", b"still here"))
        assert zenoh[RECORDER].receive(PATIENCE_S, "forces").payload == b"still here"
        with pytest.raises(PeerLost, match="nothing came"):
            zenoh[RECORDER].receive(ABSENCE_S, "more")

    def test_a_role_that_stays_is_not_gone(self, zenoh: dict[str, ZenohPort]) -> None:
        assert not zenoh[RECORDER].wait_until_gone(PLANT, ABSENCE_S)

    def test_waiting_names_who_is_missing(self) -> None:
        ports = free_ports(2)
        plant = ZenohPort(PLANT, "lonely", [url(ports[0])])
        recorder = ZenohPort(RECORDER, "lonely", [url(ports[1])], [url(ports[0])])
        try:
            recorder.announce()
            plant.wait_for([RECORDER], PATIENCE_S)
            with pytest.raises(PeerLost) as caught:
                plant.wait_for([CONTROLLER, RECORDER], ABSENCE_S)
            assert "plant waited 0.2 s for controller on bus 'lonely'" in str(caught.value)
            assert "recorder" not in str(caught.value)
        finally:
            plant.close()
            recorder.close()

    def test_a_role_that_did_not_announce_itself_is_not_there(self) -> None:
        """A session is no role yet: its subscribers may not exist."""
        ports = free_ports(2)
        plant = ZenohPort(PLANT, "early", [url(ports[0])])
        recorder = ZenohPort(RECORDER, "early", [url(ports[1])], [url(ports[0])])
        try:
            with pytest.raises(PeerLost, match="recorder"):
                plant.wait_for([RECORDER], ABSENCE_S)
            recorder.announce()
            plant.wait_for([RECORDER], PATIENCE_S)
        finally:
            plant.close()
            recorder.close()

    def test_runs_of_other_names_are_not_heard(self) -> None:
        ports = free_ports(3)
        recorder = ZenohPort(RECORDER, "mine", [url(ports[0])])
        plants = [
            ZenohPort(PLANT, name, [url(port)], [url(ports[0])])
            for name, port in zip(["other", "mine"], ports[1:], strict=True)
        ]
        try:
            for plant in plants:
                plant.announce()
            recorder.wait_for([PLANT], PATIENCE_S)
            for plant in plants:
                plant.publish(Envelope("truth", plant.name.encode()))
            assert recorder.receive(PATIENCE_S, "truth").payload == b"mine"
            with pytest.raises(PeerLost, match="nothing came"):
                recorder.receive(ABSENCE_S, "more")
        finally:
            for port in (*plants, recorder):
                port.close()


class TestEndpoints:
    """What a zenoh port opens."""

    def test_only_the_given_loopback_endpoints_listen(self) -> None:
        def connections() -> set[tuple[str, int, str]]:
            found = psutil.Process().net_connections("inet")
            return {(c.laddr.ip, c.laddr.port, f"{c.type.name} {c.status}") for c in found}

        before = connections()
        ports = free_ports(3)
        mesh = zenoh_mesh(ports)
        try:
            opened = connections() - before
        finally:
            for port in mesh.values():
                port.close()
        listening = {(ip, number) for ip, number, state in opened if "LISTEN" in state}
        assert listening == {("127.0.0.1", number) for number in ports}
        assert {ip for ip, _, _ in opened} == {"127.0.0.1"}
        assert not [o for o in opened if "DGRAM" in o[2]]  # no multicast, no UDP at all

    def test_a_port_in_use_gives_a_sentence(self) -> None:
        [number] = free_ports(1)
        first = ZenohPort(PLANT, "taken", [url(number)])
        try:
            with pytest.raises(BusError) as caught:
                ZenohPort(CONTROLLER, "taken", [url(number)])
        finally:
            first.close()
        sentence = str(caught.value)
        assert f"controller cannot open the bus at {url(number)}: is the port in use?" in sentence
        assert "\n" not in sentence

    @pytest.mark.parametrize("endpoint", ["tcp/127.0.0.1", "pigeon/1", "127.0.0.1:7450"])
    def test_an_endpoint_that_is_none(self, endpoint: str) -> None:
        with pytest.raises(BusError, match="plant cannot open the bus at"):
            ZenohPort(PLANT, "wrong", [endpoint])

    def test_a_configuration_file_gives_the_endpoints(self, tmp_path: Path) -> None:
        numbers = free_ports(2)
        file = tmp_path / "bus.json5"
        file.write_text(f'{{ listen: {{ endpoints: ["{url(numbers[0])}"] }} }}')
        plant = ZenohPort(PLANT, "filed", [], config_file=file)
        recorder = ZenohPort(RECORDER, "filed", [url(numbers[1])], [url(numbers[0])])
        try:
            recorder.announce()
            plant.wait_for([RECORDER], PATIENCE_S)
            plant.publish(Envelope("truth", b"heard"))
            assert recorder.receive(PATIENCE_S, "truth").payload == b"heard"
        finally:
            plant.close()
            recorder.close()

    @pytest.mark.parametrize("content", [None, "{ nonsense"])
    def test_a_configuration_file_that_cannot_be_used(
        self, tmp_path: Path, content: str | None
    ) -> None:
        file = tmp_path / "bus.json5"
        if content is not None:
            file.write_text(content)
        with pytest.raises(BusError, match=r"plant cannot open the bus at .*bus\.json5"):
            ZenohPort(PLANT, "filed", [], config_file=file)
