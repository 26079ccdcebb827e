"""The budget of a law in a scene: its effect, its limits, in the scene's and in a real plant."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from hertzloop.results.cases import OTHER, CaseState, Span
from hertzloop.scene.controller import mean_latency_us
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup
from hertzloop.studies.budget.goal import METRICS, Goal, all_met, worst_excess
from hertzloop.studies.budget.limits import (
    BudgetLimit,
    Case,
    Search,
    contact_us,
    converter_width,
    limit_of,
    quantities_of,
    side_by_side,
)
from hertzloop.studies.budget.stability import linear_margin, tolerated
from hertzloop.studies.budget.worst_limit import WorstLimit, worst_limit
from hertzloop.studies.margin.margin import Margin
from hertzloop.studies.requests import BudgetRequest
from hertzloop.studies.sweeps.design import Spread, phases, spread_of
from hertzloop.studies.sweeps.evaluate import Pool, Rows, evaluate

_PHASES, _QUICK_PHASES = 5, 3
_SEEDS, _QUICK_SEEDS = 3, 1
_POINTS, _QUICK_POINTS = 10, 5
# Contact times after the touch that a search simulates at most, and the run that confirms it.
_SHORT_CONTACTS, _LONG_CONTACTS = 60.0, 400.0
# A plate in three dimensions takes a hundred times as long as a thin one.
_QUICK_WITHOUT = ("plate.theory", "run.accuracy")

# At an accuracy of 1e-3 a solid's modes end at 244 kHz, and velocity fed back 3, 7 or 11 us late
# excites that end: an instability that modes up to half the sampling frequency do not show.
REAL: dict[str, Any] = {
    "run.accuracy": 1e-4,
    "contact.plasticity": "thornton",
    "plate.theory": "3d",
    "actuator.bandwidth_hz": 300e3,
    "actuator.damping": 0.7,
    "sensors.bits": 16,
}
NOISE = 1e-4  # rms, of the converter's range, in the real plant


@dataclass(frozen=True)
class Baseline:
    """What a law does in a scene as it is: metrics against no control at the scene's own touch
    phase, their spread over phases, whether the goals are met at every phase, and whether the loop
    was unstable at one of them."""

    metrics: dict[str, float]
    over_phases: dict[str, Spread]
    met: bool
    unstable: bool
    missed: tuple[str, ...]


@dataclass(frozen=True)
class InPlant:
    """Effect by metrics of a span, and limits, in one plant; `margin`: the linear margin, None for
    a law that has none; `binds_first`: the quantity whose limit is the nearest, by
    `BudgetLimit.share`, None where no limit was found; `left_out`: keys of the real plant that the
    scene does not accept."""

    span: Span
    nominal: Baseline
    margin: Margin | None
    limits: tuple[BudgetLimit, ...]
    binds_first: str | None
    left_out: tuple[str, ...] = ()

    @property
    def unstable(self) -> bool | None:
        """Whether the loop is unstable, in a run or by linear theory; None if unknown."""
        if self.nominal.unstable:
            return True
        stable = None if self.margin is None else self.margin.stable
        return None if stable is None else not stable


@dataclass(frozen=True)
class Budget:
    """The answer of `hertzloop budget`; `real` is None where it was not asked for, and so is
    `other`, the scene by metrics of the other span; `other_db`: its change of the plate energy,
    None without one; `worst`: the limit of jitter against the worst sequence, if asked for."""

    scene: str
    law: str
    span: Span
    goals: tuple[Goal, ...]
    ideal: InPlant
    real: InPlant | None
    other: InPlant | None
    other_db: float | None
    cases: int
    worst: WorstLimit | None = None


def search_of(setup: Setup, quick: bool, span: Span) -> Search:
    """Return how thoroughly to search. See `limits` on the short runs of the search."""
    seeds = _QUICK_SEEDS if quick else _SEEDS
    short_s = setup.first_touch_s + _SHORT_CONTACTS * 1e-6 * contact_us(setup)
    long_s = setup.first_touch_s + _LONG_CONTACTS * 1e-6 * contact_us(setup)
    first = span == "impact"
    return Search(
        phases=phases(_QUICK_PHASES if quick else _PHASES),
        seeds=tuple(setup.seed + i for i in range(seeds)),
        points=_QUICK_POINTS if quick else _POINTS,
        short_s=float(f"{short_s:.3g}") if first and 2.0 * short_s < setup.duration_s else None,
        long_s=float(f"{long_s:.3g}") if first and long_s < setup.duration_s else None,
    )


def real_plant(setup: Setup, quick: bool = False) -> tuple[Setup, tuple[str, ...]]:
    """Return the scene with a contact that yields, a solid plate, an actuator with a bandwidth, and
    a converter with noise, each where the scene is ideal and accepts it.

    Args:
        setup: The scene.
        quick: Leave the plate thin, which costs a hundredth of the time.

    Returns:
        The setup, and the keys that the scene does not accept.
    """
    found, left_out = setup, []
    for key, value in REAL.items():
        if quick and key in _QUICK_WITHOUT:
            continue
        if not _is_ideal(setup, key):
            continue
        try:
            tried = found.vary({key: value})
            _ = tried.plant, tried.sensor  # a stage may refuse what the tables accept
            found = tried
        except SceneError:
            left_out.append(key)
    width = converter_width(found)
    if width and not found.scene.sensors.noise_rms:
        found = found.vary({"sensors.noise_rms": NOISE * width})
    return found, tuple(left_out)


def _is_ideal(setup: Setup, key: str) -> bool:
    """Whether a scene leaves a key as it is by default: what it says otherwise stays."""
    table, _, name = key.partition(".")
    given = getattr(setup.scene, table)
    if key in ("run.accuracy", "actuator.damping"):
        return key == "run.accuracy" or setup.scene.actuator.bandwidth_hz is None
    return bool(getattr(given, name) == type(given).model_fields[name].default)


def budget(
    pool: Pool,
    setup: Setup,
    goals: Sequence[Goal],
    request: BudgetRequest,
    on_progress: Callable[[float], None] = lambda share: None,
) -> Budget:
    """Measure the budget of the law of a scene.

    Args:
        pool: Runs cases, see `local_pool`.
        setup: The scene with its law.
        goals: What the law has to do, all of it.
        request: What to search, how finely, and by the metrics of which span.
        on_progress: Is told the finished share of the work.

    Raises:
        SceneError: the scene has no law, or its nominal case cannot be run.
    """
    if not setup.has_law:
        raise SceneError(
            "controller.law = 'off': has no limits. Name a law, for example --law slope_threshold"
        )
    span, both, quick = request.first_span, request.span == "both", request.quick
    with_real, names = request.with_real, request.only
    parts = 1 + with_real + both
    counted = [0]

    def of_plant(
        found: Setup, part: int, left_out: tuple[str, ...] = (), span: Span = span
    ) -> InPlant:
        def run(cases: list[Case]) -> Rows:
            counted[0] += len(cases)
            return evaluate(pool, found, span, cases)

        search = search_of(found, quick, span)
        nominal = nominal_of(run, found, goals, search, whole=part == 0)
        wanted = [q for q in quantities_of(found) if q.name in names or not names]
        searched = side_by_side(
            [limit_of(q, goals, search) for q in wanted],
            run,
            lambda done: on_progress((part + done / len(wanted)) / parts),
        )
        margin = linear_margin(found)
        limits = tuple(
            _with_mean_latency(found, tolerated(found, margin, quantity, limit, search.points))
            for quantity, limit in zip(wanted, searched, strict=True)
        )
        first = next((limit.quantity for limit in nearest(limits)), None)
        return InPlant(span, nominal, margin, limits, first, left_out)

    ideal, real = of_plant(setup, 0), None
    other = of_plant(setup, 1, span=OTHER[span]) if both else None
    other_db = evaluate(pool, setup, OTHER[span], [{}])[0]["plate_energy_db"]
    if with_real:
        changed, left_out = real_plant(setup, quick)
        real = of_plant(changed, 1 + both, left_out)
    worst = _worst_of(pool, setup, goals, request, ideal) if request.worst else None
    on_progress(1.0)
    return Budget(
        setup.name,
        setup.law_reference,
        span,
        tuple(goals),
        ideal,
        real,
        other,
        other_db,
        counted[0] + 1 + (worst.cases if worst else 0),
        worst,
    )


def _worst_of(
    pool: Pool, setup: Setup, goals: Sequence[Goal], request: BudgetRequest, ideal: InPlant
) -> WorstLimit:
    """Search the worst sequence within the range of jitter that the search of its limit went
    through, or up to the first range that fails with random draws."""
    jitter = next(limit for limit in ideal.limits if limit.quantity == "jitter_us")
    most_us = jitter.searched[1] if jitter.first_failure is None else jitter.first_failure
    search = search_of(setup, request.quick, ideal.span)
    lasts = {} if search.short_s is None else {"run.duration_s": search.short_s}

    def run(cases: list[Case]) -> Rows:
        return evaluate(pool, setup, ideal.span, [lasts | case for case in cases])

    return worst_limit(setup, goals, round(1000.0 * most_us / setup.step_ns), search.phases, run)


def nominal_of(
    run: Callable[[list[Case]], Rows],
    setup: Setup,
    goals: Sequence[Goal],
    search: Search,
    whole: bool,
) -> Baseline:
    """Measure what a law does in a scene as it is; `whole`: simulate the scene's own touch phase as
    long as the scene says, as `hertzloop run` does. Raises SceneError if that cannot be run."""
    lasts = {} if search.long_s is None else {"run.duration_s": search.long_s}
    at = [lasts | {"run.touch_phase": phase} for phase in search.phases]
    own, *rows = run([{} if whole else lasts, *at])
    for row in (own, *rows):
        if row["state"] == CaseState.NOT_RUN:
            raise SceneError(f"{setup.name}: the law cannot be run in this scene: {row['status']}")
    worst = max(rows, key=lambda row: worst_excess(goals, row))
    return Baseline(
        metrics={name: float("nan") if own[name] is None else own[name] for name in METRICS},
        over_phases={
            name: spread_of([float("nan") if row[name] is None else row[name] for row in rows])
            for name in METRICS
        },
        met=all(all_met(goals, row) for row in rows),
        unstable=any(row["state"] == CaseState.UNSTABLE for row in (own, *rows)),
        missed=tuple(str(goal) for goal in goals if not goal.met(worst)),
    )


def nearest(limits: Iterable[BudgetLimit]) -> list[BudgetLimit]:
    """Return the limits that were found, those with the least share of their searched range left
    before them first."""
    found = [limit for limit in limits if limit.share is not None]
    return sorted(found, key=lambda limit: limit.share or 0.0)


def as_data(found: Budget) -> dict[str, Any]:
    """Return a budget as the data of `--json`."""
    real = found.real
    return {
        "scene": found.scene,
        "law": found.law,
        "span": found.span,
        "goal": " and ".join(map(str, found.goals)),
        "goals": [
            {"metric": g.metric, "relation": g.relation, "limit": g.limit} for g in found.goals
        ],
        "met": found.ideal.nominal.met,
        "missed": list(found.ideal.nominal.missed),
        "nominal": found.ideal.nominal.metrics,
        "nominal_over_phases": _spreads(found.ideal.nominal),
        "limits": {limit.quantity: _limit(limit) for limit in found.ideal.limits},
        "binds_first": found.ideal.binds_first,
        "other_span_db": found.other_db,
        "other_span": {limit.quantity: _limit(limit) for limit in found.other.limits}
        if found.other
        else None,
        "real_plant": {limit.quantity: _limit(limit) for limit in real.limits} if real else None,
        "real_plant_met": real.nominal.met if real else None,
        "real_plant_nominal": real.nominal.metrics if real else None,
        "real_plant_over_phases": _spreads(real.nominal) if real else None,
        "real_plant_binds_first": real.binds_first if real else None,
        "real_plant_left_out": list(real.left_out) if real else None,
        "real_plant_linear_margin": _margin(real.margin) if real else None,
        "real_plant_unstable": real.unstable if real else None,
        "linear_margin": _margin(found.ideal.margin),
        "worst_jitter": None if found.worst is None else asdict(found.worst),
        "unstable": found.ideal.unstable,
        "probability": None,
        "cases": found.cases,
    }


def _spreads(nominal: Baseline) -> dict[str, dict[str, float]]:
    return {name: asdict(spread) for name, spread in nominal.over_phases.items()}


def _margin(margin: Margin | None) -> dict[str, Any] | None:
    return None if margin is None else asdict(margin)


def _limit(limit: BudgetLimit) -> dict[str, Any]:
    data = asdict(limit)
    del data["quantity"]
    return data | {
        "boundary": limit.boundary.value,
        "searched": list(limit.searched),
        "holds_again": list(limit.holds_again),
        "impact_alone": _limit(limit.impact_alone) if limit.impact_alone else None,
    }


def _with_mean_latency(setup: Setup, limit: BudgetLimit) -> BudgetLimit:
    """Return a limit of the jitter with the mean latency of the force that acts under it."""
    if limit.quantity != "jitter_us" or not limit.value:
        return limit
    mean_us = mean_latency_us(setup.vary({limit.key: limit.value}))
    remark = f"mean latency {mean_us:.3g} us"
    return replace(limit, remark=f"{limit.remark}, {remark}" if limit.remark else remark)
