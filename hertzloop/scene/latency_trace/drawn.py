"""Latencies drawn from a log-normal distribution with autocorrelation."""

import math
from typing import Any, cast

import numpy as np

from hertzloop.scene.errors import shown
from hertzloop.scene.latency_trace.trace_file import MOST_LATENCIES

# Numbers that a distribution of latencies must have, with their least value.
_DRAWN = {"median_us": 0.0, "sigma": 0.0, "autocorrelation": 0.0}
_SAMPLES = 4096
_TRACE = 13  # random stream of these latencies


def draw_latencies(table: dict[str, Any]) -> list[float]:
    """Latencies that are log-normal, with an autocorrelation from one sample to the next.

    The logarithms form a first-order autoregressive process. `least_us` is added, `seed` and
    `samples` are 1 and 4096 if left out.
    """
    where = "controller.latency_trace"
    known = {*_DRAWN, "least_us", "seed", "samples"}
    if unknown := sorted(set(table) - known):
        raise ValueError(f"{where}.{unknown[0]}: unknown key. Use {', '.join(sorted(known))}")
    numbers: dict[str, Any] = {"least_us": 0.0, "seed": 1, "samples": _SAMPLES} | table
    for name, least in {**_DRAWN, "least_us": 0.0, "seed": 0, "samples": 1}.items():
        value = numbers.get(name)
        whole = name in ("seed", "samples")
        good = isinstance(value, int if whole else int | float) and not isinstance(value, bool)
        most = {"autocorrelation": 1.0 - 1e-9, "samples": MOST_LATENCIES}.get(name, 1e6)
        if not good or not least <= cast(float, value) <= most:
            raise ValueError(
                f"{where}.{name} = {shown(value)}: must be a {'whole ' if whole else ''}number "
                f"from {least:g} to {most:g}"
            )
    normal = np.random.Generator(np.random.Philox(key=[numbers["seed"], _TRACE])).standard_normal(
        numbers["samples"]
    )
    keep, walk = numbers["autocorrelation"], float(normal[0])
    found = [walk]
    for one in normal[1:]:
        walk = keep * walk + math.sqrt(1.0 - keep * keep) * float(one)
        found.append(walk)
    logs = numbers["sigma"] * np.array(found)
    return [round(float(x), 3) for x in numbers["least_us"] + numbers["median_us"] * np.exp(logs)]
