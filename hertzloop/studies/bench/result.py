"""What `bench` measured: the cost of the loop in each transport, and the rate of a sweep."""

from dataclasses import dataclass

from hertzloop.loop.run_options import Transport


@dataclass(frozen=True)
class LoopCost:
    """Wall time of the whole loop, recorded, in one transport.

    Attributes:
        transport: how the parts of the loop exchange samples and forces.
        median_us: wall time a step, us, median over the rounds.
        least_us: wall time a step, us, smallest of the rounds.
        times_real_time: simulated time over wall time, at the median.
    """

    transport: Transport
    median_us: float
    least_us: float
    times_real_time: float


@dataclass(frozen=True)
class SweepCost:
    """Rate of one core in a sweep over the latency.

    Attributes:
        cases: number of cases in a round.
        per_s: cases a second of processor time, median over the rounds.
        most_per_s: cases a second in the fastest round.
    """

    cases: int
    per_s: float
    most_per_s: float


@dataclass(frozen=True)
class BenchResult:
    """What was measured.

    Attributes:
        scene: name of the scene.
        steps: number of steps of a run.
        rounds: how often everything was measured, after one round that loads the kernels.
        loops: one entry a transport.
        sweep: rate of one core in a sweep.
    """

    scene: str
    steps: int
    rounds: int
    loops: tuple[LoopCost, ...]
    sweep: SweepCost
