"""Latencies drawn from a log-normal distribution with autocorrelation."""

import math
from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from hertzloop.scene.latency_trace.trace_file import MOST_LATENCIES, TraceTable

_TRACE = 13  # random stream of these latencies
_Size = Annotated[float, Field(ge=0.0, le=1e6)]


class DrawnTrace(TraceTable):
    """A log-normal distribution of latencies, with an autocorrelation from one sample to the next.

    The logarithms form a first-order autoregressive process, and `least_us` is added.
    """

    median_us: _Size
    sigma: _Size
    autocorrelation: Annotated[float, Field(ge=0.0, le=1.0 - 1e-9)]
    least_us: _Size = 0.0
    seed: Annotated[int, Field(ge=0, le=1_000_000)] = 1
    samples: Annotated[int, Field(ge=1, le=MOST_LATENCIES)] = 4096


def draw_latencies(table: Mapping[str, Any]) -> list[float]:
    """Return the latencies of a table of a scene, us. Raises ValueError; see `DrawnTrace`."""
    drawn = DrawnTrace.checked(table)
    draws = np.random.Generator(np.random.Philox(key=[drawn.seed, _TRACE]))
    normal = draws.standard_normal(drawn.samples)
    keep, walk = drawn.autocorrelation, float(normal[0])
    found = [walk]
    for one in normal[1:]:
        walk = keep * walk + math.sqrt(1.0 - keep * keep) * float(one)
        found.append(walk)
    logs = drawn.sigma * np.array(found)
    return [round(float(x), 3) for x in drawn.least_us + drawn.median_us * np.exp(logs)]
