"""Ports between processes: who is there, and what a zenoh port opens."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from typing import Any

import psutil
import pytest

from hertzloop.bus.port import BusError, PeerLost
from hertzloop.bus.streams import CONTROLLER, PLANT, RECORDER, Envelope
from hertzloop.bus.zenoh_port import ZenohPort
from tests.bus.meshes import ABSENCE_S, PATIENCE_S, url, zenoh_mesh
from tests.hertzloop.commands import wait_for
from tests.ports import free_ports


@pytest.fixture
def zenoh():
    with zenoh_mesh() as ports:
        yield ports


@pytest.fixture
def opened():
    """Opens a port, which is closed after the test."""
    with ExitStack() as closing:

        def port(*arguments: Any, **more: Any) -> ZenohPort:
            made = ZenohPort(*arguments, **more)
            closing.callback(made.close)
            return made

        yield port


Opened = Callable[..., ZenohPort]


@pytest.mark.parametrize("twice", [PLANT, CONTROLLER, RECORDER])
def test_a_role_that_is_there_twice_is_refused_before_a_run(opened, twice):
    """One of the others sees both, whatever the order in which they came."""
    looks = RECORDER if twice == PLANT else PLANT
    a, b, c = (url(port) for port in free_ports(3))
    looking = opened(looks, "twins", [a])
    for where in (b, c):
        opened(twice, "twins", [where], [a]).liveliness.announce()
    wait_for(lambda: len(looking.liveliness.alive[twice]) == 2)
    with pytest.raises(BusError, match=f"2 processes are the {twice} on bus 'twins'"):
        looking.liveliness.wait_for([twice], PATIENCE_S)


def heard(plant: ZenohPort, recorder: ZenohPort) -> None:
    """What the plant says reaches the recorder."""
    recorder.liveliness.announce()
    plant.liveliness.wait_for([RECORDER], PATIENCE_S)
    plant.publish(Envelope("truth", b"heard"))
    assert recorder.receive(PATIENCE_S, "truth").payload == b"heard"


class TestPresence:
    """Who is there: only ports between processes can tell."""

    def test_a_departure_is_reported_after_what_was_sent(self, zenoh):
        zenoh[PLANT].publish(Envelope("daq", b"last words"))
        zenoh[PLANT].close()
        assert zenoh[CONTROLLER].receive(PATIENCE_S, "samples").payload == b"last words"
        with pytest.raises(PeerLost, match=r"plant left the run; controller was .* samples"):
            zenoh[CONTROLLER].receive(PATIENCE_S, "samples")
        with pytest.raises(PeerLost, match=r"plant left the run; controller was sending 'force'"):
            zenoh[CONTROLLER].publish(Envelope("force", b""))

    def test_a_role_that_was_released_may_leave(self, zenoh):
        for role in (CONTROLLER, RECORDER):
            zenoh[role].liveliness.release(PLANT)
        zenoh[PLANT].close()
        assert zenoh[RECORDER].liveliness.wait_until_gone(PLANT, PATIENCE_S)
        zenoh[CONTROLLER].publish(Envelope("force", b"still here"))
        assert zenoh[RECORDER].receive(PATIENCE_S, "forces").payload == b"still here"
        with pytest.raises(PeerLost, match="nothing came"):
            zenoh[RECORDER].receive(ABSENCE_S, "more")

    def test_a_role_that_left_before_the_start_may_come_again(self, opened):
        here, there = map(url, free_ports(2))
        plant, first = (
            opened(PLANT, "again", [here]),
            opened(RECORDER, "again", [there], [here]),
        )
        first.liveliness.announce()
        plant.liveliness.wait_for([RECORDER], PATIENCE_S)
        first.close()
        assert plant.liveliness.wait_until_gone(RECORDER, PATIENCE_S)
        heard(plant, opened(RECORDER, "again", [there], [here]))

    def test_a_role_leaves_with_or_without_confirming_completion(self, zenoh):
        zenoh[RECORDER].liveliness.confirm_completion()
        zenoh[RECORDER].close()
        zenoh[PLANT].liveliness.wait_for_completion(RECORDER, PATIENCE_S)
        zenoh[CONTROLLER].close()
        with pytest.raises(PeerLost, match="controller left the run before its part was complete"):
            zenoh[PLANT].liveliness.wait_for_completion(CONTROLLER, PATIENCE_S)

    def test_a_token_that_overtakes_the_last_words_of_its_role_is_no_loss(self, zenoh):
        """The recorder has heard them; the plant's token is gone before the controller has."""
        zenoh[RECORDER].liveliness.confirm_completion()
        zenoh[RECORDER].close()
        zenoh[PLANT].liveliness.leave()
        for role in (RECORDER, PLANT):
            assert zenoh[CONTROLLER].liveliness.wait_until_gone(role, PATIENCE_S)
        with pytest.raises(PeerLost, match=r"controller waited .* for samples: nothing came"):
            zenoh[CONTROLLER].receive(ABSENCE_S, "samples")
        zenoh[PLANT].publish(Envelope("end/plant", b"last words"))
        assert zenoh[CONTROLLER].receive(PATIENCE_S, "samples").payload == b"last words"

    def test_last_words_that_come_after_a_departure_explain_it(self, zenoh):
        """Two links, nothing confirmed: the plant may be about to say why the recorder left."""
        zenoh[RECORDER].close()
        assert zenoh[CONTROLLER].liveliness.wait_until_gone(RECORDER, PATIENCE_S)
        zenoh[CONTROLLER].publish(Envelope("force", b"not missed yet"))
        assert not zenoh[CONTROLLER].pending()
        zenoh[PLANT].publish(Envelope("end/plant", b"interrupted"))
        assert zenoh[CONTROLLER].receive(PATIENCE_S, "samples").payload == b"interrupted"

    def test_a_departure_that_nobody_explains_is_reported(self, zenoh):
        zenoh[RECORDER].close()
        left = "recorder left the run; controller was waiting for samples"
        with pytest.raises(PeerLost, match=left):
            zenoh[CONTROLLER].receive(PATIENCE_S, "samples")
        assert zenoh[CONTROLLER].pending()  # of it, again
        with pytest.raises(PeerLost, match=left):
            zenoh[CONTROLLER].receive(PATIENCE_S, "samples")
        with pytest.raises(PeerLost, match="recorder left the run; controller was sending 'force'"):
            zenoh[CONTROLLER].publish(Envelope("force", b""))

    def test_a_wait_that_ends_in_vain_says_whose_message_was_awaited(self, zenoh):
        """The launcher blames by these roles, whatever the words of the sentence."""
        for senders in ((), (CONTROLLER,), (CONTROLLER, RECORDER)):
            with pytest.raises(PeerLost) as caught:
                zenoh[PLANT].receive(ABSENCE_S, "something", senders)
            assert set(caught.value.roles) == {*senders}

    def test_a_wait_can_be_aborted(self, zenoh):
        zenoh[PLANT].abort(KeyboardInterrupt())
        with pytest.raises(KeyboardInterrupt):
            zenoh[PLANT].receive(PATIENCE_S, "forces")
        with pytest.raises(KeyboardInterrupt):
            zenoh[PLANT].liveliness.wait_until_gone(RECORDER, PATIENCE_S)

    def test_waiting_names_who_is_missing(self, opened):
        here, there = map(url, free_ports(2))
        plant = opened(PLANT, "lonely", [here])
        opened(RECORDER, "lonely", [there], [here]).liveliness.announce()
        plant.liveliness.wait_for([RECORDER], PATIENCE_S)
        with pytest.raises(PeerLost) as caught:
            plant.liveliness.wait_for([CONTROLLER, RECORDER], ABSENCE_S)
        assert "plant waited 0.2 s for controller on bus 'lonely'" in str(caught.value)
        assert "recorder" not in str(caught.value)

    def test_runs_of_other_names_are_not_heard(self, opened):
        here, *others = map(url, free_ports(3))
        recorder = opened(RECORDER, "mine", [here])
        plants = [
            opened(PLANT, name, [where], [here])
            for name, where in zip(["other", "mine"], others, strict=True)
        ]
        for plant in plants:
            plant.liveliness.announce()
        recorder.liveliness.wait_for([PLANT], PATIENCE_S)
        for plant in plants:
            plant.publish(Envelope("truth", plant.name.encode()))
        assert recorder.receive(PATIENCE_S, "truth").payload == b"mine"
        with pytest.raises(PeerLost, match="nothing came"):
            recorder.receive(ABSENCE_S, "more")


