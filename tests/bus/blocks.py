"""Block messages with made-up contents, for tests of the wire and of the streams."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from google.protobuf.message import Message
from hypothesis import strategies as st

from hertzloop.bus import codec
from hertzloop.bus.messages_pb2 import DaqBlock, ForceBlock, TruthBlock

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
    if isinstance(header, DaqBlock):
        header.saturated = draw(st.binary(max_size=3))
        header.scale = draw(st.floats())
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
