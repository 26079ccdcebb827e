"""Limits of `hertzloop budget` against brute force: every value of a quantity in every variant.

`python -m benchmarks.budget_agreement aluminium-3mm force_feedback predicted` prints for each law
where the two differ, and the time of each.
"""

import sys
import time
from typing import Any

from benchmarks.latency import LAWS, law_values
from hertzloop.scenes.errors import SceneError
from hertzloop.setup import Setup, load
from hertzloop.studies.budget.budget import search_of
from hertzloop.studies.budget.goal import DEFAULT_GOAL, all_met, parse_goal
from hertzloop.studies.budget.limits import (
    Boundary,
    Limit,
    Quantity,
    Search,
    limit_of,
    quantities_of,
    side_by_side,
    variants,
)
from hertzloop.studies.sweeps.evaluate import Pool, Rows, evaluate
from hertzloop.studies.sweeps.pool import local_pool

# As long as a sphere needs to leave; the search then simulates the same runs as brute force.
DURATIONS_S = {
    "aluminium-3mm": 0.0016, "offcentre-6mm": 0.0016, "aluminium-20mm": 0.004, "oak-20mm": 0.008,
}  # fmt: skip


def by_brute_force(
    pool: Pool, setup: Setup, quantity: Quantity, search: Search
) -> tuple[float | None, bool]:
    """Return the limit of a quantity, None where there is none in the range, and whether the
    tolerated values are an interval."""
    goals, each = [parse_goal(DEFAULT_GOAL)], variants(quantity, search)
    cases = [{quantity.key: value} | one for value in quantity.values for one in each]
    rows = evaluate(pool, setup, "impact", cases)
    holds = [all(all_met(goals, row) for row in rows[i : i + len(each)])
             for i in range(0, len(rows), len(each))]  # fmt: skip
    first_bad = holds.index(False) if False in holds else len(holds)
    none = first_bad in (0, len(holds))
    return None if none else quantity.reported(first_bad - 1), not any(holds[first_bad:])


def compare(pool: Pool, setup: Setup) -> tuple[list[str], float, float]:
    """Return the differences in words, and the time of the search and of brute force, s."""
    search, goals = search_of(setup, False, "impact"), [parse_goal(DEFAULT_GOAL)]

    def run(cases: list[dict[str, Any]]) -> Rows:
        return evaluate(pool, setup, "impact", cases)

    run([{}])
    began_s = time.perf_counter()
    quantities = quantities_of(setup)
    limits: list[Limit] = side_by_side([limit_of(q, goals, search) for q in quantities], run)
    searched_s, found = time.perf_counter() - began_s, []
    began_s = time.perf_counter()
    for quantity, limit in zip(quantities, limits, strict=True):
        if limit.boundary is Boundary.IMPOSSIBLE:
            continue
        value, interval = by_brute_force(pool, setup, quantity, search)
        if value != limit.value:
            found.append(f"{quantity.name}: {limit.value} for {value}")
        elif interval != limit.interval:
            found.append(f"{quantity.name}: a gap was not seen")
    return found, searched_s, time.perf_counter() - began_s


def main(scene: str, laws: list[str]) -> None:
    """Print the comparison for laws in a scene."""
    base = [f"run.duration_s={DURATIONS_S[scene]}"] if scene in DURATIONS_S else []
    with local_pool(1) as pool:
        for law in laws or LAWS:
            try:
                setup = load(scene, base).vary(law_values(law))
                found, searched_s, brute_s = compare(pool, setup)
            except SceneError as error:
                print(f"{scene}, {law}: {error}")
                continue
            words = "; ".join(found) or "no difference"
            print(f"{scene}, {law}: {searched_s:.2f} s, {brute_s:.2f} s by brute force; {words}",
                  flush=True)  # fmt: skip


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
