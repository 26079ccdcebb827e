"""Published tables, computed again: rows of figures in the format of the study's tables.

Every figure compares the first impact with the active force to the same without it. A row is
a slope-threshold row if it has `v_thr_m_s`, else a row of the parameter study with `force` or
`shape`, and `t_a_step`. Columns that are no figures are copied.
"""

import csv
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Literal

import typer

from benchmarks.program import (
    JsonOption,
    OutDirOption,
    QuickOption,
    bars,
    check_json,
    conclude,
    fail,
    number_table,
    out,
    progress,
    results_in,
    start,
    write_json,
    written,
)
from hertzloop.controller.laws.precomputed import SHAPES
from hertzloop.loop.simulate import simulate
from hertzloop.plant.metrics.noise import ImpactNoise, holmes_j, peak_pressure_pa
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.results.impacts import first_impact
from hertzloop.scene.errors import SceneError
from hertzloop.scene.setup import Setup, load

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
_MATERIALS = {"aluminium": "aluminium", "oak": "oak", "sylomer_m": "sylomer", "sylomer": "sylomer"}
_SHORTEST_STEPS, _LONGEST_STEPS = 1 << 12, 1 << 15  # published scheme: work grows as the square
_US_PER_STEP = 1.0
# On aluminium no constant gives restitution 0.7: at 9.4116 N s/m it jumps from 0.702 to 0.693,
# where the contact without control becomes one step longer. The slope-threshold tables fit the
# side below (the scene's 9.41) and count two steps more than the steps in contact; the
# parameter study fits the side above and counts one more. Both say 35 without control.
_DAMPED_SIDE_N_S_M = 9.412


class RowError(ValueError):
    """A row cannot be computed; the sentence names the row, the column and what would do."""


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


def parse_row(cells: dict[str, str], number: int) -> Row:
    """Read a row (counted from 1). Raises RowError."""

    def number_in(column: str, default: float | None = None) -> float:
        text = (cells.get(column) or "").strip()
        if not text and default is not None:
            return default
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise RowError(f"row {number}: {column} = '{text}' is not a number")
        return value

    material = (cells.get("material") or "aluminium").strip()
    if material not in _MATERIALS:
        raise RowError(
            f"row {number}: material = '{material}' is not known; take one of "
            f"{', '.join(_MATERIALS)}"
        )
    settings = [f"controller.kappa={number_in('kappa')!r}"]
    if (cells.get("v_thr_m_s") or "").strip():
        settings += [
            "controller.law=slope_threshold", f"controller.v_thr_m_s={number_in('v_thr_m_s')!r}"
        ]  # fmt: skip
    else:
        settings += _precomputed(cells, number, number_in("t_a_step", 1.0))
    of_study = not (cells.get("v_thr_m_s") or "").strip()
    return Row(material, number_in("drop_height_m", 0.05), tuple(settings), of_study)


def _precomputed(cells: dict[str, str], number: int, t_a_step: float) -> list[str]:
    """Settings of a row of the parameter study."""
    force, shape = (cells.get("force") or "").strip(), (cells.get("shape") or "").strip()
    if shape:
        known = list(dict.fromkeys(SHAPES.values()))
        if shape not in known:
            raise RowError(f"row {number}: shape = '{shape}'; take one of {', '.join(known)}")
        force = next(name for name, its in SHAPES.items() if its == shape)
    if force not in SHAPES:
        raise RowError(
            f"row {number}: needs v_thr_m_s for the slope-threshold law, or force = F_a1 to F_a13 "
            f"or a shape for a pre-computed one; found force = '{force}'"
        )
    if t_a_step < 1 or t_a_step != int(t_a_step):
        raise RowError(f"row {number}: t_a_step = {t_a_step:g}; steps are counted from 1")
    return [
        "controller.law=precomputed",
        f"controller.precomputed={force}",
        f"controller.delay_us={_US_PER_STEP * (t_a_step - 1)!r}",
    ]


def scene_of(row: Row, scheme: str, settings: Iterable[str] = ()) -> Setup:
    """Scene of a row under a scheme. Raises SceneError."""
    name = _MATERIALS[row.material]
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
    longest = _LONGEST_STEPS if published else 16 * setup.steps
    steps = _SHORTEST_STEPS if published else setup.steps
    while steps <= longest:
        setup = scene_of(row, scheme, [f"run.duration_s={steps * setup.step_s!r}"])
        impact = first_impact(setup, simulate(setup).truth)
        if impact is not None and impact.ended:
            counted_less = published and row.parameter_study
            return _one_step_less(impact.noise, setup) if counted_less else impact.noise
        steps *= 2 if published else 4
    return None


