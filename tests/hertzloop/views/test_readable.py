"""Numbers as people write them."""

import pytest

from hertzloop.common.readable import number, quantity
from tests.commands import refused


@pytest.mark.parametrize(
    ("value", "unit", "expected"),
    [
        (0.139, "J", "139 mJ"),
        (1e-5, "m rms", "10 um rms"),
        (0.9999996, "J", "1 J"),
        (123456.0, "Hz", "123 kHz"),
        (-2e9, "Pa", "-2 GPa"),
        (3e-12, "J", "0.003 nJ"),
        (0.0, "m", "0 m"),
        (12.0, "bits", "12 bits"),
        (5e9, "us", "5e9 us"),
    ],
)
def test_a_quantity_has_the_unit_that_people_would_choose(value, unit, expected):
    assert quantity(value, unit) == expected


def test_a_number_has_a_short_exponent():
    assert [number(x) for x in (-1e9, 1e-7, 20, 0.125)] == ["-1e9", "1e-7", "20", "0.125"]


def test_bounds_of_a_key_are_readable():
    refused("-1e9 to 1e9", "scene", "check", "--set", "sensors.full_scale=[0, 2e9]")
