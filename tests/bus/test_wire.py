"""Blocks on the wire: the protobuf library and ours read each other, nothing else passes."""

import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.message import DecodeError, Message
from hypothesis import given, settings
from hypothesis import strategies as st

from hertzloop.bus import codec
from hertzloop.bus.messages_pb2 import (
    DaqBlock,
    EnergyBalance,
    ForceBlock,
    Hello,
    RunEnd,
    StreamCount,
    TruthBlock,
)
from hertzloop.bus.streams import STREAMS

VALUES = np.array([1.5, -0.0, np.nan, np.inf, 5e-324])

BLOCKS: dict[str, type[Message]] = {"daq": DaqBlock, "force": ForceBlock, "truth": TruthBlock}

_ANY_BITS = {  # all bit patterns of a double, NaNs with payload included
    "<f8": st.integers(0, 2**64 - 1).map(lambda i: np.array(i, "<u8").view("<f8")[()]),
    "<i4": st.integers(-(2**31), 2**31 - 1),
}


@st.composite
def contents(draw: st.DrawFn) -> tuple[Message, dict[str, np.ndarray]]:
    """A header and arrays of one length, some of them absent."""
    kind = draw(st.sampled_from(list(BLOCKS.values())))
    header: Any = kind(
        run_id=draw(st.integers(0, 2**64 - 1)),
        sequence=draw(st.one_of(st.just(0), st.integers(0, 2**40))),
        first_step=draw(st.one_of(st.just(0), st.integers(0, 2**40))),
        step_ns=draw(st.integers(0, 2**32 - 1)),
    )
    length = draw(st.integers(0, 20))
    arrays = {}
    for name, (_, dtype) in codec.array_fields(kind).items():
        if draw(st.booleans()):
            values = _ANY_BITS[dtype.str]
            arrays[name] = np.array(
                draw(st.lists(values, min_size=length, max_size=length)), dtype=dtype
            )
    return header, arrays


def by_the_library(header: Message, arrays: Mapping[str, np.ndarray]) -> bytes:
    """The same message, serialised by the protobuf library alone."""
    full = type(header)()
    full.CopyFrom(header)
    for name, values in arrays.items():
        getattr(full, name).extend(values.tolist())
    return full.SerializeToString()


def same_contents(message: Message, block: codec.DecodedBlock) -> bool:
    """Whether the library's reading of a block is ours, byte by byte."""
    rest = type(message)()
    rest.CopyFrom(message)
    for name, (_, dtype) in codec.array_fields(type(message)).items():
        if np.array(getattr(message, name), dtype).tobytes() != block.arrays[name].tobytes():
            return False
        rest.ClearField(name)
    return rest.SerializeToString() == block.header.SerializeToString()


@given(contents())
@settings(max_examples=200, deadline=None)
def test_ours_and_the_library_write_and_read_the_same(made):
    header, arrays = made
    ours, theirs = codec.encode(header, **arrays), by_the_library(header, arrays)
    message = type(header).FromString(ours)
    assert message.SerializeToString() == theirs
    assert same_contents(message, codec.decode(type(header), ours))
    assert same_contents(message, codec.decode(type(header), theirs))


@pytest.mark.parametrize("values", [VALUES[::-1], np.arange(6.0).reshape(2, 3).T[1], [1, 2]])
def test_any_array_layout_can_be_sent(values):
    block = codec.decode(ForceBlock, codec.encode(ForceBlock(), force_n=values))
    assert block.arrays["force_n"].tobytes() == np.array(values, float).tobytes()


@pytest.mark.parametrize("length", [0, 1, 15, 16, 2000, 3_000_000])
def test_lengths_around_those_of_the_length_prefix(length):
    payload = codec.encode(ForceBlock(sequence=1), force_n=np.arange(float(length)))
    block = codec.decode(ForceBlock, payload)
    assert np.array_equal(block.arrays["force_n"], np.arange(float(length)))


def tag(number: int, wire_type: int) -> bytes:
    """Tag of a field; numbers here need one or two bytes."""
    value = number << 3 | wire_type
    return bytes([value]) if value < 0x80 else bytes([value & 0x7F | 0x80, value >> 7])


def packed(number: int, *values: float) -> bytes:
    raw = struct.pack(f"<{len(values)}d", *values)
    return tag(number, 2) + bytes([len(raw)]) + raw


