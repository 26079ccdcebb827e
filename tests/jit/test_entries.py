"""Entries for Python: kernels get one when Python calls them, and not before."""

import re
from typing import Any, NamedTuple

import numpy as np
import pytest
from numba.core.errors import TypingError

from hertzloop.common.jit import kernel
from hertzloop.common.jit.by_type import by_type
from hertzloop.common.jit.progress import report_compiling


def third(x):
    return x / 3.0


def of_third(inner: Any) -> Any:
    @kernel
    def outer(x):
        return inner(x) + 1.0

    return outer


def compiled_for(call: Any) -> int:
    """How many compilations a call causes."""
    seen: list[bool] = []
    with report_compiling(seen.append):
        call()
    return seen.count(True)


def test_a_kernel_that_kernels_called_first_answers_python_too():
    inner = kernel(third)
    outer = of_third(inner)
    assert outer(0.7) == third(0.7) + 1.0
    assert "cpython" not in "".join(inner.inspect_llvm().values())
    assert compiled_for(lambda: inner(0.7)) == 1
    assert inner(0.7) == third(0.7)
    assert "cpython" in "".join(inner.inspect_llvm().values())
    assert compiled_for(lambda: (inner(0.1), outer(0.1), of_third(inner)(0.1))) == 1  # the new one


class Half(NamedTuple):
    of: float


class Double(NamedTuple):
    of: float


half = kernel(lambda part, x: part.of * x / 2.0)
double = kernel(lambda part, x: part.of * x * 2.0)
chosen = by_type({Half: half, Double: double, type(None): kernel(lambda part, x: x)})


@kernel
def choose(part, x):
    return chosen(part, x)


def test_the_type_chooses_with_no_function_between():
    assert (choose(Half(3.0), 5.0), choose(Double(3.0), 5.0), choose(None, 5.0)) == (7.5, 30.0, 5.0)
    assert len(half.parts) == len(double.parts) == 1
    with pytest.raises(TypingError):
        choose(1.5, 5.0)


def weighted(x: np.ndarray, y: np.ndarray, z: float) -> float:
    total = 0.0
    for i in range(x.size):
        total += x[i] * y[i] + z * x[i] * y[i]
        if total > 1e3:
            total = total * y[i] - z * x[i]
    return total


def code_of_caller(inner_first: bool) -> str:
    """Machine code of a caller without the names in it."""
    inner = kernel(weighted, fastmath={"contract"})

    @kernel
    def outer(x, y):
        return inner(x, y, 0.3) * inner(y, x, 0.7)

    x, y = np.linspace(0.0, 1.0, 50), np.linspace(1.0, 3.0, 50)
    if inner_first:
        inner(x, y, 0.3)
    outer(x, y)
    (assembly,) = outer.inspect_asm().values()
    return re.sub(r"\S*(weighted|outer)\S*|\d{6,}", "name", assembly)


def test_code_does_not_depend_on_what_was_compiled_before():
    """Otherwise the transports would round in other places, as they compile in another order."""
    assert code_of_caller(inner_first=True) == code_of_caller(inner_first=False)
