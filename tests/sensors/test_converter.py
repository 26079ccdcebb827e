"""The converter alone: codes, steps and limits for every number of bits."""

import math
import struct

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from hertzloop.sensors import kernels as k
from hertzloop.sensors.acquisition import Sensor, SensorSpec, converter_codes, converter_step

bits = st.integers(1, 24)
# Ranges no narrower than 1e-3 of where they lie: else a step of 24 bits nears a rounding there.
ranges = st.tuples(st.floats(-1e3, 1e3), st.floats(1e-6, 1e3)).map(
    lambda r: (r[0], r[0] + max(r[1], 1e-3 * abs(r[0])))
)
places = st.floats(0.0, 1.0)
# Rounding of value - offset against a step of 24 bits: 1e3 * 2^-53 * 2^24.
ROUNDING = 1e-5


def read(n: int, full_scale: tuple[float, float], value: float) -> tuple[int, float, int]:
    """Code, value and saturation flag of one sample."""
    sensor = Sensor(SensorSpec(bits=n, full_scale=full_scale), 1e-6, 1, 1)
    k.follow(sensor.model, sensor.state, value)
    return k.sample(sensor.model, sensor.state, 0)


def inside(full_scale: tuple[float, float], place: float) -> float:
    low, high = full_scale
    return min(max(low + place * (high - low), low), high)


def ends(n: int, full_scale: tuple[float, float]) -> tuple[float, float]:
    """Lowest and highest level."""
    scale, offset, first, last = converter_codes(n, full_scale)
    return offset + scale * first, offset + scale * last


@given(bits, ranges, places)
def test_error_is_at_most_half_a_step_and_nothing_is_flagged(n, full_scale, place):
    value = inside(full_scale, place)
    _, got, clipped = read(n, full_scale, value)
    step = converter_step(n, full_scale)
    lowest, highest = ends(n, full_scale)
    if lowest <= value <= highest:
        assert abs(got - value) <= (0.5 + ROUNDING) * step
    else:  # the range is up to a step wider than the levels
        assert abs(got - value) <= (1.0 + ROUNDING) * step
        assert got in (lowest, highest)
    assert clipped == 0


@given(bits, ranges)
def test_zero_is_a_level_where_the_range_has_it(n, full_scale):
    low, high = full_scale
    scale, (lowest, _) = converter_step(n, full_scale), ends(n, full_scale)
    if low <= 0.0 <= high:
        for value in (0.0, 0.49 * min(high, scale), 0.49 * max(low, -scale)):
            assert read(n, full_scale, value)[1] == 0.0
    else:
        assert lowest == pytest.approx(low, abs=ROUNDING * scale)


@given(bits, ranges)
def test_the_ends_give_the_outermost_codes_which_fit(n, full_scale):
    low, high = full_scale
    _, _, first, last = converter_codes(n, full_scale)
    assert (first, last) == (-(2 ** (n - 1)), 2 ** (n - 1) - 1)  # two's complement of n bits
    assert -(2**31) <= first <= last < 2**31  # fits the message's 32 bits
    for value, code in ((low, first), (high, last)):
        found, got, clipped = read(n, full_scale, value)
        assert found == code
        assert clipped == 0
        assert abs(got - value) <= (1.0 + ROUNDING) * converter_step(n, full_scale)


@given(bits, ranges, st.floats(1e-9, 1e6))
def test_values_out_of_range_are_limited_and_flagged(n, full_scale, beyond):
    low, high = full_scale
    _, _, first, last = converter_codes(n, full_scale)
    below, above = low - beyond * (high - low), high + beyond * (high - low)
    assume(below < low and above > high)
    for value, code in ((below, first), (above, last), (-math.inf, first), (math.inf, last)):
        found, _, clipped = read(n, full_scale, value)
        assert (found, clipped) == (code, 1)


@given(st.lists(st.floats(allow_nan=False), min_size=1))
def test_an_ideal_channel_passes_the_bits(values):
    # Whatever came before: the filter that is not there must not remember it.
    sensor = Sensor(SensorSpec(), 1e-6, 1, 1)
    for value in values:
        k.follow(sensor.model, sensor.state, value)
        code, got, clipped = k.sample(sensor.model, sensor.state, 0)
        assert (code, clipped) == (0, 0)
        assert struct.pack("d", got) == struct.pack("d", value)


def test_an_ideal_converter_with_a_range_limits():
    sensor = Sensor(SensorSpec(full_scale=(-1.0, 2.0)), 1e-6, 1, 1)
    expected = {-1.5: (-1.0, 1), -1.0: (-1.0, 0), 0.1: (0.1, 0), 2.0: (2.0, 0), 2.1: (2.0, 1)}
    for value, wanted in expected.items():
        k.follow(sensor.model, sensor.state, value)
        assert k.sample(sensor.model, sensor.state, 0)[1:] == wanted


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"bits": 25, "full_scale": (0.0, 1.0)}, "bits is 25; must be 1 to 24"),
        ({"bits": 12}, "needs a full_scale range"),
        ({"full_scale": (1.0, -1.0)}, r"full_scale is \(1.0, -1.0\)"),
        ({"every_steps": 0}, "every_steps is 0"),
        ({"low_pass_hz": 1e4, "low_pass": "sigma-delta"}, "one of butterworth, bessel"),
        ({"low_pass_hz": 1e4, "low_pass_order": 9}, "low_pass_order is 9"),
        ({"noise_rms": -1e-9}, "noise_rms is -1e-09"),
        ({"full_scale": (0.0, float("inf"))}, "full_scale is"),
    ],
)
def test_channels_that_cannot_be_are_refused(values, sentence):
    with pytest.raises(ValueError, match=sentence):
        SensorSpec(**values)
