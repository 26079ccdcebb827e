"""The impact speed of each hit, a free key of its own."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hertzloop.fitting.fit.keys.free_key_option import parse_free_key
from hertzloop.fitting.fit.keys.free_keys import FreeKey
from hertzloop.fitting.fit.keys.key_scope import values_for_record
from hertzloop.fitting.fit.problem.problem import FitProblem
from hertzloop.fitting.records.record import Record
from hertzloop.scene.setup import Setup

_SPEEDS = (0.001, 45.0)  # of a hammer, m/s


def add_hit_speeds(
    setup: Setup, records: Sequence[Record], free: Sequence[FreeKey]
) -> list[FreeKey]:
    """Return the free keys, with one speed of the striker for each of several hits."""
    key, _ = _speed_key(setup)
    own = hit_speed_keys(setup, records, free, 2)
    return [*(f for f in free if not own or f.key != key), *own]


def hit_speed_keys(
    setup: Setup, records: Sequence[Record], free: Sequence[FreeKey], fewest: int
) -> list[FreeKey]:
    """Return a free key for the speed of every hit; of a sphere, only if its speed is.

    Args:
        setup: the scene.
        records: with the numbers of their hits.
        free: the free keys.
        fewest: number of hits below which there is no such key.
    """
    key, hammer = _speed_key(setup)
    named = next((f for f in free if f.key.partition("[")[0] == key), None)
    hits = {one.hit: one for one in records if one.hit}
    if len(hits) < fewest or not (named or hammer):
        return []
    own = named or parse_free_key(setup, f"{key}={_SPEEDS[0]:g}:{_SPEEDS[1]:g}")
    return [
        replace(own, key=f"{key}[{hit}]")
        for hit, one in hits.items()
        if key not in one.measurement.set
    ]


def set_start_speeds(problem: FitProblem, start: dict[str, float]) -> None:
    """Start with the speed of a hammer that gives the peak of its first record, as nobody measures
    it. Both `problem.free` and `start` change."""
    done: set[str] = set()
    for index, (c, simulator) in enumerate(zip(problem.channels, problem.simulators, strict=True)):
        for place, f in enumerate(problem.free):
            mine = values_for_record({f.key: f.start}, c.record)
            if f.key in done or f.prior or "hammer.speed_m_s" not in mine or c.is_gap:
                continue
            done.add(f.key)
            seen = problem.simulate_channel(index, start, 3.0 * simulator.contact_s)
            largest = float(np.max(np.abs(seen.value(seen.simulated.time_s))))
            n = simulator.spec.contact.exponent
            speed = f.start * (c.peak / largest) ** (0.5 * (n + 1.0) / n)
            begun = replace(f, start=min(max(speed, 1.01 * f.low), 0.99 * f.high))
            problem.free = [*problem.free[:place], begun, *problem.free[place + 1 :]]
            start[f.key] = begun.start


def _speed_key(setup: Setup) -> tuple[str, bool]:
    """Return the scene's key for the speed of the striker, and whether this is a hammer."""
    if setup.scene.hammer is not None:
        return "hammer.speed_m_s", True
    sphere = setup.scene.sphere
    by_speed = sphere is not None and sphere.speed_m_s is not None
    return "sphere.speed_m_s" if by_speed else "sphere.drop_height_m", False
