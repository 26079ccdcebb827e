"""How thoroughly a limit is searched: touch phases, seeds, values of the scan, lengths of runs."""

from dataclasses import dataclass

from hertzloop.results.spans import Span
from hertzloop.results.touch_phases import phases
from hertzloop.scene.setup import Setup
from hertzloop.studies.budget.limits import BudgetQuantity
from hertzloop.studies.budget.quantities import contact_us
from hertzloop.studies.cases.rows import Case

_PHASES, _QUICK_PHASES = 5, 3
_SEEDS, _QUICK_SEEDS = 3, 1
_POINTS, _QUICK_POINTS = 10, 5
# Contact times after the touch that a search simulates at most, and the run that confirms it.
_SHORT_CONTACTS, _LONG_CONTACTS = 60.0, 400.0


@dataclass(frozen=True)
class SearchEffort:
    """How thoroughly to search: touch phases, seeds for a quantity that works by chance, the
    number of values in the scan (see `BudgetQuantity.finer`), and how much of a run to simulate in
    the search and to confirm its result, s; None for the whole."""

    phases: tuple[float, ...]
    seeds: tuple[int, ...]
    points: int
    short_s: float | None = None
    long_s: float | None = None


def lasting(duration_s: float | None) -> Case:
    """Return the setting that ends a run after a time; none for the whole run."""
    return {} if duration_s is None else {"run.duration_s": duration_s}


def effort_of(setup: Setup, quick: bool, span: Span) -> SearchEffort:
    """Return how thoroughly to search; `limit_search.py` explains the short runs."""
    seeds = _QUICK_SEEDS if quick else _SEEDS
    short_s = setup.first_touch_s + _SHORT_CONTACTS * 1e-6 * contact_us(setup)
    long_s = setup.first_touch_s + _LONG_CONTACTS * 1e-6 * contact_us(setup)
    first = span == "impact"
    return SearchEffort(
        phases=phases(_QUICK_PHASES if quick else _PHASES),
        seeds=tuple(setup.run.seed + i for i in range(seeds)),
        points=_QUICK_POINTS if quick else _POINTS,
        short_s=float(f"{short_s:.3g}") if first and 2.0 * short_s < setup.run.duration_s else None,
        long_s=float(f"{long_s:.3g}") if first and long_s < setup.run.duration_s else None,
    )


def variants(quantity: BudgetQuantity, effort: SearchEffort) -> list[Case]:
    """Return the settings in which a value has to meet the goals."""
    at = [{"run.touch_phase": phase} for phase in effort.phases]
    if not quantity.by_chance:
        return at
    return [one | {"run.seed": seed} for seed in effort.seeds for one in at]
