"""A controller made from a description: law, signal path, converter."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hertzloop.controller import kernels as controller_kernels
from hertzloop.controller import law_kernels as laws
from hertzloop.controller.kernels import SIGNAL_PATH_COUNTS
from hertzloop.controller.loading.bound import BoundLaw, BrokenPromise, LawFault

# Random streams; the sensor's noise and the touch phase are others.
_JITTER_STREAM, _DROP_OUT_STREAM, _TRACE_STREAM = 2, 3, 6
_BLOCK = 50  # latencies of a trace that stay together when it is resampled
_TICK_ROUNDING = 1e-6  # steps; a tick so little before a sample still takes it


@dataclass(frozen=True)
class SignalPath:
    """What lies between law and actuator.

    The command of the sample at step j acts from step j + 1 + latency_steps + jitter on,
    jitter uniform over 0..jitter_steps; a command is lost with `drop_out_probability` and
    the last force is then held. `bits` and `full_scale_n` (N) describe the converter, None
    means ideal or unlimited; `slew_n_s` limits the rate of the force (N/s).

    `trace`: latency by sample beyond `latency_steps`, in steps, repeated to the end of the run, or
    `resampled`: in blocks drawn by the seed, so that neighbours stay neighbours. `dead_steps`: a
    delay that every command has on top. Commands that would act at `stuck_step` or later are lost.

    `tick_steps`, `first_tick_steps`: period and first tick of the controller's own clock, in steps.
    A command then waits for the first tick at or after its sample, in whole steps; 0: for none.
    """

    latency_steps: int = 0
    jitter_steps: int = 0
    drop_out_probability: float = 0.0
    bits: int | None = None
    full_scale_n: float | None = None
    slew_n_s: float | None = None
    trace: tuple[int, ...] = ()
    resampled: bool = False
    dead_steps: int = 0
    stuck_step: int | None = None
    tick_steps: float = 0.0
    first_tick_steps: float = 0.0

    @cached_property
    def most_added_steps(self) -> int:
        """Largest latency of a command beyond `latency_steps`."""
        waits = math.floor(self.tick_steps + 0.5)
        return self.jitter_steps + max(self.trace, default=0) + self.dead_steps + waits

    @property
    def varies(self) -> bool:
        """Whether commands differ in latency."""
        return bool(self.jitter_steps or any(self.trace) or self.tick_steps)


# Fields of a signal path that leave a linear loop linear, a fine converter apart. `margin` refuses
# a path that sets another one.
LINEAR_PATH_FIELDS = frozenset(
    {
        "latency_steps",
        "dead_steps",
        "bits",
        "full_scale_n",
        "resampled",
        "first_tick_steps",
    }
)
# Fields of a signal path that make no steps in a smooth force unless it `varies`. Where a path sets
# another one, an infinite plate expects a force with steps.
SMOOTH_PATH_FIELDS = frozenset(
    {
        "latency_steps",
        "dead_steps",
        "full_scale_n",
        "jitter_steps",
        "trace",
        "resampled",
        "tick_steps",
        "first_tick_steps",
    }
)


class Controller:
    """Law and signal path for a run of `steps` steps, sampled every `every_steps` steps."""

    def __init__(
        self,
        law: BoundLaw,
        path: SignalPath,
        step_s: float,
        steps: int,
        every_steps: int,
        seed: int,
    ) -> None:
        samples = -(-steps // every_steps)
        self.bound = law
        self.law = law.model
        self.law_state = laws.first_state(law.state.data, samples)
        added, dropped = _added_steps(path, samples, every_steps, seed)
        full_scale = path.full_scale_n or 0.0
        if path.bits is not None and path.full_scale_n is None:
            raise ValueError("a converter with bits needs a full-scale force")
        last_code = 2 ** (path.bits - 1) - 1 if path.bits is not None else 0
        self.path = controller_kernels.SignalPathModel(
            every_steps=every_steps,
            latency_steps=path.latency_steps,
            added_steps=added,
            dropped=dropped,
            ideal=path.bits is None,
            limited=path.full_scale_n is not None,
            full_scale_n=full_scale,
            lsb_n=full_scale / last_code if last_code else 1.0,
            last_code=last_code,
            slew_n=math.inf if path.slew_n_s is None else path.slew_n_s * step_s,
        )
        self.path_state = controller_kernels.SignalPathState(
            np.full(steps, np.nan), np.zeros(SIGNAL_PATH_COUNTS, np.int64), np.zeros(2)
        )
        self.forces = np.zeros(steps)

    @property
    def failed_at(self) -> int:
        """The first sample on which the law has failed; -1 if there is none."""
        return int(self.law_state.counts[laws.FAULT]) - 1

    def check(self) -> None:
        """Raises LawFault if the law has failed on a sample so far; KeyboardInterrupt if that ended
        it."""
        if self.bound.ended:
            ended = self.bound.ended[0]
            self.bound.ended.clear()  # the law may be used again
            raise ended
        if self.failed_at >= 0:
            if self.law_state.counts[laws.CAUSE] != laws.NO_NUMBER:
                raise BrokenPromise(self.bound.explain_promise(self.law_state))
            seen = self.law_state.history[: self.law_state.counts[laws.SAMPLES]]
            raise LawFault(self.bound.explain(seen, self.failed_at))


def latency_steps(path: SignalPath, steps: int, every_steps: int, seed: int) -> np.ndarray:
    """Return the latency of each command before they are put in order, in steps, shape (samples,).

    Args as of `mean_latency_steps`.
    """
    samples = -(-steps // every_steps)
    added, _ = _added_steps(path, samples, every_steps, seed)
    return np.full(samples, path.latency_steps) + (added if added.size else 0)


def mean_latency_steps(path: SignalPath, steps: int, every_steps: int, seed: int) -> float:
    """Mean latency of the force that acts, in steps.

    Commands keep their order, so that under jitter and traces this is more than the mean of the
    latencies: a command that would overtake an earlier one waits for it.

    Args:
        path: Signal path between law and actuator.
        steps: Steps of the run.
        every_steps: Steps between two samples.
        seed: Seed of the run.

    Returns:
        Mean over all steps from the first command on. It counts as `controller.latency_us` does:
        without jitter, traces and drop-outs it is `path.latency_steps`. NaN if no command acts.
    """
    samples = -(-steps // every_steps)
    added, dropped = _added_steps(path, samples, every_steps, seed)
    taken = np.arange(samples) * every_steps
    acts = taken + 1 + path.latency_steps + (added if added.size else 0)
    if dropped.size:
        taken, acts = taken[~dropped], acts[~dropped]
    acts = np.maximum.accumulate(acts)
    if not len(acts) or acts[0] >= steps:
        return math.nan
    step = np.arange(acts[0], steps)
    acting = taken[np.searchsorted(acts, step, side="right") - 1]
    held = 0.5 * (every_steps - 1)  # a command that is never late acts this long on average
    return float(np.mean(step - acting - 1) - held)


def _added_steps(
    path: SignalPath, samples: int, every_steps: int, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the latency of each command beyond `latency_steps`, in steps, and whether it is lost.

    An array is empty if no command has such a latency, or none is lost.
    """
    added, dropped = np.empty(0, np.int64), np.empty(0, np.bool_)
    if path.jitter_steps > 0:
        added = _random(seed, _JITTER_STREAM).integers(0, path.jitter_steps + 1, samples)
    if path.trace or path.dead_steps or path.tick_steps:
        traced = _traced(path, samples, seed) + path.dead_steps
        traced += _waits(path, samples, every_steps)
        added = traced if added.size == 0 else added + traced
    if path.drop_out_probability > 0.0:
        dropped = _random(seed, _DROP_OUT_STREAM).random(samples) < path.drop_out_probability
    if path.stuck_step is not None:
        acts = np.arange(samples) * every_steps + 1 + path.latency_steps
        late = (acts if added.size == 0 else acts + added) >= path.stuck_step
        dropped = late if dropped.size == 0 else dropped | late
    return added, dropped


def _traced(path: SignalPath, samples: int, seed: int) -> np.ndarray:
    """Latency of each sample beyond the least one by its trace, in steps; zeros without a trace."""
    trace = np.array(path.trace or (0,), np.int64)
    if not path.resampled:
        return np.resize(trace, samples)
    length = min(_BLOCK, trace.size)
    blocks = -(-samples // length)
    starts = _random(seed, _TRACE_STREAM).integers(0, trace.size, blocks)
    places = (starts[:, None] + np.arange(length)) % trace.size
    return trace[places.ravel()[:samples]]


def _waits(path: SignalPath, samples: int, every_steps: int) -> np.ndarray:
    """Steps from each sample to the first tick at or after it; zeros without a clock."""
    if not path.tick_steps:
        return np.zeros(samples, np.int64)
    until = path.first_tick_steps + _TICK_ROUNDING - np.arange(samples) * every_steps
    return np.floor(np.mod(until, path.tick_steps) + 0.5).astype(np.int64)


def _random(seed: int, stream: int) -> np.random.Generator:
    """Reproducible numbers: a function of seed, stream and position only."""
    return np.random.Generator(np.random.Philox(key=[seed, stream]))
