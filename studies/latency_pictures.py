"""Pictures of the latency study: maps with the contour "no better than no control", bands."""

from pathlib import Path
from typing import Any

import numpy as np

from studies import pictures

_AXES = {
    "sensors.bits": "bits of the sensor",
    "sensors.every_steps": "sampling period (us)",
    "controller.kappa": "kappa",
    "controller.v_thr_m_s": "v_thr (m/s)",
}
_WITHOUT = {"rebound_percent": 100.0}


def draw_maps(
    path: Path, title: str, maps: dict[str, list[dict[str, Any]]], figures: dict[str, str]
) -> None:
    """A row a figure, a column a map; dashed: as without control."""
    sheet, axes = pictures.sheet(len(figures), len(maps), width=13.0, height=2.2)
    for column, (key, rows) in enumerate(maps.items()):
        latencies = sorted({row["controller.latency_us"] for row in rows})
        values = sorted({row[key] for row in rows})
        for line, (figure, label) in enumerate(figures.items()):
            ax = axes[line, column]
            shape = (len(latencies), len(values))
            z = np.array([np.nan if r[figure] is None else r[figure] for r in rows], float)
            z = z.reshape(shape).T
            level = _WITHOUT.get(figure, 0.0)
            low, high = np.nanpercentile(z, [2, 98])
            reach = max(abs(low - level), abs(high - level), 1e-3)
            levels = level + np.linspace(-reach, reach, 13)
            shown = ax.contourf(latencies, values, z, levels, cmap="cividis", extend="both")
            if np.nanmin(z) < level < np.nanmax(z):
                ax.contour(latencies, values, z, [level], colors="white", linestyles="--")
            sheet.colorbar(shown, ax=ax, ticks=levels[::4])
            if column == 0:
                ax.set_ylabel(f"{label}\n\n{_AXES[key]}")
            else:
                ax.set_ylabel(_AXES[key])
            if line == len(figures) - 1:
                ax.set_xlabel("latency (us)")
    sheet.suptitle(f"{title}: against no control; dashed: no better than that; white: unstable")
    pictures.save(sheet, path)


def draw_chance(path: Path, title: str, rows: list[dict[str, Any]], laws: tuple[str, ...]) -> None:
    """Median and 5 to 95 % of the seeds over jitter and over the share of lost commands."""
    sheet, axes = pictures.sheet(1, 2, width=10.0, height=3.4)
    for ax, key, label in (
        (axes[0, 0], "controller.jitter_us", "largest jitter (us)"),
        (axes[0, 1], "controller.drop_out_probability", "share of commands lost"),
    ):
        for i, law in enumerate(laws):
            mine = [row for row in rows if key in row and row["controller.law"] == law]
            places = sorted({row[key] for row in mine})
            spread = [[row["plate_energy_db"] for row in mine if row[key] == x] for x in places]
            low, middle, high = np.percentile(np.array(spread), [5, 50, 95], axis=1)
            look = pictures.look(i)
            ax.plot(places, middle, label=law, **look)
            ax.fill_between(places, low, high, color=look["color"], alpha=0.2)
        ax.axhline(0.0, color="black", linewidth=0.8)
        ax.set(xlabel=label, ylabel="plate energy against no control (dB)")
        ax.legend()
    sheet.suptitle(f"{title}: median, and 5 to 95 % of 20 seeds")
    pictures.save(sheet, path)