def _one_step_less(noise: ImpactNoise, setup: Setup) -> ImpactNoise:
    """The figures with a contact time that counts one step less."""
    radius, speed = setup.sphere.radius_m, noise.impact_speed_m_s
    time_s = noise.contact_time_s - setup.step_s
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


def read_rows(path: Path) -> tuple[list[str], list[dict[str, str]]]:
    """Header and rows of a table. Raises RowError with a sentence."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file)
            rows = list(reader)
    except OSError as error:
        raise RowError(f"cannot read {path}: {error.strerror}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise RowError(f"{path} is no CSV table: {error}") from error
    header = list(reader.fieldnames or [])
    if "kappa" not in header:
        raise RowError(
            f"{path} has no column kappa; the first line must name the columns, of which kappa "
            "and either v_thr_m_s or force (or shape) and t_a_step are needed"
        )
    for number, row in enumerate(rows, 1):
        if None in row or None in row.values():
            raise RowError(f"{path}: row {number} does not have {len(header)} cells")
    return header, rows


def compute_table(
    header: list[str],
    rows: list[dict[str, str]],
    scheme: str,
    on_progress: Callable[[int], None] = lambda row: None,
    by: Mapping[str, Compare] = FIGURES,
) -> tuple[list[str], list[dict[str, str]], int]:
    """The table with X_computed and X_difference after every figure X; rows without an end.

    Figures that the table does not have are added as X_computed. Raises RowError.
    """
    parsed = [parse_row(row, i) for i, row in enumerate(rows, 1)]
    new_header: list[str] = []
    for column in header:
        new_header.append(column)
        if column in FIGURES:
            new_header += [f"{column}_computed", f"{column}_difference"]
    new_header += [f"{column}_computed" for column in FIGURES if column not in header]
    endless, new_rows = 0, []
    for number, (row, wanted) in enumerate(zip(rows, parsed, strict=True), 1):
        try:
            figures = compute(wanted, scheme, by)
        except SceneError as error:
            raise RowError(f"row {number}: {error}") from error
        endless += figures["dT"] is None
        new_rows.append({**row, **with_differences(row, figures, number)})
        on_progress(number)
    return new_header, new_rows, endless


def with_differences(
    row: dict[str, str], figures: dict[str, float | None], number: int
) -> dict[str, str]:
    """The cells X_computed, and X_difference where row `number` has a figure X. Raises RowError."""
    cells = {}
    for column, value in figures.items():
        cells[f"{column}_computed"] = "" if value is None else f"{value:.6g}"
        published = (row.get(column) or "").strip()
        if column not in row:
            continue
        cells[f"{column}_difference"] = ""
        if published and value is not None:
            try:
                difference = value - float(published)
            except ValueError as error:
                raise RowError(f"row {number}: {column} = '{published}' is not a number") from error
            cells[f"{column}_difference"] = f"{difference:.6g}"
    return cells


def write_table(path: Path, header: list[str], rows: list[dict[str, str]]) -> None:
    """Write as CSV."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, header, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def agreement(rows: list[dict[str, str]]) -> list[Agreement]:
    """Median and worst absolute difference of every figure that the rows have."""
    found = []
    for column in FIGURES:
        off = [
            (abs(float(row[key])), number)
            for number, row in enumerate(rows, 1)
            if row.get(key := f"{column}_difference")
        ]
        if off:
            values = sorted(value for value, _ in off)
            middle = len(values) // 2
            median = 0.5 * (values[middle] + values[-middle - 1])
            worst, worst_row = max(off)
            found.append(Agreement(column, len(values), median, worst, worst_row))
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


