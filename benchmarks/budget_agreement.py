"""Limits of `hertzloop budget` against brute force: every value of a quantity in every variant."""

import time
from dataclasses import dataclass
from typing import Annotated, Any

import typer

from benchmarks.latency import LAWS, law_values
from benchmarks.program import OutDirOption, QuickOption, start, tracked
from benchmarks.results import results_in
from benchmarks.scenes import load
from hertzloop.cli.options import SceneArgument, SetOption
from hertzloop.cli.terminal import fail, out
from hertzloop.scene.errors import SceneError
from hertzloop.scene.loading import DEFAULT
from hertzloop.scene.setup import Setup
from hertzloop.studies.budget.effort import SearchEffort, effort_of, variants
from hertzloop.studies.budget.goal import DEFAULT_GOAL, all_met, parse_goal
from hertzloop.studies.budget.limit_search import limit_of
from hertzloop.studies.budget.limits import Boundary, BudgetLimit, BudgetQuantity
from hertzloop.studies.budget.plant_limits import side_by_side
from hertzloop.studies.budget.quantities import quantities_of
from hertzloop.studies.cases.evaluate import Pool, evaluate
from hertzloop.studies.cases.pool import local_pool
from hertzloop.studies.cases.rows import Rows

_ALL = 1_000_000
# As long as a sphere needs to leave; the search then simulates the same runs as brute force.
DURATIONS_S = {
    "aluminium-3mm": 0.0016,
    "offcentre-6mm": 0.0016,
    "aluminium-20mm": 0.004,
    "oak-20mm": 0.008,
}


def by_brute_force(
    pool: Pool, setup: Setup, quantity: BudgetQuantity, search: SearchEffort, most: int
) -> dict[int, bool]:
    """Return which places of a quantity meet the goal: all, or at most so many, evenly spread."""
    last, each = len(quantity.values) - 1, variants(quantity, search)
    count = min(most, last + 1)
    places = sorted({round(i * last / (count - 1)) for i in range(count)})
    cases = [{quantity.key: quantity.values[place]} | one for place in places for one in each]
    rows = evaluate(pool, setup, "impact", cases)
    goals = [parse_goal(DEFAULT_GOAL)]
    return {
        place: all(all_met(goals, row) for row in rows[i * len(each) : (i + 1) * len(each)])
        for i, place in enumerate(places)
    }


def difference(quantity: BudgetQuantity, limit: BudgetLimit, holds: dict[int, bool]) -> str:
    """Return in words how a limit differs from brute force; empty if it does not."""
    if limit.first_failure is None:
        good = len(quantity.values) - 1 if limit.boundary is Boundary.NO_LIMIT else -1
    else:
        good = [*map(quantity.reported, range(len(quantity.values)))].index(limit.first_failure) - 1
    failing = [place for place, held in holds.items() if place <= good and not held]
    if failing:
        return f"{quantity.name}: {limit.value}, but {quantity.reported(failing[0])} fails"
    if holds.get(good + 1):
        return f"{quantity.name}: {limit.value}, but the next value holds"
    again = any(held for place, held in holds.items() if place > good)
    return f"{quantity.name}: a gap was not seen" if again and limit.interval else ""


@dataclass(frozen=True)
class Agreement:
    """Search and brute force for a law: `differences` in words, processor times in s, and that of
    the search over that of brute force."""

    law: str
    limits: int
    differences: str
    differ: int
    search_s: float
    brute_force_s: float
    ratio: float


def compare(
    pool: Pool, setup: Setup, law: str, only: tuple[str, ...] = (), most: int = _ALL
) -> Agreement:
    """Compare the limits of all quantities, or of those named `only`, with at most `most` values of
    each; the time of brute force is then that of all values, in proportion."""
    search, goals = effort_of(setup, False, "impact"), [parse_goal(DEFAULT_GOAL)]

    def run(cases: list[dict[str, Any]]) -> Rows:
        return evaluate(pool, setup, "impact", cases)

    quantities = [q for q in quantities_of(setup) if not only or q.name in only]
    run([{q.key: q.values[place]} for q in quantities for place in (1, -1)])  # compiles
    began_s = time.process_time()
    limits: list[BudgetLimit] = side_by_side([limit_of(q, goals, search) for q in quantities], run)
    searched_s, brute_s = time.process_time() - began_s, 0.0
    found: list[str] = []
    for quantity, limit in zip(quantities, limits, strict=True):
        if limit.boundary is Boundary.IMPOSSIBLE:
            continue
        began_s = time.process_time()
        quantity = quantity.within(limit)  # a search ends with its scan where it found a limit
        holds = by_brute_force(pool, setup, quantity, search, most)
        brute_s += (time.process_time() - began_s) * len(quantity.values) / len(holds)
        found += filter(None, [difference(quantity, limit, holds)])
    ratio = searched_s / brute_s
    return Agreement(law, len(limits), "; ".join(found), len(found), searched_s, brute_s, ratio)


def main(
    scene: SceneArgument = DEFAULT,
    folder: OutDirOption = None,
    settings: SetOption = None,
    laws: Annotated[
        list[str] | None, typer.Option("--law", help="Try only this law; repeatable.")
    ] = None,
    values: Annotated[
        int, typer.Option(min=2, help="Try at most this many values of a quantity (all).")
    ] = _ALL,
    quick: QuickOption = False,
) -> None:
    """Compare the limits of `hertzloop budget` with brute force.

    Brute force simulates every value of a quantity in every variant. With --values it simulates
    evenly spread values, and its time is estimated. With --quick there is one law, and the latency
    alone.

    Example: python -m benchmarks.budget_agreement aluminium-3mm --quick
    """
    base = [f"run.duration_s={DURATIONS_S[scene]}"] if scene in DURATIONS_S else []
    base += settings or []
    found = []
    with results_in(folder, "budget_agreement", "modal") as results:
        with local_pool(1) as pool:
            for law in tracked("laws", laws or (["force_feedback"] if quick else LAWS)):
                try:
                    setup = load(scene, base).vary(law_values(law))
                    only = ("latency_us",) if quick else ()
                    found.append(compare(pool, setup, law, only, values))
                except SceneError as error:
                    out.say(f"{law} is left out: {error}")
        if not found:
            fail(f"no law has a budget in {scene}.", 1)
        results.write("budget_agreement", found)
        results.table(
            f"limits in {scene}",
            {
                "law": "{.law}",
                "differences": lambda a: a.differences or "none",
                "search, s": "{.search_s:.2f}",
                "brute force, s": "{.brute_force_s:.2f}",
                "ratio": "{.ratio:.3f}",
            },
            found,
            text=2,
        )
        differ, limits = sum(a.differ for a in found), sum(a.limits for a in found)
        results.conclude(
            f"Of {limits} limits {differ} differ from brute force, and the search takes "
            f"{min(a.ratio for a in found):.2f} to {max(a.ratio for a in found):.2f} of its time."
        )


if __name__ == "__main__":
    start("benchmarks.budget_agreement")
