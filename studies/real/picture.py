"""Picture of the ideal and the real plant, law by law."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from studies import pictures, words

if TYPE_CHECKING:
    from studies.real.study import Effect

_WANTED_DB = -3.0
_WORST_DB = 5.0  # what is worse stands at the right end as a number
_APART = 0.16  # of a law's line, between its plants
_FACES = {"ideal": "white", "real": None}


def draw(path: Path, found: "list[Effect]") -> None:
    """A row a scene, a column a latency: plate energy of every law, mean and range over phases."""
    scenes, latencies = list(dict.fromkeys(e.scene for e in found)), list(found[0].energies)
    sheet, axes = pictures.sheet(len(scenes), len(latencies), width=11.0, height=2.9)
    for line, scene in enumerate(scenes):
        mine = [e for e in found if e.scene == scene]
        for column, latency_us in enumerate(latencies):
            ax = axes[line, column]
            _draw(ax, mine, latency_us)
            ax.set_title(f"{scene}, latency {latency_us:g} us", fontsize=9)
            if column:
                ax.tick_params(labelleft=False)
            if line == len(scenes) - 1:
                ax.set_xlabel(words.against_none("plate_energy_db"))
    handles, labels = axes[0, 0].get_legend_handles_labels()
    sheet.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    sheet.suptitle("Left of the line: energy taken off the plate. Bars: range over touch phases")
    pictures.save(sheet, path)


def _draw(ax: Any, mine: "list[Effect]", latency_us: int) -> None:
    laws = list(dict.fromkeys(e.law for e in mine))
    for i, plant in enumerate(dict.fromkeys(e.plant for e in mine)):
        some = [(e.energies[latency_us], laws.index(e.law) + (2 * i - 1) * _APART)
                for e in mine if e.plant == plant]  # fmt: skip
        shown = [(s, y) for s, y in some if s.mean <= _WORST_DB]
        style = pictures.look(i, marked=True) | {"linestyle": ""}
        face = _FACES.get(plant) or style["color"]
        ax.errorbar(
            [s.mean for s, _ in shown], [y for _, y in shown],
            xerr=[[s.mean - s.least for s, _ in shown], [s.most - s.mean for s, _ in shown]],
            label=plant, markerfacecolor=face, **style,
        )  # fmt: skip
        for spread, y in some:
            if not spread.mean <= _WORST_DB:
                beyond = "unstable" if math.isnan(spread.mean) else f"{spread.mean:+.0f} dB"
                ax.annotate(beyond, (0.98, y), xycoords=("axes fraction", "data"), ha="right",
                            va="center", fontsize=7, color=style["color"])  # fmt: skip
    ax.axvline(0.0, color="black", linewidth=0.8)
    ax.axvline(_WANTED_DB, color="0.5", linewidth=0.8, linestyle=":")
    ax.set_yticks(range(len(laws)), [words.law(law) for law in laws])
    ax.set_ylim(len(laws) - 0.5, -0.5)
