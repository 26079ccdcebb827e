"""The wall clock of a run at a pace: the plant takes every step when it is due.

The force of step k acts if it has arrived when the step is taken; otherwise the newest force that
has arrived acts. See docs/how-to/paced.md.
"""

import math
import time
from collections.abc import Callable

import numpy as np

from hertzloop.bus.messages_pb2 import Pacing
from hertzloop.bus.shared_memory import sleep_precisely
from hertzloop.closed_loop import clock as clocks
from hertzloop.closed_loop.clock import new_clock
from hertzloop.closed_loop.exchange import (
    ANSWERED,
    CLOCK,
    FORCES_END,
    SAMPLES_END,
    Exchange,
    Unsent,
)
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup

_MOST_WAITING = 1 << 22  # samples that are not answered
REST_S = 50e-6


def check_pace(setup: Setup, pace: float, timeout_s: float) -> None:
    """Raise SceneError for a pace (simulated over wall time) at which processes that wait
    `timeout_s` for a message would take each other for dead."""
    sample_s, most_s = setup.run.step_s * setup.sensor.every_steps, timeout_s / 4
    if not sample_s <= most_s * pace:  # nor at a pace of nan
        every_s = sample_s / pace if pace > 0.0 else math.inf
        raise SceneError(
            f"a pace of {pace:g} brings a sample every {every_s:.3g} s, but the processes wait "
            f"{timeout_s:g} s for each other: use a pace of {sample_s / most_s:.2g} or more, or a "
            "longer --timeout"
        )


class Paced:
    """When the steps of a run are due, and how the forces came.

    Attributes:
        clock: The same for the compiled loop.
    """

    def __init__(self, setup: Setup, pace: float, timeout_s: float) -> None:
        """`pace`: simulated over wall time. Raises SceneError: the processes would time out."""
        check_pace(setup, pace, timeout_s)
        room = 1 << min(_MOST_WAITING, setup.run.steps // setup.sensor.every_steps + 1).bit_length()
        self._pace, self._step_ns = pace, setup.run.step_ns
        self.clock = new_clock(setup.run.steps, room, setup.run.step_ns / pace)

    def started(self, exchange: Exchange, step: int) -> Exchange:
        """Start the clock at the present step; return the exchange that follows it."""
        sleep_precisely()
        counts = self.clock.counts
        counts[clocks.PUT] = counts[clocks.ANSWERS_NOTED] = exchange.counts[ANSWERED]
        counts[clocks.FORCES_NOTED] = exchange.counts[FORCES_END]
        counts[clocks.START_NS] = time.monotonic_ns() - int(step * self.clock.step_ns)
        return exchange._replace(kind=CLOCK)

    def unanswered_s(self, exchange: Exchange, unsent: Unsent) -> float:
        """Return how long the oldest sample without an answer has waited, s."""
        first, ring = int(exchange.counts[ANSWERED]), self.clock.taken_ns
        if first >= unsent.counts[SAMPLES_END]:
            return 0.0
        return time.monotonic() - 1e-9 * float(ring[first % len(ring)])

    def rest(self, step: int, pending: Callable[[], bool]) -> None:
        """Without shared memory, wait until a step is due or a message arrives."""
        began = time.monotonic_ns()
        due = self.clock.counts[clocks.START_NS] + step * self.clock.step_ns
        while not pending() and time.monotonic_ns() < due - REST_S * 1e9:
            time.sleep(REST_S)
        self.clock.counts[clocks.WAITED_NS] += time.monotonic_ns() - began

    def statistics(self, exchange: Exchange) -> tuple[Pacing, dict[str, np.ndarray]]:
        """Return how plant and controller kept pace."""
        counts = self.clock.counts
        wall_ns = time.monotonic_ns() - int(counts[clocks.START_NS])
        header = Pacing(
            pace=self._pace,
            response_max_ns=int(counts[clocks.RESPONSE_MAX_NS]),
            late_max_ns=int(counts[clocks.LATE_MAX_NS]),
            behind_max_ns=int(counts[clocks.BEHIND_MAX_NS]),
            working_ns=max(0, wall_ns - int(counts[clocks.WAITED_NS])),
            classes_an_octave=clocks.CLASSES_AN_OCTAVE,
            loop_delay_steps=exchange.grant.loop_delay_steps,
            step_ns=self._step_ns,
        )
        return header, {"answers": np.trim_zeros(self.clock.histogram, "b").astype(float)}
