"""Picture of a Pareto front."""

from pathlib import Path

from matplotlib.figure import Figure

from studies import pictures, words
from studies.tuning.tune import Found


def draw_front(
    path: Path, title: str, best: list[Found], reference: Found, objectives: tuple[str, ...]
) -> None:
    """Write `front` as PNG."""
    pictures.save(front(title, best, reference, objectives), path)


def front(title: str, best: list[Found], reference: Found, objectives: tuple[str, ...]) -> Figure:
    """The settings found, law by law, over the first two objectives (or over their number)."""
    sheet, axes = pictures.sheet(1, 1, width=8.5, height=4.2)
    ax = axes[0, 0]
    x, y = objectives[0], objectives[1] if len(objectives) > 1 else objectives[0]
    for i, law in enumerate(dict.fromkeys(f.values["controller.law"] for f in best)):
        mine = [f for f in best if f.values["controller.law"] == law]
        look = pictures.look(i, marked=True) | {"linestyle": ""}
        ax.plot(
            [f.figures[x] for f in mine], [f.figures[y] for f in mine], label=words.law(law), **look
        )
    ax.plot(
        reference.figures[x], reference.figures[y], "k*", markersize=13, label="published setting"
    )
    ax.set(xlabel=words.against_none(x), ylabel=words.against_none(y), title=title)
    sheet.legend(loc="outside right upper")
    return sheet
