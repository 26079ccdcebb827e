"""Messages in protobuf wire format, with numpy arrays as packed fields.

A protobuf message may be written as the concatenation of its parts, so the scalar fields go through
the protobuf library and every array is appended as one packed field: tag, length, raw little-endian
values. Any protobuf reader decodes the result; reading a block of 1000 samples costs microseconds.
"""

from functools import cache
from typing import Any, NamedTuple, TypeVar

import numpy as np
from google.protobuf.descriptor import Descriptor, FieldDescriptor
from google.protobuf.message import DecodeError, Message

from hertzloop.bus.streams import STREAMS, Envelope

_DTYPES: dict[int, np.dtype[Any]] = {
    FieldDescriptor.TYPE_DOUBLE: np.dtype("<f8"),
    FieldDescriptor.TYPE_FLOAT: np.dtype("<f4"),
    FieldDescriptor.TYPE_SFIXED32: np.dtype("<i4"),
}
_LENGTH_DELIMITED = 2
_FIXED_WIDTHS = {1: 8, 5: 4}  # wire type -> bytes
_WIRE_TYPES = {  # of a scalar field; all others are varints, wire type 0
    FieldDescriptor.TYPE_DOUBLE: 1,
    FieldDescriptor.TYPE_FIXED64: 1,
    FieldDescriptor.TYPE_SFIXED64: 1,
    FieldDescriptor.TYPE_FLOAT: 5,
    FieldDescriptor.TYPE_FIXED32: 5,
    FieldDescriptor.TYPE_SFIXED32: 5,
    FieldDescriptor.TYPE_STRING: _LENGTH_DELIMITED,
    FieldDescriptor.TYPE_BYTES: _LENGTH_DELIMITED,
    FieldDescriptor.TYPE_MESSAGE: _LENGTH_DELIMITED,
}

M = TypeVar("M", bound=Message)


class MessageError(ValueError):
    """A payload is not the message it should be."""


class DecodedBlock(NamedTuple):
    """A decoded block: scalar fields in `header`, arrays by field name."""

    header: Any
    arrays: dict[str, np.ndarray]


class _Layout(NamedTuple):
    """Fields of a message type: arrays as in `array_fields`, and the wire type of every
    number; repeated fields are packed."""

    arrays: dict[str, tuple[int, np.dtype]]
    wire_types: dict[int, int]


@cache
def _layout(descriptor: Descriptor) -> _Layout:
    return _Layout(
        arrays={
            field.name: (field.number, _DTYPES[field.type])
            for field in descriptor.fields
            if field.is_repeated and field.type in _DTYPES
        },
        wire_types={
            field.number: _LENGTH_DELIMITED if field.is_repeated else _WIRE_TYPES.get(field.type, 0)
            for field in descriptor.fields
        },
    )


def array_fields(message_class: type[Message]) -> dict[str, tuple[int, np.dtype]]:
    """Field name -> (field number, dtype) of the packed arrays of a message type."""
    return _layout(message_class.DESCRIPTOR).arrays


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def encode(header: Message, **arrays: np.ndarray) -> bytes:
    """Serialise `header` with `arrays` (1-D, by field name); empty arrays are left out.

    Raises KeyError for a name that is not an array field of the message.
    """
    fields = array_fields(type(header))
    parts = [header.SerializeToString()]
    for name, values in arrays.items():
        number, dtype = fields[name]
        raw = np.ascontiguousarray(values, dtype=dtype).tobytes()
        if raw:
            parts += [_varint(number << 3 | _LENGTH_DELIMITED), _varint(len(raw)), raw]
    return b"".join(parts)


def _read_varint(payload: memoryview, at: int) -> tuple[int, int]:
    value = shift = 0
    while shift < 64:
        byte = payload[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, at
        shift += 7
    raise MessageError("a number in it is longer than 64 bits")


def _split(
    payload: memoryview, wire_types: dict[int, int], wanted: set[int]
) -> tuple[bytes, dict[int, memoryview]]:
    """Separate the fields in `wanted`, each at most once, from the rest of a payload.

    The protobuf library passes over a field that the message type does not have; here it
    means that the payload is something else.
    """
    rest: list[memoryview] = []
    found: dict[int, memoryview] = {}
    at, end = 0, len(payload)
    while at < end:
        start = at
        tag, at = _read_varint(payload, at)
        number, wire_type = tag >> 3, tag & 7
        if wire_types.get(number) != wire_type:
            raise MessageError(f"it has no field {number} of wire type {wire_type}")
        body = at
        if wire_type == 0:
            _, at = _read_varint(payload, at)
        elif wire_type in _FIXED_WIDTHS:
            at += _FIXED_WIDTHS[wire_type]
        else:
            length, body = _read_varint(payload, at)
            at = body + length
        if at > end:
            raise MessageError(f"field {number} runs {at - end} bytes past the end")
        if number in found:
            raise MessageError(f"field {number} comes twice")
        if number in wanted:
            found[number] = payload[body:at]
        else:
            rest.append(payload[start:at])
    return b"".join(rest), found


def decode(message_class: type[M], payload: bytes) -> DecodedBlock:
    """Read a block message; arrays are views of the payload, absent ones are empty.

    Raises MessageError when the payload is not a whole message of this type or
    when its arrays differ in length.
    """
    fields, wire_types = _layout(message_class.DESCRIPTOR)
    arrays = {name: np.empty(0, dtype) for name, (_, dtype) in fields.items()}
    names = {number: name for name, (number, _) in fields.items()}
    try:
        rest, found = _split(memoryview(payload), wire_types, set(names))
        for number, raw in found.items():
            arrays[names[number]] = np.frombuffer(raw, fields[names[number]][1])
        header = message_class()
        header.ParseFromString(rest)
    except (DecodeError, IndexError, ValueError) as error:
        raise MessageError(
            f"{len(payload)} bytes are not a {message_class.DESCRIPTOR.name}: {error}"
        ) from error
    lengths = {name: len(a) for name, a in arrays.items() if len(a)}
    if len(set(lengths.values())) > 1:
        raise MessageError(f"{message_class.DESCRIPTOR.name} has arrays of lengths {lengths}")
    return DecodedBlock(header, arrays)


def decoded(envelope: Envelope) -> DecodedBlock:
    """Decode any stream's message. Raises MessageError if it is malformed."""
    return decode(STREAMS[envelope.stream].message, envelope.payload)


def sample_count(block: DecodedBlock) -> int:
    """Number of samples in a decoded block; a message without arrays counts as one."""
    return max((len(a) for a in block.arrays.values()), default=1)
