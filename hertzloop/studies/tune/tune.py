"""Search for the laws and parameters with the best metrics in a scene.

Over a set of scenes the worst of them counts, metric by metric.
"""

from collections.abc import Callable
from dataclasses import replace

from hertzloop.studies.cases.evaluate import CaseTally
from hertzloop.studies.cases.journal import FinishedCases
from hertzloop.studies.cases.pool import local_pool
from hertzloop.studies.tune.plan import TunePlan
from hertzloop.studies.tune.result import Candidate, TuneResult, best_first
from hertzloop.studies.tune.score import published_setting, unstable_loop, with_spreads
from hertzloop.studies.tune.search import front, search_law


def tune(
    plan: TunePlan,
    finished: FinishedCases | None = None,
    on_progress: Callable[[int], None] = lambda generations: None,
) -> TuneResult:
    """Search the settings of the laws of a plan that no other setting beats.

    Args:
        plan: What to search.
        finished: Cases that an earlier start has finished, if they are kept.
        on_progress: Called with the number of finished generations of all laws.

    Raises:
        SceneError: a scene cannot be simulated.
        WorkersLost: a worker process was lost.
    """
    request, tally = plan.request, CaseTally()
    found: list[Candidate] = []
    with local_pool(request.workers) as workers:
        pool = tally.counting(workers if finished is None else finished.skipping_finished(workers))
        published = published_setting(pool, plan)
        for before, law in enumerate(plan.axes):
            done = before * request.generations
            found += search_law(pool, plan, law, lambda n, done=done: on_progress(done + n))  # type: ignore[misc]
        best = front(found, request.minimise)
        published, *best = with_spreads(pool, plan, [published, *best_first(best, published)])
    growths = [unstable_loop(plan.variants, candidate.values) for candidate in best]
    return TuneResult(
        minimise=tuple(request.minimise),
        span=request.span,
        at_most=dict(request.at_most),
        front=[
            replace(candidate, unstable_loop=growth)
            for candidate, growth in zip(best, growths, strict=True)
        ],
        published=published,
        failed=[row["status"] for row in tally.without_result],
        cases=tally.cases,
        ran=tally.cases if finished is None else finished.ran,
    )
