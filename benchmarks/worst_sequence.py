"""The worst sequence of latencies that a search finds, against random draws."""

from dataclasses import asdict, dataclass
from typing import Annotated, Any

import numpy as np
import typer

from benchmarks.program import (
    JsonOption,
    check_json,
    conclude,
    number_table,
    out,
    start,
    write_json,
)
from hertzloop.scene.loading import shipped
from hertzloop.scene.setup import load
from hertzloop.studies.budget.goal import DEFAULT_GOAL, parse_goal, worst_excess
from hertzloop.studies.budget.worst_sequence import case_of, window_of, worst_sequence
from hertzloop.studies.sweeps.evaluate import Pool, Rows, evaluate
from hertzloop.studies.sweeps.pool import local_pool

_CHUNK = 2000  # draws that are held at once
_METRIC = "plate_energy_db"


@dataclass(frozen=True)
class Worst:
    """Worst plate energy (dB) in a scene by the search and by random draws, and their cases."""

    scene: str
    range_us: float
    searched_db: float
    cases: int
    drawn_db: float
    median_db: float
    draws: int


def compare(pool: Pool, scene: str, steps: int, draws: int) -> Worst:
    """Search a scene, and draw latencies of each sample, uniform from 0 to `steps`."""
    setup, goals = load(scene), [parse_goal(DEFAULT_GOAL)]

    def run(cases: list[dict[str, Any]]) -> Rows:
        return evaluate(pool, setup, "impact", cases)

    latency_us, step_us = setup.scene.controller.latency_us, setup.step_ns / 1000.0
    found = worst_sequence(setup, goals, steps, [0.0], run)
    (nominal,) = run([case_of([latency_us], 0.0)])
    window, generator = window_of(setup, steps, nominal), np.random.default_rng(1)
    energies: list[float] = []
    for first in range(0, draws, _CHUNK):
        delays = generator.integers(0, steps + 1, (min(_CHUNK, draws - first), window.count))
        before = [latency_us] * window.first
        rows = run([case_of(before + (latency_us + step_us * one).tolist(), 0.0) for one in delays])
        energies += [np.inf if np.isinf(worst_excess(goals, r)) else r[_METRIC] for r in rows]
    searched = np.inf if np.isinf(found.excess) else float(found.metrics[_METRIC] or 0.0)
    drawn, median = float(np.max(energies)), float(np.median(energies))
    return Worst(scene, steps * step_us, searched, found.cases, drawn, median, draws)


def main(
    scenes: Annotated[list[str] | None, typer.Argument(help="Scenes; all shipped ones.")] = None,
    steps: Annotated[int, typer.Option(min=1, help="Range of the latency, steps.")] = 8,
    draws: Annotated[int, typer.Option(min=1, help="Random draws in each scene.")] = 100_000,
    json_file: JsonOption = None,
) -> None:
    """Compare the worst sequence that a search finds with the worst of random draws.

    Example: python -m benchmarks.worst_sequence aluminium-3mm --draws 2000
    """
    check_json(json_file)
    found = []
    with local_pool(None) as pool:
        for scene in scenes or shipped():
            if load(scene).has_law:
                found.append(compare(pool, scene, steps, draws))
    rows = [
        (w.scene, f"{w.range_us:g}", f"{w.searched_db:.3f}", str(w.cases), f"{w.drawn_db:.3f}",
         f"{w.median_db:.3f}", str(w.draws))
        for w in found
    ]  # fmt: skip
    headings = (
        "scene",
        "range, us",
        "worst found, dB",
        "cases",
        "worst drawn, dB",
        "median",
        "draws",
    )
    out.print(number_table("plate energy under varying latency", headings, rows, text=1))
    write_json(json_file, {"worst": [asdict(one) for one in found]})
    least = min(one.searched_db - one.drawn_db for one in found)
    conclude(f"The search is at least {least:.3f} dB worse than all draws (negative: better).")


if __name__ == "__main__":
    start("benchmarks.worst_sequence")
