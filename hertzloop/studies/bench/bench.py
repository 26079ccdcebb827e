"""How fast a scene runs on this machine: the loop in each transport, and cases of a sweep.

Machines are shared and noisy. So all measurements take turns, round after round, and a load from
elsewhere meets all of them alike.
"""

import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from hertzloop.loop.run_options import RunOptions, Transport
from hertzloop.processes.record import record
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup
from hertzloop.studies.bench.result import BenchResult, LoopCost, SweepCost
from hertzloop.studies.cases.evaluate import run_cases
from hertzloop.studies.cases.rows import without_result

_ROUNDS, _QUICK_ROUNDS = 5, 2
_CASES, _QUICK_CASES = 100, 30  # of the sweep, a round


def measure(
    setup: Setup, quick: bool = False, on_progress: Callable[[int, int], None] = lambda *_: None
) -> BenchResult:
    """Measure the loop in each transport and the cases of a small latency sweep, in turn.

    Args:
        setup: the scene to run.
        quick: whether to measure fewer rounds and cases.
        on_progress: called with the number of finished rounds and of all rounds.

    Returns:
        Medians and least times over the rounds.

    Raises:
        SceneError: if no case of the sweep can be run.
        RunFailed, BusError, StreamFault, RecordingError: if a run fails.
    """
    rounds = _QUICK_ROUNDS if quick else _ROUNDS
    cases = latency_cases(setup, _QUICK_CASES if quick else _CASES)
    times: dict[Transport, list[float]] = {transport: [] for transport in Transport}
    rates: list[float] = []
    for turn in range(rounds + 1):
        for transport in Transport:
            wall_s = _loop_s(setup, transport)
            if turn:  # the first round loads what is compiled
                times[transport].append(wall_s)
        per_s = _cases_per_s(setup, cases)
        if turn:
            rates.append(per_s)
        on_progress(turn + 1, rounds + 1)
    to_us = 1e6 / setup.steps
    loops = tuple(
        LoopCost(
            transport, to_us * median(some), to_us * min(some), setup.duration_s / median(some)
        )
        for transport, some in times.items()
    )
    sweep = SweepCost(len(cases), median(rates), max(rates))
    return BenchResult(setup.name, setup.steps, rounds, loops, sweep)


def latency_cases(setup: Setup, count: int) -> list[dict[str, float]]:
    """Cases of a sweep over the latency from 0 upwards, one step apart, shorter than the run."""
    most = max(1, min(count, setup.steps - 1))
    return [{"controller.latency_us": round(1e6 * i * setup.step_s, 6)} for i in range(most)]


def _loop_s(setup: Setup, transport: Transport) -> float:
    """Wall time of the loop of a recorded run, s."""
    with TemporaryDirectory(prefix="hertzloop-") as folder:
        stats = record(setup, Path(folder) / "bench.mcap", RunOptions(transport))
    return float(stats["wall_s"])


def _cases_per_s(setup: Setup, cases: list[dict[str, float]]) -> float:
    """Cases a second of processor time of this thread. Raises SceneError if none can be run."""
    began = time.thread_time()
    rows = list(run_cases(setup, "impact", list(enumerate(cases))))
    spent_s = time.thread_time() - began
    if failed := without_result(rows):
        raise SceneError(f"{len(failed)} of {len(rows)} cases cannot be run: {failed[0]['status']}")
    return len(rows) / spent_s
