"""The guards of the lock-step: against a controller that breaks its word, against forgeries."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hertzloop.bus import codec
from hertzloop.bus.codec import decoded
from hertzloop.bus.messages_pb2 import RunEnd, StreamCount
from hertzloop.bus.port import PeerLost
from hertzloop.bus.streams import Envelope, StreamFault
from hertzloop.scene.setup import load
from hertzloop.scene.toml import to_toml
from tests.bus.tapes import changed
from tests.hertzloop.exchange import Alter, exchange, forces
from tests.hertzloop.short_runs import SHORT, scene

pytestmark = pytest.mark.usefixtures("short_blocks")


def refused(seed: int, *words: str, name: str = "law", **how: Any) -> None:
    with pytest.raises(StreamFault) as caught:
        exchange(scene(name), seed, **how)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize("seed", range(5))
class TestBrokenControllers:
    """Each ends the run, whatever the delays."""

    def test_a_broken_promise(self, seed: int) -> None:
        """It has promised no force until contact, and pushes all the same."""

        def change(header: Any, force: np.ndarray) -> np.ndarray | None:
            # The promise for these steps came with the first block, whatever came after it.
            return force + 1.0 if header.sequence == 1 else None

        refused(seed, "breaks the promise of zero force", horizon=100, alter=forces(change))

    def test_forces_beyond_the_end(self, seed: int) -> None:
        def change(header: Any, force: np.ndarray) -> np.ndarray | None:
            end = header.first_step + len(force)
            return np.append(force, 0.0) if end == scene().steps else None

        refused(seed, "reaches step 2501, the run has 2500", alter=forces(change))

    @pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
    def test_a_force_that_is_no_number(self, seed: int, value: float) -> None:
        def change(header: Any, force: np.ndarray) -> None:
            force[-1:] = value

        def broken(header: Any, force: np.ndarray) -> np.ndarray:
            change(header, force)
            return force

        refused(seed, "stream 'force' sequence 0 holds force_n", alter=forces(broken))

    @pytest.mark.parametrize("value", [math.nan, math.inf])
    def test_a_level_that_is_no_number(self, seed: int, value: float) -> None:
        def change(header: Any, force: np.ndarray) -> None:
            header.promise_level = value

        refused(seed, "'force' sequence 0 holds promise_level", alter=forces(change))

    def test_an_answer_to_samples_never_sent(self, seed: int) -> None:
        def change(header: Any, force: np.ndarray) -> None:
            header.samples_seen += 10**6

        refused(seed, "'force' sequence 0 answers 100", "were sent", alter=forces(change))

    def test_an_answer_to_fewer_samples_than_before(self, seed: int) -> None:
        def change(header: Any, force: np.ndarray) -> None:
            header.samples_seen -= header.samples_seen if header.sequence == 3 else 0

        refused(
            seed, "'force' sequence 3 answers 0 samples", "answered before",
            horizon=100, alter=forces(change),
        )  # fmt: skip

    def test_silence_where_a_force_is_needed(self, seed: int) -> None:
        """It answers all samples, but grants and promises nothing."""
        keep: list[int] = []

        def change(header: Any, force: np.ndarray) -> np.ndarray | None:
            keep.append(header.first_step)
            header.first_step, header.promise_zero = keep[0], False
            return force[:0]

        refused(seed, "but granted no force for step", alter=forces(change))

    def test_an_end_too_early(self, seed: int) -> None:
        def alter(envelope: Envelope) -> list[Envelope]:
            if envelope.stream != "force":
                return []
            return [Envelope("end/controller", RunEnd(run_id=run_of(envelope), role="controller")
                             .SerializeToString(), 0)]  # fmt: skip

        refused(seed, "the controller ended the run: too early", alter=alter)

    def test_a_stream_that_lost_its_tail(self, seed: int) -> None:
        """The plant reconciles what it heard: here the controller announces more."""

        def change(end: RunEnd) -> None:
            next(c for c in end.count if c.stream == "force").messages += 1

        refused(seed, "stream 'force' is incomplete", alter=at_the_end(change))

    def test_another_scene(self, seed: int) -> None:
        """Right counts, but it says at its end that it worked by other parameters."""

        def change(end: RunEnd) -> None:
            text = end.report.scene_toml
            end.report.scene_toml = text.replace("kappa = 0.8", "kappa = -5.0")

        refused(seed, "'kappa = -5.0' where", "'kappa = 0.8'", alter=at_the_end(change))

    def test_another_stiffness(self, seed: int) -> None:
        def change(end: RunEnd) -> None:
            end.report.stiffness *= 2.0

        refused(seed, "the controller worked with a contact stiffness", alter=at_the_end(change))

    def test_no_word_about_its_scene(self, seed: int) -> None:
        refused(seed, "names no scene", alter=at_the_end(lambda e: e.ClearField("report")))


def run_of(envelope: Envelope) -> int:
    return int(decoded(envelope).header.run_id)


def at_the_end(change: Callable[[RunEnd], object], role: str = "controller") -> Alter:
    """Changes the end of a role."""

    def alter(envelope: Envelope) -> list[Envelope]:
        if envelope.stream != f"end/{role}":
            return [envelope]
        end = RunEnd.FromString(envelope.payload)
        change(end)
        return [replace(envelope, payload=end.SerializeToString())]

    return alter


def hello_of_another_law(envelope: Envelope, sequence: int | None) -> Envelope:
    header = decoded(envelope).header
    header.scene_toml = to_toml(load("aluminium-3mm", [*SHORT, "controller.kappa=-5"]).scene)
    return Envelope("hello", header.SerializeToString(), sequence)


@pytest.mark.parametrize("seed", range(5))
class TestControllerBelievesNothing:
    """What reaches the controller alone; the plant hears of it and the run ends."""

    @pytest.mark.parametrize(
        ("sequence", "sentence"),
        [
            (None, "a message without a number came on stream 'hello', 1 was expected"),
            (0, "repeat on stream 'hello': sequence 0 came, 1 was expected"),
            (1, "a second message came on stream 'hello'"),
            (2, "gap on stream 'hello'"),
        ],
    )
    def test_a_second_set_up(self, seed: int, sequence: int | None, sentence: str) -> None:
        def forge(envelope: Envelope) -> list[Envelope]:
            if envelope.stream != "hello":
                return [envelope]
            return [envelope, hello_of_another_law(envelope, sequence)]

        refused(seed, "the controller ended the run", sentence, forge=forge)

    def test_a_forged_hello_instead(self, seed: int) -> None:
        """In its place and in good order: only what the controller says at its end shows it."""

        def forge(envelope: Envelope) -> list[Envelope]:
            return [hello_of_another_law(envelope, 0) if envelope.stream == "hello" else envelope]

        refused(seed, "'kappa = -5.0' where", "'kappa = 0.8'", forge=forge)

    def test_a_hello_without_a_number(self, seed: int) -> None:
        def forge(envelope: Envelope) -> list[Envelope]:
            return [replace(envelope, sequence=None)]

        with pytest.raises((StreamFault, PeerLost)):
            exchange(scene(), seed, forge=forge)

    @pytest.mark.parametrize(("field", "value"), [("steps", 2000), ("scene_toml", "[plate]")])
    def test_a_hello_that_contradicts_itself(self, seed: int, field: str, value: Any) -> None:
        def forge(envelope: Envelope) -> list[Envelope]:
            return [changed(envelope, **{field: value}) if envelope.stream == "hello" else envelope]

        refused(seed, "the controller ended the run: the plant announced", forge=forge)

    @pytest.mark.parametrize("value", [math.nan, math.inf])
    def test_samples_that_are_no_numbers(self, seed: int, value: float) -> None:
        refused(
            seed, "the controller ended the run: stream 'daq' sequence 0 holds value",
            forge=samples(lambda header, values: np.append(values[:-1], value)),
        )  # fmt: skip

    def test_codes_that_mean_no_numbers(self, seed: int) -> None:
        """A finite scale of finite codes, whose product is not."""

        def forge(envelope: Envelope) -> list[Envelope]:
            if envelope.stream != "daq":
                return [envelope]
            block = decoded(envelope)
            block.header.scale = 1e308
            codes = np.full(len(block.arrays["code"]), 1000)
            return [Envelope("daq", codec.encode(block.header, code=codes))]

        refused(
            seed,
            "'daq' sequence 0 holds a value that is not finite",
            name="converters",
            forge=forge,
        )

    def test_samples_beyond_the_end(self, seed: int) -> None:
        def more(header: Any, values: np.ndarray) -> np.ndarray:
            beyond = header.first_step + len(values) == scene().steps
            return np.append(values, 1.0) if beyond else values

        refused(seed, "the controller ended the run: stream 'daq'", "beyond the run's end",
                forge=samples(more))  # fmt: skip

    def test_samples_at_another_rate(self, seed: int) -> None:
        def forge(envelope: Envelope) -> list[Envelope]:
            return [changed(envelope, every_steps=2) if envelope.stream == "daq" else envelope]

        refused(seed, "has a sample every 2 steps, the scene every 1", forge=forge)

    def test_samples_before_the_hello(self, seed: int) -> None:
        def forge(envelope: Envelope) -> list[Envelope]:
            return [] if envelope.stream == "hello" else [envelope]

        with pytest.raises(PeerLost):  # it cannot speak for a run that it does not know
            exchange(scene(), seed, forge=forge)

    @pytest.mark.parametrize("stream", ["hello", "daq"])
    def test_it_reconciles_all_that_it_heard(self, seed: int, stream: str) -> None:
        def change(end: RunEnd) -> None:
            next(c for c in end.count if c.stream == stream).messages += 1

        links = exchange(scene(), seed, forge=at_the_end(change, "plant"))
        assert f"stream '{stream}' is incomplete" in links.fault

    def test_an_end_before_the_last_sample(self, seed: int) -> None:
        """Its counts are right, but the run was announced longer."""
        ended: list[bool] = []

        def forge(envelope: Envelope) -> list[Envelope]:
            if envelope.stream != "daq" or ended:
                return [envelope]
            ended.append(True)
            counts = [StreamCount(stream="hello", messages=1, samples=1),
                      StreamCount(stream="daq"), StreamCount(stream="scene")]  # fmt: skip
            end = RunEnd(run_id=run_of(envelope), role="plant", count=counts)
            return [Envelope("end/plant", end.SerializeToString(), 0), envelope]

        refused(seed, "the plant ended after 0 samples", forge=forge)


def samples(change: Callable[[Any, np.ndarray], np.ndarray]) -> Alter:
    """Changes the values of every block of samples."""

    def alter(envelope: Envelope) -> list[Envelope]:
        if envelope.stream != "daq":
            return [envelope]
        block = decoded(envelope)
        values = change(block.header, block.arrays["value"].copy())
        return [Envelope("daq", codec.encode(block.header, value=values))]

    return alter
