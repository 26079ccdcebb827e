"""The worst sequence of latencies that a search finds, against random draws."""

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
import typer

from benchmarks.program import OutDirOption, QuickOption, start, tracked
from benchmarks.results import results_in
from hertzloop.cli.options import JsonOption
from hertzloop.scene.loading import shipped
from hertzloop.scene.setup import load
from hertzloop.studies.budget.goal import DEFAULT_GOAL, parse_goal, worst_excess
from hertzloop.studies.budget.worst_sequence import case_of, window_of, worst_sequence
from hertzloop.studies.cases.evaluate import Pool, Rows, evaluate
from hertzloop.studies.cases.pool import local_pool

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
    folder: OutDirOption = None,
    steps: Annotated[int, typer.Option(min=1, help="Range of the latency, steps.")] = 8,
    draws: Annotated[int, typer.Option(min=1, help="Random draws in each scene.")] = 100_000,
    quick: QuickOption = False,
    json_file: JsonOption = None,
) -> None:
    """Compare the worst sequence that a search finds with the worst of random draws.

    With --quick there is one scene, with 50 draws.

    Example: python -m benchmarks.worst_sequence aluminium-3mm --draws 2000
    """
    if quick:
        scenes, draws = scenes or ["aluminium-3mm"], 50
    with results_in(folder, "worst_sequence", "modal", json_file=json_file) as results:
        names = [scene for scene in scenes or shipped() if load(scene).has_law]
        with local_pool(1 if quick else None) as pool:
            found = [compare(pool, scene, steps, draws) for scene in tracked("scenes", names)]
        results.write("worst", found)
        results.table(
            "plate energy under varying latency",
            {
                "scene": "{.scene}",
                "range, us": "{.range_us:g}",
                "worst found, dB": "{.searched_db:.3f}",
                "cases": "{.cases}",
                "worst drawn, dB": "{.drawn_db:.3f}",
                "median": "{.median_db:.3f}",
                "draws": "{.draws}",
            },
            found,
        )
        least = min(one.searched_db - one.drawn_db for one in found)
        results.conclude(
            f"The search is at least {least:.3f} dB worse than all draws (negative: better)."
        )


if __name__ == "__main__":
    start("benchmarks.worst_sequence")
