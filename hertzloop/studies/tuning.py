"""Search for the law and its parameters that do best in a scene, or in all of a set of scenes.

One objective: differential evolution; several: NSGA-II (Deb et al. 2002), both from pymoo.
Over a set of scenes the worst of them counts, objective by objective.
"""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pymoo.algorithms.moo.nsga2 import NSGA2
from pymoo.algorithms.soo.nonconvex.de import DE
from pymoo.core.problem import Problem
from pymoo.optimize import minimize
from pymoo.util.nds.non_dominated_sorting import NonDominatedSorting

from hertzloop.common.atomic_files import atomic_write
from hertzloop.controller.law import LawContext
from hertzloop.controller.loading.law import LawError
from hertzloop.controller.loading.registry import find, resolve, shipped
from hertzloop.results.cases import Span
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup
from hertzloop.studies import words
from hertzloop.studies.margin.margin import Growth, growth_of
from hertzloop.studies.requests import TuneRequest
from hertzloop.studies.sweeps.design import (
    Axis,
    Design,
    DesignError,
    Spread,
    at_all,
    fitted,
    spread_over,
)
from hertzloop.studies.sweeps.evaluate import Pool, evaluate
from hertzloop.studies.sweeps.sweep import work_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Tried where the user names no law.
LAWS = (
    "slope_threshold",
    "least_squares",
    "shifted_threshold",
    "predicted",
    "fade_out",
    "force_feedback",
    "velocity_feedback",
    "acceleration_feedback",
)


@dataclass(frozen=True)
class Candidate:
    """A setting and its metrics.

    Attributes:
        values: values by scene key.
        metrics: minimised metrics by name, the worst of the scenes.
        spreads: mean and range over touch phases by metric, for the scene with the worst mean;
            empty where not computed.
    """

    values: dict[str, Any]
    metrics: dict[str, float]
    spreads: dict[str, Spread] = field(default_factory=dict)


@dataclass(frozen=True)
class Tuned:
    """Settings that no other beats, the published one, and what was asked for: scenes as TOML,
    metrics, the span, limits, the command that finds them again."""

    scenes: Sequence[str]
    objectives: Sequence[str]
    span: str
    at_most: Mapping[str, float]
    front: list[Candidate]
    published: Candidate
    verdict: Sequence[str]
    failed: int
    command: str
    versions: str


def write_tuned(path: Path, tuned: Tuned) -> None:
    """Write a JSON file. Raises NotWritten."""
    data = asdict(tuned)
    for found in (*data["front"], data["published"]):
        for spread in found["spreads"].values():  # JSON knows no nan
            spread.update({k: None if math.isnan(v) else v for k, v in spread.items()})
    text = json.dumps({"tuned": data}, indent=2, allow_nan=False)
    atomic_write(path, text + "\n")


def read_tuned(path: Path) -> Tuned:
    """Raises ValueError for another kind of file."""
    try:
        data = json.loads(path.read_bytes())["tuned"]
        front = [_candidate(one) for one in data.pop("front")]
        return Tuned(front=front, published=_candidate(data.pop("published")), **data)
    except FileNotFoundError as error:
        raise ValueError(f"{path}: no such results. Give a file that a sweep wrote.") from error
    except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
        raise ValueError(f"{path} holds no results of a tuning: {error}") from error


def _candidate(data: dict[str, Any]) -> Candidate:
    spreads = {
        name: Spread(**{k: math.nan if v is None else v for k, v in spread.items()})
        for name, spread in data["spreads"].items()
    }
    return Candidate(data["values"], data["metrics"], spreads)


PUBLISHED: dict[str, Any] = {
    "controller.law": "slope_threshold",
    "controller.kappa": 0.8,
    "controller.v_thr_m_s": -0.25,
}
_BAD = 1e6  # of a case without metrics: unstable, or impossible


def header_of(
    scenes: list[Setup], laws: tuple[str, ...], axes: tuple[Axis, ...], search: TuneRequest
) -> dict[str, Any]:
    """What decides which settings a search tries, and what comes of them: its scenes, laws with
    their digests, given `axes`, its `search`, versions."""
    own = {"axes": [asdict(axis) for axis in axes], "search": asdict(search)}
    return work_of(scenes, laws, Design(axes)) | own


def ranges_of(law: str, impact_speed_m_s: float) -> tuple[Axis, ...]:
    """What is varied of a law if nothing else is asked for. Raises SceneError."""
    about = LawContext(impact_speed_m_s=impact_speed_m_s)
    try:
        ranges = find(resolve(law)).ranges(about).items()
    except LawError as error:
        raise SceneError(str(error)) from error
    return tuple(Axis(f"controller.{key}", (), low, high) for key, (low, high) in ranges)


