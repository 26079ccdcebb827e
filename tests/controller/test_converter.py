"""The force converter: nearest level, clipped, and no force stays no force."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hertzloop.controller import kernels as k
from hertzloop.controller.controller import SignalPath
from tests.controller.drive import make
from tests.controller.specs import LawSpec

OFF = LawSpec("off", 1.0)


def line_of(bits: int | None, full_scale: float | None) -> k.SignalPathModel:
    return make(OFF, SignalPath(bits=bits, full_scale_n=full_scale), 1).path


BITS = st.integers(2, 24)
FULL_SCALES = st.sampled_from([1.0, 3.0, 100.0, 0.7, 12345.6])
PARTS = st.floats(-1.5, 1.5)  # of the full scale


@given(BITS, FULL_SCALES, PARTS)
@settings(max_examples=300, deadline=None)
def test_one_force(bits, full_scale, part):
    line, force = line_of(bits, full_scale), part * full_scale
    out = k.convert_force(line, force)
    step = full_scale / (2 ** (bits - 1) - 1)
    code = round(out / step)
    assert out == code * step  # a level, exactly
    assert abs(code) <= 2 ** (bits - 1) - 1
    assert k.convert_force(line, out) == out  # idempotent
    if abs(force) <= full_scale:
        # Half a step, and the rounding of two numbers of up to 2^23 steps: 2^-29 of a step.
        assert abs(out - force) <= step * (0.5 + 2.0**-28)
    else:
        assert code == math.copysign(2 ** (bits - 1) - 1, force)


def test_zero_stays_zero():
    for bits in range(2, 25):
        line = line_of(bits, 0.7)
        for steps in (0.0, -0.0, 0.49, -0.49):
            assert k.convert_force(line, steps * line.lsb_n) == 0.0, bits


def test_bits_without_a_range_are_refused():
    with pytest.raises(ValueError, match="full-scale"):
        line_of(8, None)