MALFORMED = {
    "a tag and no more": (ForceBlock, tag(2, 0)),
    "a length beyond the end": (ForceBlock, tag(16, 2) + b"\x10" + b"\0" * 15),
    "a length of 2^63": (ForceBlock, tag(16, 2) + b"\xff" * 8 + b"\x7f" + b"\0" * 16),
    "an array with half a value": (ForceBlock, tag(16, 2) + b"\x04" + b"\0" * 4),
    "a group": (ForceBlock, tag(3, 3) + tag(3, 4)),
    "field number 0": (ForceBlock, tag(0, 0) + b"\1"),
    "an array not packed": (ForceBlock, tag(16, 1) + b"\0" * 8),
    "an array in two parts": (ForceBlock, packed(16, 1.0) + packed(16, 2.0)),
    "codes and values of unequal number": (DaqBlock, packed(16, 1.0) + packed(17, 1.0)),
    "text that is no UTF-8": (Hello, tag(2, 2) + b"\2\xff\xfe"),
    "a field that no such message has": (ForceBlock, tag(9, 0) + b"\1"),
}


@pytest.mark.parametrize("name", MALFORMED)
def test_malformed_payload(name):
    kind, payload = MALFORMED[name]
    with pytest.raises(codec.MessageError, match=kind.DESCRIPTOR.name):
        codec.decode(kind, payload)


SAMPLES = {
    Hello: Hello(run_id=1, scene="a", scene_toml="b", steps=3, step_ns=4).SerializeToString(),
    DaqBlock: codec.encode(
        DaqBlock(run_id=1, sequence=2, first_step=3, step_ns=4, every_steps=1, scale=0.5),
        code=np.arange(3),
    ),
    ForceBlock: codec.encode(
        ForceBlock(run_id=1, sequence=2, first_step=3, step_ns=4, samples_seen=5), force_n=VALUES
    ),
    TruthBlock: codec.encode(
        TruthBlock(run_id=1, sequence=2, first_step=3, step_ns=4), xi_m=VALUES, xi_s_m=VALUES
    ),
    EnergyBalance: EnergyBalance(run_id=1, kinetic_j=0.5, newton_iterations=7).SerializeToString(),
    RunEnd: RunEnd(
        run_id=1, role="plant", count=[StreamCount(stream="daq", messages=1)]
    ).SerializeToString(),
}


@pytest.mark.parametrize("stream", STREAMS)
def test_no_field_of_any_stream_is_taken_for_another_kind(stream):
    """Also those that we never fill, as the line in a source that an event can have."""
    message = STREAMS[stream].message()
    some = {FieldDescriptor.TYPE_STRING: "a", FieldDescriptor.TYPE_BYTES: b"a"}
    for field in message.DESCRIPTOR.fields:
        if field.is_repeated:
            continue
        if field.type == FieldDescriptor.TYPE_MESSAGE:
            getattr(message, field.name).SetInParent()
        else:
            setattr(message, field.name, some.get(field.type, 1))
    assert message.ListFields()
    assert codec.decode(type(message), message.SerializeToString()).header == message


def check_against_the_library(kind: type[Message], payload: bytes) -> bool:
    """Decoding raises MessageError or agrees with the library; whether it decoded."""
    try:
        block = codec.decode(kind, payload)
    except codec.MessageError:
        return False
    try:
        message = kind.FromString(payload)
    except DecodeError:
        pytest.fail(f"the library does not take {payload.hex()}")
    assert same_contents(message, block), payload.hex()
    return True


@given(
    st.sampled_from(list(SAMPLES)),
    st.lists(st.tuples(st.integers(0, 200), st.integers(0, 255)), min_size=1, max_size=3),
    st.integers(0, 200),
    st.binary(max_size=4),
)
@settings(max_examples=400, deadline=None)
def test_damaged_bytes(kind, changes, at, inserted):
    """Some bytes of a good message changed, some inserted."""
    payload = bytearray(SAMPLES[kind])
    for place, value in changes:
        payload[place % len(payload)] = value
    payload[at % len(payload) : at % len(payload)] = inserted
    check_against_the_library(kind, bytes(payload))


def test_the_generated_module_is_up_to_date(tmp_path):
    """Compared as descriptors: the generated text depends on the compiler's version."""
    protoc = pytest.importorskip("grpc_tools.protoc")
    from google.protobuf.descriptor_pb2 import FileDescriptorProto, FileDescriptorSet

    from hertzloop.bus import messages_pb2

    root = Path(messages_pb2.__file__).parents[1]
    out = tmp_path / "messages.binpb"
    known = Path(protoc.__file__).parent / "_proto"  # google/protobuf/timestamp.proto
    words = ["protoc", f"-I{root}", f"-I{known}", f"--descriptor_set_out={out}"]
    words += ["bus/messages.proto"]
    assert protoc.main(words) == 0
    fresh = FileDescriptorSet.FromString(out.read_bytes()).file[0]
    present = FileDescriptorProto.FromString(messages_pb2.DESCRIPTOR.serialized_pb)
    for message in fresh.message_type:
        for field in message.field:
            field.ClearField("json_name")  # the compiler leaves it out of the module
    assert present == fresh