def axes_of(law: str, given: tuple[Axis, ...], impact_speed_m_s: float) -> tuple[Axis, ...]:
    """What is varied of a law: the axes `given`, else its own. Raises DesignError where it has
    none, SceneError where it cannot say."""
    axes = given or ranges_of(law, impact_speed_m_s)
    if not axes:
        others = ", ".join(name for name in shipped() if ranges_of(name, impact_speed_m_s))
        raise DesignError(
            f"controller.law = '{law}' has no parameters to tune. Use one of {others}, or name "
            "other scene keys with --vary"
        )
    return axes


def fastest_m_s(scenes: Sequence[Setup]) -> float:
    """Largest impact speed of the scenes."""
    return max(setup.plant.sphere.impact_speed_m_s for setup in scenes)


def _value(axis: Axis, x: float) -> Any:
    if axis.values:
        return axis.values[min(int(x), len(axis.values) - 1)]
    return axis.at_resolution(float(x))


class _Settings(Problem):
    """Parameters of a law as an optimisation problem; all cases of a generation at once."""

    def __init__(
        self,
        pool: Pool,
        scenes: list[Setup],
        fixed: dict[str, Any],
        axes: tuple[Axis, ...],
        search: TuneRequest,
    ) -> None:
        self.pool, self.scenes, self.search = pool, scenes, search
        coarsest = max(scenes, key=lambda setup: setup.step_ns)
        # By the law that is tried: the scenes' own may not have its keys.
        of_law = coarsest.vary(fixed)
        axes = tuple(fitted(axis, of_law) for axis in axes)
        self.fixed, self.axes = fixed, axes
        low = [0.0 if axis.values else axis.low for axis in axes]
        high = [len(axis.values) - 1e-9 if axis.values else axis.high for axis in axes]
        super().__init__(
            n_var=len(axes),
            n_obj=len(search.objectives),
            n_ieq_constr=len(search.at_most) + search.require_stable,
            xl=low,
            xu=high,
        )

    def settings(self, x: np.ndarray) -> dict[str, Any]:
        pairs = zip(self.axes, x, strict=True)
        return self.fixed | {axis.key: _value(axis, float(v)) for axis, v in pairs}

    def _evaluate(self, x: np.ndarray, out: dict[str, Any], *_: Any, **__: Any) -> None:
        search = self.search
        names, wanted = [*search.objectives, *search.at_most], len(search.objectives)
        cases = [self.settings(p) for p in x]
        growths = [
            unstable_loop(self.scenes, case) if search.require_stable else None for case in cases
        ]
        stable = [i for i, growth in enumerate(growths) if growth is None]
        worst = np.full((len(cases), len(names)), _BAD)
        if stable:
            tried = [cases[i] for i in stable]
            worst[stable] = worst_of(
                self.pool, self.scenes, search.span, tried, names, search.phases
            )
        out["F"] = worst[:, :wanted]
        excess = [worst[:, wanted:] - np.array(list(search.at_most.values()))]
        if search.require_stable:  # the growth leads the search to where there is none
            excess.append(np.array([[_growth_per_s(growth)] for growth in growths]))
        out["G"] = np.concatenate(excess, axis=1)


def _growth_per_s(growth: Growth | None) -> float:
    """Growth of an unstable loop, 1/s; 0 of a stable one, and a large number if undecided."""
    if growth is None:
        return 0.0
    return _BAD if growth.per_s is None else growth.per_s


def worst_of(
    pool: Pool,
    scenes: list[Setup],
    span: Span,
    cases: list[dict[str, Any]],
    names: list[str],
    phases: int = 1,
) -> np.ndarray:
    """Largest metric over the scenes, shape (cases, names), each the mean over so many `phases` of
    the touch, or at the scene's own if that is 1; _BAD where there is none."""

    def metric(row: dict[str, Any], name: str) -> float:
        value = _BAD if row["status"] else float(row[name])
        return _BAD if math.isnan(value) else value

    tried = cases if phases == 1 else [c for case in cases for c in at_all(case, phases)]
    found = np.array(
        [
            [[metric(row, name) for name in names] for row in evaluate(pool, setup, span, tried)]
            for setup in scenes
        ]
    ).reshape(len(scenes), len(cases), phases, len(names))
    means = np.where((found >= _BAD).any(axis=2), _BAD, found.mean(axis=2))
    return np.asarray(means.max(axis=0))


def unstable_loop(scenes: Sequence[Setup], values: dict[str, Any]) -> Growth | None:
    """Return the fastest growth of an unstable linear loop over the scenes under a setting; None
    where every loop is stable in flight, or is not linear."""
    found = []
    for setup in scenes:
        with suppress(SceneError):  # a setting that a scene refuses has no metrics either
            growth = growth_of(setup.vary(values))
            if growth is not None and growth.unstable_poles != 0:
                found.append(growth)
    return max(found, key=lambda g: math.inf if g.per_s is None else g.per_s, default=None)


def with_spreads(
    pool: Pool, scenes: list[Setup], span: Span, found: list[Candidate], names: Sequence[str]
) -> list[Candidate]:
    """The same settings with mean and range of their metrics over the touch phase."""
    cases = [f.values for f in found]
    tried = [spread_over(pool, setup, span, cases, tuple(names)) for setup in scenes]

    def worst(i: int, name: str) -> Spread:
        return max((spreads[i][name] for spreads in tried), key=lambda s: s.mean)

    return [replace(f, spreads={n: worst(i, n) for n in names}) for i, f in enumerate(found)]


