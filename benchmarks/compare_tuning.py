"""`hertzloop tune` beside Optuna: the same objectives, ranges and number of trials."""

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from benchmarks.program import OutDirOption, QuickOption, start, tracked
from benchmarks.results import results_in
from benchmarks.scenes import load
from hertzloop.cli.options import JsonOption
from hertzloop.cli.prepare import compile_first
from hertzloop.common.optional_dependencies import need
from hertzloop.scene.setup import Setup
from hertzloop.studies.cases.axis import fitted
from hertzloop.studies.cases.evaluate import Pool
from hertzloop.studies.cases.pool import local_pool
from hertzloop.studies.tune.plan import TunePlan, plan_tune
from hertzloop.studies.tune.request import TuneRequest
from hertzloop.studies.tune.score import worst_of

if TYPE_CHECKING:
    from optuna.samplers import BaseSampler

_SCENES = ("aluminium-3mm", "offcentre-6mm")
_LAW = "predicted"
_OBJECTIVES = ("plate_energy_db", "rebound_percent")
_WORST = (0.0, 300.0)  # corner of the area that a front dominates: no gain, three times the height
_SEEDS = (1, 2, 3)

OURS = "hertzloop tune"
TPE, NSGA2 = "Optuna, TPE", "Optuna, NSGA-II"


class Task(NamedTuple):
    """A scene, what is minimised in it, and how long is searched for it."""

    scene: str
    setup: Setup
    search: TuneRequest

    def plan(self) -> TunePlan:
        """The search that hertzloop runs."""
        return plan_tune([self.setup], self.search)


class Outcome(NamedTuple):
    """Metrics found, (settings, objectives), and the processor time of the search, s."""

    metrics: np.ndarray
    seconds: float


@dataclass(frozen=True)
class Comparison:
    """A searcher over all seeds: median value, and median processor time, s.

    The value of one objective is the least plate energy, dB. That of two is the area that the
    front dominates, in per cent of that of all fronts of the scene together.
    """

    scene: str
    objectives: int
    searcher: str
    median: float
    seconds: float


def by_hertzloop(pool: Pool, task: Task) -> Outcome:
    """The settings that `hertzloop tune` returns."""
    from hertzloop.studies.tune.search import search_law  # of an extra

    began = time.process_time()
    found = search_law(pool, task.plan(), _LAW)
    seconds = time.process_time() - began
    return Outcome(np.array([list(one.metrics.values()) for one in found]), seconds)


def by_optuna(pool: Pool, task: Task, sampler: "BaseSampler") -> Outcome:
    """All settings that a sampler of Optuna tried, a generation at a time."""
    import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    plan, search, law = task.plan(), task.search, {"controller.law": _LAW}
    axes = [fitted(axis, task.setup.vary(law)) for axis in plan.axes[_LAW]]
    began = time.process_time()
    study = optuna.create_study(directions=["minimize"] * len(search.minimise), sampler=sampler)
    tried = []
    for _ in range(search.generations):
        trials = [study.ask() for _ in range(search.population)]
        cases = [
            law
            | {
                axis.key: axis.at_resolution(trial.suggest_float(axis.key, axis.low, axis.high))
                for axis in axes
            }
            for trial in trials
        ]
        metrics = worst_of(pool, plan, cases, search.minimise)
        for trial, values in zip(trials, metrics, strict=True):
            study.tell(trial, values.tolist())
        tried.append(metrics)
    return Outcome(np.concatenate(tried), time.process_time() - began)


def value_of(metrics: np.ndarray) -> float:
    """The least of one objective, or the area that two dominate."""
    if metrics.shape[1] == 1:
        return float(np.min(metrics))
    from pymoo.indicators.hv import HV

    return float(HV(ref_point=np.array(_WORST))(metrics))


def searched(task: Task, seed: int) -> dict[str, Outcome]:
    """What each searcher finds with a seed, on one core."""
    from optuna.samplers import NSGAIISampler, TPESampler

    samplers: dict[str, Callable[[], BaseSampler]] = {TPE: lambda: TPESampler(seed=seed)}
    if len(task.search.minimise) > 1:
        size = task.search.population
        samplers[NSGA2] = lambda: NSGAIISampler(seed=seed, population_size=size)
    with local_pool(1) as pool:
        found = {OURS: by_hertzloop(pool, task)}
        return found | {name: by_optuna(pool, task, make()) for name, make in samplers.items()}


def compared(task: Task, seeds: Sequence[dict[str, Outcome]]) -> list[Comparison]:
    """One line a searcher."""
    names = list(seeds[0])
    values = {name: [value_of(one[name].metrics) for one in seeds] for name in names}
    if len(task.search.minimise) > 1:
        whole = value_of(np.concatenate([o.metrics for one in seeds for o in one.values()]))
        values = {name: [100.0 * one / whole for one in of] for name, of in values.items()}
    return [
        Comparison(
            task.scene,
            len(task.search.minimise),
            name,
            statistics.median(of),
            statistics.median(one[name].seconds for one in seeds),
        )
        for name, of in values.items()
    ]


def main(
    out_dir: OutDirOption = None, quick: QuickOption = False, json_file: JsonOption = None
) -> None:
    """Search for the best settings of a law with `hertzloop tune` and with Optuna, each 1000 trials
    and three seeds.

    Example: python -m benchmarks.compare_tuning --quick
    """
    with results_in(out_dir, "compare-tuning", json_file=json_file) as results:
        need("pymoo", "optuna")
        generations, seeds = (3, _SEEDS[:1]) if quick else (TuneRequest().generations, _SEEDS)
        tasks = []
        for scene in _SCENES[:1] if quick else _SCENES:
            setup = load(scene)
            compile_first(setup)
            for count in (1, 2):
                search = TuneRequest(
                    laws=[_LAW], minimise=_OBJECTIVES[:count], generations=generations
                )
                tasks.append(Task(scene, setup, search))
        found: list[Comparison] = []
        for task in tracked("searches", tasks):
            outcomes = []
            for seed in seeds:
                search = replace(task.search, seed=seed)
                outcomes.append(searched(task._replace(search=search), seed))
            found += compared(task, outcomes)
        results.write("tuning", found)
        trials = generations * TuneRequest().population
        for count, title in ((1, "least plate energy, dB"), (2, "dominated area, %")):
            results.table(
                f"{title}: {trials} trials, {len(seeds)} seeds",
                {
                    "scene": "{.scene}",
                    "searcher": "{.searcher}",
                    "median": "{.median:.4g}",
                    "s": "{.seconds:.1f}",
                },
                [one for one in found if one.objectives == count],
                text=2,
            )
        at = {(one.objectives, one.searcher): one for one in found if one.scene == _SCENES[0]}
        results.conclude(
            f"In {_SCENES[0]} hertzloop finds {at[1, OURS].median:.2f} dB and TPE "
            f"{at[1, TPE].median:.2f} dB, which takes "
            f"{at[1, TPE].seconds / at[1, OURS].seconds:.1f} times as long; of two objectives "
            f"hertzloop's front has {at[2, OURS].median:.1f} % of the area, that of TPE "
            f"{at[2, TPE].median:.1f} %."
        )


if __name__ == "__main__":
    start("benchmarks.compare_tuning")
