"""Limits of `hertzloop budget` against brute force: every value of a quantity in every variant."""

import time
from dataclasses import asdict, dataclass
from typing import Annotated, Any

import typer

from benchmarks.latency import LAWS, law_values
from benchmarks.program import (
    JsonOption,
    OutDirOption,
    QuickOption,
    SceneArgument,
    bars,
    check_json,
    conclude,
    fail,
    number_table,
    out,
    results_in,
    start,
    tracked,
    write_json,
    written,
)
from hertzloop.scenes.errors import SceneError
from hertzloop.scenes.scene import DEFAULT
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
from hertzloop.studies.words import write_rows

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


@dataclass(frozen=True)
class Agreement:
    """Search and brute force for a law: `differences` in words, processor times in s."""

    law: str
    differences: tuple[str, ...]
    limits: int
    searched_s: float
    brute_s: float

    @property
    def ratio(self) -> float:
        """Time of the search over that of brute force."""
        return self.searched_s / self.brute_s


def compare(pool: Pool, setup: Setup, law: str, only: tuple[str, ...] = ()) -> Agreement:
    """Compare the limits of all quantities, or of those named `only`."""
    search, goals = search_of(setup, False, "impact"), [parse_goal(DEFAULT_GOAL)]

    def run(cases: list[dict[str, Any]]) -> Rows:
        return evaluate(pool, setup, "impact", cases)

    quantities = [q for q in quantities_of(setup) if not only or q.name in only]
    run([{q.key: q.values[place]} for q in quantities for place in (1, -1)])  # compiles
    began_s = time.process_time()
    limits: list[Limit] = side_by_side([limit_of(q, goals, search) for q in quantities], run)
    searched_s, found = time.process_time() - began_s, []
    began_s = time.process_time()
    for quantity, limit in zip(quantities, limits, strict=True):
        if limit.boundary is Boundary.IMPOSSIBLE:
            continue
        value, interval = by_brute_force(pool, setup, quantity, search)
        if value != limit.value:
            found.append(f"{quantity.name}: {limit.value} for {value}")
        elif interval != limit.interval:
            found.append(f"{quantity.name}: a gap was not seen")
    return Agreement(law, tuple(found), len(limits), searched_s, time.process_time() - began_s)


def main(
    scene: SceneArgument = DEFAULT,
    folder: OutDirOption = None,
    laws: Annotated[
        list[str] | None, typer.Option("--law", help="Try only this law; repeatable.")
    ] = None,
    quick: QuickOption = False,
    json_file: JsonOption = None,
) -> None:
    """Compare the limits of `hertzloop budget` with brute force.

    Brute force simulates every value of a quantity in every variant. With --quick there is one law,
    and the latency alone.

    Example: python -m benchmarks.budget_agreement aluminium-3mm --quick
    """
    check_json(json_file)
    base = [f"run.duration_s={DURATIONS_S[scene]}"] if scene in DURATIONS_S else []
    found = []
    with results_in(folder, "budget_agreement", "modal") as made:
        with local_pool(1) as pool:
            for law in tracked("laws", laws or (["force_feedback"] if quick else LAWS)):
                try:
                    setup = load(scene, base).vary(law_values(law))
                    only = ("latency_us",) if quick else ()
                    found.append(compare(pool, setup, law, only))
                except SceneError as error:
                    out.print(f"{law} is left out: {error}", soft_wrap=True)
        if not found:
            fail(f"no law has a budget in {scene}.", 1)
        columns = ("law", "limits", "differences", "search_s", "brute_force_s", "ratio")
        rows = [(a.law, a.limits, "; ".join(a.differences), a.searched_s, a.brute_s, a.ratio)
                for a in found]  # fmt: skip
        write_rows(made / "budget_agreement.csv", columns, (list(row) for row in rows))
        bars(made / "budget_agreement.png", f"Budget of {scene}", "time of brute force",
             [(a.law, a.ratio) for a in found], log=True)  # fmt: skip
    cells = [(a.law, "; ".join(a.differences) or "none", f"{a.searched_s:.2f}", f"{a.brute_s:.2f}",
              f"{a.ratio:.3f}") for a in found]  # fmt: skip
    headings = ("law", "differences", "search, s", "brute force, s", "ratio")
    out.print(number_table(f"limits in {scene}", headings, cells, text=2))
    written(made, "budget_agreement.csv", "budget_agreement.png")
    differ, limits = sum(len(a.differences) for a in found), sum(a.limits for a in found)
    conclude(
        f"Of {limits} limits {differ} differ from brute force, and the search takes "
        f"{min(a.ratio for a in found):.2f} to {max(a.ratio for a in found):.2f} of its time."
    )
    write_json(json_file, {"agreement": [asdict(a) for a in found]})


if __name__ == "__main__":
    start("benchmarks.budget_agreement")
