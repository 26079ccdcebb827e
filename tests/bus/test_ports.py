"""The contract of a port, kept by the in-process and by the zenoh port alike."""

import numpy as np
import pytest

from hertzloop.bus.messages_pb2 import TruthBlock
from hertzloop.bus.port import InProcessBus, InProcessPort, PeerLost
from hertzloop.bus.streams import CONTROLLER, PLANT, RECORDER, STREAMS, SUBSCRIPTIONS, Envelope
from tests.bus.meshes import ABSENCE_S, PATIENCE_S, ROLES, in_process_mesh, zenoh_mesh


@pytest.fixture(params=["in-process", "zenoh"])
def mesh(request):
    if request.param == "in-process":
        yield in_process_mesh()
    else:
        with zenoh_mesh() as ports:
            yield ports


def text(i: int) -> bytes:
    return f"message {i}".encode()


class TestContract:
    """What every port does."""

    @pytest.mark.parametrize("stream", ["truth", "events/plant"])
    def test_all_messages_arrive_in_order(self, mesh, stream):
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

    def test_streams_of_one_publisher_keep_their_order(self, mesh):
        streams = ["hello", "daq", "truth", "events/plant", "balance", "end/plant"] * 20
        for i, stream in enumerate(streams):
            mesh[PLANT].publish(Envelope(stream, text(i), i // 6))
        got = [mesh[RECORDER].receive(PATIENCE_S, "anything") for _ in streams]
        assert [(e.stream, e.payload) for e in got] == [(s, text(i)) for i, s in enumerate(streams)]

    def test_each_role_hears_what_the_table_says(self, mesh):
        for stream in STREAMS.values():
            mesh[stream.publisher].publish(Envelope(stream.name, b"", 0))
        for role in ROLES:
            heard = {mesh[role].receive(PATIENCE_S, "").stream for _ in SUBSCRIPTIONS[role]}
            assert heard == set(SUBSCRIPTIONS[role])
            with pytest.raises(PeerLost):
                mesh[role].receive(ABSENCE_S, "nothing more")

    def test_silence_names_who_waits_and_for_what(self, mesh):
        with pytest.raises(PeerLost, match=r"^plant wait.* for the force for step 7"):
            mesh[PLANT].receive(ABSENCE_S, "the force for step 7")

    def test_pending(self, mesh):
        assert not mesh[PLANT].pending()
        mesh[CONTROLLER].publish(Envelope("force", b"a"))
        mesh[CONTROLLER].publish(Envelope("force", b"b"))
        assert mesh[PLANT].receive(PATIENCE_S, "a").payload == b"a"
        assert mesh[PLANT].receive(PATIENCE_S, "b").payload == b"b"
        assert not mesh[PLANT].pending()


def test_answers_published_from_a_handler_wait_their_turn():
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
