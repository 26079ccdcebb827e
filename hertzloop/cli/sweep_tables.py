"""Tables that the command `sweep` prints."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from hertzloop.studies.cases.rows import metrics_with_values, with_metric
from hertzloop.studies.pages.words import short
from hertzloop.studies.sweep.result import extremes
from hertzloop.views.format import Table

_MOST_ROWS = 20


def extremes_table(rows: list[dict[str, Any]], keys: list[str]) -> Table:
    """Return the least and the largest value of each metric, and the keys that gave them."""
    table = Table(title="Against no control")
    for heading in ("metric", "least", "at", "largest", "at"):
        table.add_column(heading, justify="left" if heading in ("metric", "at") else "right")
    for metric, *words in extremes(rows, keys, metrics_with_values(rows)):
        table.add_row(metric, *words)
    return table


def cases_table(rows: list[dict[str, Any]], keys: list[str]) -> Table:
    """Return keys and metrics of each case; of many cases every so many."""
    every = max(1, -(-len(rows) // _MOST_ROWS))
    shown = rows[::every]
    names = metrics_with_values(rows)
    count = f"{len(shown)} of {len(rows)} cases" if every > 1 else "All cases"
    right = [*(key.split(".")[-1] for key in keys), *names]
    table = Table(right=right, title=f"{count}, against no control")
    for row in shown:
        cells = (f"{row[name]:z.2f}" if with_metric([row], name) else "" for name in names)
        table.add_row(*(short(row[key]) for key in keys), *cells)
    return table


def are_few(rows: list[dict[str, Any]]) -> bool:
    """Return whether a table shows every case."""
    return len(rows) <= _MOST_ROWS


def quantiles_table(rows: list[dict[str, Any]], keys: list[str]) -> Table:
    """Return median and 95 % range of metrics over the draws; a row for each setting of `keys`."""
    # As many metrics as fit side by side in 80 columns.
    names = metrics_with_values(rows)[: max(2, 4 - len(keys))]
    right = [*(key.split(".")[-1] for key in keys), *names]
    table = Table(right=right, title="Over draws of the uncertain keys: median (2.5 to 97.5 %)")
    groups: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
    for row in rows:
        groups.setdefault(tuple(row[key] for key in keys), []).append(row)
    for values, group in list(groups.items())[:_MOST_ROWS]:
        cells = []
        for name in names:
            having = [row[name] for row in with_metric(group, name)] or [math.nan]
            low, middle, high = np.percentile(having, [2.5, 50.0, 97.5])
            cells.append(f"{middle:.4g} ({low:.4g} to {high:.4g})")
        table.add_row(*(short(value) for value in values), *cells)
    return table


def phases_table(groups: list[dict[str, Any]], keys: list[str], metrics: Sequence[str]) -> Table:
    """Return mean and range over the touch phase; a row for each setting of the other keys."""
    right = [*(key.split(".")[-1] for key in keys), *metrics]
    table = Table(right=right, title="Over touch phases: mean (least to most)")
    for group in groups[:_MOST_ROWS]:
        table.add_row(*(short(group[key]) for key in keys), *(str(group[f]) for f in metrics))
    if len(groups) > _MOST_ROWS:
        table.caption = f"and {len(groups) - _MOST_ROWS} more; --json has them all"
    return table
