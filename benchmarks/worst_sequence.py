"""The worst sequence of latencies that a search finds, against random draws."""

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
import typer

from benchmarks.program import OutDirOption, QuickOption, start, tracked
from benchmarks.results import results_in
from hertzloop.cli.options import JsonOption
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.scene.loading import shipped
from hertzloop.scene.setup import load
from hertzloop.studies.cases.evaluate import Pool, evaluate
from hertzloop.studies.cases.pool import local_pool
from hertzloop.studies.cases.rows import Rows
from hertzloop.studies.worst.search import WorstSearch, largest

_CHUNK = 2000  # draws that are held at once
_OBJECTIVE = largest("plate_energy_db")


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


def with_cases() -> list[str]:
    """Names of the shipped scenes that have a law, and a scheme on which metrics of cases rest."""
    setups = {name: load(name) for name in shipped()}
    return [n for n, one in setups.items() if one.has_law and SCHEMES[one.scheme].conserves]


def compare(pool: Pool, scene: str, steps: int, draws: int) -> Worst:
    """Search a scene, and draw jitter from 0 to `steps`, both at its own touch phase.

    A case ends with the first impact.
    """
    setup = load(scene)
    range_us = steps * setup.step_ns / 1000.0

    def run(cases: list[dict[str, Any]]) -> Rows:
        return evaluate(pool, setup, "impact", cases)

    found = WorstSearch(setup, _OBJECTIVE, [setup.touch_phase], run).within(steps)
    drawn: list[float] = []
    for first in range(0, draws, _CHUNK):
        seeds = range(first, min(first + _CHUNK, draws))
        rows = run([{"controller.jitter_us": range_us, "run.seed": seed} for seed in seeds])
        drawn += [_OBJECTIVE.excess(row) for row in rows]
    worst, median = float(np.max(drawn)), float(np.median(drawn))
    return Worst(scene, range_us, found.excess, found.cases, worst, median, draws)


def main(
    scenes: Annotated[list[str] | None, typer.Argument(help="Scenes; all with a law.")] = None,
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
        names = scenes or with_cases()
        with local_pool(1 if quick else None) as pool:
            found = [compare(pool, scene, steps, draws) for scene in tracked("scenes", names)]
        results.write("worst", found)
        results.table(
            "plate energy under varying latency",
            {
                "scene": "{.scene}",
                "range, us": "{.range_us:g}",
                "worst found, dB": "{.searched_db:.4f}",
                "cases": "{.cases}",
                "worst drawn, dB": "{.drawn_db:.4f}",
                "median": "{.median_db:.4f}",
                "draws": "{.draws}",
            },
            found,
        )
        least = min(one.searched_db - one.drawn_db for one in found)
        results.conclude(
            f"The search is at least {least:.4f} dB worse than all draws (negative: better)."
        )


if __name__ == "__main__":
    start("benchmarks.worst_sequence")