def tune(
    pool: Pool,
    scenes: list[Setup],
    law: str,
    axes: tuple[Axis, ...],
    search: TuneRequest,
    on_progress: Callable[[int], None] = lambda generation: None,
) -> list[Candidate]:
    """Best settings of one law: the one that is best, or the Pareto front of several objectives,
    sorted by the first. Empty if none keeps to the limits or is stable."""
    problem = _Settings(pool, scenes, {"controller.law": law}, axes, search)
    objectives = search.objectives
    algorithm = (DE if len(objectives) == 1 else NSGA2)(pop_size=search.population)
    result = minimize(
        problem,
        algorithm,
        ("n_gen", search.generations),
        seed=search.seed,
        callback=lambda algorithm: on_progress(algorithm.n_gen),
    )
    if result.X is None:
        return []
    points, values = np.atleast_2d(result.X), np.atleast_2d(result.F)
    found = [
        Candidate(problem.settings(x), dict(zip(objectives, (float(v) for v in f), strict=True)))
        for x, f in zip(points, values, strict=True)
        if np.all(f < _BAD)
    ]
    return sorted(found, key=lambda f: f.metrics[objectives[0]])


def best_of(
    pool: Pool,
    scenes: list[Setup],
    laws: Sequence[str],
    given: tuple[Axis, ...],
    search: TuneRequest,
    on_progress: Callable[[int], None] = lambda generation: None,
) -> list[Candidate]:
    """The settings of several laws that no other beats; axes are those of each law where none are
    `given`, `on_progress` counts the generations of all. Raises DesignError for a law without."""
    speed = fastest_m_s(scenes)
    searched = [(law, axes_of(law, given, speed)) for law in laws]
    found: list[Candidate] = []
    for i, (law, axes) in enumerate(searched):
        before = i * search.generations
        found += tune(
            pool,
            scenes,
            law,
            axes,
            search,
            lambda n, before=before: on_progress(before + n),  # type: ignore[misc]
        )
    return front(found, search.objectives)


def front(found: list[Candidate], objectives: Sequence[str]) -> list[Candidate]:
    """Those that no other beats in every objective, sorted by the first."""
    if not found:
        return []
    values = np.array([[f.metrics[name] for name in objectives] for f in found])
    best = NonDominatedSorting().do(values, only_non_dominated_front=True)
    unique = {tuple(values[i]): found[i] for i in best}
    return [unique[key] for key in sorted(unique)]


def published(
    pool: Pool, scenes: list[Setup], span: Span, objectives: Sequence[str], phases: int = 1
) -> Candidate:
    """The published setting of the slope-threshold law in the same scenes."""
    worst = worst_of(pool, scenes, span, [PUBLISHED], list(objectives), phases)[0]
    return Candidate(PUBLISHED, dict(zip(objectives, (float(v) for v in worst), strict=True)))


def better_than(
    reference: Candidate, found: list[Candidate], gain: str, keep: str
) -> Candidate | None:
    """The setting with the least `gain` among those that do not raise `keep`; None if none has
    less than the reference."""
    allowed = [f for f in found if f.metrics[keep] <= reference.metrics[keep]]
    best = min(allowed, key=lambda f: f.metrics[gain], default=None)
    return best if best and best.metrics[gain] < reference.metrics[gain] else None


def draw_front(
    path: Path, title: str, best: list[Candidate], reference: Candidate, objectives: Sequence[str]
) -> None:
    """Write the Pareto front as PNG."""
    from hertzloop.studies import pictures  # matplotlib belongs to an extra

    pictures.save(front_sheet(title, best, reference, objectives), path)


def front_sheet(
    title: str, best: list[Candidate], reference: Candidate, objectives: Sequence[str]
) -> "Figure":
    """The settings found, law by law, over the first two objectives (or over their number)."""
    from hertzloop.studies import pictures  # matplotlib belongs to an extra

    sheet, axes = pictures.sheet(1, 1, width=8.5, height=4.2)
    ax = axes[0, 0]
    x, y = objectives[0], objectives[1] if len(objectives) > 1 else objectives[0]
    for i, law in enumerate(dict.fromkeys(f.values["controller.law"] for f in best)):
        mine = [f for f in best if f.values["controller.law"] == law]
        look = pictures.look(i, marked=True) | {"linestyle": ""}
        ax.plot(
            [f.metrics[x] for f in mine], [f.metrics[y] for f in mine], label=words.law(law), **look
        )
    ax.plot(
        reference.metrics[x], reference.metrics[y], "k*", markersize=13, label="published setting"
    )
    ax.set(xlabel=words.against_none(x), ylabel=words.against_none(y), title=title)
    sheet.legend(loc="outside right upper")
    return sheet
