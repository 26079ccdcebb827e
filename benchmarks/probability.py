"""How often the interval of `hertzloop budget --uncertain` holds the true probability."""

from dataclasses import asdict, dataclass
from typing import Annotated, Any

import numpy as np
import scipy
import typer

from benchmarks.program import (
    JsonOption,
    OutDirOption,
    QuickOption,
    bars,
    check_json,
    compile_first,
    conclude,
    number_table,
    out,
    results_in,
    share,
    start,
    tracked,
    write_json,
    write_records,
    written,
)
from hertzloop.scene.setup import load
from hertzloop.studies.budget.goal import all_met, parse_goal
from hertzloop.studies.budget.probability import FIRST, probability, wilson
from hertzloop.studies.sweeps.evaluate import Pool, evaluate
from hertzloop.studies.sweeps.pool import local_pool
from hertzloop.studies.sweeps.uncertain import UncertainInputs, uncertain_of

# A small scene whose every case has the same plant.
_SETTINGS = ["run.duration_s=0.0013", "run.accuracy=0.1", "controller.v_thr_m_s=-0.6"]
_TABLE: dict[str, Any] = {
    "controller.latency_us": {
        "distribution": "triangular", "low": 0.0, "mode": 2.0, "high": 8.0,
    },
    "controller.kappa": {"distribution": "normal", "mean": 0.8, "standard_deviation": 0.1},
}  # fmt: skip
# Probabilities in the middle, and near 1.
_GOALS = ("plate_energy_db <= 0", "plate_energy_db <= 1")
_TRUTH_SEED = 1_000_003


@dataclass(frozen=True)
class Coverage:
    """Intervals that hold the true probability, which has a standard error of its own; `exact`: the
    share by theory."""

    goal: str
    truth: float
    exact: float
    covered: int
    repetitions: int
    mean_cases: float
    mean_half_width: float


def exact_coverage(truth: float, within: float, most: int = 4096) -> float:
    """Return how often the interval holds a probability when cases double until half the interval
    is at most `within`: the sum over all numbers of successes at which drawing stops."""
    cases, covered = FIRST, 0.0
    going = scipy.stats.binom.pmf(np.arange(cases + 1), cases, truth)
    while True:
        for met in np.flatnonzero(going):
            low, high = wilson(int(met), cases)
            if 0.5 * (high - low) <= within or cases >= most:
                covered += going[met] if low <= truth <= high else 0.0
                going[met] = 0.0
        if not going.any():
            return float(covered)
        more = min(cases, most - cases)
        going = np.convolve(going, scipy.stats.binom.pmf(np.arange(more + 1), more, truth))
        cases += more


def coverage(
    pool: Pool, uncertain: UncertainInputs, goal: str, repetitions: int, cases: int, within: float
) -> Coverage:
    """Compare the intervals of so many seeds with the share of `cases` other draws."""
    setup, goals = load("aluminium-3mm", _SETTINGS), [parse_goal(goal)]
    drawn = [uncertain.draw(_TRUTH_SEED, number) for number in range(cases)]
    met = sum(all_met(goals, row) for row in evaluate(pool, setup, "impact", drawn))
    truth, found = met / cases, []
    for seed in tracked(goal, range(repetitions)):
        # Case n of seed s has the random numbers of (s, n): seeds far apart share none.
        one = setup.vary({"run.seed": 1 + 100_000 * seed})
        found.append(probability(pool, one, goals, uncertain, "impact", within=within))
    widths = [p.interval[1] - p.interval[0] for p in found]
    return Coverage(
        goal, truth, exact_coverage(truth, within),
        sum(p.interval[0] <= truth <= p.interval[1] for p in found), repetitions,
        sum(p.cases for p in found) / repetitions, 0.5 * sum(widths) / repetitions,
    )  # fmt: skip


def main(
    folder: OutDirOption = None,
    repetitions: Annotated[
        int, typer.Option(min=1, help="Intervals for each goal (4 with --quick).")
    ] = 200,
    cases: Annotated[
        int, typer.Option(min=100, help="Cases of the true probability (500 with --quick).")
    ] = 20_000,
    quick: QuickOption = False,
    json_file: JsonOption = None,
) -> None:
    """Count how often the 95 % interval of a probability holds the true one.

    The true probability is the share of other draws of the same distributions.

    Example: python -m benchmarks.probability --quick
    """
    check_json(json_file)
    setup = load("aluminium-3mm", _SETTINGS)
    uncertain = uncertain_of(_TABLE, setup)
    with results_in(folder, "probability", "modal") as made:
        compile_first(setup)
        with local_pool() as pool:
            found = [
                coverage(pool, uncertain, goal, 4, 500, 0.1) if quick
                else coverage(pool, uncertain, goal, repetitions, cases, 0.05)
                for goal in _GOALS
            ]  # fmt: skip
        write_records(made / "probability.csv", found)
        shares = [(c.goal, 100.0 * c.covered / c.repetitions) for c in found]
        bars(made / "probability.png", "Coverage of Wilson's interval", "%", shares)
    headings = ("goal", "true", "by theory", "covered", "of", "mean cases", "mean half width")
    rows = [(c.goal, f"{c.truth:.4f}", f"{c.exact:.4f}", str(c.covered), str(c.repetitions),
             f"{c.mean_cases:.0f}", f"{c.mean_half_width:.3f}") for c in found]  # fmt: skip
    out.print(number_table("95 % intervals of a probability", headings, rows, text=1))
    # At the default of --within, over probabilities that are neither rare nor nearly certain.
    spread = {p: exact_coverage(p, 0.03) for p in np.linspace(0.05, 0.95, 10 if quick else 91)}
    least, most = min(spread, key=spread.__getitem__), max(spread, key=spread.__getitem__)
    out.print(f"By theory, half the interval at most 0.03: {100 * spread[least]:.1f} % at the "
              f"probability {least:.2f}, to {100 * spread[most]:.1f} % at {most:.2f}.")  # fmt: skip
    written(made, "probability.csv", "probability.png")
    conclude(
        "The 95 % interval holds the true probability in "
        f"{share(sum(c.covered for c in found), sum(c.repetitions for c in found))}."
    )
    write_json(json_file, {"coverage": [asdict(c) for c in found]})


if __name__ == "__main__":
    start("benchmarks.probability")
