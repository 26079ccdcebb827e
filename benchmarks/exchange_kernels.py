"""Both ends of an exchange in the fast lane, with nothing but the exchange."""

from hertzloop.bus import lane_kernels
from hertzloop.common.jit import kernel


@kernel
def ask(lane, first, count):
    """One sample out, one force back, `count` times; the first sample that was not answered in
    time."""
    for i in range(first, first + count):
        lane_kernels.put_sample(lane, i, 1.0)
        if not lane_kernels.wait_for_answer(lane):
            return i
        lane_kernels.receive_force(lane)
    return first + count


@kernel
def echo(lane, first, count):
    """The other end: samples answered until the first one that does not come in time."""
    for i in range(first, first + count):
        if not lane_kernels.wait_for_sample(lane, i):
            return i
        if not lane_kernels.wait_for_room(lane):
            return i
        lane_kernels.put_answer(lane, i + 1, lane_kernels.sample_value(lane, i), 0.0)
    return first + count
