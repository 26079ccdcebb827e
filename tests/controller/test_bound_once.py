"""A law is bound once for constants that are the same to the bit, and anew for all others."""

from typing import Any, NamedTuple

import numpy as np
import pytest

from hertzloop.controller.loading.registry import find


class Constants(NamedTuple):
    """As a law's own."""

    gain: Any = 0.5
    weights: Any = np.array([1.0, -1.0])


class Turned(NamedTuple):
    """The same two, the other way round."""

    weights: Any = 0.5
    gain: Any = 2.0


LAW = find("off")


def test_equal_constants_are_bound_once() -> None:
    first = LAW.bound_to(Constants())
    assert LAW.bound_to(Constants(weights=np.array([1.0, -1.0]))) is first
    assert LAW.bound_to(Constants(), ahead=False) is not first


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (Constants(0.0), Constants(-0.0)),
        (Constants(1.0), Constants(1)),
        (Constants(0.1), Constants(0.1 + 2**-56)),
        (Constants(weights=np.zeros(2)), Constants(weights=-np.zeros(2))),
        (Constants(weights=np.ones((3, 2))), Constants(weights=np.ones((2, 3)))),
        (Constants(0.5, 2.0), Turned(0.5, 2.0)),
    ],
)
def test_what_differs_in_anything_is_another(one: Any, other: Any) -> None:
    assert LAW.bound_to(one) is not LAW.bound_to(other)