class TestLargeMessages:
    """They are sent in a thread of their own."""

    def test_what_was_published_before_the_port_is_closed_is_sent(self, zenoh):
        zenoh[PLANT].publish(Envelope("truth", bytes(3_000_000)))
        zenoh[PLANT].close()
        assert len(zenoh[RECORDER].receive(PATIENCE_S, "truth").payload) == 3_000_000

    def test_one_that_cannot_be_sent_ends_the_next_wait_and_message(self, zenoh, monkeypatch):
        plant = zenoh[PLANT]

        def refuse(envelope: Envelope) -> None:
            raise PeerLost("recorder accepted no message", RECORDER)

        with monkeypatch.context() as patched:
            patched.setattr(plant, "_put", refuse)
            plant.publish(Envelope("truth", bytes(100_000)))
            with pytest.raises(PeerLost, match="recorder accepted no message"):
                plant.receive(PATIENCE_S, "a force")
        assert plant.pending()
        with pytest.raises(PeerLost, match="recorder accepted no message"):
            plant.publish(Envelope("daq", b"sample"))
        plant.publish(Envelope("end/plant", b"end", 0))
        assert zenoh[CONTROLLER].receive(PATIENCE_S, "the end").payload == b"end"


class TestEndpoints:
    """What a zenoh port opens."""

    def test_only_the_given_loopback_endpoints_listen(self):
        def connections() -> set[tuple[str, int, str]]:
            found = psutil.Process().net_connections("inet")
            return {(c.laddr.ip, c.laddr.port, f"{c.type.name} {c.status}") for c in found}

        ports = free_ports(3)
        before = connections()
        with zenoh_mesh(ports=ports):
            opened = connections() - before
        listening = {(ip, number) for ip, number, state in opened if "LISTEN" in state}
        assert listening == {("127.0.0.1", number) for number in ports}
        assert {ip for ip, _, _ in opened} == {"127.0.0.1"}
        assert not [o for o in opened if "DGRAM" in o[2]]  # no multicast, no UDP at all

    def test_opening_and_closing_leaves_no_handle(self):
        [number] = free_ports(1)
        counts = []
        for _ in range(12):
            plant = ZenohPort(PLANT, "often", [url(number)])
            plant.liveliness.announce()
            plant.close()
            counts.append(psutil.Process().num_fds())
        assert counts[-1] <= counts[1]

    def test_a_configuration_file_without_endpoints_opens_none(self, opened, tmp_path):
        """zenoh's own default would be every interface."""
        file = tmp_path / "bus.json5"
        file.write_text("{ transport: { link: { tx: { lease: 4000 } } } }")
        before = {c.laddr for c in psutil.Process().net_connections() if c.status == "LISTEN"}
        opened(PLANT, "filed", [], config_file=file)
        after = {c.laddr for c in psutil.Process().net_connections() if c.status == "LISTEN"}
        assert after == before

    def test_a_port_in_use_gives_a_sentence(self, opened):
        [where] = map(url, free_ports(1))
        opened(PLANT, "taken", [where])
        with pytest.raises(BusError) as caught:
            ZenohPort(CONTROLLER, "taken", [where])
        sentence = str(caught.value)
        assert f"controller cannot open the bus at {where}: the port is in use. " in sentence
        assert sentence.endswith("Choose another one, or end the program that uses it.")
        assert "\n" not in sentence
        assert ".rs" not in sentence  # zenoh adds where it says so in its own source

    def test_a_configuration_file_gives_the_endpoints(self, opened, tmp_path):
        here, there = map(url, free_ports(2))
        file = tmp_path / "bus.json5"
        file.write_text(f'{{ listen: {{ endpoints: ["{here}"] }} }}')
        plant = opened(PLANT, "filed", [], config_file=file)
        heard(plant, opened(RECORDER, "filed", [there], [here]))

    @pytest.mark.parametrize(
        ("content", "why"),
        [
            (None, "it cannot be read"),
            ("{ nonsense", "line 1 is wrong"),
            ('{"mode":\n"KEY1"}', "line 2 is wrong"),
            ('{"listen_private_key_base64":\n\n"KEY1', "line 3 is wrong"),
        ],
    )
    def test_a_configuration_file_that_cannot_be_used_is_not_quoted(self, tmp_path, content, why):
        file = tmp_path / "bus.json5"
        if content is not None:
            file.write_text(content)
        said = rf"bus\.json5: is not a zenoh configuration: {why}"
        with pytest.raises(BusError, match=said) as caught:
            ZenohPort(PLANT, "filed", [], config_file=file)
        assert "KEY1" not in str(caught.value)


def test_a_forged_token_does_not_keep_a_finished_run(zenoh):
    """Somebody else on the bus says to be the recorder, and stays."""
    plant = zenoh[PLANT]
    token = (
        zenoh[CONTROLLER]
        ._session.liveliness()
        .declare_token("hertzloop/contract/alive/recorder/forged")
    )
    wait_for(lambda: len(plant.liveliness.alive[RECORDER]) == 2)
    zenoh[RECORDER].liveliness.confirm_completion()
    zenoh[RECORDER].close()
    with ThreadPoolExecutor(1) as other:
        waiting = other.submit(plant.liveliness.wait_for_completion, RECORDER, 2 * PATIENCE_S)
        try:
            waiting.result(PATIENCE_S)
        finally:
            token.undeclare()


def test_the_wait_for_a_recorder_that_does_not_finish_is_bounded(zenoh):
    with pytest.raises(PeerLost, match="recorder did not complete its part within 0 s"):
        zenoh[PLANT].liveliness.wait_for_completion(RECORDER, ABSENCE_S)
