"""The chart of a tuning: its settings over two metrics."""

from matplotlib.figure import Figure

from hertzloop.studies.pages import pictures, words
from hertzloop.studies.tune.result import TuneResult


def front_sheet(title: str, result: TuneResult) -> Figure:
    """Draw the settings found, law by law, over the first two metrics (or over their number)."""
    sheet, axes = pictures.sheet(1, 1, width=8.5, height=4.2)
    ax, best, reference = axes[0, 0], result.front, result.published
    x, y = result.minimise[0], result.minimise[min(1, len(result.minimise) - 1)]
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
