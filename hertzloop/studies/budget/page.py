"""A budget as one HTML page: effect, limits, and maps of the two tightest quantities."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator

from hertzloop.common.atomic_files import atomic_write
from hertzloop.results.cases import Span
from hertzloop.scene.setup import Setup
from hertzloop.scene.toml import to_toml
from hertzloop.studies.budget.budget import Budget, InPlant, nearest, search_of
from hertzloop.studies.budget.goal import Goal, all_met
from hertzloop.studies.budget.limits import Boundary, BudgetLimit, BudgetQuantity, quantities_of
from hertzloop.studies.cases.evaluate import Pool, evaluate
from hertzloop.studies.cases.identity import code_version
from hertzloop.studies.pages import pictures
from hertzloop.studies.pages.html import ResultChart, ResultPage, ResultTable, svg

_HELD = (Boundary.NO_LIMIT, Boundary.REFUSED)
_PLACES = 11  # values of a quantity in a map
_BEYOND = 1.6  # times the distance to the limit, in places, that a map shows


@dataclass(frozen=True)
class Map:
    """Where two quantities together meet the goals: `met` is the share of the touch phases, shape
    (values of `down`, values of `across`); values in the units of the report."""

    across: BudgetQuantity
    down: BudgetQuantity
    across_places: tuple[int, ...]
    down_places: tuple[int, ...]
    met: np.ndarray


def tightest(plant: InPlant) -> list[BudgetLimit]:
    """Return the limits with the smallest share, at most two of them."""
    return nearest(plant.limits)[:2]


def map_of(
    pool: Pool, setup: Setup, goals: Sequence[Goal], span: Span, plant: InPlant, quick: bool
) -> Map | None:
    """Simulate a map of the two tightest quantities; None where fewer than two have a limit."""
    limits = tightest(plant)
    if len(limits) < 2:
        return None
    known = {quantity.name: quantity for quantity in quantities_of(setup)}
    search = search_of(setup, quick, span)
    lasts = {} if search.short_s is None else {"run.duration_s": search.short_s}
    across, down = (known[limit.quantity] for limit in limits)
    places = [_places(known[limit.quantity], limit) for limit in limits]
    cases = [
        {across.key: across.values[i], down.key: down.values[j], "run.touch_phase": phase} | lasts
        for j in places[1]
        for i in places[0]
        for phase in search.phases
    ]
    rows = evaluate(pool, setup, span, cases)
    met = np.array([all_met(goals, row) for row in rows], dtype=float)
    shape = (len(places[1]), len(places[0]), len(search.phases))
    return Map(across, down, places[0], places[1], met.reshape(shape).mean(axis=2))


def _places(quantity: BudgetQuantity, limit: BudgetLimit) -> tuple[int, ...]:
    last = len(quantity.within(limit).values) - 1
    good = quantity.own + round((limit.share or 0.0) * last)
    end = min(last, max(good + 3, round(_BEYOND * good)))
    return tuple(sorted({round(x) for x in np.linspace(0, end, _PLACES)}))


def draw_map(found: Map) -> Figure:
    """Draw a map; both axes have a place for each value."""
    sheet, axes = pictures.sheet(1, 1, width=6.5, height=4.6)
    ax = axes[0, 0]
    shown = ax.imshow(found.met, origin="lower", aspect="auto", vmin=0.0, vmax=1.0, cmap="RdYlBu")
    ax.grid(False)
    for axis, quantity, places in (
        (ax.xaxis, found.across, found.across_places),
        (ax.yaxis, found.down, found.down_places),
    ):
        words = [
            str(quantity.values[place])
            if quantity.reported(place) is None
            else f"{quantity.reported(place):.3g}"
            for place in places
        ]
        axis.set_major_locator(MaxNLocator(8, integer=True))
        axis.set_major_formatter(
            FuncFormatter(lambda x, _, w=words: w[round(x)] if 0 <= round(x) < len(w) else "")
        )
    ax.set_xlabel(f"{found.across.name} ({found.across.unit})")
    ax.set_ylabel(f"{found.down.name} ({found.down.unit})")
    sheet.colorbar(shown, ax=ax, label="share of touch phases that meet the goal")
    return sheet


def _share_bars(found: Budget) -> Figure:
    plants = [("scene", found.ideal), *([("real plant", found.real)] if found.real else [])]
    sheet, axes = pictures.sheet(1, 1, width=8.0, height=3.2)
    ax = axes[0, 0]
    names = [limit.quantity for limit in found.ideal.limits]
    for i, (name, plant) in enumerate(plants):
        shares = [1.0 if limit.boundary in _HELD else limit.share or 0.0 for limit in plant.limits]
        places = np.arange(len(names)) + 0.38 * i
        ax.barh(places, shares, height=0.36, label=name, color=pictures.COLOURS[i])
    ax.set_yticks(np.arange(len(names)) + 0.19 * (len(plants) - 1), names)
    ax.invert_yaxis()
    ax.set_xlabel(
        "part of the searched values up to the limit; 1: no limit found, 0: none tolerated"
    )
    ax.legend(loc="lower right")
    return sheet


def write_page(
    folder: Path,
    setup: Setup,
    found: Budget,
    mapped: Map | None,
    lines: Sequence[str],
    command: str,
) -> Path:
    """Write budget.html into a folder.

    Args:
        folder: An existing folder.
        setup: The scene.
        found: Its budget.
        mapped: A map of the two tightest quantities, if there is one.
        lines: Sentences on top of the page.
        command: The command that makes the page again.

    Returns:
        The path of the page. Raises NotWritten.
    """
    charts = [ResultChart("How far each limit is", svg(_share_bars(found)))]
    if mapped is not None:
        title = f"{mapped.across.name} and {mapped.down.name} together"
        words = "Blue: the goal is met at every touch phase. Red: at none."
        if any(limit.impact_alone for limit in found.ideal.limits):
            words += " The map does not show where the linear loop is unstable."
        charts.append(ResultChart(title, svg(draw_map(mapped)), words))
    plants = [("In the scene", found.ideal)]
    if found.real:
        plants.append(("In the real plant", found.real))
    alone = "Each quantity alone, with the others as in the plant."
    tables = [ResultTable(name, *_headings_and_cells(plant), alone) for name, plant in plants]
    text = ResultPage(
        title=f"Budget of {found.law} in {found.scene}",
        lines=list(lines),
        charts=charts,
        tables=tables,
        commands=[command],
        versions=code_version(),
        scenes=[(found.scene, to_toml(setup.scene))],
    ).html()
    path = folder / "budget.html"
    atomic_write(path, text)
    return path


def _headings_and_cells(plant: InPlant) -> tuple[tuple[str, ...], list[list[str]]]:
    headings = ("quantity", "limit", "next value misses", "searched", "interval", "unit")
    cells = [_cells(limit) for limit in plant.limits]
    if not any(limit.impact_alone for limit in plant.limits):
        return headings, cells
    for row, limit in zip(cells, plant.limits, strict=True):
        row.insert(2, _value(limit.impact_alone or limit))
    return (*headings[:2], f"{plant.span} alone", *headings[2:]), cells


def _value(limit: BudgetLimit) -> str:
    value = limit.boundary.value if limit.value is None else f"{limit.value:.4g}"
    value += f" ({limit.remark})" if limit.remark else ""
    return f"{value}: {limit.reason}" if limit.reason else value


def _cells(limit: BudgetLimit) -> list[str]:
    again = ", ".join(f"{x:.4g}" for x in limit.holds_again)
    return [
        limit.quantity,
        _value(limit),
        "" if limit.first_failure is None else f"{limit.first_failure:.4g}",
        f"{limit.searched[0]:.3g} to {limit.searched[1]:.3g}",
        "yes" if limit.interval else f"no: met again at {again}",
        limit.unit,
    ]
