"""Published tables, computed again.

Every figure compares the first impact with the active force to the same without it. A row is
a slope-threshold row if it has `v_thr_m_s`, else a row of the parameter study with `force` and
`t_a_step`. Columns that are no figures are copied.
"""

import csv
import math
import statistics
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Literal

import typer

from benchmarks.program import OutDirOption, QuickOption, start, tracked
from benchmarks.results import Results, results_in
from benchmarks.scenes import load
from hertzloop.cli.terminal import out
from hertzloop.loop.simulate import simulate
from hertzloop.plant.metrics.noise import ImpactNoise, holmes_j, peak_pressure_pa
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.results.impacts import first_impact
from hertzloop.scene.setup import Setup

# Figures in the order of the tables, and how they compare two impacts.
Compare = Callable[[ImpactNoise, ImpactNoise], float]
FIGURES: dict[str, Compare] = {
    "EAL": lambda a, b: _db(10.0, a.longhorn_j, b.longhorn_j),
    "EAH": lambda a, b: _db(10.0, a.holmes_j, b.holmes_j),
    "pup": lambda a, b: _db(20.0, a.peak_pressure_pa, b.peak_pressure_pa),
    "Evib": lambda a, b: _db(10.0, a.transmitted_j, b.transmitted_j),
    "vpmax": lambda a, b: _db(20.0, a.plate_speed_max_m_s, b.plate_speed_max_m_s),
    "Erad": lambda a, b: _db(10.0, a.radiated_j, b.radiated_j),
    "reb": lambda a, b: 100.0 * (a.next_impact_speed_m_s / b.next_impact_speed_m_s) ** 2,
    "vnext": lambda a, b: 100.0 * abs(a.next_impact_speed_m_s / b.next_impact_speed_m_s),
    "dT": lambda a, b: 1e5 * (a.contact_time_s - b.contact_time_s),
}
# The same with radiated energy by eq. 3.13 (Maidanik) where the study takes 3.12.
WITH_MAIDANIK = FIGURES | {
    "Erad": lambda a, b: _db(10.0, a.radiated_maidanik_j, b.radiated_maidanik_j)
}
UNITS = {"reb": "%", "vnext": "points", "dT": "1e-5 s"}  # others: dB
_SHORTEST_STEPS, _LONGEST_STEPS = 1 << 12, 1 << 15  # published scheme: work grows as the square
_US_PER_STEP = 1.0
# On aluminium no constant gives restitution 0.7: at 9.4116 N s/m it jumps from 0.702 to 0.693,
# where the contact without control becomes one step longer. The slope-threshold tables fit the
# side below (the scene's 9.41) and count two steps more than the steps in contact; the
# parameter study fits the side above and counts one more. Both say 35 without control.
_DAMPED_SIDE_N_S_M = 9.412


@dataclass(frozen=True)
class Row:
    """What a row asks for."""

    material: str
    drop_height_m: float
    settings: tuple[str, ...]  # of the controller, as for --set
    parameter_study: bool = False


@dataclass(frozen=True)
class Agreement:
    """How far a column is off over all rows: absolute differences in the column's unit."""

    column: str
    rows: int
    median: float
    worst: float
    worst_row: int  # counted from 1


def _db(factor: float, value: float, reference: float) -> float:
    """factor log10 of the ratio's size; -inf for zero."""
    ratio = abs(value / reference)
    return factor * math.log10(ratio) if ratio > 0.0 else -math.inf


def parse_row(cells: Mapping[str, str]) -> Row:
    """The row of cells."""
    kappa = f"controller.kappa={cells['kappa']}"
    law: tuple[str, ...]
    if threshold := cells.get("v_thr_m_s"):
        law = (kappa, "controller.law=slope_threshold", f"controller.v_thr_m_s={threshold}")
    else:
        force = f"controller.precomputed={cells['force']}"
        delay = f"controller.delay_us={_US_PER_STEP * (int(cells['t_a_step']) - 1)!r}"
        law = (kappa, "controller.law=precomputed", force, delay)
    material = cells.get("material", "aluminium").removesuffix("_m")
    return Row(material, float(cells.get("drop_height_m", 0.05)), law, not threshold)


