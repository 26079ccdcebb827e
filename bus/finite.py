"""No number on the bus is infinite or none: the first one of a message that is."""

import math
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
from google.protobuf.descriptor import Descriptor, FieldDescriptor

# A promise that no sample can break has no level; a plate without modes has no estimate.
_ALLOWED = {"promise_level": -math.inf, "expected_error": math.inf}


@cache
def _doubles(descriptor: Descriptor) -> tuple[str, ...]:
    """Scalar fields of a message type that could hold such a number."""
    return tuple(
        field.name
        for field in descriptor.fields
        if field.type == FieldDescriptor.TYPE_DOUBLE and not field.is_repeated
    )


def not_finite(header: Any, arrays: Mapping[str, np.ndarray]) -> str:
    """Name, value and step of the first number that is not finite; "" if all are."""
    for name in _doubles(header.DESCRIPTOR):
        value = getattr(header, name)
        if not math.isfinite(value) and value != _ALLOWED.get(name):
            return f"{name} = {value:g}"
    for name, values in arrays.items():
        finite = np.isfinite(values)
        if not finite.all():
            i = int(np.argmin(finite))
            step = header.first_step + i * getattr(header, "every_steps", 1)
            return f"{name} = {values[i]:g} at step {step}"
    return ""