# What no program can find in the study, and why.
LEFT_OUT = (
    "table 5.6, which figure its last column names: cannot be assigned to rows",
    "table 5.3, vnext 8 % for F_a6 (-1.0): the appendix and table 5.7 say 28 %; 8 % is reb",
    "table A.1, how the optimum is taken and brought back into time: not printed; of figure A.1 "
    "only the axis is left",
    "Heitkaemper's approximation of radiated energy (appendix C.1): no formula is printed",
)
SHIPPED = tuple(
    Path(__file__).parent / f"{name}.csv" for name in ("parameter_study", "slope_threshold")
)
SchemeName = Literal["thesis2008", "modal"]
SchemeOption = Annotated[SchemeName, typer.Option(help="Compute the plant by this scheme.")]
_QUICK_ROWS = 5  # of each file


def main(
    rows_files: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="ROWS.csv",
            help="Rows to compute; the shipped parameter study and slope threshold by default.",
            show_default=False,
        ),
    ] = None,
    folder: OutDirOption = None,
    scheme: SchemeOption = "thesis2008",
    maidanik: Annotated[
        bool, typer.Option("--maidanik", help="Compute Erad by eq. 3.13, not by the study's 3.12.")
    ] = False,
    quick: QuickOption = False,
    json_file: JsonOption = None,
) -> None:
    """Compute every row of the published tables again, beside the published values.

    Writes FILE-computed.csv for each FILE.csv. With --quick: the first 5 rows of each file.

    Example: python -m paper.tables --quick
    """
    check_json(json_file)
    files = rows_files or list(SHIPPED)
    stems = [path.stem for path in files]
    if twice := [stem for stem in stems if stems.count(stem) > 1]:
        fail(f"ROWS.csv = {twice[0]}.csv: named twice. Give files of different names", 2)
    read = {}
    for path in files:
        try:
            read[path] = read_rows(path)
        except RowError as error:
            fail(str(error), 2)
    data, computed, names = [], [], []
    with results_in(folder, "tables", scheme) as made:
        for path, (header, rows) in read.items():
            rows = rows[:_QUICK_ROWS] if quick else rows
            by = WITH_MAIDANIK if maidanik else FIGURES
            try:
                with progress(path.name, len(rows)) as advance:
                    new_header, new_rows, endless = compute_table(header, rows, scheme, advance, by)
            except RowError as error:
                fail(f"{path}: {error}", 2)
            names.append(f"{path.stem}-computed.csv")
            write_table(made / names[-1], new_header, new_rows)
            found, close = agreement(new_rows), shares(new_rows)
            _print(path, scheme, new_rows, endless)
            computed += new_rows
            data.append({
                "file": str(path), "rows": len(new_rows), "endless": endless, "shares": close,
                "agreement": [asdict(one) for one in found],
            })  # fmt: skip
        every = agreement(computed)
        sizes = [(f"{one.column} ({UNITS.get(one.column, 'dB')})", one.median) for one in every]
        if sizes:
            names.append("tables.png")
            bars(made / "tables.png", f"{scheme} against the published rows",
                 "median difference, in the unit of the label", sizes)  # fmt: skip
    written(made, *names)
    conclude(_conclusion(scheme, every, len(computed)))
    write_json(json_file, {"scheme": scheme, "tables": data})


def _print(path: Path, scheme: str, rows: list[dict[str, str]], endless: int) -> None:
    """The agreement of one file's computed rows with the published ones."""
    cells = []
    for a in agreement(rows):
        unit = UNITS.get(a.column, "dB")
        cells.append((
            a.column, str(a.rows), f"{a.median:.3f} {unit}", f"{a.worst:.3f} {unit}",
            str(a.worst_row),
        ))  # fmt: skip
    if cells:
        headings = ("figure", "rows", "median off by", "worst", "in row")
        title = f"{scheme} against the published rows of {path.name}"
        out.print(number_table(title, headings, cells, text=1))
    for what, value in shares(rows).items():
        out.print(f"{what}: {100.0 * value:.0f} % of the rows")
    if endless:
        out.print(f"{endless} of {len(rows)} contacts do not end; their cells are empty")


def _conclusion(scheme: str, found: list[Agreement], rows: int) -> str:
    """How close the computed rows come to the published ones, in one sentence."""
    in_db = [one for one in found if one.column not in UNITS]
    if not in_db:
        return f"{rows} rows are computed by {scheme}; none has a published level to compare with."
    worst = max(in_db, key=lambda one: one.median)
    return (
        f"Over {rows} rows, {scheme} differs from the published levels by a median of "
        f"{worst.median:.2f} dB or less, the largest being that of {worst.column}."
    )


if __name__ == "__main__":
    start("paper.tables")