def scene_of(row: Row, scheme: str, settings: Iterable[str] = ()) -> Setup:
    """Scene of a row under a scheme. Raises SceneError."""
    name = row.material
    published = not SCHEMES[scheme].conserves
    source = f"thesis-{name}" if published else f"{name}-20mm"
    keys = [f"sphere.drop_height_m={row.drop_height_m!r}", *row.settings, *settings]
    if published and row.parameter_study and name == "aluminium":
        keys.append(f"contact.viscous_n_s_m={_DAMPED_SIDE_N_S_M}")
    return load(source, keys)


@lru_cache(maxsize=256)
def noise_of(row: Row, scheme: str) -> ImpactNoise | None:
    """Figures of a row's first impact; None if it does not end within the longest run."""
    setup = scene_of(row, scheme)
    published = not SCHEMES[scheme].conserves
    longest = _LONGEST_STEPS if published else 16 * setup.run.steps
    steps = _SHORTEST_STEPS if published else setup.run.steps
    while steps <= longest:
        setup = scene_of(row, scheme, [f"run.duration_s={steps * setup.run.step_s!r}"])
        impact = first_impact(setup, simulate(setup).truth)
        if impact is not None and impact.ended:
            counted_less = published and row.parameter_study
            return _one_step_less(impact.noise, setup) if counted_less else impact.noise
        steps *= 2 if published else 4
    return None


def _one_step_less(noise: ImpactNoise, setup: Setup) -> ImpactNoise:
    """The figures with a contact time that counts one step less."""
    radius, speed = setup.mechanics.sphere.radius_m, noise.impact_speed_m_s
    time_s = noise.contact_time_s - setup.run.step_s
    return replace(
        noise,
        contact_time_s=time_s,
        holmes_j=holmes_j(radius, speed, time_s),
        peak_pressure_pa=peak_pressure_pa(radius, speed, time_s),
    )


def compute(
    row: Row, scheme: str, figures: Mapping[str, Compare] = FIGURES
) -> dict[str, float | None]:
    """All figures of a row; None where the contact does not end."""
    without = replace(row, settings=("controller.law=off",))
    controlled, free = noise_of(row, scheme), noise_of(without, scheme)
    if controlled is None or free is None:
        return dict.fromkeys(FIGURES)
    return {column: compare(controlled, free) for column, compare in figures.items()}


def read_rows(path: Path) -> list[dict[str, str]]:
    """Rows of a table."""
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def compute_table(
    rows: Iterable[dict[str, str]], scheme: str, figures: Mapping[str, Compare] = FIGURES
) -> Iterator[dict[str, str]]:
    """The rows with X_computed and X_difference after every figure X, empty where a contact does
    not end. Figures that the table does not have are added as X_computed."""
    for row in rows:
        computed = compute(parse_row(row), scheme, figures)
        cells = {}
        for column, published in row.items():
            cells[column] = published
            if column in computed:
                value = computed[column]
                off = "" if value is None else value - float(published)
                cells |= {f"{column}_computed": _cell(value), f"{column}_difference": _cell(off)}
        yield cells | {f"{c}_computed": _cell(v) for c, v in computed.items() if c not in row}


def _cell(value: float | str | None) -> str:
    """A number as it is written into a table; empty without one."""
    return f"{value:.6g}" if isinstance(value, float) else ""


def agreement(rows: list[dict[str, str]]) -> list[Agreement]:
    """Median and worst absolute difference of every figure that the rows have."""
    found = []
    for column in FIGURES:
        key = f"{column}_difference"
        off = [(abs(float(row[key])), i) for i, row in enumerate(rows, 1) if row.get(key)]
        if off:
            middle = statistics.median(value for value, _ in off)
            found.append(Agreement(column, len(off), middle, *max(off)))
    return found


