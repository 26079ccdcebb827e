"""Whether latencies measured in some paced runs predict the metrics of others.

Each run is recorded at the pace of the wall clock and repeated in lock-step with its own latencies.
The latencies of the first runs, resampled by many seeds, predict a 95 % range of each metric. The
other runs are held out: they are counted where they fall in this range.
"""

from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import numpy as np
import typer

from benchmarks.program import (
    JsonOption,
    OutDirOption,
    QuickOption,
    SceneArgument,
    bars,
    check_json,
    compile_first,
    conclude,
    number_table,
    out,
    results_in,
    scene_from,
    share,
    start,
    tracked,
    write_json,
    write_records,
    written,
)
from hertzloop.loop.run_options import RunOptions
from hertzloop.loop.simulate import simulate
from hertzloop.recordings.latencies import latencies_of
from hertzloop.recordings.reader import read
from hertzloop.results.assessed_run import run_and_assess
from hertzloop.results.recorded import truth_of
from hertzloop.scene.setup import Setup
from hertzloop.studies.sweeps.evaluate import Pool, evaluate
from hertzloop.studies.sweeps.pool import local_pool

_SETTINGS = ["run.duration_s=0.0012", "controller.law=force_feedback"]
_METRICS = ("plate_energy_db", "rebound_percent", "peak_force_n")
_TRACE = "controller.latency_trace"


@dataclass(frozen=True)
class Predicted:
    """The predicted 95 % range of a metric, the median of the runs held out, and how many of them
    are within."""

    metric: str
    low: float
    high: float
    median: float
    within: int
    held_out: int


def paced(setup: Setup, path: Path, pace: float) -> tuple[list[float], bool]:
    """Run at the pace of the wall clock.

    Args:
        setup: The scene.
        path: The recording.
        pace: Simulated time over wall time.

    Returns:
        The latency of each sample, us, and whether lock-step with them gives the same bytes.
    """
    run_and_assess(setup, path, RunOptions(pace=pace), lambda step: None)
    recording = read(path)
    latencies = [float(x) for x in latencies_of(recording)]
    again = setup.vary({_TRACE: latencies})
    repeated = simulate(again.with_plate_model(setup.plate_model)).truth
    return latencies, np.array_equal(repeated, truth_of(recording))


def predict(pool: Pool, setup: Setup, traces: list[list[float]], known: int, draws: int) \
        -> list[Predicted]:  # fmt: skip
    """Predict the metrics from the first `known` traces, and count the others within."""
    joined = [latency for trace in traces[:known] for latency in trace]
    resampled = {_TRACE: joined, "controller.latency_trace_use": "resample"}
    drawn = evaluate(pool, setup.vary(resampled), "impact",
                     [{"run.seed": seed} for seed in range(1, draws + 1)])  # fmt: skip
    held = [evaluate(pool, setup.vary({_TRACE: trace}), "impact", [{}])[0]
            for trace in traces[known:]]  # fmt: skip
    found = []
    for metric in _METRICS:
        low, high = np.quantile([row[metric] for row in drawn], (0.025, 0.975))
        values = [row[metric] for row in held]
        within = sum(bool(low <= value <= high) for value in values)
        found.append(
            Predicted(metric, float(low), float(high), float(np.median(values)), within, len(held))
        )
    return found


def main(
    scene: SceneArgument = "aluminium-3mm",
    folder: OutDirOption = None,
    runs: Annotated[int, typer.Option(min=2, help="Paced runs (3 with --quick).")] = 28,
    known: Annotated[
        int, typer.Option(min=1, help="Runs whose latencies are known (1 with --quick).")
    ] = 8,
    pace: Annotated[
        float, typer.Option(min=1e-4, max=1.0, help="Simulated time over wall time.")
    ] = 0.01,
    draws: Annotated[
        int, typer.Option(min=20, help="Resampled traces of the prediction (40 with --quick).")
    ] = 1000,
    quick: QuickOption = False,
    json_file: JsonOption = None,
) -> None:
    """Predict paced runs from the latencies of other paced runs.

    Example: python -m benchmarks.paced_prediction --quick
    """
    check_json(json_file)
    if quick:
        runs, known, draws = 3, 1, 40
    known = min(known, runs - 1)
    setup = scene_from(scene, _SETTINGS, None)
    traces, equal = [], 0
    with results_in(folder, "paced_prediction", "modal") as made:
        compile_first(setup)
        with TemporaryDirectory() as kept:
            for number in tracked("runs", range(runs)):
                trace, same = paced(setup, Path(kept) / f"{number}.mcap", pace)
                traces.append(trace)
                equal += same
        with local_pool(1) as pool:
            found = predict(pool, setup, traces, known, draws)
        write_records(made / "paced_prediction.csv", found)
        bars(made / "paced_prediction.png", "Held-out runs in the 95 % range", "%",
             [(p.metric, 100.0 * p.within / p.held_out) for p in found])  # fmt: skip
    rows = [(p.metric, f"{p.low:.4g}", f"{p.high:.4g}", f"{p.median:.4g}", str(p.within),
             str(p.held_out)) for p in found]  # fmt: skip
    headings = ("metric", "2.5 %", "97.5 %", "median held out", "within", "of")
    out.print(number_table(f"paced runs of {setup.name}", headings, rows, text=1))
    late = np.concatenate([np.asarray(trace) for trace in traces])
    out.print(f"Latencies: median {np.median(late):.3g} us, 99 % below "
              f"{np.quantile(late, 0.99):.3g} us, largest {late.max():.4g} us.")  # fmt: skip
    written(made, "paced_prediction.csv", "paced_prediction.png")
    conclude(
        f"{equal} of {runs} paced runs are repeated to the bit, and "
        f"{share(sum(p.within for p in found), sum(p.held_out for p in found))} of the metrics "
        "held out are in the predicted 95 % range."
    )
    write_json(json_file, {"repeated": equal, "runs": runs, "known": known,
                           "predicted": [asdict(p) for p in found]})  # fmt: skip


if __name__ == "__main__":
    start("benchmarks.paced_prediction")
