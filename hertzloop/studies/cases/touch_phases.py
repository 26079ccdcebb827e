"""Cases of a study at several phases of the first touch; see `results.touch_phases`."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from hertzloop.results.spans import Span
from hertzloop.results.touch_phases import FEW, TOUCH_PHASE_KEY, Spread, phases, spread_of
from hertzloop.scene.setup import Setup
from hertzloop.studies.cases.evaluate import Pool, evaluate
from hertzloop.studies.cases.rows import Rows, metric_of, with_equal


def at_all(case: dict[str, Any], count: int = FEW) -> list[dict[str, Any]]:
    """Return a case at every phase."""
    return [case | {TOUCH_PHASE_KEY: phase} for phase in phases(count)]


def spread_over(
    pool: Pool, setup: Setup, span: Span, cases: list[dict[str, Any]], metrics: tuple[str, ...]
) -> list[dict[str, Spread]]:
    """Return the spread of some metrics, one dictionary for each case."""
    rows = evaluate(pool, setup, span, [c for case in cases for c in at_all(case)])
    groups = [rows[i : i + FEW] for i in range(0, len(rows), FEW)]
    return [_spreads(group, metrics) for group in groups]


def _spreads(rows: Rows, metrics: Sequence[str]) -> dict[str, Spread]:
    return {name: spread_of([metric_of(row, name) for row in rows]) for name in metrics}


def grouped(rows: Rows, keys: list[str], metrics: Sequence[str]) -> list[dict[str, Any]]:
    """Return one dictionary for all rows that agree in `keys`: these, and the spread of metrics as
    plain data, in the order of the rows."""
    return [
        {key: group[0][key] for key in keys}
        | {name: asdict(one) for name, one in _spreads(group, metrics).items()}
        for group in with_equal(rows, keys)
    ]