def shares(rows: list[dict[str, str]], step_e5_s: float = 0.1) -> dict[str, float]:
    """Shares of the rows whose contact time and next impact speed come close."""
    slack = 1e-6
    times = [
        (abs(float(row["dT_difference"])), abs(float(row["dT"])))
        for row in rows
        if row.get("dT_difference")
    ]
    speeds = [abs(float(row["vnext_difference"])) for row in rows if row.get("vnext_difference")]
    found: dict[str, float] = {}
    if times:
        in_step = [off <= step_e5_s + slack for off, _ in times]
        found["dT within one step"] = sum(in_step) / len(times)
        near = [ok or off <= 0.05 * dt for ok, (off, dt) in zip(in_step, times, strict=True)]
        found["dT within one step or 5 %"] = sum(near) / len(times)
        far = [not ok and off > 0.25 * dt for ok, (off, dt) in zip(in_step, times, strict=True)]
        found["dT off by more than a step and 25 %"] = sum(far) / len(times)
    for points in (3.0, 5.0):
        if speeds:
            close = sum(off <= points + slack for off in speeds)
            found[f"vnext within {points:g} points"] = close / len(speeds)
    return found


SHIPPED = tuple(
    Path(__file__).parent / f"{name}.csv" for name in ("parameter_study", "slope_threshold")
)
SchemeName = Literal["thesis2008", "modal"]
SchemeOption = Annotated[SchemeName, typer.Option(help="Compute the plant by this scheme.")]
_QUICK_ROWS = 5  # of each file


def main(
    folder: OutDirOption = None,
    scheme: SchemeOption = "thesis2008",
    maidanik: Annotated[
        bool, typer.Option("--maidanik", help="Compute Erad by eq. 3.13, not by the study's 3.12.")
    ] = False,
    quick: QuickOption = False,
) -> None:
    """Compute every row of the published tables again, beside the published values.

    Writes FILE-computed.csv for each FILE.csv. With --quick: the first 5 rows of each file.

    Example: python -m paper.tables --quick
    """
    figures = WITH_MAIDANIK if maidanik else FIGURES
    every: list[dict[str, str]] = []
    with results_in(folder, "tables", scheme) as results:
        for path in SHIPPED:
            rows = read_rows(path)[: _QUICK_ROWS if quick else None]
            computed = list(tracked(path.name, compute_table(rows, scheme, figures)))
            cells = (row.values() for row in computed)
            results.write_rows(f"{path.stem}-computed", list(computed[0]), cells)
            _report(results, path, scheme, computed)
            every += computed
        results.conclude(_conclusion(scheme, agreement(every), len(every)))


def _report(results: Results, path: Path, scheme: str, rows: list[dict[str, str]]) -> None:
    """Print the agreement of one file's computed rows with the published ones."""
    found, close = agreement(rows), shares(rows)
    endless = sum(not row["dT_computed"] for row in rows)
    results.table(
        f"{scheme} against the published rows of {path.name}",
        {
            "figure": "{.column}",
            "rows": "{.rows}",
            "median off by": lambda a: f"{a.median:.3f} {UNITS.get(a.column, 'dB')}",
            "worst": lambda a: f"{a.worst:.3f} {UNITS.get(a.column, 'dB')}",
            "in row": "{.worst_row}",
        },
        found,
    )
    for what, value in close.items():
        out.print(f"{what}: {100.0 * value:.0f} % of the rows")
    if endless:
        out.print(f"{endless} of {len(rows)} contacts do not end; their cells are empty")


def _conclusion(scheme: str, found: list[Agreement], rows: int) -> str:
    """How close the computed rows come to the published ones, in one sentence."""
    worst = max((one for one in found if one.column not in UNITS), key=lambda one: one.median)
    return (
        f"Over {rows} rows, {scheme} differs from the published levels by a median of "
        f"{worst.median:.2f} dB or less, the largest being that of {worst.column}."
    )


if __name__ == "__main__":
    start("paper.tables")
