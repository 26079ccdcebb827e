"""exp, log, sine and cosine: against the C library's, and compiled as in Python."""

import math

import numpy as np
import pytest

from hertzloop.common import elementary_kernels as el
from hertzloop.common.uncompiled import plain

RNG = np.random.default_rng(5)
ULP = 2.3e-16


def test_exp_and_log():
    for x in (*RNG.uniform(-700, 700, 200), *RNG.uniform(-1, 1, 200), 0.0, -745.0):
        assert el.exp(x) == pytest.approx(math.exp(x), rel=2 * ULP, abs=5e-324)
        assert el.expm1(x) == pytest.approx(math.expm1(x), rel=2 * ULP)
        y = 2.0 ** (x / 2.0)
        assert el.log(y) == pytest.approx(math.log(y), rel=2 * ULP)
        assert el.exp(x) == plain(el.exp)(x)
        assert el.log(y) == plain(el.log)(y)


def test_exp_at_its_ends():
    found = [el.exp(x) for x in (800.0, -800.0, math.inf, -math.inf)]
    assert found == [math.inf, 0.0, math.inf, 0.0]
    assert math.isnan(el.exp(math.nan))


def test_sine_and_cosine():
    for x in (*RNG.uniform(-1e6, 1e6, 200), *RNG.uniform(-4, 4, 200), 0.0):
        found = el.sine_and_cosine(x)
        assert found == pytest.approx((math.sin(x), math.cos(x)), abs=2e-16)
        assert found == plain(el.sine_and_cosine)(x)
        of_pi = el.sine_and_cosine_of_pi(x)
        turn = math.pi * math.remainder(x, 2.0)
        assert of_pi == pytest.approx((math.sin(turn), math.cos(turn)), abs=5e-16)
        assert of_pi == plain(el.sine_and_cosine_of_pi)(x)


def test_multiples_of_a_right_angle_are_exact():
    found = [el.sine_and_cosine_of_pi(0.5 * n) for n in (0, 1, 2, 3, 2001)]
    assert found == [(0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0), (1.0, 0.0)]
