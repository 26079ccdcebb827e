"""A clock that stands still while this process does not run.

A process that was stopped, or had no processor time, could not hear the others: it must not
hold that time against them.
"""

import math
import threading
import time
from collections.abc import Callable

_BEAT_S = 0.2
_PAUSE_S = 1.0  # without a beat: an ordinary delay on a busy machine is shorter


class ProcessClock:
    """Seconds for which this process has run; `start` lets a thread notice every pause.

    Without that thread, a pause is the time between two calls of `now`, where that is long.
    """

    def __init__(self) -> None:
        self._lock, self._thread = threading.Lock(), threading.Thread()
        self.on_beat: Callable[[], None] = lambda: None  # called again and again, once started
        self._seen_s, self._paused_s = time.monotonic(), 0.0
        self._ended_s, self._lasted_s = -math.inf, 0.0  # the latest pause, by the monotonic clock

    def start(self) -> None:
        """Begin to watch this process, unless that has begun; after a fork it has not."""
        if not self._thread.is_alive():
            self._seen_s, self._ended_s = time.monotonic(), -math.inf
            self._thread = threading.Thread(target=self._beat, name="clock", daemon=True)
            self._thread.start()

    def _beat(self) -> None:
        while True:
            self.now()
            self.on_beat()
            time.sleep(_BEAT_S)

    def now(self) -> float:
        """Time without the pauses, s."""
        paused_s, now_s = self._paused_s, time.monotonic()
        # Without the lock, unless another thread counts a pause meanwhile, or there was one.
        if 0.0 <= now_s - self._seen_s < _BEAT_S and paused_s == self._paused_s:
            return now_s - paused_s
        with self._lock:
            now_s = time.monotonic()
            gap_s = now_s - self._seen_s
            if gap_s > _PAUSE_S:
                self._paused_s += gap_s - _BEAT_S
                self._ended_s, self._lasted_s = now_s, gap_s
            self._seen_s = now_s  # last: who sees it finds the pause
            return now_s - self._paused_s

    def since(self, then_s: float) -> float:
        """Time since `then_s` of the monotonic clock without the latest pause, s."""
        self.now()
        pause_s = min(self._lasted_s, max(self._ended_s - then_s, 0.0))
        return time.monotonic() - then_s - pause_s

    def paused_s(self, within_s: float) -> float:
        """How long the latest pause was that ended within the last `within_s`; 0 without one."""
        self.now()
        return self._lasted_s if time.monotonic() - self._ended_s <= within_s else 0.0


clock = ProcessClock()
