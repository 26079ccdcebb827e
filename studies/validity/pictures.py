"""Picture of the map: what matters above a thousandth and above a tenth."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator

from hertzloop.setup import load
from studies import pictures

_LEVELS = ((1e-3, "what costs more than 0.1 %"), (1e-1, "what costs more than 10 %"))
_SCENES = ("aluminium-3mm", "offcentre-6mm", "aluminium-20mm")
_LATE_MM = 10.0  # radius from which on a name ends at its star
_TICKS = (0.2, 0.5, 1, 2, 5, 10, 20)
_HATCHES = ("", "////", "....", "xxx", "", "")
_PLACES = (0.6, 0.5, 0.25, 0.6, 0.5, 0.9)  # of the length of a line, where its name is
_PLAIN = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1}


def draw_map(
    path: Path, about: str, radii_m: np.ndarray, thicknesses_m: np.ndarray,
    sizes: dict[str, np.ndarray], remedies: dict[str, str],
) -> None:  # fmt: skip
    """Two panels, a limit each: every effect has a line, and a shade where it matters."""
    sheet, axes = pictures.sheet(1, 2, width=13.0, height=7.0)
    x, y = 1e3 * radii_m, 1e3 * thicknesses_m
    known = {name: size for name, size in sizes.items() if not np.isnan(size).any()}
    places = {name: i for i, name in enumerate(sizes)}
    for ax, (level, title) in zip(axes[0], _LEVELS, strict=True):
        everywhere = [name for name, size in known.items() if size.min() > level]
        for name, size in known.items():
            if size.min() <= level < size.max():
                _shade(ax, x, y, size, level, name, places[name])
        if everywhere:
            title += f"; everywhere: {', '.join(everywhere)}"
        _mark_scenes(ax)
        ax.set(xscale="log", yscale="log", xlabel="radius of the sphere (mm)", title=title)
        for axis in (ax.xaxis, ax.yaxis):
            axis.set_major_locator(FixedLocator(_TICKS))
            axis.set_major_formatter(lambda value, _: f"{value:g}")
            axis.set_minor_locator(FixedLocator(()))
        ax.set_xlim(x[0], x[-1])
        ax.set_ylim(y[0], y[-1])
    axes[0, 0].set_ylabel("thickness of the plate (mm)")
    handles = [
        _key(name, remedies[name], places[name])
        for name, size in known.items()
        if size.max() > _LEVELS[0][0]
    ]
    sheet.legend(handles=handles, loc="outside lower center", ncols=2, fontsize=9,
                 title="shaded where it matters: effect, and what it takes")  # fmt: skip
    sheet.suptitle(f"What an impact needs: {about}\nunshaded: Kirchhoff's plate and Hertz's "
                   "elastic contact do; sizes from Zener's impact, before any run")  # fmt: skip
    pictures.save(sheet, path)


def _mark_scenes(ax: Any) -> None:
    """Shipped scenes of these materials, by their names."""
    for name in _SCENES:
        setup = load(name)
        plate = setup.structure.local_plate
        assert plate is not None  # each is a plate
        radius, thickness = 1e3 * setup.sphere.radius_m, 1e3 * plate.thickness_m
        ax.plot(radius, thickness, "k*", markersize=11, zorder=7)
        side = "right" if radius > _LATE_MM else "center"
        ax.annotate(name, (radius, thickness), xytext=(0, 9), textcoords="offset points", ha=side,
                    weight="bold", zorder=7, bbox=_PLAIN)  # fmt: skip


def _shade(
    ax: Any, x: np.ndarray, y: np.ndarray, size: np.ndarray, level: float, name: str, index: int
) -> None:
    """One effect: shade above the level, its line, and its name on that."""
    look = pictures.look(index)
    ax.contourf(x, y, size, [level, np.inf], colors=[look["color"]], alpha=0.16,
                hatches=[_HATCHES[index]])  # fmt: skip
    lines = ax.contour(x, y, size, [level], colors=[look["color"]], linewidths=2.0)
    lines.set_linestyle(look["linestyle"])
    for line in lines.allsegs[0]:
        # Each effect at a place of its own along its line, so that names do not meet.
        where = line[np.argsort(line[:, 1])][int(len(line) * _PLACES[index])]
        side = "right" if where[0] > _LATE_MM else "center"
        ax.text(*where, name, color=look["color"], weight="bold", ha=side, va="center",
                zorder=6, bbox=_PLAIN)  # fmt: skip


def _key(name: str, remedy: str, index: int) -> Patch:
    colour = pictures.look(index)["color"]
    red, green, blue = (int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
    return Patch(facecolor=(red, green, blue, 0.16), edgecolor=colour, hatch=_HATCHES[index],
                 linewidth=1.5, label=f"{name}: {remedy}")  # fmt: skip
