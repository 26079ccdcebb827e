"""A budget as one HTML page: effect, limits, and maps of the two tightest quantities."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator

from hertzloop.scene.setup import Setup
from hertzloop.scene.toml import to_toml
from hertzloop.studies.budget.limits import Boundary, BudgetLimit
from hertzloop.studies.budget.result import BudgetResult, InPlant, PairMap
from hertzloop.studies.cases.identity import code_version
from hertzloop.studies.pages import pictures
from hertzloop.studies.pages.html import ResultChart, ResultPage, ResultTable, svg

_HELD = (Boundary.NO_LIMIT, Boundary.REFUSED)


def draw_pair_map(found: PairMap) -> Figure:
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


def _share_bars(found: BudgetResult) -> Figure:
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


def budget_page(
    setup: Setup, found: BudgetResult, lines: Sequence[str], command: str
) -> ResultPage:
    """Return the page of a budget.

    Args:
        setup: The scene.
        found: Its budget.
        lines: Sentences on top of the page.
        command: The command that makes the page again.
    """
    charts = [ResultChart("How far each limit is", svg(_share_bars(found)))]
    if found.pair_map is not None:
        mapped = found.pair_map
        title = f"{mapped.across.name} and {mapped.down.name} together"
        words = "Blue: the goal is met at every touch phase. Red: at none."
        if any(limit.impact_alone for limit in found.ideal.limits):
            words += " The map does not show where the linear loop is unstable."
        charts.append(ResultChart(title, svg(draw_pair_map(mapped)), words))
    plants = [("In the scene", found.ideal)]
    if found.real:
        plants.append(("In the real plant", found.real))
    alone = "Each quantity alone, with the others as in the plant."
    tables = [ResultTable(name, *_headings_and_cells(plant), alone) for name, plant in plants]
    return ResultPage(
        title=f"Budget of {found.law} in {found.scene}",
        lines=lines,
        charts=charts,
        tables=tables,
        commands=[command],
        versions=code_version(),
        scenes=[(found.scene, to_toml(setup.scene))],
    )


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
