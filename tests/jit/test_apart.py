"""Kernels that stay functions of their own."""

import numpy as np
import pytest

from hertzloop.common.jit import kernel
from hertzloop.common.jit.by_type import apart


@kernel
def summed(values, factor):
    total = 0.0
    for value in values:
        total += factor * value
    return total, values.size


@kernel
def together(values):
    return summed(values, 3)[0] + 1.0


summed_apart = apart(summed)


@kernel
def apart_from(values):
    return summed_apart(values, 3)[0] + 1.0


def test_it_gives_the_same_bits_from_python_and_from_kernels():
    values = np.linspace(0.1, 0.7, 11)
    assert apart_from(values) == together(values)
    assert summed_apart(values, 3.0) == summed(values, 3.0)
    assert summed_apart.__doc__ == summed.__doc__


def test_a_kernel_that_raises_does_so_through_it():
    @kernel
    def refuse(x):
        if x > 1.0:
            raise ValueError("too much")
        return x

    refuse_apart = apart(refuse)

    @kernel
    def caller(x):
        return refuse_apart(x)

    with pytest.raises(ValueError, match="too much"):
        caller(2.5)
    assert caller(0.5) == 0.5
