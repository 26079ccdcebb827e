"""Comparison of recordings: the same bytes or the first difference, in one sentence."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from hertzloop.recordings.compare import first_difference
from hertzloop.recordings.reader import read
from tests.recordings.rewriting import Sent, messages, record, rewrite, write


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    """Samples every second step through a converter, some out of its range."""
    path = tmp_path_factory.mktemp("compare") / "original.mcap"
    settings = ("sensors.every_steps=2", "sensors.bits=12", "sensors.full_scale=[-2e-5, 1e-5]")
    return record(path, *settings)


def difference(a: Path, b: Path) -> str | None:
    found = first_difference(read(a), read(b))
    assert (found is None) == (first_difference(read(b), read(a)) is None)
    return found


def flip(stream: str, number: int, name: str, at: int) -> Callable[[Sent], None]:
    """Flip the lowest bit of one value."""

    def change(message: Sent) -> None:
        if (message.stream, message.number) == (stream, number):
            message.arrays[name].view(np.uint8)[at * message.arrays[name].itemsize] ^= 1

    return change


@pytest.mark.parametrize(
    ("stream", "name"), [("daq", "code"), ("force", "force_n"), ("truth", "f_a_n")]
)
def test_one_bit(original, tmp_path, stream, name):
    message = [m for m in messages(original) if m.stream == stream][1]
    at = len(message.arrays[name]) - 1
    changed = rewrite(original, tmp_path / "b.mcap", flip(stream, message.number, name, at))
    step = message.header.first_step + at * getattr(message.header, "every_steps", 1)
    found = difference(original, changed)
    assert found.startswith(f"{stream}.{name} differs first at step {step}: "), found


def test_the_earliest_of_several_differences_is_named(original, tmp_path):
    def change(message: Sent) -> None:
        flip("truth", 1, "xi_m", 9)(message)
        flip("truth", 1, "f_a_n", 5)(message)
        flip("truth", 2, "xi_s_m", 0)(message)

    found = difference(original, rewrite(original, tmp_path / "b.mcap", change))
    assert found.startswith("truth.f_a_n differs first at step 1005")


def test_a_flag_of_the_converter(original, tmp_path):
    def change(message: Sent) -> None:
        if message.stream == "daq" and message.number == 1:
            first, *others = message.header.saturated
            message.header.saturated = bytes([first ^ 1, *others])

    second = [m for m in messages(original) if m.stream == "daq"][1].header
    found = difference(original, rewrite(original, tmp_path / "b.mcap", change))
    assert found.startswith(f"daq.saturated differs first at step {second.first_step}:")


@pytest.mark.parametrize("label", ["scale", "offset", "every_steps"])
def test_the_description_of_a_channel(original, tmp_path, label):
    def change(message: Sent) -> None:
        if message.stream == "daq":
            setattr(message.header, label, getattr(message.header, label) * 2)

    found = difference(original, rewrite(original, tmp_path / "b.mcap", change))
    assert found.startswith(f"daq.{label} differs")


@pytest.mark.parametrize(
    ("left", "right", "same"),
    [
        ("0000000000000000", "0000000000000080", False),  # 0.0, -0.0
        ("010000000000f87f", "010000000000f87f", True),  # the same NaN
        ("010000000000f87f", "020000000000f87f", False),  # NaNs with other payloads
        ("000000000000f07f", "000000000000f0ff", False),  # infinities
    ],
)
def test_bytes_are_compared_not_values(original, left, right, same):
    one, other = read(original), read(original)
    for recording, value in ((one, left), (other, right)):
        recording.truth.arrays["f_a_n"][1007:1008] = np.frombuffer(bytes.fromhex(value), "<f8")
    found = first_difference(one, other)
    assert (found is None) == same
    assert same or str(found).startswith("truth.f_a_n differs first at step 1007")


@pytest.mark.parametrize(("field", "value"), [("message", "something else"), ("mode", 7)])
def test_another_event(original, tmp_path, field, value):
    """The sentence counts, and so do the data for programs behind the same sentence."""

    def change(message: Sent) -> None:
        if message.stream == "events/controller" and message.number == 1:
            setattr(message.header, field, value)

    found = difference(original, rewrite(original, tmp_path / "b.mcap", change))
    assert found.startswith("events of the controller differ first")
    assert str(value) in found


def test_events_of_two_publishers_may_interleave_in_any_way(original, tmp_path):
    """Which of two processes the recorder hears first is no property of the run."""
    order = sorted(messages(original), key=lambda m: m.stream != "events/plant")
    assert difference(original, write(tmp_path / "b.mcap", original, order)) is None
